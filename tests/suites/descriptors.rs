//! An executor and a driver without a free file descriptor while an arm moves: a file that cannot be opened is reported
//! and tried again, and is never mistaken for the death of a process. Run by the threads of the test harness; each test
//! has a cell of its own.

use std::process::Command;

use rcc_protocol::Role;
use rcc_tests::{TestCell, await_some, nets};
use serde_json::Value;

/// Number of cycles without descriptors, longer than the watchdog's time (2 s, at 1 kHz): a program that could not send
/// its heartbeat would be killed.
const CYCLES: u64 = 3000;

/// A process that cannot open any more files; dropping this restores its limit.
struct DescriptorLimit {
    pid: String,
    soft: String,
}

impl DescriptorLimit {
    fn new(pid: u32) -> Option<DescriptorLimit> {
        let pid = pid.to_string();
        let query = [
            "--pid",
            &pid,
            "--nofile",
            "--output",
            "SOFT",
            "--noheadings",
        ];
        let output = Command::new("prlimit").args(query).output().ok()?;
        let soft = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        // Open files stay open; a new descriptor would have a number above the limit.
        let starved = DescriptorLimit { pid, soft };
        (output.status.success() && starved.limit("3")).then_some(starved)
    }

    fn limit(&self, soft: &str) -> bool {
        let limit = format!("--nofile={soft}:");
        let status = Command::new("prlimit")
            .args(["--pid", &self.pid, &limit])
            .status();
        status.is_ok_and(|status| status.success())
    }
}

impl Drop for DescriptorLimit {
    fn drop(&mut self) {
        self.limit(&self.soft);
    }
}

/// Returns how often processes of `role` have reported that they cannot determine whether `process` is alive.
fn doubts(cell: &TestCell, role: &str, process: &str) -> usize {
    let (out, _) = cell.cli_exits(0, &["--output", "json", "events"]);
    let lines = out
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
    let is = |event: &Value| {
        event["kind"] == "life-unknown"
            && event["source"]["role"] == role
            && event["fields"]["process"] == process
    };
    lines.filter(is).count()
}

/// Lets a process open no file for some seconds while the arm moves; asserts that no process and no net ends.
fn starve(role: Role, label: &str, about: &str) {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let line = cell.run(&nets::line("line", 0.2, 0.02));
    let mut arm = cell.simulator("lwr-sim");
    arm.await_motion();
    let pids = || {
        [
            (Role::Executor, "exec"),
            (Role::Driver, "lwr"),
            (Role::Driver, "io"),
        ]
        .map(|(role, label)| cell.announced(role, label).pid)
    };
    let before = pids();
    let Some(starved) = DescriptorLimit::new(cell.announced(role, label).pid) else {
        eprintln!("skipped: no prlimit (util-linux) that may limit another process");
        return;
    };
    let watch = cell.watch();
    let begun = watch.status().cycle;
    await_some("some seconds without descriptors", || {
        (watch.status().cycle > begun + CYCLES).then_some(())
    });
    assert!(
        doubts(&cell, role.as_str(), about) > 0,
        "the failure is reported"
    );
    assert_eq!(cell.state(line)["state"], "running", "{}", cell.logs());
    assert_eq!(cell.state(lamp)["state"], "running");
    drop(starved);
    drop(watch);
    assert_eq!(pids(), before, "no process died");
    assert_eq!(cell.state(line)["state"], "running", "{}", cell.logs());
    cell.done(line, "cancel");
    cell.assert_ends(line, "canceled");
    cell.done(lamp, "cancel");
    cell.stop();
}

#[test]
fn an_executor_without_a_free_descriptor_keeps_its_drivers_and_is_not_killed() {
    starve(Role::Executor, "exec", "driver/lwr");
}

#[test]
fn a_driver_without_a_free_descriptor_keeps_its_executor_and_is_not_killed() {
    starve(Role::Driver, "lwr", "executor");
}
