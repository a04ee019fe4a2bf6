//! `kill -9` of processes that are not part of the control loop of a motion (loader, monitor, command line,
//! supervisor), and processes that hang. Each test has a cell of its own.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use nix::sys::signal::Signal;
use rcc_config::CellConfig;
use rcc_core::message::CommandState;
use rcc_protocol::Role;
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::simulator::{Simulator, assert_within_limits};
use rcc_tests::{TestCell, await_some, nets, program, repository};

#[test]
fn a_killed_loader_does_not_affect_a_motion_and_its_successor_knows_all_names() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let (broken, row) = cell.load_any("net: broken\nprimitives: 7\n");
    assert_eq!(row["state"], "rejected", "{row}");
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    arm.await_motion();
    let dead = cell.kill(Role::Loader, "loader");
    cell.await_successor(Role::Loader, "loader", dead);
    let row = await_some("the successor's answer", || {
        let reply = cell.try_rest("GET", "/commands/line", "")?;
        (reply.status == 200).then_some(reply.body)
    });
    assert_eq!(
        (row["id"].as_u64(), row["state"].as_str()),
        (Some(line), Some("running")),
        "{row}"
    );
    assert_eq!(row["uses"][0], "lwr", "{row}");
    assert!(
        row["text"]
            .as_str()
            .is_some_and(|text| text.contains("LinearMotion")),
        "{row}"
    );
    let rejected = cell.state(broken);
    assert_eq!(rejected["state"], "rejected");
    assert!(
        rejected["diagnostics"]
            .as_array()
            .is_some_and(|list| !list.is_empty()),
        "{rejected}"
    );
    cell.assert_ends(line, "finished");
    assert_within_limits(&arm.state(), &[]);
    // The successor also executes new requests.
    let next = cell.run(&nets::line("next", 0.0, 0.2));
    cell.done(next, "cancel");
    cell.assert_ends(next, "canceled");
    cell.stop();
}

#[test]
fn a_killed_monitor_affects_no_other_process() {
    let cell = TestCell::demo();
    let watch =
        "  watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: move.pose}}\n";
    let line = cell.run(&nets::motion("line", 0.2, 0.1, watch));
    let tail = || {
        let mut tail = cell.program("rcc-monitor");
        tail.args(["tail", "--output", "json"])
            .stdout(Stdio::piped());
        ends_with_test(&mut tail)
            .spawn()
            .expect("rcc-monitor starts")
    };
    let (mut first, mut second) = (tail(), tail());
    let lines = |child: &mut std::process::Child| {
        BufReader::new(child.stdout.take().expect("a pipe")).lines()
    };
    let (mut of_first, mut of_second) = (lines(&mut first), lines(&mut second));
    assert!(of_first.next().is_some() && of_second.next().is_some());
    first.kill().expect("the child is ours");
    first.wait().expect("the child is ours");
    for _ in 0..500 {
        of_second.next().expect("a line").expect("UTF-8");
    }
    second.kill().expect("the child is ours");
    second.wait().expect("the child is ours");
    cell.assert_ends(line, "finished");
    cell.stop();
}

#[test]
fn a_monitor_that_hangs_affects_nothing_and_reports_lost_records_when_it_continues() {
    let cell = TestCell::demo();
    let lamp = cell.run(&nets::lamp("lamp"));
    let mut tail = cell.program("rcc-monitor");
    tail.args(["tail", "--output", "json"])
        .stdout(Stdio::piped());
    let mut tail = ends_with_test(&mut tail)
        .spawn()
        .expect("rcc-monitor starts");
    let mut lines = BufReader::new(tail.stdout.take().expect("a pipe")).lines();
    lines.next().expect("a line").expect("UTF-8");
    signal(tail.id(), Signal::SIGSTOP);
    let watch = cell.watch();
    let begun = watch.status().cycle;
    // Longer than the history of the stream of records.
    await_some("cycles to pass", || {
        (watch.status().cycle > begun + 1000).then_some(())
    });
    assert_eq!(
        watch.status().dropped_records,
        0,
        "the executor's ring never fills"
    );
    drop(watch);
    signal(tail.id(), Signal::SIGCONT);
    let loss = lines
        .map(|line| line.expect("UTF-8"))
        .find(|line| line.contains("\"lost\""));
    let loss: serde_json::Value = serde_json::from_str(&loss.expect("a line")).expect("JSON");
    assert!(
        loss["lost"].as_u64().is_some_and(|lost| lost > 500),
        "{loss}"
    );
    assert_eq!(cell.state(lamp)["state"], "running");
    tail.kill().expect("the child is ours");
    tail.wait().expect("the child is ours");
    cell.done(lamp, "cancel");
    cell.stop();
}

#[test]
fn a_killed_client_cannot_cancel_and_the_motion_ends_normally() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let path = cell.file(&nets::line("line", 0.2, 0.1));
    let mut run = cell.program("rcc-cli");
    run.arg("run")
        .arg(&path)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut run = ends_with_test(&mut run).spawn().expect("rcc-cli starts");
    arm.await_motion();
    run.kill().expect("the child is ours");
    run.wait().expect("the child is ours");
    let row = cell.rest("GET", "/commands/line", "").body;
    assert_eq!(row["state"], "running", "{row}");
    cell.assert_ends(row["id"].as_u64().expect("an id"), "finished");
    let (table, _) = cell.cli_exits(0, &["ls"]);
    assert!(
        table.contains("line") && table.contains("finished"),
        "{table}"
    );
    cell.stop();
}

#[test]
fn ctrl_c_on_run_cancels_and_unloads() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let path = cell.file(&nets::line("line", 0.2, 0.1));
    let mut run = cell.program("rcc-cli");
    run.arg("run").arg(&path).stdout(Stdio::piped());
    let run = ends_with_test(&mut run).spawn().expect("rcc-cli starts");
    arm.await_motion();
    signal(run.id(), Signal::SIGINT);
    let output = run.wait_with_output().expect("the child is ours");
    assert_eq!(output.status.code(), Some(130), "{output:?}");
    assert!(
        String::from_utf8_lossy(&output.stdout).contains("canceled"),
        "{output:?}"
    );
    assert_eq!(
        cell.rest("GET", "/commands", "").body,
        serde_json::json!([])
    );
    assert_within_limits(&arm.await_rest(), &[]);
    cell.stop();
}

#[test]
fn a_loader_that_hangs_does_not_affect_a_motion_and_knows_everything_when_it_continues() {
    // The long watchdog time keeps the supervisor from killing the loader; `services` tests that it kills it otherwise.
    let cell = TestCell::changed(|text| {
        text.replace(
            "period: 1 ms",
            "period: 1 ms\nsupervision: {watchdog: 60 s}",
        )
    });
    let mut arm = cell.simulator("lwr-sim");
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    arm.await_motion();
    let loader = cell.announced(Role::Loader, "loader").pid;
    signal(loader, Signal::SIGSTOP);
    let (_, errors) = cell.cli_exits(6, &["--timeout", "300ms", "state", "line"]);
    assert!(errors.contains("RCC4005"), "{errors}");
    let watch = cell.watch();
    await_some("the end of the line", || {
        let tables = watch.tables();
        let row = tables.commands.iter().find(|row| row.id == line)?;
        (CommandState::from_number(row.state) == CommandState::Terminated).then_some(())
    });
    drop(watch);
    signal(loader, Signal::SIGCONT);
    cell.assert_ends(line, "finished");
    assert_eq!(
        cell.announced(Role::Loader, "loader").pid,
        loader,
        "the loader was not restarted"
    );
    assert_within_limits(&arm.state(), &[]);
    cell.stop();
}

#[test]
fn a_driver_that_hangs_loses_its_net_and_stays_at_rest_when_it_continues() {
    let cell = TestCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let line = cell.run(&nets::line("line", 0.2, 0.1));
    arm.await_motion();
    let driver = cell.announced(Role::Driver, "lwr").pid;
    signal(driver, Signal::SIGSTOP);
    let row = cell.await_end(line);
    assert_eq!(row["fault"]["fault"], "device lost", "{row}");
    assert_within_limits(&arm.await_rest(), &[1]);
    signal(driver, Signal::SIGCONT);
    cell.await_device("lwr", "ready");
    arm.assert_still(1000);
    let next = cell.run(&nets::line("next", 0.0, 0.2));
    cell.assert_ends(next, "finished");
    assert_within_limits(&arm.state(), &[1]);
    cell.stop();
}

/// Removes the arm's simulator from the demo's configuration, so that it can outlive the supervisor.
fn without_arm_simulator(text: String) -> String {
    let from = text.find("  lwr-sim:").expect("the simulator of the arm");
    let to = text
        .find("  io-sim:")
        .expect("the simulator of the station");
    text[..from].to_owned() + &text[to..]
}

#[test]
fn a_killed_supervisor_ends_its_children_and_the_arm_comes_to_rest() {
    let demo = repository().join("configs/cells/demo.yaml");
    let place = CellFixture::new(&demo, without_arm_simulator);
    let offline = CellConfig::load_offline(&demo).unwrap_or_else(|faults| panic!("{faults}"));
    let simulator = offline
        .simulators
        .iter()
        .find(|simulator| simulator.name == "lwr-sim");
    let ports = |argument: &String| match argument.split_once('=') {
        Some(("--driver", _)) => format!("--driver=127.0.0.1:{}", place.port("fri")),
        _ => argument.clone(),
    };
    let arguments: Vec<String> = simulator
        .expect("lwr-sim")
        .arguments
        .iter()
        .map(ports)
        .collect();
    let mut simulator = Command::new(program("lwr-sim"));
    // Not in the cell's folder: the robot outlives the cell.
    let socket = place.folder().join("robot.sock");
    let simulator = simulator.args(arguments).arg("--control").arg(&socket);
    let simulator = simulator.stdout(Stdio::null());
    let mut simulator = ends_with_test(simulator).spawn().expect("lwr-sim starts");
    let mut cell = TestCell::in_fixture(place);
    let mut arm = Simulator::connect(&socket);
    cell.run(&nets::line("line", 0.2, 0.1));
    arm.await_motion();
    cell.kill_supervisor();
    cell.await_dead();
    assert_within_limits(&arm.await_rest(), &[1]);
    cell.up_again();
    arm.assert_still(1000);
    let next = cell.run(&nets::line("next", 0.0, 0.2));
    cell.assert_ends(next, "finished");
    cell.stop();
    simulator.kill().expect("the child is ours");
    simulator.wait().expect("the child is ours");
}
