//! The configuration of the stage, and the programs that it starts beside its cell.
//! Runs on the thread of the matrix.

use std::fs::File;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use rcc_config::CellConfig;

use super::{PRIORITY, Stage};
use crate::cell_fixture::CellFixture;
use crate::endurance::CORE;
use crate::processes::ends_with_test;
use crate::{program, repository};

/// Number of sums in the big net.
const BIG: usize = 1500;

impl Stage {
    pub(super) fn monitor(&self) -> Child {
        let mut command = self.cell.program("rcc-monitor");
        command.args(["tail", "--output", "json"]);
        spawn(command)
    }

    pub(super) fn client(&self, arguments: &[&str]) -> Child {
        let mut command = self.cell.program("rcc-cli");
        command.args(arguments);
        spawn(command)
    }

    pub(super) fn load_big(&self) -> Child {
        let mut text = "net: big\nprimitives:\n  clock: {type: Time}\n".to_owned();
        let mut before = "clock.out".to_owned();
        for number in 0..BIG {
            text += &format!("  s{number}: {{type: Add, inputs: {{a: {before}, b: 1 s}}}}\n");
            before = format!("s{number}.out");
        }
        text += &format!(
            "  over: {{type: Less, inputs: {{a: {before}, b: 0 s}}}}\n  end: {{type: Termination, inputs: {{done: over.out}}}}\n"
        );
        let path = self.cell.file(&text);
        self.client(&["load", &path.display().to_string()])
    }

    pub(super) fn janitor(&self) -> Child {
        let cell = self.cell.cell();
        let mut command = Command::new(program("rcc-janitor"));
        command
            .args(["--cell", cell.name(), "--runtime-dir"])
            .arg(cell.runtime_dir());
        spawn(command)
    }
}

/// Edits the demo's configuration: executor pinned, many restarts allowed, no simulated robot.
pub(super) fn configured(text: String) -> String {
    let from = text.find("  lwr-sim:").expect("the simulator of the arm");
    let to = text
        .find("  io-sim:")
        .expect("the simulator of the station");
    let text = text[..from].to_owned() + &text[to..];
    // Plans of unloaded nets are kept while a recording may need them; 1 s is shorter than the wait for a leak to go.
    let patient =
        "period: 1 ms\nsupervision: {restarts: 20, within: 1 s}\nrecorder: {seconds: 1}\n";
    text.replace(
        "{priority: 80}",
        &format!("{{priority: {PRIORITY}, core: {CORE}}}"),
    )
    .replace("period: 1 ms\n", patient)
}

/// Returns the robot's control socket, outside of the cell's runtime folder because the robot outlives the cell.
pub(super) fn robot_socket(place: &CellFixture) -> PathBuf {
    place.folder().join("robot.sock")
}

/// Starts the simulated robot of the demo with the ports of the fixture.
pub(super) fn start_robot(place: &CellFixture) -> Child {
    let demo = repository().join("configs/cells/demo.yaml");
    let offline = CellConfig::load_offline(&demo).unwrap_or_else(|faults| panic!("{faults}"));
    let simulator = offline
        .simulators
        .iter()
        .find(|simulator| simulator.name == "lwr-sim");
    let arguments = &simulator.expect("lwr-sim").arguments;
    let arguments = arguments
        .iter()
        .map(|argument| match argument.split_once('=') {
            Some(("--driver", _)) => format!("--driver=127.0.0.1:{}", place.port("fri")),
            _ => argument.clone(),
        });
    let log = File::create(place.folder().join("lwr-sim.log")).expect("a log can be written");
    let mut command = Command::new(program("lwr-sim"));
    command
        .args(arguments)
        .arg("--control")
        .arg(robot_socket(place))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(log);
    ends_with_test(&mut command)
        .spawn()
        .expect("lwr-sim starts")
}

fn spawn(mut command: Command) -> Child {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
        .spawn()
        .unwrap_or_else(|error| panic!("{command:?}: {error}"))
}

/// Exchanges the outputs `torch` and `gas` of the arm in the configuration file; a second call restores it.
pub(super) fn swap_outputs(place: &CellFixture) {
    let text = std::fs::read_to_string(place.config()).expect("the configuration can be read");
    let (torch, gas) = ("      torch: {", "      gas:   {");
    assert!(text.contains(torch) && text.contains(gas), "{text}");
    let text = text
        .replace(torch, "      #: {")
        .replace(gas, torch)
        .replace("      #: {", gas);
    std::fs::write(place.config(), text).expect("the configuration can be written");
}
