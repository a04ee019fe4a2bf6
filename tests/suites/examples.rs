//! Every net in `configs/nets` is valid for the demo cell and runs there, through all processes.
//! Each test has a cell of its own.

use std::path::PathBuf;

use rcc_config::RobotConfig;
use rcc_tests::cell_fixture::{CellFixture, files_below};
use rcc_tests::simulator::{assert_within_limits, joints_of};
use rcc_tests::{TestCell, await_some, repository};
use serde_json::{Value, json};

fn example_nets() -> Vec<PathBuf> {
    let mut files = files_below(&repository().join("configs/nets"));
    files.sort();
    assert!(files.len() >= 3, "{files:?}");
    files
}

/// A cell in which the nets run as they are: only the arm's entry in the configuration differs.
struct ExampleCell {
    config: &'static str,
    simulator: &'static str,
    /// Replacements in the file.
    replaced: &'static [(&'static str, &'static str)],
}

const LWR: ExampleCell = ExampleCell {
    config: "demo.yaml",
    simulator: "lwr-sim",
    replaced: &[],
};
const IIWA: ExampleCell = ExampleCell {
    config: "iiwa-demo.yaml",
    simulator: "iiwa-sim",
    replaced: &[],
};
/// The arm of a Med in the iiwa's cell, with its own file of limits.
const MED: ExampleCell = ExampleCell {
    replaced: &[
        ("--arm=iiwa7", "--arm=med7"),
        ("iiwa7_turned.yaml", "med7_turned.yaml"),
    ],
    ..IIWA
};

impl ExampleCell {
    fn path(&self) -> PathBuf {
        repository().join("configs/cells").join(self.config)
    }

    fn change(&self, text: String) -> String {
        self.replaced.iter().fold(text, |text, (one, other)| {
            assert!(text.contains(one), "{one}");
            text.replace(one, other)
        })
    }

    /// Checks or simulates nets offline; returns the exit code and what is said.
    fn offline(&self, verb: &str, files: &[PathBuf]) -> (Option<i32>, String) {
        let fixture = CellFixture::new(&self.path(), |text| self.change(text));
        let output = std::process::Command::new(rcc_tests::program("rcc-cli"))
            .arg(verb)
            .args(files)
            .arg("--config")
            .arg(fixture.config())
            .output()
            .expect("rcc-cli runs");
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), words)
    }
}

#[test]
fn every_example_net_is_valid_offline() {
    for cell in [LWR, IIWA, MED] {
        let (code, words) = cell.offline("check", &example_nets());
        assert_eq!(code, Some(0), "{words}");
    }
}

#[test]
fn every_example_net_runs_in_a_cell() {
    assert_within_limits(&runs_in(&LWR), &[]);
}

#[test]
fn every_example_net_runs_on_an_iiwa_with_only_the_device_changed() {
    let state = runs_in(&IIWA);
    assert_eq!(state["faults"], json!([]), "{state}");
}

#[test]
fn every_example_net_runs_on_a_med_within_its_own_limits() {
    let state = runs_in(&MED);
    assert_eq!(state["faults"], json!([]), "{state}");
    let path = repository().join("configs/robots/med7_turned.yaml");
    let text = std::fs::read_to_string(&path).expect("the robot's file");
    let robot = RobotConfig::parse(&text, "med7_turned.yaml");
    let robot = robot.unwrap_or_else(|faults| panic!("{faults}"));
    let fastest = joints_of(&state["commanded_velocity_max"]);
    for (joint, (fastest, limits)) in fastest.iter().zip(&robot.joints).enumerate() {
        assert!(*fastest <= limits.velocity_rad_s, "A{}: {state}", joint + 1);
    }
}

#[test]
fn a_position_that_is_within_the_limits_of_an_iiwa_alone_is_refused_for_a_med() {
    let path = repository().join("configs/nets/point-to-point.yaml");
    let text = std::fs::read_to_string(path).expect("a net");
    let far = text.replace("deg(30)]", "deg(174.5)]");
    assert_ne!(far, text);
    let folder = rcc_testing::folder();
    let file = folder.path().join("far.yaml");
    std::fs::write(&file, far).expect("the folder is writable");
    let (code, words) = IIWA.offline("simulate", std::slice::from_ref(&file));
    assert_eq!(code, Some(0), "{words}");
    let (code, words) = MED.offline("simulate", &[file]);
    assert_eq!(code, Some(5), "{words}");
    let limit = "A7 would be at 174.500°";
    assert!(
        words.contains("RCC3014") && words.contains(limit),
        "{words}"
    );
}

/// Runs all nets in a cell, one after the other; returns the state of the simulated arm at the end.
fn runs_in(of: &ExampleCell) -> Value {
    let cell = TestCell::start(&of.path(), |text| of.change(text));
    let mut arm = cell.simulator(of.simulator);
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
