//! What the README shows is run: every command of its console blocks, and its nets.
//! Each test has a cell of its own.

use std::process::Command;

use rcc_tests::{TestCell, program, repository};

/// The text between ` ```kind ` and the next fence, for every such block.
fn blocks(kind: &str) -> Vec<String> {
    let text = std::fs::read_to_string(repository().join("README.md")).expect("a README");
    let fence = format!("```{kind}\n");
    let parts = text.split(&fence).skip(1);
    parts
        .map(|part| part.split("```").next().unwrap_or_default().to_owned())
        .collect()
}

/// The commands of all console blocks.
fn commands() -> Vec<String> {
    let blocks = blocks("console").join("\n");
    let lines = blocks.lines().filter_map(|line| line.strip_prefix("$ "));
    lines.map(str::to_owned).collect()
}

#[test]
fn the_demo_runs_and_verifies_everything() {
    let output = Command::new(program("rcc-cli"))
        .arg("demo")
        .current_dir(repository())
        .output()
        .expect("it runs");
    let (out, err) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert_eq!(output.status.code(), Some(0), "{out}\n{err}");
}

#[test]
fn every_rcc_cli_command_of_the_readme_runs() {
    let cell = TestCell::demo();
    let mut run = 0;
    for command in commands() {
        let words: Vec<&str> = command
            .split('#')
            .next()
            .unwrap_or_default()
            .split_whitespace()
            .collect();
        let Some((name, arguments)) = words
            .split_first()
            .filter(|(name, _)| name.ends_with("rcc-cli"))
        else {
            continue;
        };
        // The demo has a test of its own; `up` runs already, under the harness.
        if matches!(arguments.first(), Some(&("demo" | "up")) | None) {
            continue;
        }
        run += 1;
        // A person types more slowly than an arm comes to rest.
        if matches!(arguments.first(), Some(&("run" | "load" | "start"))) {
            cell.await_devices();
        }
        let mut line = cell.program("rcc-cli");
        let output = line
            .args(arguments)
            .current_dir(repository())
            .output()
            .expect("it runs");
        let (out, err) = (
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr),
        );
        assert_eq!(
            output.status.code(),
            Some(0),
            "{name} {arguments:?}: {out}\n{err}"
        );
    }
    eprintln!("{run} commands");
    cell.stop();
}

#[test]
fn every_net_of_the_readme_is_valid() {
    let config = repository().join("configs/cells/demo.yaml");
    for text in blocks("yaml")
        .iter()
        .filter(|text| text.contains("primitives:"))
    {
        let config = rcc_config::CellConfig::load_offline(&config)
            .unwrap_or_else(|faults| panic!("{faults}"));
        rcc_language::compile(text, "README.md", &config)
            .unwrap_or_else(|faults| panic!("{faults}"));
    }
}
