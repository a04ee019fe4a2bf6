//! `rcc-cli up` obeys `supervision`: a process that hangs is killed and restarted, a process that dies too often has
//! failed permanently, and only a failed executor ends the cell. Each test has a cell of its own. Run by the threads of
//! the test harness.

use std::fs;

use nix::sys::signal::Signal;
use rcc_protocol::Role;
use rcc_tests::processes::signal;
use rcc_tests::{TestCell, await_some};

/// Starts the demo cell with these keys of `supervision:`.
fn cell(supervision: &str) -> TestCell {
    TestCell::changed(|text| {
        let keys = format!("period: 1 ms\nsupervision: {{{supervision}}}");
        text.replace("period: 1 ms", &keys)
    })
}

/// Waits until the supervisor's output has a line with these words; returns the line.
fn await_line(cell: &TestCell, words: &str) -> String {
    await_some(&format!("'{words}' from the supervisor"), || {
        let log = fs::read_to_string(cell.folder().join("up.log")).ok()?;
        log.lines()
            .find(|line| line.contains(words))
            .map(str::to_owned)
    })
}

#[test]
fn a_process_that_hangs_is_killed_and_restarted() {
    let cell = cell("watchdog: 1 s");
    for (role, label, name) in [
        (Role::Driver, "lwr", "driver/lwr"),
        (Role::Loader, "loader", "loader"),
        (Role::Executor, "exec", "executor"),
    ] {
        let hung = cell.announced(role, label);
        assert!(signal(hung.pid, Signal::SIGSTOP), "{name} does not exist");
        cell.await_successor(role, label, hung.incarnation);
        let line = await_line(&cell, &format!("{name:<20} hangs: no progress for"));
        assert!(line.contains("killing it"), "{line}");
        await_line(
            &cell,
            &format!("{name:<20} died: killed because it hung (SIGABRT)"),
        );
    }
    cell.await_devices();
    cell.stop();
}

#[test]
fn a_driver_that_dies_too_often_fails_permanently_and_the_rest_keeps_running() {
    let cell = cell("restarts: 1, within: 3600 s");
    let first = cell.kill(Role::Driver, "io");
    let second = cell.await_successor(Role::Driver, "io", first);
    await_line(&cell, "restarting (1/1 in 3600 s)");
    assert!(
        signal(second.pid, Signal::SIGKILL),
        "the driver does not exist"
    );
    await_line(
        &cell,
        "driver/io            failed: not restarted (SIGKILL)",
    );
    let line = await_line(&cell, "  > the rest of the cell keeps running");
    assert!(line.contains("died more than 1 times in 3600 s"), "{line}");
    cell.await_device("lwr", "ready");
    let place = cell.interrupt();
    place.await_dead();
    place.assert_nothing_left();
}

#[test]
fn a_failed_executor_ends_the_cell() {
    let mut cell = cell("restarts: 0");
    cell.kill(Role::Executor, "exec");
    let status = cell.await_end_of_up();
    assert_eq!(status.code(), Some(1));
    await_line(&cell, "  > the cell ends");
    cell.await_dead();
    cell.assert_nothing_left();
}
