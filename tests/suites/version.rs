//! Every program says of which build it is, and all of one build say the same.

use std::process::Command;

use rcc_tests::program;

const PROGRAMS: [&str; 9] = [
    "io-sim",
    "lwr-sim",
    "rcc-cli",
    "rcc-driver",
    "rcc-exec",
    "rcc-janitor",
    "rcc-loader",
    "rcc-monitor",
    "rcc-probe",
];

#[test]
fn every_program_prints_version_commit_catalogue_and_layout() {
    let expected = rcc_ipc::version::version();
    let catalogue = format!("catalogue {:016x}", rcc_core::primitives::fingerprint());
    for part in [env!("CARGO_PKG_VERSION"), "commit ", &catalogue, "layout "] {
        assert!(expected.contains(part), "{part}: {expected}");
    }
    for name in PROGRAMS {
        let output = Command::new(program(name)).arg("--version").output();
        let output = output.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(output.status.code(), Some(0), "{name}");
        let said = String::from_utf8_lossy(&output.stdout);
        assert_eq!(said.trim_end(), format!("{name} {expected}"));
    }
}
