//! `convert` as a user types it: converts a net of the predecessor into a file that `check` accepts. Needs no cell.

use std::path::{Path, PathBuf};
use std::process::Command;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_rcc-cli"))
        .args(arguments)
        .current_dir(repository())
        .env("RCC_CELL", "no-cell-of-convert")
        .env("RCC_CONFIGS", repository().join("configs"))
        .env_remove("RCC_OUTPUT")
        .output()
        .expect("it runs");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), text)
}

#[test]
fn a_net_of_the_predecessor_becomes_a_file_that_is_valid() {
    let net = "tests/data/directionet/flat/lwr_lin-02-lwr-lin.net";
    let folder = rcc_testing::folder();
    let file = folder.path().join("lin.yaml");
    let path = file.to_str().expect("UTF-8");
    let (converted, checked) = (run(&["convert", net, "-o", path]), run(&["check", path]));
    let written = std::fs::read_to_string(&file);
    assert_eq!(converted.0, Some(0), "{}", converted.1);
    assert!(written.is_ok_and(|text| text.contains("JointPositionCommand")));
    assert_eq!(checked.0, Some(0), "{}", checked.1);
}

#[test]
fn the_option_o_says_what_it_wrote() {
    let folder = rcc_testing::folder();
    for (verb, net, name) in [
        (
            "convert",
            "tests/data/directionet/flat/lwr_lin-02-lwr-lin.net",
            "a.yaml",
        ),
        ("graph", "configs/nets/blink.yaml", "b.svg"),
        ("plot", "configs/nets/line.yaml", "c.svg"),
    ] {
        let file = folder.path().join(name);
        let output = Command::new(env!("CARGO_BIN_EXE_rcc-cli"))
            .args([verb, net, "-o"])
            .arg(&file)
            .current_dir(repository())
            .env("RCC_CELL", "no-cell-of-convert")
            .env("RCC_CONFIGS", repository().join("configs"))
            .env_remove("RCC_OUTPUT")
            .output()
            .expect("it runs");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        let wrote = format!("wrote {}", file.display());
        assert!(said.starts_with(&wrote), "{verb}: {said}");
        assert!(file.is_file(), "{verb}");
    }
}

#[test]
fn parts_without_counterpart_are_refused_with_their_location() {
    let (code, text) = run(&["convert", "tests/nets/bad/RCC1601-no-counterpart.net"]);
    assert_eq!(code, Some(3), "{text}");
    assert!(
        text.contains("RCC1601") && text.contains("RCC1601-no-counterpart.net:"),
        "{text}"
    );
}
