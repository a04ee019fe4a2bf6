//! Dependencies between packages point down only (ARCHITECTURE.md, code map): checked with `cargo metadata` and the
//! sources of the real-time core. Run by the threads of the test harness.

mod files;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

use rcc_tests::cell_fixture::files_below;
use rcc_tests::repository;
use serde_json::Value;

/// Returns the dependencies of each package of the workspace, without dev-dependencies.
fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version=1", "--no-deps", "--offline"])
        .current_dir(repository())
        .output()
        .expect("cargo runs");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let of = |package: &Value| {
        let all = package["dependencies"].as_array().expect("dependencies");
        let usual = all.iter().filter(|dependency| dependency["kind"] != "dev");
        let names = usual.map(|dependency| dependency["name"].as_str().expect("a name").to_owned());
        names.collect()
    };
    let row = |package: &Value| {
        (
            package["name"].as_str().expect("a name").to_owned(),
            of(package),
        )
    };
    packages.iter().map(row).collect()
}

/// Packages of the workspace that each package may depend on.
const ARROWS: &[(&str, &[&str])] = &[
    ("rcc-core", &[]),
    ("rcc-motion", &["rcc-core"]),
    ("rcc-os", &[]),
    ("rcc-config", &["rcc-core", "rcc-os"]),
    ("rcc-protocol", &["rcc-core", "rcc-os"]),
    ("rcc-ipc", &["rcc-core", "rcc-os", "rcc-protocol"]),
    (
        "rcc-engine",
        &["rcc-core", "rcc-motion", "rcc-os", "rcc-protocol"],
    ),
    ("rcc-process", &["rcc-core", "rcc-config", "rcc-os"]),
    (
        "rcc-language",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-motion",
            "rcc-config",
            "rcc-protocol",
        ],
    ),
    (
        "rcc-api",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-config",
            "rcc-protocol",
            // Heads of incident files.
            "rcc-engine",
            "rcc-language",
            "rcc-directionet",
        ],
    ),
    (
        "rcc-directionet",
        &["rcc-core", "rcc-config", "rcc-language"],
    ),
    ("rcc-client", &["rcc-api"]),
    ("rcc-graph", &["rcc-language"]),
    ("rcc-robot", &["rcc-core"]),
    ("rcc-terminal", &["rcc-core"]),
    ("rcc-trajectory", &["rcc-core", "rcc-config", "rcc-motion"]),
    ("rcc-net", &["rcc-core", "rcc-config", "rcc-language"]),
    // Used by tests and benchmarks only.
    ("rcc-testing", &["rcc-core"]),
    (
        "rcc-loader",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-config",
            "rcc-protocol",
            "rcc-ipc",
            "rcc-process",
            "rcc-language",
            "rcc-api",
        ],
    ),
    (
        "rcc-exec",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-config",
            "rcc-protocol",
            "rcc-ipc",
            "rcc-engine",
            "rcc-process",
        ],
    ),
    (
        // For drivers in repositories of their own.
        "rcc-driver-kit",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-motion",
            "rcc-config",
            "rcc-protocol",
            "rcc-ipc",
            "rcc-process",
        ],
    ),
    // Drivers in C, and the template in Rust: they use the kit alone.
    ("rcc-driver-c", &["rcc-driver-kit"]),
    ("line-drivers", &["rcc-driver-kit"]),
    (
        "rcc-drivers",
        &[
            "rcc-driver-kit",
            "rcc-core",
            "rcc-os",
            "rcc-motion",
            "rcc-config",
            "rcc-protocol",
            "rcc-ipc",
            "rcc-process",
        ],
    ),
    (
        // `rcc-drivers`: the simulators' control port.
        "rcc-ethercat",
        &[
            "rcc-protocol",
            "rcc-process",
            "rcc-driver-kit",
            "rcc-drivers",
        ],
    ),
    // Message types and files of recordings, for the monitor, for `replay` and for gateways.
    ("rcc-recording", &["rcc-core"]),
    // For programs that watch a cell: the monitor and gateways.
    (
        "rcc-reading",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-config",
            "rcc-protocol",
            "rcc-ipc",
            "rcc-recording",
        ],
    ),
    (
        "rcc-monitor",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-config",
            "rcc-protocol",
            "rcc-ipc",
            "rcc-reading",
            "rcc-recording",
            "rcc-process",
            // The dashboard: draws nets, replays incidents, and speaks with the loader.
            "rcc-api",
            "rcc-engine",
            "rcc-language",
            "rcc-directionet",
            "rcc-graph",
        ],
    ),
    (
        "rcc-cli",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-motion",
            "rcc-config",
            "rcc-protocol",
            "rcc-ipc",
            "rcc-process",
            "rcc-language",
            "rcc-directionet",
            "rcc-graph",
            "rcc-robot",
            "rcc-terminal",
            "rcc-trajectory",
            "rcc-api",
            "rcc-recording",
            "rcc-client",
            // `replay` and `simulate` run the same cycle in virtual time.
            "rcc-engine",
        ],
    ),
    (
        // Reads what monitors read, and is a client of the loader.
        "rcc-foxglove",
        &[
            "rcc-os",
            "rcc-protocol",
            "rcc-process",
            "rcc-api",
            "rcc-client",
            "rcc-reading",
            "rcc-recording",
        ],
    ),
    (
        // A client of the loader, and a driver.
        "rcc-link",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-config",
            "rcc-protocol",
            "rcc-process",
            "rcc-language",
            "rcc-api",
            "rcc-client",
            "rcc-terminal",
            "rcc-driver-kit",
        ],
    ),
    (
        // Reads what monitors read, and is a client of the loader.
        "rcc-ros2",
        &[
            "rcc-core",
            "rcc-os",
            "rcc-config",
            "rcc-protocol",
            "rcc-process",
            "rcc-api",
            "rcc-client",
            "rcc-reading",
            "rcc-recording",
            "rcc-trajectory",
        ],
    ),
    (
        // A client of the loader.
        "rcc-robotics-api",
        &[
            "rcc-core",
            "rcc-config",
            "rcc-protocol",
            "rcc-ipc",
            "rcc-process",
            "rcc-language",
            "rcc-directionet",
            "rcc-api",
            "rcc-client",
        ],
    ),
];

#[test]
fn dependencies_between_packages_point_down_only() {
    let all = dependencies();
    for (package, dependencies) in &all {
        // These packages test and measure all the others.
        if ["rcc-tests", "rcc-fuzz", "rcc-bench"].contains(&package.as_str()) {
            continue;
        }
        let row = ARROWS.iter().find(|(name, _)| name == package);
        let (_, allowed) = row.unwrap_or_else(|| panic!("{package} is not in the table of arrows"));
        for dependency in dependencies.iter().filter(|name| all.contains_key(*name)) {
            assert!(
                allowed.contains(&dependency.as_str()),
                "{package} must not use {dependency}"
            );
        }
    }
}

#[test]
fn only_rcc_ipc_names_iceoryx2() {
    let direct = dependencies();
    let users: Vec<&String> = direct
        .iter()
        .filter(|(_, names)| names.iter().any(|name| name.starts_with("iceoryx2")))
        .map(|(package, _)| package)
        .collect();
    assert_eq!(users, ["rcc-ipc"]);
}

/// Returns the part of a source file before its tests: up to the first `#[cfg(test)]`.
fn without_tests(path: &Path) -> String {
    let text = fs::read_to_string(path).expect("a source file");
    text.split("#[cfg(test)]")
        .next()
        .unwrap_or_default()
        .to_owned()
}

#[test]
fn the_real_time_core_has_no_std_no_heap_and_no_unsafe() {
    let source = repository().join("rcc-core/src");
    let root = fs::read_to_string(source.join("lib.rs")).expect("the crate's root");
    assert!(
        root.contains("#![no_std]") || root.contains("#![cfg_attr(not(test), no_std)]"),
        "rcc-core is no_std"
    );
    assert!(
        root.contains("forbid(unsafe_code)"),
        "rcc-core forbids unsafe code"
    );
    let test_only = |path: &Path| {
        // Files of modules that are declared under `#[cfg(test)]`.
        ["tests.rs", "testing.rs", "scalar_properties.rs"]
            .iter()
            .any(|name| path.ends_with(name))
    };
    for path in files_below(&source).iter().filter(|path| !test_only(path)) {
        let text = without_tests(path);
        for word in ["std::", "alloc::", "extern crate"] {
            let used = text.lines().find(|line| {
                let code = line.split("//").next().unwrap_or_default();
                code.contains(word) && !code.contains("no_std")
            });
            assert_eq!(used, None, "{} uses `{word}`", path.display());
        }
    }
}

#[test]
fn unsafe_code_occurs_only_where_it_is_allowed() {
    for package in [
        "rcc-core",
        "rcc-exec",
        "rcc-loader",
        "rcc-drivers",
        "rcc-monitor",
        "rcc-cli",
        "gateways",
    ] {
        for path in files_below(&repository().join(package)) {
            let relative = path
                .strip_prefix(repository())
                .expect("below the repository");
            let relative = relative.display().to_string();
            let ours = relative.ends_with(".rs")
                && relative.contains("/src/")
                && !relative.contains("/tests");
            let may = relative.starts_with("rcc-core/ipc/")
                || relative.starts_with("rcc-drivers/c/src/ffi")
                || relative == "rcc-core/os/src/memory.rs"
                || relative == "rcc-core/os/src/wide.rs";
            if !ours || may {
                continue;
            }
            let text = without_tests(&path);
            let used = text.lines().find(|line| {
                let code = line.split("//").next().unwrap_or_default();
                code.contains("unsafe {")
                    || code.contains("unsafe fn")
                    || code.contains("unsafe impl")
            });
            assert_eq!(used, None, "{relative}");
        }
    }
}
