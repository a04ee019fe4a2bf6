//! An iiwa in place of the LWR or beside it, through all processes: the same nets, another entry in the configuration.
//! Each test has a cell of its own.

use rcc_core::message::ClockState;
use rcc_tests::simulator::joints_of;
use rcc_tests::{TestCell, await_some, nets, repository};
use serde_json::json;

fn cell(name: &str, change: impl Fn(String) -> String) -> TestCell {
    TestCell::start(&repository().join("configs/cells").join(name), change)
}

/// Returns the demo with the iiwa, which speaks this version.
fn demo(version: &str) -> TestCell {
    cell("iiwa-demo.yaml", |text| {
        let text = text.replace("--fri=2.7 ", &format!("--fri={version} "));
        text.replace("version: \"2.7\"", &format!("version: \"{version}\""))
    })
}

#[test]
fn a_line_runs_in_every_version_that_has_inputs_and_outputs() {
    for version in ["1.14", "1.16", "2.5", "2.7"] {
        let cell = demo(version);
        let mut arm = cell.simulator("iiwa-sim");
        cell.await_devices();
        let id = cell.run(&nets::line("there", 0.15, 0.1));
        cell.assert_ends(id, "finished");
        let state = arm.await_rest();
        assert_eq!(state["faults"], json!([]), "{state}");
        // The simulator's base is turned against that of the robot's file.
        let y = state["flange_position"][1].as_f64().expect("a number");
        assert!((y + 0.15).abs() < 1e-3, "{version}: {state}");
        cell.stop();
    }
}

#[test]
fn a_pose_overlay_runs_the_same_line() {
    let cell = cell("iiwa-demo.yaml", |text| {
        let overlay = "      - --arm=iiwa7\n      - --overlay=cartesian-pose\n";
        text.replace("      - --arm=iiwa7\n", overlay)
    });
    let mut arm = cell.simulator("iiwa-sim");
    cell.await_devices();
    let id = cell.run(&nets::line("there", 0.15, 0.1));
    cell.assert_ends(id, "finished");
    let state = arm.await_rest();
    assert_eq!(state["faults"], json!([]), "{state}");
    let y = state["flange_position"][1].as_f64().expect("a number");
    assert!((y + 0.15).abs() < 1e-3, "{state}");
    cell.stop();
}

#[test]
fn a_lwr_and_an_iiwa_carry_a_load_together_each_on_its_own_clock() {
    let cell = cell("lwr-and-iiwa.yaml", |text| text);
    let (mut left, mut right) = (cell.simulator("lwr-sim"), cell.simulator("iiwa-sim"));
    cell.await_devices();
    let net = repository().join("configs/two-arms/shared-load.yaml");
    let id = cell.run(&std::fs::read_to_string(net).expect("the example"));
    cell.assert_ends(id, "finished");
    for arm in [&mut left, &mut right] {
        let state = arm.await_rest();
        assert_eq!(state["faults"], json!([]), "{state}");
    }
    let seen = right.state();
    // An answer to every second message, which comes each 2 ms.
    let (sent, answered) = (&seen["counts"]["sent"], &seen["counts"]["answered"]);
    let (sent, answered) = (sent.as_u64().expect("it"), answered.as_u64().expect("it"));
    assert!(answered <= sent / 2 + 1 && answered > sent / 4, "{seen}");
    cell.stop();
}

#[test]
fn a_torque_is_added_to_the_applications_spring() {
    let cell = cell("iiwa-impedance.yaml", |text| text);
    let mut arm = cell.simulator("iiwa-sim");
    cell.await_devices();
    let before = arm.joints();
    let net = repository().join("configs/impedance/joint-torque.yaml");
    let text = std::fs::read_to_string(net).expect("the example");
    let id = cell.run(&text);
    let expected = 2.0 / 1000.0;
    await_some("the spring to give way", || {
        let off = arm.joints()[6] - before[6];
        ((off - expected).abs() < 1e-5).then_some(())
    });
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    await_some("the spring to return", || {
        let state = arm.state();
        let off = joints_of(&state["q"])[6] - before[6];
        (off.abs() < 1e-5 && state["added"][6] == 0.0).then_some(())
    });
    // A net that means other springs than the application has is refused.
    let (id, row) = cell.load_any(&text.replace("1000, 1000]", "1000, 900]"));
    let refused = row["state"] == "rejected" || {
        let reply = cell.operate(id, "start");
        reply.body.to_string().contains("stiffness")
    };
    assert!(refused, "{row}");
    cell.stop();
}

#[test]
fn an_emergency_stop_ends_the_net_and_nothing_moves_until_a_person_and_a_start() {
    let cell = demo("2.7");
    let mut arm = cell.simulator("iiwa-sim");
    cell.await_devices();
    let id = cell.run(&nets::line("there", 0.15, 0.05));
    arm.await_motion();
    cell.cli_exits(0, &["fault", "lwr", "estop"]);
    let row = cell.await_end(id);
    assert_eq!(row["reason"], "fault", "{row}");
    let state = arm.await_rest();
    assert_eq!(state["safety"], "stop1", "{state}");
    assert_eq!(state["emergency_stop"], true, "{state}");
    cell.cli_exits(0, &["fault", "lwr", "ack"]);
    cell.await_device("lwr", "ready");
    arm.reset_statistics();
    arm.assert_still(500);
    let row = cell.device("lwr").expect("a row");
    assert!(row["holder"].is_null(), "{row}");
    let id = cell.run(&nets::line("again", 0.15, 0.1));
    cell.assert_ends(id, "finished");
    let state = arm.await_rest();
    assert_eq!(state["faults"], json!([]), "{state}");
    // The simulator's base is turned against that of the robot's file.
    let y = state["flange_position"][1].as_f64().expect("a number");
    assert!((y + 0.15).abs() < 1e-3, "{state}");
    for effect in [
        &["force", "0", "0", "-5"][..],
        &["loss", "20%"],
        &["freeze", "20ms"],
        &["load", "1"],
        &["clear"],
    ] {
        let line: Vec<&str> = ["fault", "lwr"].iter().chain(effect).copied().collect();
        cell.cli_exits(0, &line);
    }
    cell.stop();
}

#[test]
fn a_clock_that_follows_the_iiwa_is_locked() {
    let cell = cell("iiwa-demo.yaml", |text| {
        // The rest of the line becomes a comment.
        let text = text.replace("    delay: 80 ms", "    #");
        format!("{text}\nclock: {{device: lwr}}\n")
    });
    let watch = cell.watch();
    await_some("a locked clock", || {
        (watch.status().clock.state == ClockState::Locked as u32).then_some(())
    });
    cell.await_devices();
    let id = cell.run(&nets::lamp("lamp"));
    let before = watch.status().cycle;
    await_some("cycles", || {
        (watch.status().cycle > before + 300).then_some(())
    });
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    drop(watch);
    cell.stop();
}
