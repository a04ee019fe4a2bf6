//! `.ci/programs` runs every example and benchmark of the workspace. Reads files only; run by a thread of the harness.

use std::fs;
use std::path::Path;

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
