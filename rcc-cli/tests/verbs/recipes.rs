//! Every net of the page of recipes: it is valid, and does in virtual time what the page says. Needs no cell.

use std::fs;

use serde_json::Value;

use crate::program::{repository, run, run_to};

/// Returns the nets of the page with their names.
fn nets() -> Vec<(String, String)> {
    let page = fs::read_to_string(repository().join("docs/recipes.md")).expect("the page");
    let blocks = page.split("\n```yaml\n").skip(1);
    let nets = blocks.filter_map(|rest| {
        let text = rest.split("```").next()?;
        let name = text.strip_prefix("net: ")?.lines().next()?;
        Some((name.to_owned(), text.to_owned()))
    });
    nets.collect()
}

#[test]
fn every_recipe_does_what_the_page_says() {
    let folder = rcc_testing::folder();
    // Events of each net, and its end; the others run until they are canceled.
    let scripts: &[(&str, &[&str], &str)] = &[
        ("pick-and-place", &[], "finished"),
        ("sine", &[], "finished"),
        ("track", &["--input", "belt.out=0.1"], "finished"),
        ("heat", &["--cancel-at", "1s"], "canceled"),
        ("teleop", &["--cancel-at", "1s"], "canceled"),
    ];
    let nets = nets();
    assert_eq!(nets.len(), scripts.len(), "{nets:?}");
    for (name, text) in nets {
        let file = folder.path().join(format!("{name}.yaml"));
        fs::write(&file, text).expect("written");
        let file = file.to_str().expect("UTF-8");
        run_to(0, &["check", file]);
        let script = scripts.iter().find(|(known, ..)| *known == name);
        let (_, options, reason) = script.unwrap_or_else(|| panic!("no script for {name}"));
        let arguments = ["--output", "json", "simulate", file];
        let (_, out, errors) = run(&[&arguments[..], options].concat());
        let report: Value = serde_json::from_str(&out).expect("JSON");
        assert_eq!(report["reason"], *reason, "{name}: {out}{errors}");
    }
}

#[test]
fn a_constant_beyond_the_range_of_its_analog_output_is_refused() {
    let folder = rcc_testing::folder();
    let check = |speed: &str| {
        let file = folder.path().join("belt.yaml");
        let text = format!(
            "net: belt\nprimitives:\n  cancel: {{type: Cancel}}\n  end: {{type: Termination, inputs: {{done: cancel.requested}}}}\n  \
             speed: {{type: Constant, parameters: {{value: {speed}}}}}\n  belt: {{type: AnalogOutput, parameters: {{device: io, \
             channel: belt_speed}}, inputs: {{in: speed.out}}}}\n"
        );
        fs::write(&file, text).expect("written");
        run(&["check", file.to_str().expect("UTF-8")])
    };
    let (code, out, errors) = check("1.5 m/s");
    let text = errors + &out;
    assert_ne!(code, Some(0), "{text}");
    assert!(text.contains("RCC1302"), "{text}");
    assert!(
        text.contains("takes 0 m/s to 1 m/s, found 1.5 m/s"),
        "{text}"
    );
    let accepted = check("1 m/s");
    assert_eq!(accepted.0, Some(0), "{accepted:?}");
}
