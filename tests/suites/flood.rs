//! CANCEL by name while every interface of the loader is flooded: a short run of `cargo run --release -p rcc-tests
//! --example cancel_latency`. It asserts that each CANCEL is answered and executed, but no time.

use std::process::Command;

use rcc_protocol::Role;
use rcc_tests::TestCell;
use rcc_tests::flood::{self, Options, kinds::FloodKind};
use rcc_tests::turns;

/// Entry point of the processes that flood the loader until they are killed.
#[test]
fn flooder() {
    flood::flood_if_asked();
}

#[test]
fn when_memory_runs_out_the_loader_is_killed_before_the_executor_and_the_drivers() {
    let cell = TestCell::demo();
    let score = |role, label| {
        let pid = cell.announced(role, label).pid;
        let text = std::fs::read_to_string(format!("/proc/{pid}/oom_score_adj"));
        text.expect("the process runs")
            .trim()
            .parse::<i32>()
            .expect("a number")
    };
    let loader = score(Role::Loader, "loader");
    let executor = score(Role::Executor, "exec");
    assert!(executor < loader, "{executor} {loader}");
    for driver in ["lwr", "io"] {
        assert!(score(Role::Driver, driver) < loader, "{driver}");
    }
    cell.stop();
}

#[test]
fn every_cancel_is_answered_and_executed_while_every_interface_is_flooded() {
    let _alone = turns::alone();
    let options = Options {
        nets: 4,
        primitives: 2000,
        cancels: 12,
        processes: 1,
        kinds: FloodKind::ALL.to_vec(),
    };
    let again = || {
        let mut command = Command::new(std::env::current_exe().expect("a program has a path"));
        command.args(["--exact", "flood::flooder", "--test-threads", "1"]);
        command
    };
    let report = flood::run(&options, &again);
    assert_eq!(report.cancels.len(), options.cancels);
    assert_eq!(report.failed().count(), 0, "{report}");
    assert!(!report.loader_restarted, "{report}");
}

#[test]
fn a_load_is_taken_although_others_have_left_their_rejected_texts_behind() {
    let cell = TestCell::demo();
    let socket = cell.cell().socket();
    let load = |text: &str| {
        let reply = rcc_tests::rest::request(&socket, "POST", "/commands", text.as_bytes());
        reply.expect("the loader answers")
    };
    for number in 0..rcc_core::message::COMMANDS_MAX + 8 {
        let reply = load(&format!("net: faulty-{number}\n"));
        let id = reply.body["id"].as_u64();
        let id = id.unwrap_or_else(|| panic!("text {number} was refused: {reply:?}"));
        rcc_tests::await_some("the text to be rejected", || {
            let path = format!("/commands/{id}?brief=true");
            let row = rcc_tests::rest::request(&socket, "GET", &path, b"").ok()?;
            (row.body["state"] == "rejected").then_some(())
        });
    }
    let reply = load(&flood::net("good", 2));
    assert_eq!(reply.status, 202, "{reply:?}");
    cell.stop();
}
