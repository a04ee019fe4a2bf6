//! Moves the arm back and forth with nets that finish, are canceled, are aborted, lose their driver, or run while two
//! processes are killed at the same moment. Runs on one thread, which also starts the arm's driver.

use std::time::Duration;

use nix::sys::signal::Signal;
use serde_json::Value;

use super::field::{ARM, Field, IO, count, held};
use super::pairs::{self, Pair, Victim};
use super::restart;
use crate::cell_fixture::ExecutorBoards;
use crate::journal::Random;
use crate::nets;
use crate::simulator::{ANSWERS_LOST, STILL, Simulator, assert_within_limits, joints_of};

/// Distance of the targets from the middle in y, m.
const SIDE: f64 = 0.12;
/// Tolerance between the flange and the target of a finished line, m.
const NEAR: f64 = 0.002;

struct Arm<'a> {
    field: &'a Field<'a>,
    simulator: Simulator,
    watch: ExecutorBoards,
    random: Random,
}

/// The way in which the test ends a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PlannedOutcome {
    Finish,
    Cancel,
    Abort,
    Kill,
    Pair(Pair),
}

impl PlannedOutcome {
    /// True if the arm's driver is killed.
    fn kills(self) -> bool {
        match self {
            PlannedOutcome::Kill => true,
            PlannedOutcome::Pair(pair) => pair.contains(Victim::ArmDriver),
            PlannedOutcome::Finish | PlannedOutcome::Cancel | PlannedOutcome::Abort => false,
        }
    }
}

/// Runs until the journal ends.
pub fn run(field: &Field<'_>) {
    let pid = held(&field.arm_driver).start(field.place);
    let mut arm = Arm {
        field,
        simulator: field.place.simulator("lwr-sim"),
        watch: field.place.watch(),
        random: field.random(1),
    };
    field.await_driver(&arm.watch, ARM, pid);
    arm.simulator.await_rest();
    arm.simulator.reset_statistics();
    field.journal.rounds("arm", |number| arm.round(number));
    field.end(&mut held(&field.arm_driver));
    drop(arm.watch);
}

impl Arm<'_> {
    fn round(&mut self, number: u64) {
        let field = self.field;
        field.renew(&mut self.watch);
        restart::driver(field, &mut held(&field.arm_driver), &self.watch, ARM);
        let fate = self.fate();
        let calm = (fate == PlannedOutcome::Kill).then(|| {
            let mut driver = held(&field.io_driver);
            // The thread that locks the driver restarts it if it was killed in a pair.
            restart::driver(field, &mut driver, &self.watch, IO);
            driver
        });
        let lamp = calm.as_ref().map(|_| {
            let name = format!("beside-{number}");
            let lamp = field.load(&name, &nets::lamp(&name));
            field.start(lamp);
            lamp
        });
        let y = if number.is_multiple_of(2) {
            SIDE
        } else {
            -SIDE
        };
        let name = format!("line-{number}");
        let line = field.load(&name, &nets::line(&name, y, 0.25));
        field
            .journal
            .pause(self.random.time_below(Duration::from_millis(300)));
        self.assert_nothing_moved();
        field.journal.note(format!("start {name}, to {fate:?}"));
        field.start(line);
        let row = self.carry_out(fate, line);
        self.check_end(fate, &row, y);
        field.unload(line);
        if fate.kills() {
            self.start_driver();
        }
        if let Some(lamp) = lamp {
            // The simulated station has no real-time priority: on a busy machine its answers may be late on their own.
            let row = field.row(lamp);
            let starved = row["fault"]["device"] == "io";
            if starved {
                field.keep_disturbed(row.to_string());
            }
            assert!(
                row["state"] == "running" || starved,
                "the net on the other device was disturbed: {row}"
            );
            field.stop(lamp, "cancel");
            field.await_end(lamp);
            field.unload(lamp);
        }
    }

    /// Chooses what happens to the next motion. A fifth of all restarts are those of the arm's driver, spread over the
    /// time.
    fn fate(&mut self) -> PlannedOutcome {
        if pairs::due(self.field) {
            return PlannedOutcome::Pair(Pair::choose(&mut self.random));
        }
        let (all, counts) = (self.field.options.restarts / 5, &self.field.counts);
        let done = counts
            .arm_restarts
            .load(std::sync::atomic::Ordering::Relaxed)
            + counts
                .arm_starts_killed
                .load(std::sync::atomic::Ordering::Relaxed);
        let others = counts
            .io_restarts
            .load(std::sync::atomic::Ordering::Relaxed);
        if done < all && done * 4 <= others {
            return PlannedOutcome::Kill;
        }
        match self.random.below(10) {
            0 | 1 => PlannedOutcome::Cancel,
            2 => PlannedOutcome::Abort,
            _ => PlannedOutcome::Finish,
        }
    }

    /// Records a finding if a joint moved since the last reset, at which the arm was at rest.
    fn assert_nothing_moved(&mut self) {
        let state = self.simulator.state();
        let fastest = joints_of(&state["velocity_max"]);
        if fastest.iter().any(|velocity| *velocity > STILL) {
            self.field
                .journal
                .add_finding(format!("the arm moved while no net ran: {state}"));
        }
        self.simulator.reset_statistics();
    }

    fn carry_out(&mut self, fate: PlannedOutcome, line: u64) -> Value {
        let field = self.field;
        let guests = match fate {
            PlannedOutcome::Pair(pair) => pair.guests(field),
            _ => Vec::new(),
        };
        if fate != PlannedOutcome::Finish {
            std::thread::sleep(self.random.time_below(Duration::from_millis(900)));
        }
        match fate {
            PlannedOutcome::Finish => {}
            PlannedOutcome::Cancel => field.stop(line, "cancel"),
            PlannedOutcome::Abort => field.stop(line, "abort"),
            PlannedOutcome::Kill => {
                field.journal.note("kill the arm's driver".to_owned());
                held(&field.arm_driver).end(Signal::SIGKILL);
            }
            PlannedOutcome::Pair(pair) => pair.strike(field, guests),
        }
        field.await_end(line)
    }

    /// Checks that the motion ended as planned, and that the arm is at rest and stayed within its limits.
    fn check_end(&mut self, fate: PlannedOutcome, row: &Value, y: f64) {
        let (field, counts) = (self.field, &self.field.counts);
        let rest = self.simulator.await_rest();
        assert_within_limits(&rest, &ANSWERS_LOST);
        let (reason, fault) = (
            row["reason"].as_str().unwrap_or_default(),
            &row["fault"]["fault"],
        );
        match (fate, reason) {
            (_, "finished") => {
                let at = rest["flange_position"][1].as_f64().unwrap_or(f64::NAN);
                if (at - y).abs() > NEAR {
                    field
                        .journal
                        .add_finding(format!("finished at y = {at} m, not {y} m: {row}"));
                }
                count(&counts.finished);
            }
            (PlannedOutcome::Cancel, "canceled") => count(&counts.canceled),
            (PlannedOutcome::Abort, "aborted") => count(&counts.aborted),
            (_, "fault") if fate.kills() && fault == "device lost" => count(&counts.killed),
            (_, "fault") if fault == "device lost" => {
                let words = format!(
                    "{row}; the controller: {}, {}",
                    rest["counts"], rest["faults"]
                );
                // The simulated controller has no real-time priority: on a busy machine it sleeps, and the driver
                // hears nothing from it. Without that, the loss is ours.
                if rest["counts"]["stalls"] == 0 {
                    field
                        .journal
                        .add_finding(format!("lost without a cause: {words}"));
                } else {
                    count(&counts.disturbed);
                    field.keep_disturbed(words);
                }
            }
            _ => field
                .journal
                .add_finding(format!("asked to {fate:?}, ended as {row}")),
        }
        // No joint may move from here on.
        self.simulator.reset_statistics();
    }

    /// Restarts the driver at once; with a probability of 10 % it is killed again while it starts.
    fn start_driver(&mut self) {
        let (field, counts) = (self.field, &self.field.counts);
        let mut driver = held(&field.arm_driver);
        let mut pid = driver.start(field.place);
        count(&counts.arm_restarts);
        if self.random.percent(10) {
            std::thread::sleep(self.random.time_below(Duration::from_millis(100)));
            driver.end(Signal::SIGKILL);
            pid = driver.start(field.place);
            count(&counts.arm_starts_killed);
        }
        drop(driver);
        field.clean();
        field.await_driver(&self.watch, ARM, pid);
    }
}
