//! A cell whose joints are moved by drives on a simulated EtherCAT line (`configs/cells/ethercat-drives.yaml`): enabled by a net,
//! moved by another, stopped as CiA 402 says. Over UDP as it is shipped, and over raw Ethernet between two interfaces in a network
//! namespace of the test, whose cable is pulled. Each test has a cell of its own.

use rcc_core::message::ClockState;
use rcc_protocol::Role;
use rcc_testing::namespace::{FAR, NEAR, in_namespace, plug_cable, pull_cable};
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::simulator::Simulator;
use rcc_tests::stalls::run_until_finished;
use rcc_tests::{TestCell, await_some, repository, turns};
use serde_json::{Value, json};

/// Enables the drives until CANCEL.
const POWER: &str = "
net: power
primitives:
  power:  {type: DigitalOutput, parameters: {device: table, channel: power}, inputs: {in: true}}
  cancel: {type: Cancel}
  end:    {type: Termination, inputs: {done: cancel.requested}}
";

/// Number of times that the cable is pulled.
const PULLS: usize = 2;
/// Error code of a drive whose process data have stopped.
const COMMUNICATION: u16 = 0x7500;

/// Window of the following error, counts.
const WINDOW: i64 = 100_000;

/// Moves both joints to this position, rad, at this share of their limits.
fn to(turn: f64, tilt: f64, scale: f64) -> String {
    format!(
        "
net: move
primitives:
  cancel: {{type: Cancel}}
  move:
    type: JointMotion
    parameters: {{device: table, to: [{turn} rad, {tilt} rad], scale: {scale}}}
    inputs: {{stop: cancel.requested}}
  robot: {{type: JointPositionCommand, parameters: {{device: table}}, inputs: {{position: move.joints}}}}
  end:   {{type: Termination, inputs: {{done: move.done}}}}
"
    )
}

fn start(change: impl Fn(String) -> String) -> TestCell {
    let shipped = repository().join("configs/cells/ethercat-drives.yaml");
    TestCell::start_online(&shipped, change)
}

/// Puts the line on the interfaces of the namespace.
fn on_ethernet(text: String) -> String {
    text.replace("udp 127.0.0.1:${line}", NEAR)
        .replace("--udp=127.0.0.1:${line}", &format!("--nic={FAR}"))
        .replace("ports: {line: auto udp}\n", "")
}

fn drives(line: &mut Simulator) -> [Value; 2] {
    let state = line.state();
    [0, 1].map(|drive: usize| state["terminals"][drive]["drive"].clone())
}

fn positions(line: &mut Simulator) -> [i64; 2] {
    drives(line).map(|drive| drive["position"].as_i64().expect("counts"))
}

/// Waits until no drive is enabled.
fn await_no_torque(line: &mut Simulator) -> [Value; 2] {
    await_some("no drive enabled", || {
        let drives = drives(line);
        let ended =
            |drive: &Value| drive["state"] == "switch_on_disabled" || drive["state"] == "fault";
        drives.iter().all(ended).then_some(drives)
    })
}

/// Waits until the first drive has left its place.
fn await_motion(line: &mut Simulator, from: i64) {
    await_some("motion", || {
        ((positions(line)[0] - from).abs() > 20_000).then_some(())
    });
}

/// Enables the drives; returns the net that does.
fn enable(cell: &CellFixture) -> u64 {
    let power = cell.run(POWER);
    cell.await_device("table", "ready");
    power
}

#[test]
fn a_net_moves_the_joints_within_the_window_of_the_drives() {
    let cell = start(|text| text);
    let mut line = cell.simulator("line-sim");
    assert_eq!(positions(&mut line), [0, 0]);
    let power = enable(&cell);
    assert_eq!(positions(&mut line), [0, 0], "enabling moves nothing");
    let id = cell.run(&to(0.4, -0.3, 0.15));
    await_some("the end of the motion", || {
        for drive in drives(&mut line) {
            let at = |key: &str| drive[key].as_i64().expect("counts");
            let error = (at("target") - at("position")).abs();
            assert!(error < WINDOW, "{drive}");
            assert_eq!(drive["state"], "operation_enabled");
        }
        (cell.state(id)["state"] != "running").then_some(())
    });
    cell.assert_ends(id, "finished");
    // The second drive turns the other way, and is at 0.2 rad with count 0.
    await_some("the goal", || {
        (positions(&mut line) == [400_000, 500_000]).then_some(())
    });
    let (words, _) = cell.cli_exits(0, &["doctor", "ethercat", "table"]);
    assert!(
        words.contains("all drives are in `operation enabled`"),
        "{words}"
    );
    cell.done(power, "cancel");
    cell.assert_ends(power, "canceled");
    cell.await_device("table", "online");
    await_no_torque(&mut line);
    assert_eq!(positions(&mut line), [400_000, 500_000]);
    let row = cell.device("table").expect("a row").to_string();
    assert!(row.contains("the drives are off"), "{row}");
    cell.stop();
}

#[test]
fn a_fault_stops_all_drives_and_only_a_new_start_resets_it() {
    let cell = start(|text| text);
    let mut line = cell.simulator("line-sim");
    let power = enable(&cell);
    let id = cell.run(&to(2.0, 1.0, 0.3));
    await_motion(&mut line, 0);
    line.ask(&json!({"fault": {"terminal": 2, "code": 0x2310}}));
    let row = cell.await_end(id);
    assert!(row.to_string().contains("device lost"), "{row}");
    let [turn, tilt] = await_no_torque(&mut line);
    assert_eq!(
        (&turn["state"], &tilt["state"]),
        (&json!("switch_on_disabled"), &json!("fault"))
    );
    let rest = positions(&mut line);
    assert!(rest[0] < 2_000_000, "it stopped on its way");
    cell.await_device("table", "online");
    let (words, _) = cell.cli_exits(1, &["doctor", "ethercat", "table"]);
    let wanted = "the drive of tilt (tilter) is in fault; error code 0x2310";
    assert!(words.contains(wanted), "{words}");
    // The output is still on: that is no new permission.
    assert_eq!(cell.state(power)["state"], "running");
    let id = cell.load(&to(0.0, 0.0, 0.3));
    let refused = cell.operate(id, "start");
    assert_eq!(
        (refused.status, refused.code()),
        (409, "RCC3008"),
        "{refused:?}"
    );
    let words = refused.error_text();
    assert!(words.contains("a drive is in fault"), "{words}");
    assert_eq!(cell.state(id)["state"], "ready");
    assert_eq!(drives(&mut line)[1]["state"], "fault");
    cell.done(power, "cancel");
    cell.assert_ends(power, "canceled");
    assert_eq!(drives(&mut line)[1]["state"], "fault");
    enable(&cell);
    assert_eq!(positions(&mut line), rest);
    let id = cell.run(&to(0.0, 0.0, 0.15));
    cell.assert_ends(id, "finished");
    cell.stop();
}

#[test]
fn the_drives_brake_by_themselves_when_the_driver_is_killed() {
    let cell = start(|text| text);
    let mut line = cell.simulator("line-sim");
    enable(&cell);
    let id = cell.run(&to(2.5, 1.2, 0.2));
    await_motion(&mut line, 0);
    let dead = cell.kill(Role::Driver, "table");
    // By their watchdogs, or by the start of the next driver, whichever is earlier.
    await_no_torque(&mut line);
    let rest = positions(&mut line);
    assert!(rest[0] < 2_500_000, "it stopped on its way: {rest:?}");
    let row = cell.await_end(id);
    assert!(row.to_string().contains("device lost"), "{row}");
    cell.await_successor(Role::Driver, "table", dead);
    cell.await_device("table", "online");
    await_no_torque(&mut line);
    assert_eq!(positions(&mut line), rest, "nothing moves by itself");
    enable(&cell);
    assert_eq!(positions(&mut line), rest);
    let id = cell.run(&to(0.0, 0.2, 0.15));
    cell.assert_ends(id, "finished");
    cell.stop();
}

#[test]
fn a_cable_pulled_in_motion_stops_the_drives_and_nothing_moves_when_it_is_back() {
    in_namespace("a_cable_pulled_in_motion", || {
        let cell = start(on_ethernet);
        let mut line = cell.simulator("line-sim");
        for pull in 0..PULLS {
            let power = enable(&cell);
            let from = positions(&mut line)[0];
            let there = if pull % 2 == 0 { 2.5 } else { -2.5 };
            let id = cell.run(&to(there, 0.2, 0.2));
            await_motion(&mut line, from);
            pull_cable();
            for net in [id, power] {
                let row = cell.await_end(net);
                assert_eq!(row["fault"]["fault"], "device lost", "{row}");
                assert_eq!(row["fault"]["device"], "table", "{row}");
            }
            cell.await_device("table", "offline");
            // Their own supervision of the process data: in fault, at rest after the ramp of the quick stop.
            let [turn, tilt] = await_no_torque(&mut line);
            for drive in [&turn, &tilt] {
                assert_eq!(drive["state"], "fault", "{drive}");
                assert_eq!(drive["error"], COMMUNICATION, "{drive}");
                let at = |key: &str| drive[key].as_i64().expect("counts");
                let ramp = (at("position") - at("target")).abs();
                assert!(ramp < WINDOW, "{drive}");
            }
            let rest = positions(&mut line);
            assert!(
                f64::from(rest[0] as i32).abs() < 2.4e6,
                "on its way: {rest:?}"
            );
            let (words, _) = cell.cli_exits(1, &["doctor", "ethercat", "table"]);
            assert!(
                words.contains("terminal") || words.contains("cable"),
                "{words}"
            );
            plug_cable();
            cell.await_device("table", "online");
            await_no_torque(&mut line);
            let commands = cell.rest("GET", "/commands", "").body;
            let running = commands.as_array().expect("rows").iter();
            assert_eq!(running.filter(|row| row["state"] == "running").count(), 0);
            // Enabling resets the fault, and holds the drives where they are.
            let power = enable(&cell);
            assert_eq!(positions(&mut line), rest, "nothing moves by itself");
            cell.done(power, "cancel");
            cell.assert_ends(power, "canceled");
            await_no_torque(&mut line);
            assert_eq!(positions(&mut line), rest);
        }
        cell.stop();
    });
}

#[test]
fn with_distributed_clocks_the_exchanges_follow_the_first_drive_and_the_cycles_the_exchanges() {
    let _alone = turns::alone();
    let cell = start(|text| {
        let text = text
            .replace("    delay: 80 ms", "    #")
            .replace("type: CiA402}", "type: CiA402, sync0: true}")
            .replace(
                "      terminals:",
                "      distributed_clocks: true\n      terminals:",
            );
        format!("{text}\nclock: {{device: table}}\n")
    });
    let mut line = cell.simulator("line-sim");
    let watch = cell.watch();
    await_some("a locked clock", || {
        (watch.status().clock.state == ClockState::Locked as u32).then_some(())
    });
    let power = enable(&cell);
    let id = cell.run(&to(0.2, 0.1, 0.15));
    cell.assert_ends(id, "finished");
    await_some("clocks that agree", || {
        let state = line.state();
        let clocks = [0, 1].map(|drive: usize| state["terminals"][drive]["clock"].clone());
        for clock in &clocks {
            assert_eq!(clock["sync0_ns"], 1_000_000, "{clock}");
        }
        let apart = |clock: &Value| clock["difference_ns"].as_i64().expect("ns").abs();
        clocks
            .iter()
            .all(|clock| apart(clock) < 1_000)
            .then_some(())
    });
    await_some("doctor to say that they agree", || {
        let (words, _) = cell.cli_exits(0, &["doctor", "ethercat", "table"]);
        words.contains("ns from the reference clock").then_some(())
    });
    cell.done(power, "cancel");
    cell.assert_ends(power, "canceled");
    drop(watch);
    cell.stop();
}

#[test]
fn the_cycles_follow_the_exchanges_of_the_line_if_the_clock_does() {
    let cell = start(|text| {
        let text = text.replace("    delay: 80 ms", "    #");
        format!("{text}\nclock: {{device: table}}\n")
    });
    let watch = cell.watch();
    await_some("a locked clock", || {
        (watch.status().clock.state == ClockState::Locked as u32).then_some(())
    });
    let words = String::from_utf8_lossy(&cell.cli(&["status"]).stdout).into_owned();
    assert!(words.contains("clock     table: "), "{words}");
    let clock = watch.status().clock;
    let ratio = clock.device_period_ns / 1e6;
    assert!((ratio - 1.0).abs() < 2.1e-3, "{clock:?}");
    enable(&cell);
    let mut line = cell.simulator("line-sim");
    let frames = line.state()["frames"].as_u64().expect("frames");
    let cycle = watch.status().cycle;
    run_until_finished(&cell, "table", &to(0.2, 0.0, 0.3));
    // As many cycles as exchanges, but for those before the one and after the other reading.
    let exchanges = line.state()["frames"].as_u64().expect("frames") - frames;
    let cycles = watch.status().cycle - cycle;
    assert!(exchanges > 200, "{exchanges}");
    let apart = exchanges.abs_diff(cycles);
    assert!(
        apart * 10 < exchanges,
        "{exchanges} exchanges, {cycles} cycles"
    );
    drop(watch);
    cell.stop();
}

/// Moves both axes of the gantry, and ends when they are there; the first number has this unit.
fn gantry_to(carriage: &str, slide: &str) -> String {
    format!(
        "
net: move
primitives:
  cancel: {{type: Cancel}}
  move:
    type: JointMotion
    parameters: {{device: gantry, to: [{carriage}, {slide}], scale: 0.2}}
    inputs: {{stop: cancel.requested}}
  robot: {{type: JointPositionCommand, parameters: {{device: gantry}}, inputs: {{position: move.joints}}}}
  state: {{type: JointState, parameters: {{device: gantry}}}}
  x:     {{type: At, inputs: {{in: state.position, index: 0}}}}
  away:  {{type: Formula, parameters: {{expr: \"abs(x - {carriage}) < 1 mm\"}}, inputs: {{x: x.out}}}}
  there: {{type: And, inputs: {{a: away.out, b: move.done}}}}
  end:   {{type: Termination, inputs: {{done: there.out}}}}
discard: [state.hold, state.torque, state.external_torque]
"
    )
}

/// A line of the flange, which points down.
const GANTRY_LINE: &str = "
net: line
primitives:
  cancel: {type: Cancel}
  move:
    type: LinearMotion
    parameters:
      device: gantry
      to: {xyz: [0.1 m, 0.2 m, 0.9 m], rpy: [180 deg, 0 deg, 0 deg]}
      velocity: 0.2 m/s
      acceleration: 1 m/s^2
      jerk: 10 m/s^3
    inputs: {stop: cancel.requested}
  ik:    {type: InverseKinematics, parameters: {device: gantry}, inputs: {pose: move.pose}}
  robot: {type: JointPositionCommand, parameters: {device: gantry}, inputs: {position: ik.joints}}
  end:   {type: Termination, inputs: {done: move.done}}
";

#[test]
fn a_gantry_moves_by_metres_and_refuses_degrees() {
    let shipped = repository().join("configs/cells/ethercat-gantry.yaml");
    let cell = TestCell::start_online(&shipped, |text| text);
    let mut line = cell.simulator("line-sim");
    let power = cell.run(&POWER.replace("table", "gantry"));
    cell.await_device("gantry", "ready");
    // At count 0 the slide is at 100 mm, and goes down with its counts.
    assert_eq!(positions(&mut line), [0, 0]);
    let id = cell.run(&gantry_to("400 mm", "-0.05 m"));
    cell.assert_ends(id, "finished");
    await_some("the place", || {
        (positions(&mut line) == [400_000, 300_000]).then_some(())
    });
    let id = cell.run(GANTRY_LINE);
    cell.assert_ends(id, "finished");
    await_some("the end of the line", || {
        (positions(&mut line) == [100_000, 400_000]).then_some(())
    });
    let (_, refused) = cell.load_any(&gantry_to("20 deg", "0 m"));
    let words = refused.to_string();
    assert!(words.contains("unit mismatch"), "{words}");
    // The guard and the rehearsal tell metres.
    let (id, _) = cell.load_any(&gantry_to("1.6 m", "0 m"));
    let refused = cell.operate(id, "start");
    let words = format!("{refused:?}{}", cell.state(id));
    assert!(
        words.contains("1.6") && words.contains(" m") && !words.contains('°'),
        "{words}"
    );
    cell.done(power, "cancel");
    cell.assert_ends(power, "canceled");
    cell.stop();
}
