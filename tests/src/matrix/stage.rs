//! The cell in which the cases run: `rcc-cli up` with everything except the simulated robot, which outlives the cell.
//! Runs on the thread of the matrix.

use std::fs::File;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_config::CellConfig;
use rcc_ipc::clean;
use rcc_protocol::Role;

use super::scene::{Scene, StruckProcess};
use super::strike::Strike;
use super::{Case, Outcome, Phase, Target, Victim, Way};
use crate::cell_fixture::CellFixture;
use crate::census::Census;
use crate::endurance::{self, CORE};
use crate::journal::{Journal, Random};
use crate::lateness::LatenessMonitor;
use crate::processes::{command_line, ends_with_test, signal, with_runtime_dir};
use crate::simulator::{Simulator, assert_within_limits};
use crate::{TestCell, await_some, nets, program, repository};

/// Value of `$FRI_TO_INT[2]` if the controller stopped because answers were lost.
const LOST: i64 = 1;
/// Priority of the executor, below that of the endurance run, which may run at the same time. Of two executors with one
/// priority on a core, one would wait for the other without delaying the reference thread above them.
const PRIORITY: u8 = endurance::PRIORITY - 4;
/// Error code of a loader that has not found its executor yet.
const NO_EXECUTOR: &str = "RCC4001";
/// Error code of START while a device is not ready or not attached; if not attached, the message names the
/// configurations that differ.
const NOT_READY: &str = "RCC3008";
/// Number of sums in the big net.
const BIG: usize = 1500;

/// The cell with its simulated robot.
#[derive(Debug)]
pub struct Stage {
    cell: TestCell,
    robot: Child,
    arm: Simulator,
    journal: Arc<Journal>,
    /// Resource counts of the fresh cell, with the executor's process id.
    before: (u32, Census),
}

impl Stage {
    /// Starts a fresh cell and its simulated robot.
    ///
    /// # Panics
    /// Panics if the cell does not start.
    pub fn new() -> Stage {
        let demo = repository().join("configs/cells/demo.yaml");
        let place = CellFixture::new(&demo, configured);
        let robot = start_robot(&place);
        let arm = Simulator::connect(&robot_socket(&place));
        let cell = TestCell::in_fixture(place);
        let mut stage = Stage {
            cell,
            robot,
            arm,
            journal: Arc::default(),
            before: (0, Census::default()),
        };
        stage.assert_cell_works();
        stage.reset_baseline();
        stage
    }

    /// Ends the cell and asserts that nothing is left.
    pub fn end(mut self) {
        // The robot must run until the cell has ended.
        let Stage { cell, robot, .. } = &mut self;
        signal(cell.supervisor(), Signal::SIGINT);
        let status = cell.await_end_of_up();
        assert!(status.success(), "{status}\n{}", cell.logs());
        cell.assert_nothing_left();
        let _ = robot.kill();
        let _ = robot.wait();
    }

    /// Runs one case.
    ///
    /// # Panics
    /// Panics if one of the required conditions is violated.
    pub fn play(&mut self, case: Case, seed: u64) -> Outcome {
        let mut random = Random::new(seed, 0);
        let lateness_monitor = (!case.ends_cell() && !case.victim.touches(Target::Executor))
            .then(|| LatenessMonitor::start(&self.cell, CORE, PRIORITY, &self.journal));
        self.arm.reset_statistics();
        let mut scene = self.begin(case, &mut random);
        let strike = Strike::at(case, &scene);
        let mut words = if case.ends_cell() {
            self.await_end_of_cell(case, &mut scene)
        } else {
            self.await_end_of_motion(case, &mut scene)
        };
        scene.end_guests();
        let rest = self.arm.await_rest();
        assert_within_limits(&rest, &[LOST]);
        self.arm.reset_statistics();
        if case.phase == Phase::Reconfigured {
            words += &self.assert_refused_and_restore(case, &scene);
        }
        if !case.ends_cell() {
            self.await_successors(case, &scene);
        } else if self.cell.has_ended() {
            self.cell.up_again();
        }
        self.cell.await_devices();
        self.arm.assert_not_moved();
        self.assert_cell_works();
        // Ended before the resources are counted, because the lateness monitor is itself a monitor of the cell.
        let late = lateness_monitor.flatten().map_or(0, assert_on_time);
        self.assert_no_leak();
        if !strike.met_all() {
            words += " (it had ended already)";
        }
        Outcome::Held { words, late }
    }

    /// Brings the cell into the phase of the case and determines the target processes.
    fn begin(&mut self, case: Case, random: &mut Random) -> Scene {
        let Case { victim, phase, .. } = case;
        let mut scene = Scene::default();
        for target in victim.targets() {
            // A guest is started before the phase, unless it causes the phase or is itself the process that starts.
            if let Some(guest) = self.guest_of(target, phase) {
                scene.guests.push((Some(target), guest));
                if phase == Phase::Idle || target == Target::Monitor && phase != Phase::Starting {
                    std::thread::sleep(Duration::from_millis(150));
                }
            }
        }
        match phase {
            Phase::Starting => self.interrupt_start(victim, &mut scene, random),
            Phase::Idle => {}
            Phase::Loading => {
                if !victim.touches(Target::Client) {
                    scene.guests.push((None, self.load_big()));
                }
                std::thread::sleep(
                    Duration::from_millis(20) + random.time_below(Duration::from_millis(150)),
                );
            }
            Phase::Moving | Phase::Cancelling | Phase::Reconfigured | Phase::Stopping => {
                if victim.touches(Target::Client)
                    && matches!(phase, Phase::Moving | Phase::Reconfigured)
                {
                    self.arm.await_motion();
                    let row = self.cell.rest("GET", "/commands/line", "").body;
                    scene.line = row["id"].as_u64();
                } else {
                    let line = self.cell.run(&nets::line("line", 0.15, 0.25));
                    scene.line = Some(line);
                    self.arm.await_motion();
                }
                self.enter(case, &mut scene, random);
            }
        }
        if victim.touches(Target::Janitor) {
            scene.guests.push((Some(Target::Janitor), self.janitor()));
            std::thread::sleep(random.time_below(Duration::from_millis(15)));
        }
        if phase != Phase::Starting {
            self.remember(victim, &mut scene);
        }
        scene
    }

    /// Brings a moving cell into the phase of the case.
    fn enter(&mut self, case: Case, scene: &mut Scene, random: &mut Random) {
        let Some(line) = scene.line else { return };
        match case.phase {
            Phase::Cancelling if case.victim.touches(Target::Client) => {
                let cancel = self.client(&["cancel", "line", "--wait"]);
                scene.guests.push((Some(Target::Client), cancel));
                std::thread::sleep(random.time_below(Duration::from_millis(60)));
            }
            Phase::Cancelling => {
                self.cell.done(line, "cancel");
                std::thread::sleep(random.time_below(Duration::from_millis(100)));
            }
            Phase::Reconfigured => swap_outputs(&self.cell),
            Phase::Stopping => {
                signal(self.cell.supervisor(), Signal::SIGINT);
                std::thread::sleep(random.time_below(Duration::from_millis(400)));
            }
            _ => {}
        }
    }

    /// Starts the monitor or client that is the target. `None` for other targets, and for a client that sends the
    /// cancel: it is started when the arm moves.
    fn guest_of(&self, target: Target, phase: Phase) -> Option<Child> {
        match (target, phase) {
            (Target::Monitor, _) => Some(self.monitor()),
            (Target::Client, Phase::Starting | Phase::Moving | Phase::Reconfigured) => {
                let path = self.cell.file(&nets::line("line", 0.15, 0.25));
                Some(self.client(&["run", &path.display().to_string()]))
            }
            (Target::Client, Phase::Idle | Phase::Stopping) => Some(self.client(&["tail"])),
            (Target::Client, Phase::Loading) => Some(self.load_big()),
            _ => None,
        }
    }

    fn remember(&self, victim: Victim, scene: &mut Scene) {
        for target in victim.targets() {
            let struck = match target.announced_as() {
                Some((role, label)) => {
                    let announced = self.cell.announced(role, label);
                    StruckProcess {
                        target,
                        pid: announced.pid,
                        incarnation: announced.incarnation,
                    }
                }
                None => StruckProcess {
                    target,
                    pid: match target {
                        Target::Supervisor => self.cell.supervisor(),
                        _ => scene.guest(target).map_or(0, |guest| guest.id()),
                    },
                    incarnation: 0,
                },
            };
            scene.struck.push(struck);
        }
    }

    /// Makes the target start again, by the supervisor if it is supervised, and returns while it is starting.
    fn interrupt_start(&mut self, victim: Victim, scene: &mut Scene, random: &mut Random) {
        self.remember(victim, scene);
        for index in 0..scene.struck.len() {
            let StruckProcess { target, pid, .. } = scene.struck[index];
            match target {
                Target::Monitor | Target::Client | Target::Janitor => {}
                Target::Supervisor => {
                    signal(self.cell.supervisor(), Signal::SIGINT);
                    self.cell.await_end_of_up();
                    self.cell.begin_up_again();
                    scene.struck[index].pid = self.cell.supervisor();
                    std::thread::sleep(random.time_below(Duration::from_millis(300)));
                    return;
                }
                _ => {
                    let words = command_line(pid);
                    signal(pid, Signal::SIGKILL);
                    scene.struck[index].pid = await_some("the target to be started again", || {
                        let all = with_runtime_dir(self.cell.folder());
                        all.into_iter()
                            .find(|other| *other != pid && command_line(*other) == words)
                    });
                }
            }
        }
        std::thread::sleep(random.time_below(Duration::from_millis(40)));
    }

    /// Waits until the net of the case has ended, asserts that the case allows this end, and returns it in words.
    fn await_end_of_motion(&mut self, case: Case, scene: &mut Scene) -> String {
        let Case { victim, phase, way } = case;
        let client = victim.touches(Target::Client);
        if client && phase == Phase::Starting {
            // Its net may or may not have been started before the client died; both are allowed.
            scene.await_guests(way);
            self.clear(false);
            return "–".to_owned();
        }
        let Some(line) = scene.line else {
            return "–".to_owned();
        };
        if case.ends(Target::Executor) {
            return "at rest".to_owned();
        }
        let runs = client && matches!(phase, Phase::Moving | Phase::Reconfigured);
        if runs && matches!(way, Way::Stop | Way::Term) {
            return scene.end_of_client(way);
        }
        let row = self.cell.await_end(line);
        let reason = row["reason"].as_str().unwrap_or_default().to_owned();
        let planned = if phase == Phase::Cancelling {
            "canceled"
        } else {
            "finished"
        };
        let touched = victim.touches(Target::ArmDriver) || victim.touches(Target::Executor);
        let asked = client && way == Way::Term && reason == "canceled";
        // The client died before it sent the cancel.
        let unsent = client && phase == Phase::Cancelling && reason == "finished";
        assert!(
            reason == planned || touched || asked || unsent,
            "ended as {row} instead of {planned}"
        );
        match row["fault"]["fault"].as_str() {
            Some(fault) => fault.to_owned(),
            None => reason,
        }
    }

    /// Waits until the cell has ended, or until it is ready again if its supervisor was only stopped for a while.
    fn await_end_of_cell(&mut self, case: Case, scene: &mut Scene) -> String {
        let Case { victim, phase, way } = case;
        if phase == Phase::Starting && way == Way::Stop {
            self.cell.await_ready();
            return "goes on".to_owned();
        }
        let status = self.cell.await_end_of_up();
        // By design, a running monitor waits for the cell to start again, so it must be killed.
        scene.end_guests();
        if victim.touches(Target::Supervisor) && matches!(way, Way::Kill | Way::Segv) {
            self.cell.await_dead();
            return "at rest".to_owned();
        }
        self.cell.await_dead();
        self.cell.assert_nothing_left();
        let of_the_cell = |target: &Target| target.announced_as().is_some();
        let harmless = !victim.targets().iter().any(of_the_cell);
        assert!(
            status.success() || !harmless,
            "up: {status}\n{}",
            self.cell.logs()
        );
        "ended".to_owned()
    }

    /// Asserts that, while the file and the running cell differ, a net switches the output that it names or START is
    /// refused. Then restores the file and kills the processes that have read the changed one, so that they are
    /// restarted.
    fn assert_refused_and_restore(&mut self, case: Case, scene: &Scene) -> String {
        if case.ends_cell() {
            swap_outputs(&self.cell);
            return String::new();
        }
        self.await_successors(case, scene);
        let of_the_arm = [Target::ArmDriver, Target::Executor, Target::Loader];
        let reads_it = of_the_arm.iter().any(|target| case.ends(*target));
        let switched = self.switch_torch();
        assert!(
            !(reads_it && switched),
            "a net ran although its processes have different configurations of the device"
        );
        swap_outputs(&self.cell);
        for struck in &scene.struck {
            if let Some((role, label)) = struck.target.announced_as()
                && case.ends(struck.target)
            {
                let other = self.cell.kill(role, label);
                self.cell.await_successor(role, label, other);
            }
        }
        let words = if switched { ", switched" } else { ", refused" };
        words.to_owned()
    }

    /// Tries to switch the torch on. Returns whether the net could be started, and asserts that only the torch
    /// switches.
    fn switch_torch(&mut self) -> bool {
        let outputs = |arm: &mut Simulator| {
            let booleans = arm.state()["krl_from_pc"]["booleans"].clone();
            (booleans[0] == true, booleans[1] == true)
        };
        let text = nets::output("torch", "lwr", "torch");
        let loaded = await_some("an answer to LOAD", || {
            let reply = self.cell.try_rest("POST", "/commands", &text)?;
            (reply.code() != NO_EXECUTOR).then_some(reply)
        });
        let started = loaded.body["id"].as_u64().filter(|id| {
            let state = await_some("the torch's net to be loaded", || {
                let state = self.cell.try_rest("GET", &format!("/commands/{id}"), "")?;
                (state.body["state"] != "loading").then_some(state.body)
            });
            state["state"] == "ready" && self.is_started(*id)
        });
        match started {
            Some(id) => {
                await_some("the torch", || {
                    let (torch, gas) = outputs(&mut self.arm);
                    assert!(!gas, "the wrong output switches");
                    torch.then_some(())
                });
                self.cell.done(id, "cancel");
                self.cell.await_end(id);
            }
            None => assert_eq!(
                outputs(&mut self.arm),
                (false, false),
                "an output switched although START was refused"
            ),
        }
        self.clear(true);
        started.is_some()
    }

    /// True if the command starts; false if START is refused for a reason other than an arm that still moves.
    fn is_started(&self, id: u64) -> bool {
        await_some("an answer to START", || {
            let reply = self
                .cell
                .try_rest("POST", &format!("/commands/{id}/start"), "")?;
            let later = reply.code() == NOT_READY && !reply.error_text().contains("configuration");
            (reply.code() != NO_EXECUTOR && !later).then_some(reply.status == 200)
        })
    }

    /// Asserts that dead supervised processes have successors, and that stopped ones are still the same process.
    fn await_successors(&mut self, case: Case, scene: &Scene) {
        for struck in &scene.struck {
            let Some((role, label)) = struck.target.announced_as() else {
                continue;
            };
            if case.way == Way::Stop && case.phase != Phase::Starting {
                assert_eq!(
                    self.cell.announced(role, label).incarnation,
                    struck.incarnation,
                    "the stopped process did not continue"
                );
                continue;
            }
            self.cell.await_successor(role, label, struck.incarnation);
            if case.way != Way::Stop {
                // A process that was hit while starting may have announced itself before it died.
                await_some("another process", || {
                    let announced = self.cell.cell().announced(role, label).ok().flatten()?;
                    (announced.pid != struck.pid && announced.liveness().is_alive()).then_some(())
                });
            }
        }
    }

    /// Asserts that the cell works: a monitored motion is loaded, started and finishes; the arm is back at its start
    /// then.
    fn assert_cell_works(&mut self) {
        self.clear(true);
        self.arm.reset_statistics();
        let watch =
            "  watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: move.pose}}\n";
        let id = self.cell.run(&nets::motion("next", 0.0, 0.4, watch));
        self.cell.assert_ends(id, "finished");
        assert_within_limits(&self.arm.await_rest(), &[]);
        self.clear(true);
    }

    /// Runs a net with only a monitor for a moment, so that the executor publishes records.
    fn publish(&mut self) {
        let id = self.cell.run(&nets::clock("clock"));
        std::thread::sleep(Duration::from_millis(20));
        self.cell.done(id, "cancel");
        self.cell.await_end(id);
        self.clear(true);
    }

    /// Unloads all commands; active ones are aborted first if `abort` is set, otherwise awaited.
    fn clear(&mut self, abort: bool) {
        await_some("the commands to be gone", || {
            let reply = self.cell.try_rest("GET", "/commands", "")?;
            let rows = reply.body.as_array()?.clone();
            for row in &rows {
                let id = row["id"].as_u64()?;
                if abort {
                    self.cell
                        .try_rest("POST", &format!("/commands/{id}/abort"), "");
                }
                self.cell.try_rest("DELETE", &format!("/commands/{id}"), "");
            }
            rows.is_empty().then_some(())
        });
    }

    fn count(&self) -> (u32, Census) {
        let pid = self.cell.announced(Role::Executor, "exec").pid;
        (pid, Census::of(&self.cell, pid))
    }

    fn reset_baseline(&mut self) {
        self.clean();
        self.publish();
        self.clean();
        self.before = self.count();
    }

    fn clean(&self) {
        await_some("the janitor", || {
            clean::run_janitor(self.cell.cell(), clean::JANITOR_TIMEOUT).ok()
        });
    }

    fn assert_no_leak(&mut self) {
        let (executor, before) = self.before;
        let mut grown = Vec::new();
        for _ in 0..30 {
            // The janitor removes dead processes, the executor closes its connections to them with the next record that
            // it publishes, and only then can the janitor remove the files.
            self.clean();
            self.publish();
            self.clean();
            let (pid, now) = self.count();
            grown = now.growth(&before);
            // A new executor has other resource figures; only the number of the cell's files is comparable.
            grown.retain(|line| pid == executor || line.starts_with("cell:"));
            // The event log grows by design.
            grown.retain(|line| !line.contains("bytes"));
            if grown.is_empty() {
                self.before = (pid, if pid == executor { before } else { now });
                return;
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        let left = self.cell.cell().leftovers().unwrap_or_default();
        panic!("left behind: {grown:?}\n{left:?}");
    }

    fn monitor(&self) -> Child {
        let mut command = self.cell.program("rcc-monitor");
        command.args(["tail", "--output", "json"]);
        spawn(command)
    }

    fn client(&self, arguments: &[&str]) -> Child {
        let mut command = self.cell.program("rcc-cli");
        command.args(arguments);
        spawn(command)
    }

    fn load_big(&self) -> Child {
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

    fn janitor(&self) -> Child {
        let cell = self.cell.cell();
        let mut command = Command::new(program("rcc-janitor"));
        command
            .args(["--cell", cell.name(), "--runtime-dir"])
            .arg(cell.runtime_dir());
        spawn(command)
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        let _ = self.robot.kill();
        let _ = self.robot.wait();
    }
}

impl Default for Stage {
    fn default() -> Stage {
        Stage::new()
    }
}

/// Edits the demo's configuration: executor pinned, many restarts allowed, no simulated robot.
fn configured(text: String) -> String {
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
fn robot_socket(place: &CellFixture) -> PathBuf {
    place.folder().join("robot.sock")
}

/// Starts the simulated robot of the demo with the ports of the fixture.
fn start_robot(place: &CellFixture) -> Child {
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

/// Asserts that no late cycle is unexplained; returns the number of late cycles caused by the machine.
fn assert_on_time(lateness_monitor: LatenessMonitor) -> u64 {
    let lateness = lateness_monitor.finish();
    assert_eq!(
        lateness.unexplained, 0,
        "unexplained late cycles: {lateness:?}"
    );
    assert!(
        lateness.consecutive,
        "the cycle number decreased or the executor changed"
    );
    assert_eq!(lateness.dropped_records, 0, "records were dropped");
    lateness.late
}

/// Exchanges the outputs `torch` and `gas` of the arm in the configuration file; a second call restores it.
fn swap_outputs(place: &CellFixture) {
    let text = std::fs::read_to_string(place.config()).expect("the configuration can be read");
    let (torch, gas) = ("      torch: {", "      gas:   {");
    assert!(text.contains(torch) && text.contains(gas), "{text}");
    let text = text
        .replace(torch, "      #: {")
        .replace(gas, torch)
        .replace("      #: {", gas);
    std::fs::write(place.config(), text).expect("the configuration can be written");
}
