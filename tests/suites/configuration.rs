//! Processes of one cell that were started with different configurations, or come from different builds: they neither
//! measure, command, load nor start anything together, and each of them reports the reason. Each test has a cell of its
//! own.

use std::fs;

use nix::sys::signal::Signal;
use rcc_ipc::events::EventReader;
use rcc_protocol::events::{Event, EventKind, EventOrigin};
use rcc_protocol::{Build, Role};
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::signal;
use rcc_tests::rest::Reply;
use rcc_tests::{TestCell, UnsupervisedCell, await_some, nets};

/// Two lines of the file that the tests swap, so that the first digital output of the device becomes the second.
const LAMP: &str =
    "      lamp:  {kind: digital output, address: coil 0, on_release: {safe: false}}\n";
const CLAMP: &str = "      clamp: {kind: digital output, address: coil 1, on_release: hold}     # a clamped part must not fall\n";
/// One second, in ticks of the simulated controller.
const SECOND: u64 = 1000;

/// Changes the cell's file while it runs, as an editor does.
fn edit(place: &CellFixture, from: &str, to: &str) {
    let text = fs::read_to_string(place.config()).expect("the configuration");
    assert!(text.contains(from), "{from} is not in the file");
    let new = place.config().with_extension("new");
    fs::write(&new, text.replacen(from, to, 1)).expect("written");
    fs::rename(&new, place.config()).expect("replaced");
}

fn swap_lamp_and_clamp(place: &CellFixture) {
    edit(place, &format!("{LAMP}{CLAMP}"), &format!("{CLAMP}{LAMP}"));
}

/// Waits until the device is offline because of its driver's configuration; returns the reason.
fn await_mismatch(place: &CellFixture, device: &str) -> String {
    let words = await_some(
        &format!("the driver of {device} not to be attached"),
        || {
            let row = place.device(device)?;
            let reason = row["reason"].as_str()?.to_owned();
            reason.contains("another configuration").then(|| {
                assert_eq!(row["state"], "offline", "{row}");
                reason
            })
        },
    );
    assert!(words.contains("restart the cell"), "{words}");
    words
}

/// Asserts that START is refused with a message that names the configuration and the remedy.
fn assert_not_started(place: &CellFixture, id: u64, code: &str) {
    let reply: Reply = place.operate(id, "start");
    let words = reply.error_text();
    assert_eq!((reply.status, reply.code()), (409, code), "{reply:?}");
    for word in ["configuration", "restart the cell"] {
        assert!(words.contains(word), "{word}: {words}");
    }
    assert_eq!(place.state(id)["state"], "ready");
}

/// Returns each reported mismatch of configurations in the event log: the role that reports it, and the other process.
fn mismatch_reports(place: &CellFixture) -> Vec<(EventOrigin, String)> {
    let events: Vec<Event> = EventReader::open(&place.cell().state())
        .poll()
        .expect("the log");
    let reports = events.into_iter().filter_map(|event| match event.what {
        EventKind::ConfigurationMismatch { process, .. } => Some((event.source.role, process)),
        _ => None,
    });
    reports.collect()
}

fn coils(station: &mut rcc_tests::simulator::Simulator) -> [bool; 2] {
    let coils = station.state()["coils"].clone();
    [coils[0] == true, coils[1] == true]
}

#[test]
fn a_driver_restarted_with_swapped_channels_is_not_attached_and_switches_nothing() {
    let mut cell = TestCell::demo();
    let mut station = cell.simulator("io-sim");
    let before = cell.load(&nets::lamp("before"));
    swap_lamp_and_clamp(&cell);
    await_some("up to report that the change is not in force", || {
        let log = fs::read_to_string(cell.folder().join("up.log")).ok()?;
        let reported = log.contains("io: channels lamp, clamp") && log.contains("not in force");
        reported.then_some(())
    });
    let dead = cell.kill(Role::Driver, "io");
    let driver = cell.await_successor(Role::Driver, "io", dead);
    let words = await_mismatch(&cell, "io");
    assert!(
        words.contains("channels") && words.contains("executor"),
        "{words}"
    );
    // Neither the net that was loaded before nor a net that is loaded now may switch a channel.
    assert_not_started(&cell, before, "RCC3008");
    let after = cell.load(&nets::lamp("after"));
    assert_not_started(&cell, after, "RCC3008");
    let (out, _) = cell.cli_exits(0, &["devices"]);
    assert!(out.contains("another configuration"), "{out}");
    // The loader polls the file.
    rcc_tests::await_some("status to report everything", || {
        let (out, _) = cell.cli_exits(0, &["status"]);
        let all = [
            "not in force",
            "io: channels lamp, clamp",
            "loader, executor",
            "is not attached",
        ];
        all.iter().all(|word| out.contains(word)).then_some(())
    });
    let reports = |reporter: EventOrigin, of: &str| {
        mismatch_reports(&cell)
            .iter()
            .filter(|row| **row == (reporter, of.to_owned()))
            .count()
    };
    await_some("both processes to report each other", || {
        let counts = (
            reports(EventOrigin::Executor, "driver io"),
            reports(EventOrigin::Driver, "executor"),
        );
        (counts.0 > 0 && counts.1 > 0).then_some(())
    });
    // A net of the arm runs meanwhile. The announcements are still polled, but the mismatch is not reported again.
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    cell.assert_ends(line, "finished");
    assert_eq!(
        (
            reports(EventOrigin::Executor, "driver io"),
            reports(EventOrigin::Driver, "executor")
        ),
        (1, 1)
    );
    assert_eq!(coils(&mut station), [false, false], "nothing was switched");
    assert!(driver.liveness().is_alive());
    drop(station);
    signal(cell.supervisor(), Signal::SIGINT);
    cell.await_end_of_up();
    cell.up_again();
    let mut station = cell.simulator("io-sim");
    cell.run(&nets::lamp("again"));
    await_some("the lamp", || {
        (coils(&mut station) == [true, false]).then_some(())
    });
    cell.stop();
}

#[test]
fn an_executor_restarted_with_swapped_channels_is_not_obeyed_by_the_running_driver() {
    let mut cell = UnsupervisedCell::demo();
    let mut station = cell.simulator("io-sim");
    swap_lamp_and_clamp(&cell);
    cell.end("executor", Signal::SIGTERM);
    cell.end("loader", Signal::SIGTERM);
    cell.start_executor();
    cell.start_loader();
    await_mismatch(&cell, "io");
    let lamp = cell.load(&nets::lamp("lamp"));
    assert_not_started(&cell, lamp, "RCC3008");
    await_some("the driver to report the executor", || {
        let row = (EventOrigin::Driver, "executor".to_owned());
        mismatch_reports(&cell).contains(&row).then_some(())
    });
    // The other device has the same configuration in all processes, and still works.
    cell.await_device("lwr", "ready");
    let line = cell.run(&nets::line("line", 0.1, 0.1));
    cell.assert_ends(line, "finished");
    assert_eq!(coils(&mut station), [false, false], "nothing was switched");
    cell.end("io", Signal::SIGTERM);
    cell.start_driver("io");
    cell.await_devices();
    cell.start_when_ready(lamp);
    await_some("the lamp", || {
        (coils(&mut station) == [true, false]).then_some(())
    });
    cell.done(lamp, "cancel");
    cell.assert_ends(lamp, "canceled");
    cell.stop();
}

#[test]
fn a_driver_configured_for_another_arm_moves_nothing() {
    let mut cell = UnsupervisedCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let before = cell.load(&nets::line("before", 0.2, 0.1));
    edit(&cell, "/lwr4plus.yaml", "/iiwa7.yaml");
    cell.end("lwr", Signal::SIGKILL);
    cell.start_driver("lwr");
    let words = await_mismatch(&cell, "lwr");
    assert!(words.contains("robot"), "{words}");
    assert_not_started(&cell, before, "RCC3008");
    let (_, row) = cell.load_any(&nets::line("after", 0.2, 0.1));
    assert_eq!(
        row["state"], "rejected",
        "the position of the arm is unknown: {row}"
    );
    arm.assert_still(SECOND);
    cell.end("lwr", Signal::SIGTERM);
    edit(&cell, "/iiwa7.yaml", "/lwr4plus.yaml");
    cell.start_driver("lwr");
    cell.await_devices();
    cell.start_when_ready(before);
    cell.assert_ends(before, "finished");
    drop(arm);
    cell.stop();
}

#[test]
fn a_loader_with_another_configuration_loads_and_starts_nothing() {
    let mut cell = UnsupervisedCell::demo();
    let mut station = cell.simulator("io-sim");
    let running = cell.run(&nets::clock("running"));
    let before = cell.load(&nets::lamp("before"));
    swap_lamp_and_clamp(&cell);
    await_some("the loader to report the changed file", || {
        let events = EventReader::open(&cell.cell().state())
            .poll()
            .expect("the log");
        let reported = events.into_iter().any(|event| {
            matches!(event.what, EventKind::ConfigurationChanged { differs, .. } if differs == "io: channels lamp, clamp")
        });
        reported.then_some(())
    });
    cell.end("loader", Signal::SIGKILL);
    cell.start_loader();
    assert_not_started(&cell, before, "RCC4020");
    let loaded = cell.rest("POST", "/commands", &nets::lamp("after"));
    assert_eq!(
        (loaded.status, loaded.code()),
        (409, "RCC4020"),
        "{loaded:?}"
    );
    let named = r#"{"stop": [], "start": ["before"]}"#;
    let switched = cell.rest("POST", "/switch", named);
    assert_eq!(
        (switched.status, switched.code()),
        (409, "RCC4020"),
        "{switched:?}"
    );
    // The loader does not name channels that it cannot know, and still executes requests that end a net.
    assert_eq!(
        cell.device("io").expect("a row")["channels"],
        serde_json::json!([])
    );
    assert!(
        cell.device("lwr").expect("a row")["channels"]
            .as_array()
            .is_some_and(|all| !all.is_empty())
    );
    let status = cell.rest("GET", "/status", "").body;
    let words = status["configuration"].to_string();
    assert!(words.contains("refuses LOAD and START"), "{words}");
    cell.done(running, "cancel");
    cell.assert_ends(running, "canceled");
    assert_eq!(coils(&mut station), [false, false]);
    assert!(mismatch_reports(&cell).contains(&(EventOrigin::Loader, "executor".to_owned())));
    cell.end("loader", Signal::SIGTERM);
    edit(&cell, &format!("{CLAMP}{LAMP}"), &format!("{LAMP}{CLAMP}"));
    cell.start_loader();
    cell.start_when_ready(before);
    await_some("the lamp", || {
        (coils(&mut station) == [true, false]).then_some(())
    });
    cell.done(before, "cancel");
    cell.assert_ends(before, "canceled");
    cell.stop();
}

/// Edits the announcement of a process so that it names a build with another layout.
fn rebuild(place: &CellFixture, role: Role, label: &str) {
    let file = place
        .cell()
        .processes_dir()
        .join(format!("{role}-{label}.json"));
    let text = fs::read_to_string(&file).expect("an announcement");
    let mut announced: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let own = serde_json::to_value(Build::own()).expect("JSON");
    assert_eq!(
        announced["build"], own,
        "{role} {label} announces its build"
    );
    announced["build"] = serde_json::json!({"version": "0.0.9", "layout": "0000000000000bad"});
    let new = file.with_extension("edited");
    fs::write(&new, announced.to_string()).expect("written");
    fs::rename(&new, &file).expect("replaced");
}

/// Asserts that a message names both builds and the remedy.
fn assert_names_builds(words: &str) {
    let own = Build::own().to_string();
    for word in [
        "built from another version",
        "0.0.9, layout 0000000000000bad",
        &own,
        "install all programs from one build, and restart the cell",
    ] {
        assert!(words.contains(word), "{word}: {words}");
    }
}

/// Waits until a process reports that another one comes from another build; returns the sentence.
fn await_other_build(place: &CellFixture, reporter: EventOrigin, of: &str) -> String {
    await_some(&format!("{reporter:?} to report {of}"), || {
        let events: Vec<Event> = EventReader::open(&place.cell().state())
            .poll()
            .expect("the log");
        events.into_iter().find_map(|event| match &event.what {
            EventKind::BuildMismatch { process, .. }
                if event.source.role == reporter && process == of =>
            {
                Some(event.sentence(&|net, _| net.to_owned()))
            }
            _ => None,
        })
    })
}

#[test]
fn a_driver_of_another_build_is_not_attached_and_the_message_names_both_builds() {
    let mut cell = UnsupervisedCell::demo();
    let lamp = nets::lamp("lamp");
    cell.end("executor", Signal::SIGTERM);
    rebuild(&cell, Role::Driver, "io");
    cell.start_executor();
    let reason = await_some("the driver of io not to be attached", || {
        let row = cell.device("io")?;
        let reason = row["reason"].as_str()?.to_owned();
        (row["state"] == "offline" && reason.contains("another version")).then_some(reason)
    });
    assert_names_builds(&reason);
    let (out, _) = cell.cli_exits(0, &["devices"]);
    assert!(out.contains("built from another version"), "{out}");
    let status = cell.rest("GET", "/status", "").body;
    assert_names_builds(&status["configuration"].to_string());
    let id = cell.load(&lamp);
    let refused = cell.operate(id, "start");
    assert_eq!(
        (refused.status, refused.code()),
        (409, "RCC3008"),
        "{refused:?}"
    );
    assert_names_builds(&refused.error_text());
    assert_names_builds(&await_other_build(
        &cell,
        EventOrigin::Executor,
        "driver io",
    ));
    // The driver of the other device comes from the same build, and still works.
    cell.await_device("lwr", "ready");
    cell.end("io", Signal::SIGTERM);
    cell.start_driver("io");
    cell.await_devices();
    cell.stop();
}

#[test]
fn an_executor_of_another_build_is_refused_by_drivers_loader_and_monitor() {
    let mut cell = UnsupervisedCell::demo();
    cell.end("loader", Signal::SIGTERM);
    cell.end("io", Signal::SIGTERM);
    rebuild(&cell, Role::Executor, "exec");
    cell.start_driver("io");
    cell.start_loader();
    for (method, path, body) in [
        ("GET", "/devices", String::new()),
        ("POST", "/commands", nets::lamp("lamp")),
    ] {
        let refused = cell.rest(method, path, &body);
        assert_eq!(
            (refused.status, refused.code()),
            (502, "RCC4003"),
            "{refused:?}"
        );
        assert_names_builds(&refused.error_text());
    }
    for reporter in [EventOrigin::Driver, EventOrigin::Loader] {
        assert_names_builds(&await_other_build(&cell, reporter, "executor"));
    }
    let mut tail = cell.program("rcc-monitor");
    let tail = tail.arg("tail").output().expect("rcc-monitor runs");
    assert_eq!(tail.status.code(), Some(1));
    assert_names_builds(&String::from_utf8_lossy(&tail.stderr));
    cell.stop();
}
