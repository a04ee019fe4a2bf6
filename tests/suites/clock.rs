//! Clocks and rates through all processes: a cell whose clock follows its robot, base periods from 125 µs to 20 ms, and
//! nets at a lower rate. Each test has a cell of its own.

use rcc_core::message::ClockState;
use rcc_protocol::Role;
use rcc_tests::cell_fixture::ExecutorBoards;
use rcc_tests::stalls::run_until_finished;
use rcc_tests::{TestCell, await_some, nets};

/// Starts the demo cell with another period and with a clock that follows the robot.
fn following(period: &str, robot_ms: u32) -> TestCell {
    TestCell::changed(|text| {
        let text = text.replace("period: 1 ms", &format!("period: {period}"));
        // The rest of the line becomes a comment.
        let text = text.replace("    delay: 80 ms", "    #");
        let period = format!("      - --period-ms={robot_ms}\n      - --krl=first-app");
        let text = text.replace("      - --krl=first-app", &period);
        format!("{text}\nclock: {{device: lwr}}\n")
    })
}

fn await_clock(watch: &ExecutorBoards, state: ClockState) {
    await_some(state.name(), || {
        (watch.status().clock.state == state as u32).then_some(())
    });
}

/// Runs a line there and one back.
fn move_there_and_back(cell: &TestCell) {
    for (name, y) in [("there", 0.15), ("back", 0.0)] {
        run_until_finished(cell, "lwr", &nets::line(name, y, 0.1));
    }
}

#[test]
fn a_clock_that_follows_the_robot_is_locked_and_status_shows_it() {
    let cell = following("1 ms", 1);
    let watch = cell.watch();
    await_clock(&watch, ClockState::Locked);
    move_there_and_back(&cell);
    let words = cell.cli(&["status"]).stdout;
    let words = String::from_utf8_lossy(&words).into_owned();
    assert!(words.contains("clock     lwr: "), "{words}");
    let clock = watch.status().clock;
    let ratio = clock.device_period_ns / 1e6;
    assert!((ratio - 1.0).abs() < 2.1e-3, "{clock:?}");
    drop(watch);
    cell.stop();
}

#[test]
fn a_robot_that_the_clock_follows_rates_the_connection_perfect() {
    let cell = following("1 ms", 1);
    let watch = cell.watch();
    await_clock(&watch, ClockState::Locked);
    let mut robot = cell.simulator("lwr-sim");
    // The answers leave after the executor's cycle, and in the first half of the period nevertheless.
    await_some("PERFECT", || {
        (robot.state()["quality"] == "perfect").then_some(())
    });
    let lamp = cell.run(&nets::lamp("lamp"));
    await_some("PERFECT while a net runs", || {
        (robot.state()["quality"] == "perfect").then_some(())
    });
    cell.done(lamp, "cancel");
    cell.assert_ends(lamp, "canceled");
    drop(watch);
    cell.stop();
}

#[test]
fn without_its_robot_the_clock_runs_on_its_own_and_locks_again() {
    let cell = following("1 ms", 1);
    let watch = cell.watch();
    await_clock(&watch, ClockState::Locked);
    let lamp = cell.run(&nets::lamp("lamp"));
    cell.kill(Role::Driver, "lwr");
    await_clock(&watch, ClockState::Searching);
    let before = watch.status().cycle;
    await_some("cycles", || {
        (watch.status().cycle > before + 100).then_some(())
    });
    await_clock(&watch, ClockState::Locked);
    assert!(watch.status().clock.losses >= 1);
    cell.done(lamp, "cancel");
    cell.assert_ends(lamp, "canceled");
    cell.await_device("lwr", "ready");
    move_there_and_back(&cell);
    drop(watch);
    cell.stop();
}

#[test]
fn a_cell_of_125_us_moves_its_robot_of_1_ms() {
    let cell = following("125 us", 1);
    let watch = cell.watch();
    await_clock(&watch, ClockState::Locked);
    move_there_and_back(&cell);
    drop(watch);
    cell.stop();
}

#[test]
fn a_cell_of_20_ms_moves_its_robot_of_20_ms() {
    let cell = following("20 ms", 20);
    let watch = cell.watch();
    await_clock(&watch, ClockState::Locked);
    move_there_and_back(&cell);
    drop(watch);
    cell.stop();
}

#[test]
fn a_cell_of_20_ms_with_two_clocks_moves_its_robot() {
    let cell = TestCell::changed(|text| {
        let text = text.replace("period: 1 ms", "period: 20 ms");
        let text = text.replace("delay: 80 ms", "delay: 100 ms");
        text.replace(
            "      - --krl=first-app",
            "      - --period-ms=20\n      - --krl=first-app",
        )
    });
    move_there_and_back(&cell);
    cell.stop();
}

#[test]
fn a_net_of_a_lower_rate_starts_in_a_cycle_of_its_phase() {
    let cell = TestCell::demo();
    let slow = nets::clock("slow").replace("net: slow", "net: slow\nperiod: 50 ms\nphase: 7 ms");
    let slow = slow.replace("1000 Hz", "20 Hz");
    let id = cell.load(&slow);
    let reply = cell.operate(id, "start");
    assert_eq!(reply.status, 200, "{reply:?}");
    let started = reply.body["cycle"].as_u64().expect("a cycle");
    assert_eq!(started % 50, 7, "{reply:?}");
    await_some("three evaluations", || {
        (cell.state(id)["cycles"].as_u64()? >= 3).then_some(())
    });
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    let (_, refused) = cell.load_any(&slow.replace("50 ms", "2.5 ms"));
    assert_eq!(refused["state"], "rejected", "{refused}");
    assert!(refused.to_string().contains("RCC1306"), "{refused}");
    cell.stop();
}
