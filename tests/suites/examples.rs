//! Every net in `configs/nets` is valid for the demo cell and runs there, through all processes.
//! Each test has a cell of its own.

use std::path::{Path, PathBuf};

use rcc_tests::simulator::assert_within_limits;
use rcc_tests::{TestCell, await_some, cell_fixture::files_below, repository};

fn example_nets() -> Vec<PathBuf> {
    let mut files = files_below(&repository().join("configs/nets"));
    files.sort();
    assert!(files.len() >= 3, "{files:?}");
    files
}

/// The demo, and the demo with an iiwa in place of the LWR.
const CELLS: [(&str, &str); 2] = [("demo.yaml", "lwr-sim"), ("iiwa-demo.yaml", "iiwa-sim")];

#[test]
fn every_example_net_is_valid_offline() {
    for (config, _) in CELLS {
        is_valid_offline(&repository().join("configs/cells").join(config));
    }
}

fn is_valid_offline(config: &Path) {
    let files = example_nets();
    let output = std::process::Command::new(rcc_tests::program("rcc-cli"))
        .arg("check")
        .args(&files)
        .arg("--config")
        .arg(config)
        .output()
        .expect("rcc-cli runs");
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn every_example_net_runs_in_a_cell() {
    assert_within_limits(&runs_in(CELLS[0]), &[]);
}

#[test]
fn every_example_net_runs_on_an_iiwa_with_only_the_device_changed() {
    let state = runs_in(CELLS[1]);
    assert_eq!(state["faults"], serde_json::json!([]), "{state}");
}

/// Runs all nets in a cell, one after the other; returns the state of the simulated arm at the end.
fn runs_in((config, simulator): (&str, &str)) -> serde_json::Value {
    let config = repository().join("configs/cells").join(config);
    let cell = TestCell::start(&config, |text| text);
    let mut arm = cell.simulator(simulator);
    for path in example_nets() {
        let text = std::fs::read_to_string(&path).expect("a net");
        let name = path.file_stem().expect("a name").display().to_string();
        // Each net starts where the previous one has ended.
        cell.await_devices();
        let id = cell.load(&text);
        cell.start_when_ready(id);
        let row = await_some(&format!("some cycles of {name}"), || {
            let row = cell.state(id);
            (row["cycles"].as_u64() > Some(200) || row["state"] == "terminated").then_some(row)
        });
        let moves = row["uses"]
            .as_array()
            .is_some_and(|uses| uses.iter().any(|used| used == "lwr"));
        let reason = if moves || row["state"] == "terminated" {
            "finished"
        } else if row["can_cancel"] == true {
            cell.done(id, "cancel");
            "canceled"
        } else {
            cell.done(id, "abort");
            "aborted"
        };
        cell.assert_ends(id, reason);
    }
    let state = arm.state();
    cell.stop();
    state
}
