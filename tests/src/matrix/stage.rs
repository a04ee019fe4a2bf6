//! The cell in which cases are played: `rcc-cli up` with everything but the simulated robot, which outlives it.
//! Run by the thread of the matrix.

use std::fs::File;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_config::CellConfig;
use rcc_ipc::{Role, clean};

use super::{Case, Outcome, Phase, Target, Way};
use crate::census::Census;
use crate::endurance::{self, CORE};
use crate::journal::{Journal, Random};
use crate::lateness::Judge;
use crate::place::Place;
use crate::processes::{command_line, ends_with_test, of_folder, signal};
use crate::simulator::{Simulator, assert_within_limits, joints_of};
use crate::{TestCell, await_some, nets, program, repository};

/// `$FRI_TO_INT[2]` when the controller stopped because answers were lost.
const LOST: i64 = 1;
/// A resting joint is slower than this, rad/s: the simulated arm counts as resting within 0.1 mrad of its set-point, and
/// creeps up to it at a bandwidth of 80 rad/s.
const STILL: f64 = 4e-3;
/// How long a stopped process stands still: longer than any deadline of a driver, shorter than a watchdog's.
const STOPPED: Duration = Duration::from_millis(300);
/// Below that of the endurance run, which may go on beside it: of two executors of one priority on a core one waits for the
/// other, and the reference thread above them does not see it.
const PRIORITY: u8 = endurance::PRIORITY - 4;
/// Primitives of the big net.
const BIG: usize = 1500;

/// The cell.
#[derive(Debug)]
pub struct Stage {
    cell: TestCell,
    robot: Child,
    arm: Simulator,
    journal: Arc<Journal>,
    /// Counted when the cell was fresh, with the executor's process id.
    before: (u32, Census),
}

/// Who is there in a case.
#[derive(Default)]
struct Scene {
    line: Option<u64>,
    /// Processes of this case beside the cell's own; the first is the target if it is a client or a monitor.
    guests: Vec<Child>,
    /// The target's life before.
    pid: u32,
    incarnation: u64,
}

impl Stage {
    /// A fresh cell.
    ///
    /// # Panics
    /// It does not start.
    pub fn new() -> Stage {
        let demo = repository().join("configs/cells/demo.yaml");
        let place = Place::new(&demo, configured);
        let robot = start_robot(&place);
        let arm = place.simulator("fri_control");
        let cell = TestCell::in_place(place);
        let mut stage = Stage {
            cell,
            robot,
            arm,
            journal: Arc::default(),
            before: (0, Census::default()),
        };
        stage.move_a_little();
        stage.count_anew();
        stage
    }

    /// Ends it; nothing may be left.
    pub fn end(mut self) {
        // The robot must not be killed before the cell has ended.
        let Stage { cell, robot, .. } = &mut self;
        signal(cell.supervisor(), Signal::SIGINT);
        let status = cell.await_end_of_up();
        assert!(status.success(), "{status}\n{}", cell.logs());
        cell.assert_nothing_left();
        let _ = robot.kill();
        let _ = robot.wait();
    }

    /// Plays one case.
    ///
    /// # Panics
    /// Something does not hold.
    pub fn play(&mut self, case: Case, seed: u64) -> Outcome {
        let mut random = Random::new(seed, 0);
        let Case { target, phase, way } = case;
        let ends_all = phase == Phase::Stopping
            || target == Target::Supervisor && (phase == Phase::Starting || way != Way::Stop);
        let judge = (!ends_all && target != Target::Executor)
            .then(|| Judge::start(&self.cell, CORE, PRIORITY, &self.journal));
        self.arm.reset_statistics();
        let mut scene = self.begin(case, &mut random);
        let struck = strike(scene.pid, way);
        let mut words = if ends_all {
            self.await_end_of_cell(case, &mut scene)
        } else {
            self.await_end_of_motion(case, &mut scene)
        };
        for guest in &mut scene.guests {
            end_guest(guest);
        }
        let rest = self.arm.await_rest();
        assert_within_limits(&rest, &[LOST]);
        self.arm.reset_statistics();
        if ends_all {
            if self.cell.is_over() {
                self.cell.up_again();
            }
        } else {
            self.await_successor(case, &scene);
        }
        self.cell.await_devices();
        let still = self.arm.state();
        let fastest = joints_of(&still["velocity_max"]);
        assert!(
            fastest.iter().all(|velocity| *velocity <= STILL),
            "moved although nobody asked for it: {still}"
        );
        self.move_a_little();
        // Before anything is counted: the judge is a monitor itself.
        let late = judge.flatten().map_or(0, assert_on_time);
        self.assert_no_leak();
        if !struck {
            words += " (it had ended already)";
        }
        Outcome::Held { words, late }
    }

    /// Brings the cell into the phase and finds the target.
    fn begin(&mut self, case: Case, random: &mut Random) -> Scene {
        let Case { target, phase, .. } = case;
        let mut scene = Scene::default();
        if let Some(guest) = self.guest_of(case) {
            // A guest is there before the phase, except where it makes it or is starting itself.
            scene.guests.push(guest);
            if phase == Phase::Idle || target == Target::Monitor && phase != Phase::Starting {
                std::thread::sleep(Duration::from_millis(150));
            }
        }
        self.remember(target, &mut scene);
        match phase {
            Phase::Starting => self.start_anew(target, &mut scene, random),
            Phase::Idle => {}
            Phase::Loading => {
                if target != Target::Client {
                    scene.guests.push(self.load_big());
                }
                std::thread::sleep(
                    Duration::from_millis(20) + random.time_below(Duration::from_millis(150)),
                );
            }
            Phase::Moving | Phase::Cancelling | Phase::Stopping => {
                if target == Target::Client && phase == Phase::Moving {
                    self.arm.await_motion();
                    let row = self.cell.rest("GET", "/commands/line", "").body;
                    scene.line = row["id"].as_u64();
                } else {
                    let line = self.cell.run(&nets::line("line", 0.15, 0.25));
                    scene.line = Some(line);
                    self.arm.await_motion();
                    self.enter(case, line, &mut scene, random);
                }
            }
        }
        if target == Target::Janitor {
            scene.guests.insert(0, self.janitor());
            scene.pid = scene.guests[0].id();
            std::thread::sleep(random.time_below(Duration::from_millis(15)));
        }
        scene
    }

    /// From moving on to cancelling or stopping.
    fn enter(&mut self, case: Case, line: u64, scene: &mut Scene, random: &mut Random) {
        match case.phase {
            Phase::Cancelling if case.target == Target::Client => {
                let cancel = self.client(&["cancel", "line", "--wait"]);
                scene.pid = cancel.id();
                scene.guests.push(cancel);
                std::thread::sleep(random.time_below(Duration::from_millis(60)));
            }
            Phase::Cancelling => {
                self.cell.done(line, "cancel");
                std::thread::sleep(random.time_below(Duration::from_millis(100)));
            }
            Phase::Stopping => {
                signal(self.cell.supervisor(), Signal::SIGINT);
                std::thread::sleep(random.time_below(Duration::from_millis(400)));
            }
            _ => {}
        }
    }

    /// The monitor or client of a case, if it is one.
    fn guest_of(&self, case: Case) -> Option<Child> {
        match (case.target, case.phase) {
            (Target::Monitor, _) => Some(self.monitor()),
            (Target::Client, Phase::Starting | Phase::Moving) => {
                let path = self.cell.file(&nets::line("line", 0.15, 0.25));
                Some(self.client(&["run", &path.display().to_string()]))
            }
            (Target::Client, Phase::Idle | Phase::Stopping) => Some(self.client(&["tail"])),
            (Target::Client, Phase::Loading) => Some(self.load_big()),
            _ => None,
        }
    }

    fn remember(&self, target: Target, scene: &mut Scene) {
        let announced = match target {
            Target::ArmDriver => self.cell.announced(Role::Driver, "lwr"),
            Target::IoDriver => self.cell.announced(Role::Driver, "io"),
            Target::Loader => self.cell.announced(Role::Loader, "loader"),
            Target::Executor => self.cell.announced(Role::Executor, "exec"),
            Target::Supervisor => {
                scene.pid = self.cell.supervisor();
                return;
            }
            Target::Monitor | Target::Client | Target::Janitor => {
                scene.pid = scene.guests.first().map_or(0, Child::id);
                return;
            }
        };
        (scene.pid, scene.incarnation) = (announced.pid, announced.incarnation);
    }

    /// Lets the supervisor start the target, or starts it, and returns while it is starting.
    fn start_anew(&mut self, target: Target, scene: &mut Scene, random: &mut Random) {
        match target {
            Target::Monitor | Target::Client | Target::Janitor => {}
            Target::Supervisor => {
                signal(self.cell.supervisor(), Signal::SIGINT);
                self.cell.await_end_of_up();
                self.cell.begin_up_again();
                scene.pid = self.cell.supervisor();
                std::thread::sleep(random.time_below(Duration::from_millis(300)));
                return;
            }
            _ => {
                let words = command_line(scene.pid);
                signal(scene.pid, Signal::SIGKILL);
                scene.pid = await_some("the target to be started again", || {
                    let all = of_folder(self.cell.folder());
                    all.into_iter()
                        .find(|pid| *pid != scene.pid && command_line(*pid) == words)
                });
            }
        }
        std::thread::sleep(random.time_below(Duration::from_millis(40)));
    }

    /// Waits until the net of the case has ended, which must be as the case allows; says how.
    fn await_end_of_motion(&mut self, case: Case, scene: &mut Scene) -> String {
        let Case { target, phase, way } = case;
        if target == Target::Client && phase == Phase::Starting {
            // Whether its net was started before it died is a matter of luck; if so, it ends in its own way.
            for guest in &mut scene.guests {
                await_guest(guest, way);
            }
            self.clear(false);
            return "–".to_owned();
        }
        let Some(line) = scene.line else {
            return "–".to_owned();
        };
        if target == Target::Executor && way != Way::Stop {
            return "at rest".to_owned();
        }
        if target == Target::Client
            && phase == Phase::Moving
            && matches!(way, Way::Stop | Way::Term)
        {
            // It unloads its net itself, and tells by its exit code how it ended.
            let status = await_some("the client to end", || {
                scene.guests[0].try_wait().expect("the child is ours")
            });
            return match status.code() {
                Some(0) => "finished".to_owned(),
                Some(130 | 143) | None if way == Way::Term => "canceled".to_owned(),
                _ => panic!("rcc-cli run: {status}"),
            };
        }
        let row = self.cell.await_end(line);
        let reason = row["reason"].as_str().unwrap_or_default().to_owned();
        let planned = if phase == Phase::Cancelling {
            "canceled"
        } else {
            "finished"
        };
        let touched = matches!(target, Target::ArmDriver | Target::Executor);
        let asked = target == Target::Client && way == Way::Term && reason == "canceled";
        // A cancel that its client did not live to send.
        let unsent = target == Target::Client && phase == Phase::Cancelling && reason == "finished";
        assert!(
            reason == planned || touched || asked || unsent,
            "ended as {row} instead of {planned}"
        );
        match row["fault"]["fault"].as_str() {
            Some(fault) => fault.to_owned(),
            None => reason,
        }
    }

    /// Waits until the cell has ended, or goes on if its supervisor was only stopped for a while.
    fn await_end_of_cell(&mut self, case: Case, scene: &mut Scene) -> String {
        let Case { target, phase, way } = case;
        if phase == Phase::Starting && way == Way::Stop {
            self.cell.await_ready();
            return "goes on".to_owned();
        }
        let status = self.cell.await_end_of_up();
        // A monitor that lives waits for the cell's next life, by design.
        for guest in &mut scene.guests {
            end_guest(guest);
        }
        if target == Target::Supervisor && matches!(way, Way::Kill | Way::Segv) {
            self.cell.await_dead();
            return "at rest".to_owned();
        }
        self.cell.await_dead();
        self.cell.assert_nothing_left();
        let harmless = !matches!(
            target,
            Target::Executor | Target::ArmDriver | Target::IoDriver | Target::Loader
        );
        assert!(
            status.success() || !harmless,
            "up: {status}\n{}",
            self.cell.logs()
        );
        "ended".to_owned()
    }

    /// Who died under supervision is there again; who was only stopped is still the same one.
    fn await_successor(&mut self, case: Case, scene: &Scene) {
        let (role, label) = match case.target {
            Target::ArmDriver => (Role::Driver, "lwr"),
            Target::IoDriver => (Role::Driver, "io"),
            Target::Loader => (Role::Loader, "loader"),
            Target::Executor => (Role::Executor, "exec"),
            _ => return,
        };
        if case.way == Way::Stop && case.phase != Phase::Starting {
            assert_eq!(
                self.cell.announced(role, label).incarnation,
                scene.incarnation,
                "it did not go on"
            );
            return;
        }
        self.cell.await_successor(role, label, scene.incarnation);
        if case.way != Way::Stop {
            // Struck while it started, it may still have announced itself before it died.
            await_some("another process", || {
                let announced = self.cell.cell().announced(role, label).ok().flatten()?;
                (announced.pid != scene.pid && announced.liveness().is_alive()).then_some(())
            });
        }
    }

    /// Everything is reachable: a net is loaded, started, monitored, and finishes; the arm is where it began then.
    fn move_a_little(&mut self) {
        self.clear(true);
        self.arm.reset_statistics();
        let watch =
            "  watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: move.pose}}\n";
        let id = self.cell.run(&nets::motion("next", 0.0, 0.4, watch));
        self.cell.assert_ends(id, "finished");
        assert_within_limits(&self.arm.await_rest(), &[]);
        self.clear(true);
    }

    /// A net that only has a monitor runs for a moment.
    fn publish(&mut self) {
        let id = self.cell.run(&nets::clock("clock"));
        std::thread::sleep(Duration::from_millis(20));
        self.cell.done(id, "cancel");
        self.cell.await_end(id);
        self.clear(true);
    }

    /// Removes all commands; those that are active are aborted, or waited for.
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

    fn count_anew(&mut self) {
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
            // What is dead is struck out; the executor lets go of it with the next record that it publishes; then its
            // files can go.
            self.clean();
            self.publish();
            self.clean();
            let (pid, now) = self.count();
            grown = now.growth(&before);
            // Another executor has its own figures; how many files there are does not depend on who it is.
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

/// The demo's configuration: pinned, patient with deaths, and without the simulated robot.
fn configured(text: String) -> String {
    let from = text.find("  lwr-sim:").expect("the simulator of the arm");
    let to = text
        .find("  io-sim:")
        .expect("the simulator of the station");
    let text = text[..from].to_owned() + &text[to..];
    // Plans of nets that are gone are kept as long as a recording may need them: shorter than a leak is waited for.
    let patient =
        "period: 1 ms\nsupervision: {restarts: 20, within: 1 s}\nrecorder: {seconds: 1}\n";
    text.replace(
        "{priority: 80}",
        &format!("{{priority: {PRIORITY}, core: {CORE}}}"),
    )
    .replace("period: 1 ms\n", patient)
}

/// The simulated robot of the demo, in this place's ports.
fn start_robot(place: &Place) -> Child {
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
            Some(("--control", _)) => format!("--control=127.0.0.1:{}", place.port("fri_control")),
            _ => argument.clone(),
        });
    let log = File::create(place.folder().join("lwr-sim.log")).expect("a log can be written");
    let mut command = Command::new(program("lwr-sim"));
    command
        .args(arguments)
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

/// No cycle was late by us; returns how many were late with the machine.
fn assert_on_time(judge: Judge) -> u64 {
    let verdict = judge.finish();
    assert_eq!(verdict.unexplained, 0, "late cycles of ours: {verdict:?}");
    assert!(
        verdict.consecutive,
        "cycle numbers went back, or another executor"
    );
    assert_eq!(verdict.dropped_records, 0, "records were dropped");
    verdict.late
}

/// False if there was nobody any more.
fn strike(pid: u32, way: Way) -> bool {
    match way {
        Way::Kill => signal(pid, Signal::SIGKILL),
        Way::Segv => {
            let there = signal(pid, Signal::SIGSEGV);
            // The runtime of Rust gives the first one its usual meaning, in case that it was no overflow of a stack: a
            // real fault would happen again at once. Under load some of these are one.
            for _ in 0..6 {
                std::thread::sleep(Duration::from_millis(4));
                signal(pid, Signal::SIGSEGV);
            }
            there
        }
        Way::Term => signal(pid, Signal::SIGTERM),
        Way::Stop => {
            let there = signal(pid, Signal::SIGSTOP);
            std::thread::sleep(STOPPED);
            there && signal(pid, Signal::SIGCONT)
        }
    }
}

/// A guest that was only stopped, or may end in order, ends by itself.
fn await_guest(guest: &mut Child, way: Way) {
    if matches!(way, Way::Stop | Way::Term) {
        await_some("a client to end", || {
            guest.try_wait().expect("the child is ours")
        });
    }
}

/// Ends who is still there, and takes its exit code: a zombie would count as a process that was left.
fn end_guest(guest: &mut Child) {
    let _ = guest.kill();
    let _ = guest.wait();
}
