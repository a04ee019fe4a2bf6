//! Conditions that must hold after a case: dead processes have successors, the cell works, and nothing is left behind.
//! Runs on the thread of the matrix.

use std::time::Duration;

use rcc_ipc::clean;
use rcc_protocol::Role;

use super::Stage;
use super::programs::swap_outputs;
use crate::census::Census;
use crate::lateness::LatenessMonitor;
use crate::matrix::scene::Scene;
use crate::matrix::{Case, Disturbance, Phase, Target};
use crate::simulator::{Simulator, assert_within_limits};
use crate::{await_some, nets};

/// Error code of a loader that has not found its executor yet.
const NO_EXECUTOR: &str = "RCC4001";
/// Error code of START while a device is not ready or not attached; if not attached, the message names the
/// configurations that differ.
const NOT_READY: &str = "RCC3008";

impl Stage {
    /// Asserts that, while the file and the running cell differ, a net switches the output that it names or START is
    /// refused. Then restores the file and kills the processes that have read the changed one, so that they are
    /// restarted.
    pub(super) fn assert_refused_and_restore(&mut self, case: Case, scene: &Scene) -> String {
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
    pub(super) fn await_successors(&mut self, case: Case, scene: &Scene) {
        for struck in &scene.struck {
            let Some((role, label)) = struck.target.announced_as() else {
                continue;
            };
            if case.disturbance == Disturbance::Stop && case.phase != Phase::Starting {
                assert_eq!(
                    self.cell.announced(role, label).incarnation,
                    struck.incarnation,
                    "the stopped process did not continue"
                );
                continue;
            }
            self.cell.await_successor(role, label, struck.incarnation);
            if case.disturbance != Disturbance::Stop {
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
    pub(super) fn assert_cell_works(&mut self) {
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
    pub(super) fn clear(&mut self, abort: bool) {
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

    pub(super) fn reset_baseline(&mut self) {
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

    pub(super) fn assert_no_leak(&mut self) {
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
}

/// Asserts that no late cycle is unexplained; returns the number of late cycles caused by the machine.
pub(super) fn assert_on_time(lateness_monitor: LatenessMonitor) -> u64 {
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
