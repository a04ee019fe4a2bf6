//! Every program says of which build it is, and all of one build say the same; packages have every program.

use std::fs;
use std::process::Command;

use rcc_tests::{program, repository};

/// The programs that packages have.
fn programs() -> Vec<String> {
    let list = fs::read_to_string(repository().join("packaging/programs")).expect("the list");
    list.lines().map(str::to_owned).collect()
}

#[test]
fn every_program_prints_version_commit_catalogue_and_layout() {
    let expected = rcc_protocol::version::version();
    let catalogue = format!("catalogue {:016x}", rcc_core::primitives::fingerprint());
    for part in [env!("CARGO_PKG_VERSION"), "commit ", &catalogue, "layout "] {
        assert!(expected.contains(part), "{part}: {expected}");
    }
    let programs = programs();
    assert!(programs.len() >= 9, "{programs:?}");
    for name in programs {
        let output = Command::new(program(&name)).arg("--version").output();
        let output = output.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(output.status.code(), Some(0), "{name}");
        let printed = String::from_utf8_lossy(&output.stdout);
        assert_eq!(printed.trim_end(), format!("{name} {expected}"));
    }
}

#[test]
fn packages_have_every_program_that_is_built_for_users() {
    let mut built = Vec::new();
    let manifest = fs::read_to_string(repository().join("Cargo.toml")).expect("the workspace");
    let members = manifest
        .lines()
        .find(|line| line.starts_with("default-members"));
    for member in members
        .expect("default members")
        .split('"')
        .skip(1)
        .step_by(2)
    {
        let folder = repository().join(member);
        if folder.join("src/main.rs").is_file() {
            built.push(member.to_owned());
        }
        let programs = fs::read_dir(folder.join("src/bin")).into_iter().flatten();
        let stems = programs.map(|entry| entry.expect("an entry").path());
        built.extend(stems.map(|path| path.file_stem().expect("a name").display().to_string()));
    }
    built.sort_unstable();
    assert_eq!(built, programs(), "packaging/programs");
    let package = fs::read_to_string(repository().join("rcc-cli/Cargo.toml")).expect("the package");
    for name in built {
        let asset = format!("\"target/release/{name}\"");
        assert!(
            package.contains(&asset),
            "{asset} in [package.metadata.deb]"
        );
    }
}
