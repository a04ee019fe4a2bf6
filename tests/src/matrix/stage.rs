//! The cell in which the cases run: `rcc-cli up` with everything except the simulated robot, which outlives the cell.
//! Runs on the thread of the matrix.

mod aftermath;
mod programs;

use std::process::Child;
use std::sync::Arc;
use std::time::Duration;

use aftermath::assert_on_time;
use nix::sys::signal::Signal;
use programs::{configured, robot_socket, start_robot, swap_outputs};

use super::scene::{Scene, StruckProcess};
use super::strike::Strike;
use super::{Case, Disturbance, Outcome, Phase, Target, Victim};
use crate::cell_fixture::CellFixture;
use crate::census::Census;
use crate::endurance::{self, CORE};
use crate::journal::{Journal, Random};
use crate::lateness::LatenessMonitor;
use crate::processes::{command_line, signal, with_runtime_dir};
use crate::simulator::{ANSWERS_LOST, Simulator, assert_within_limits};
use crate::{TestCell, await_some, nets, repository};

/// Exit code of a program that was ended before it had done its work.
const INTERRUPTED: i32 = 130;
/// Priority of the executor, below that of the endurance run, which may run at the same time. Of two executors with one
/// priority on a core, one would wait for the other without delaying the reference thread above them.
const PRIORITY: u8 = endurance::PRIORITY - 4;

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
        assert_within_limits(&rest, &ANSWERS_LOST);
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
            Phase::Moving | Phase::Canceling | Phase::Reconfigured | Phase::Stopping => {
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
        scene.remember_guests(victim);
        assert_eq!(
            scene.struck.len(),
            victim.targets().len(),
            "{victim:?}: every target runs"
        );
        scene
    }

    /// Brings a moving cell into the phase of the case.
    fn enter(&mut self, case: Case, scene: &mut Scene, random: &mut Random) {
        let Some(line) = scene.line else { return };
        match case.phase {
            Phase::Canceling if case.victim.touches(Target::Client) => {
                let cancel = self.client(&["cancel", "line", "--wait"]);
                scene.guests.push((Some(Target::Client), cancel));
                std::thread::sleep(random.time_below(Duration::from_millis(60)));
            }
            Phase::Canceling => {
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

    /// Notes which processes of the cell are the targets.
    fn remember(&self, victim: Victim, scene: &mut Scene) {
        for target in victim.targets() {
            let (pid, incarnation) = match (target, target.announced_as()) {
                (_, Some((role, label))) => {
                    let announced = self.cell.announced(role, label);
                    (announced.pid, announced.incarnation)
                }
                (Target::Supervisor, None) => (self.cell.supervisor(), 0),
                // Not of the cell: noted when it has been started.
                (Target::Monitor | Target::Client | Target::Janitor, None) => continue,
                (target, None) => unreachable!("{target:?} announces itself"),
            };
            scene.struck.push(StruckProcess {
                target,
                pid,
                incarnation,
            });
        }
    }

    /// Makes the target start again, by the supervisor if it is supervised, and returns while it is starting.
    fn interrupt_start(&mut self, victim: Victim, scene: &mut Scene, random: &mut Random) {
        self.remember(victim, scene);
        for index in 0..scene.struck.len() {
            let StruckProcess { target, pid, .. } = scene.struck[index];
            match target {
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
        let Case {
            victim,
            phase,
            disturbance,
        } = case;
        let client = victim.touches(Target::Client);
        if client && phase == Phase::Starting {
            // Its net may or may not have been started before the client died; both are allowed.
            scene.await_guests(disturbance);
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
        if runs && matches!(disturbance, Disturbance::Stop | Disturbance::Term) {
            return scene.end_of_client(disturbance);
        }
        let row = self.cell.await_end(line);
        let reason = row["reason"].as_str().unwrap_or_default().to_owned();
        let planned = if phase == Phase::Canceling {
            "canceled"
        } else {
            "finished"
        };
        let touched = victim.touches(Target::ArmDriver) || victim.touches(Target::Executor);
        let asked = client && disturbance == Disturbance::Term && reason == "canceled";
        // The client died before it sent the cancel.
        let unsent = client && phase == Phase::Canceling && reason == "finished";
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
        let Case {
            victim,
            phase,
            disturbance,
        } = case;
        if phase == Phase::Starting && disturbance == Disturbance::Stop {
            self.cell.await_ready();
            return "goes on".to_owned();
        }
        let status = self.cell.await_end_of_up();
        // By design, a running monitor waits for the cell to start again, so it must be killed.
        scene.end_guests();
        if victim.touches(Target::Supervisor)
            && matches!(disturbance, Disturbance::Kill | Disturbance::Segv)
        {
            self.cell.await_dead();
            return "at rest".to_owned();
        }
        self.cell.await_dead();
        self.cell.assert_nothing_left();
        let of_the_cell = |target: &Target| target.announced_as().is_some();
        let harmless = !victim.targets().iter().any(of_the_cell);
        // A cell that was ended before it was ready was interrupted.
        let interrupted = phase == Phase::Starting && status.code() == Some(INTERRUPTED);
        assert!(
            status.success() || interrupted || !harmless,
            "up: {status}\n{}",
            self.cell.logs()
        );
        "ended".to_owned()
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
