//! `.ci/programs` runs every example and benchmark of the workspace, and nothing in the workspace is built twice. Reads files,
//! and asks cargo; run by a thread of the harness.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use rcc_tests::repository;

/// Returns the folders below `folder` with this name, without what builds leave.
fn folders_named(folder: &Path, name: &str, found: &mut Vec<std::path::PathBuf>) {
    let entries = fs::read_dir(folder).expect("a folder");
    for path in entries.flatten().map(|entry| entry.path()) {
        let is = |other: &str| path.file_name().is_some_and(|own| own == other);
        if !path.is_dir() || is("target") || is(".git") || is("data") || is("corpus") {
            continue;
        }
        match is(name) && folder.join("Cargo.toml").exists() {
            true => found.push(path),
            false => folders_named(&path, name, found),
        }
    }
}

#[test]
fn every_example_and_benchmark_is_run_by_ci() {
    let script = fs::read_to_string(repository().join(".ci/programs")).expect("the script");
    let words: Vec<&str> = script
        .split(|letter: char| !letter.is_ascii_alphanumeric() && letter != '_' && letter != '-')
        .collect();
    let mut folders = Vec::new();
    for name in ["examples", "benches"] {
        folders_named(repository(), name, &mut folders);
    }
    assert!(folders.len() >= 7, "{folders:?}");
    let mut programs = 0;
    for folder in folders {
        for path in fs::read_dir(&folder)
            .expect("it")
            .flatten()
            .map(|entry| entry.path())
        {
            let is_program = path.extension().is_some_and(|ending| ending == "rs")
                || path.join("main.rs").exists();
            let name = path
                .file_stem()
                .expect("a name")
                .to_string_lossy()
                .into_owned();
            if is_program {
                programs += 1;
                let path = path.display();
                assert!(
                    words.contains(&name.as_str()),
                    "add {path} to .ci/programs, in a short form"
                );
            }
        }
    }
    assert!(programs >= 20, "{programs}");
}

/// Packages behind these edges of the workspace, with version and features.
fn packages(edges: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--workspace", "--offline", "--locked"])
        .args(["--prefix", "none", "--format", "{p} {f}", "--edges", edges])
        .current_dir(repository())
        .output()
        .expect("cargo");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    let lines = text.lines().map(|line| line.trim_end_matches(" (*)"));
    lines.map(|line| line.trim_end().to_owned()).collect()
}

#[test]
fn programs_and_tests_are_built_with_the_same_features() {
    let (programs, tests) = (packages("normal,build"), packages("normal,build,dev"));
    assert!(programs.len() > 100, "{programs:?}");
    let other: Vec<_> = programs.difference(&tests).collect();
    assert!(
        other.is_empty(),
        "tests need more features of {other:?}: `cargo build --workspace` and `cargo test --workspace` would both build these packages, \
         and all that need them; name the features in tests/Cargo.toml"
    );
}
