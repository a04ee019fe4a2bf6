//! Tests the loader's service against a fake executor that only keeps a table: life cycle, names, restarts, and errors
//! without an executor. Each test has a cell of its own.

#[path = "server/fake_executor.rs"]
mod fake_executor;
#[path = "server/refusals.rs"]
mod refusals;
#[path = "server/rules.rs"]
mod rules;
#[path = "server/test_server.rs"]
mod test_server;

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::Path;

use fake_executor::{FakeExecutor, TestCell};
use rcc_api::bodies::{CommandRef, Done, Switch};
use rcc_api::codes;
use rcc_api::command_file::CommandFile;
use rcc_api::messages::NameResolver;
use rcc_core::frame::PrepareFault;
use rcc_core::message::{CommandState, DeviceState};
use rcc_core::path::MotionFault;
use rcc_core::plan::Resource;
use rcc_core::topic::Topic;
use rcc_language::names::{InputNames, Names, TopicNames};
use rcc_loader::server::caller::Caller;
use rcc_loader::server::service::Operation;
use rcc_loader::server::store::CommandStore;
use rcc_protocol::control::{Call, Refusal};
use test_server::{TestServer, ask, config, install, service};

/// Returns a caller without a deadline.
fn without_deadline() -> Caller {
    Caller::default()
}

fn line() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/nets/line.yaml");
    std::fs::read_to_string(path).expect("the net of figure 3")
}

#[test]
fn a_net_is_named_before_the_executor_has_its_plan() {
    let test = TestCell::new("names");
    let executor = FakeExecutor::start(&test.cell, &[], None);
    let service = service(&test.cell);
    let id = service
        .reserve(&without_deadline(), &line())
        .expect("a row is free");
    assert_eq!(
        service
            .detail(&id.to_string(), true)
            .map(|d| d.command.state),
        Ok("loading".into())
    );
    install(&service, id, &line(), "line.yaml");
    assert!(executor.seen.lock().expect("seen").named_before_install);
    let detail = service.detail("line", true).expect("found by its name");
    assert_eq!(
        (detail.command.id, detail.command.state.as_str()),
        (id, "ready")
    );
    assert_eq!(detail.command.uses, ["lwr"]);
    let monitors = detail.names.expect("names").monitors;
    assert_eq!(monitors[0].source, "move.pose");
}

#[test]
fn a_text_with_errors_is_rejected_and_keeps_its_diagnostics() {
    let test = TestCell::new("faults");
    let _executor = FakeExecutor::start(&test.cell, &[], None);
    let service = service(&test.cell);
    let id = service
        .reserve(&without_deadline(), "net: broken\n")
        .expect("a row is free");
    install(&service, id, "net: broken\n", "broken.yaml");
    let command = service
        .detail("broken", true)
        .expect("found by its name")
        .command;
    assert_eq!((command.id, command.state.as_str()), (id, "rejected"));
    let first = command.diagnostics.first().expect("a diagnostic");
    assert!(
        first.code.starts_with("RCC1") && !first.rendered.is_empty(),
        "{first:?}"
    );
}

#[test]
fn a_check_says_what_load_would_say_and_loads_nothing() {
    let test = TestCell::new("check");
    let executor = FakeExecutor::start(&test.cell, &[], None);
    let _served = TestServer::start(&test.cell);
    let (status, valid) = ask(&test.cell, "POST /check?file=line.yaml", line().as_bytes());
    assert_eq!((status, &valid["valid"]), (200, &true.into()), "{valid}");
    assert_eq!(
        (&valid["kind"], &valid["name"]),
        (&"net".into(), &"line".into())
    );
    assert_eq!(valid["uses"][0], "lwr");
    let (status, bad) = ask(&test.cell, "POST /check", b"net: broken\n");
    assert_eq!((status, &bad["valid"]), (200, &false.into()), "{bad}");
    assert_eq!(bad["name"], "broken");
    let shown = bad["diagnostics"][0]["rendered"].as_str();
    assert!(shown.is_some_and(|shown| shown.contains("RCC1")), "{bad}");
    // The files that a configuration names are looked for beside the cell's own.
    let cell = "cell: other\nperiod: 1 ms\ndevices: {arm: {driver: ideal-arm, robot: ../robots/ur5e.yaml}}\n";
    let (_, cell_file) = ask(&test.cell, "POST /check?file=cell.yaml", cell.as_bytes());
    assert_eq!(
        (&cell_file["kind"], &cell_file["valid"]),
        (&"cell".into(), &true.into()),
        "{cell_file}"
    );
    let wrong = cell.replace("ur5e", "ur6e");
    let (_, wrong) = ask(&test.cell, "POST /check?file=cell.yaml", wrong.as_bytes());
    assert_eq!(wrong["valid"], false, "{wrong}");
    assert!(wrong.to_string().contains("ur6e.yaml"), "{wrong}");
    assert_eq!(executor.seen.lock().expect("seen").calls.len(), 0);
}

#[test]
fn a_check_is_refused_where_every_load_would_be() {
    let test = TestCell::new("full");
    let rows: Vec<(u64, CommandState)> = (1..=64).map(|id| (id, CommandState::Ready)).collect();
    let _executor = FakeExecutor::start(&test.cell, &rows, None);
    let service = service(&test.cell);
    let full = service
        .check(&line(), "line.yaml")
        .expect_err("no row is free");
    assert_eq!(full.code.code, codes::TABLE_FULL.code);
}

#[test]
fn a_refused_plan_reports_the_executors_reason_with_names() {
    let test = TestCell::new("refused");
    let refusal = Refusal::Prepare(PrepareFault::HoldUnknown { device: 0 });
    let _executor = FakeExecutor::start(&test.cell, &[], Some(refusal));
    let service = service(&test.cell);
    let id = service
        .reserve(&without_deadline(), &line())
        .expect("a row is free");
    install(&service, id, &line(), "line.yaml");
    let command = service
        .detail(&id.to_string(), true)
        .expect("there")
        .command;
    assert_eq!(command.state, "rejected");
    let last = command.diagnostics.last().expect("a diagnostic");
    assert_eq!(last.code, codes::NOT_PREPARED.code);
    assert!(
        last.message
            .contains("the position of lwr is not known: it is offline (no driver is attached)"),
        "{last:?}"
    );
    // START of what is rejected gives that reason as well.
    let refused = service
        .operate(&without_deadline(), &id.to_string(), Operation::START)
        .expect_err("rejected");
    assert_eq!(refused.code.code, codes::WRONG_STATE.code);
    assert!(
        refused.message.contains("(no driver is attached)"),
        "{refused:?}"
    );
}

#[test]
fn a_loader_does_not_reject_what_it_loads_itself_while_it_attaches() {
    let test = TestCell::new("attaches");
    let executor = FakeExecutor::start(&test.cell, &[], None);
    // The first attached thread removes these, and the other one reserves an id meanwhile.
    for dead in 1..1000 {
        let folder = test.cell.commands_dir().join(format!("{dead:016x}"));
        std::fs::create_dir_all(&folder).expect("created");
        std::fs::write(folder.join("1.json"), "{}").expect("written");
    }
    let service = service(&test.cell);
    executor.hold(true);
    std::thread::scope(|scope| {
        let attaches = scope.spawn(|| service.list());
        let loads = scope.spawn(|| service.reserve(&without_deadline(), &line()));
        // Its command is in the executor's table, but it does not know the id yet.
        executor.wait_for_calls(1, |_| true);
        assert!(attaches.join().expect("no panic").is_ok());
        executor.hold(false);
        loads.join().expect("no panic").expect("a row is free");
    });
    let calls = &executor.seen.lock().expect("seen").calls;
    assert!(matches!(calls.as_slice(), [Call::Reserve]), "{calls:?}");
}

#[test]
fn a_restarted_loader_rejects_what_a_dead_one_was_loading_and_keeps_names() {
    let test = TestCell::new("restart");
    let rows = [(5, CommandState::Loading), (6, CommandState::Running)];
    let executor = FakeExecutor::start(&test.cell, &rows, None);
    let store = CommandStore::of(&test.cell, executor.incarnation);
    let running = CommandFile {
        id: 6,
        net: "weld".into(),
        ..CommandFile::default()
    };
    store.write(&running).expect("written");
    let service = service(&test.cell);
    let weld = service
        .detail("weld", true)
        .expect("found by its name")
        .command;
    assert_eq!((weld.id, weld.state.as_str()), (6, "running"));
    let orphan = service.detail("5", true).expect("there").command;
    assert_eq!(orphan.state, "rejected");
    assert_eq!(orphan.diagnostics[0].code, codes::LOADER_DIED.code);
    let calls = &executor.seen.lock().expect("seen").calls;
    assert!(
        matches!(calls.as_slice(), [Call::Reject { id: 5 }]),
        "{calls:?}"
    );
}

#[test]
fn a_hand_over_resolves_names_and_ids_to_active_and_ready_commands() {
    let test = TestCell::new("handover");
    let rows = [
        (3, CommandState::Running),
        (4, CommandState::Ready),
        (5, CommandState::Ready),
    ];
    let executor = FakeExecutor::start(&test.cell, &rows, None);
    let store = CommandStore::of(&test.cell, executor.incarnation);
    for (id, net) in [(3, "line"), (4, "line"), (5, "lamp")] {
        let file = CommandFile {
            id,
            net: net.to_owned(),
            ..CommandFile::default()
        };
        store.write(&file).expect("written");
    }
    let service = service(&test.cell);
    let line = || CommandRef::Name("line".to_owned());
    let switched = service.switch(
        &without_deadline(),
        &Switch {
            stop: vec![line()],
            start: vec![line(), CommandRef::Id(5)],
            ..Switch::default()
        },
    );
    let switched = switched.expect("done");
    let ids = |rows: &[Done]| rows.iter().map(|done| done.id).collect::<Vec<_>>();
    assert_eq!(
        (
            switched.cycle,
            ids(&switched.stopped),
            ids(&switched.started)
        ),
        (8, vec![3], vec![4, 5])
    );
    let last = executor.seen.lock().expect("seen").calls.last().cloned();
    assert!(
        matches!(&last, Some(Call::Switch { stop, start, .. }) if *stop == [3] && *start == [4, 5]),
        "{last:?}"
    );
    let nothing = service
        .switch(&without_deadline(), &Switch::default())
        .expect_err("nothing named");
    assert_eq!(nothing.code, codes::BAD_REQUEST);
    let nine = Switch {
        stop: vec![line(); 9],
        ..Switch::default()
    };
    assert_eq!(
        service
            .switch(&without_deadline(), &nine)
            .expect_err("too many")
            .code,
        codes::NAMED_TWICE
    );
    let unknown = Switch {
        stop: vec![line()],
        start: vec![CommandRef::Name("nobody".to_owned())],
        ..Switch::default()
    };
    assert_eq!(
        service
            .switch(&without_deadline(), &unknown)
            .expect_err("unknown")
            .code,
        codes::UNKNOWN_COMMAND
    );
}

#[test]
fn a_hand_over_can_be_requested_with_start_or_alone() {
    let test = TestCell::new("switch");
    let rows = [
        (1, CommandState::Running),
        (2, CommandState::Ready),
        (3, CommandState::Ready),
        (4, CommandState::Ready),
    ];
    let executor = FakeExecutor::start(&test.cell, &rows, None);
    let _served = TestServer::start(&test.cell);
    let asked = |head: &str, body: &str| ask(&test.cell, head, body.as_bytes());
    let (status, body) = asked("POST /commands/2/start", r#"{"after_stopping": [1]}"#);
    assert_eq!(
        (status, &body["id"], &body["cycle"]),
        (200, &2.into(), &8.into())
    );
    let (status, body) = asked("POST /switch", r##"{"stop": ["#2"], "start": ["3"]}"##);
    assert_eq!(
        (status, &body["started"][0]["id"]),
        (200, &3.into()),
        "{body}"
    );
    assert_eq!(asked("POST /commands/4/start", "{}").0, 200);
    for (head, body) in [
        ("POST /commands/2/start", r#"{"after": [1]}"#),
        ("POST /switch", "stop: [1]"),
        ("POST /switch", "{}"),
    ] {
        let (status, answer) = asked(head, body);
        assert_eq!(
            (status, &answer["code"]),
            (400, &"RCC4011".into()),
            "{answer}"
        );
    }
    let calls = &executor.seen.lock().expect("seen").calls;
    let switch = |stop: u64, start: u64| Call::Switch {
        stop: vec![stop],
        start: vec![start],
        lease: 0,
    };
    let wanted = [switch(1, 2), switch(2, 3), Call::Start { id: 4, lease: 0 }];
    assert_eq!(format!("{calls:?}"), format!("{wanted:?}"));
}

#[test]
fn an_operation_applies_to_the_newest_suitable_net_of_a_name() {
    let test = TestCell::new("newest");
    let rows = [(3, CommandState::Running), (4, CommandState::Ready)];
    let executor = FakeExecutor::start(&test.cell, &rows, None);
    let store = CommandStore::of(&test.cell, executor.incarnation);
    for id in [3, 4] {
        let net = "line".to_owned();
        store
            .write(&CommandFile {
                id,
                net,
                ..CommandFile::default()
            })
            .expect("written");
    }
    let service = service(&test.cell);
    assert_eq!(
        service
            .operate(&without_deadline(), "line", Operation::Abort)
            .map(|done| done.id),
        Ok(3)
    );
    assert_eq!(
        service
            .operate(&without_deadline(), "line", Operation::START)
            .map(|done| done.id),
        Ok(4)
    );
    assert_eq!(
        service.detail("line", true).map(|detail| detail.command.id),
        Ok(4)
    );
}

#[test]
fn an_unloaded_net_leaves_no_file() {
    let test = TestCell::new("unload");
    let executor = FakeExecutor::start(&test.cell, &[], None);
    let service = service(&test.cell);
    let id = service
        .reserve(&without_deadline(), &line())
        .expect("a row is free");
    install(&service, id, &line(), "line.yaml");
    let refused = service
        .operate(&without_deadline(), "line", Operation::Cancel)
        .map_err(|error| error.code);
    assert_eq!(refused.map(|done| done.id), Err(codes::NOT_CANCELABLE));
    service
        .operate(&without_deadline(), "line", Operation::Unload)
        .expect("it is not active");
    let store = CommandStore::of(&test.cell, executor.incarnation);
    assert_eq!(store.read(id), None);
    assert_eq!(
        service.detail("line", true).map_err(|error| error.code),
        Err(codes::UNKNOWN_COMMAND)
    );
}

/// A client that follows a net of somebody else's may ask between the executor's last table with it and the loader's answer.
#[test]
fn how_a_net_ended_is_known_while_it_is_being_unloaded() {
    let test = TestCell::new("ended");
    let executor = FakeExecutor::start(&test.cell, &[(4, CommandState::Terminated)], None);
    let service = service(&test.cell);
    executor.hold(true);
    let found = std::thread::scope(|scope| {
        let unload = || service.operate(&without_deadline(), "4", Operation::Unload);
        let unloading = scope.spawn(unload);
        while service.detail("4", true).is_ok() {
            std::thread::yield_now();
        }
        let found = service.detail_or_unloaded("4");
        executor.hold(false);
        let done = unloading.join().expect("it does not panic");
        assert_eq!(done.map(|done| done.id), Ok(4));
        found
    });
    let ended = found.map(|found| (found.command.state, found.command.reason));
    assert_eq!(ended, Ok(("terminated".into(), Some("finished".into()))));
}

#[test]
fn a_lost_executor_is_reported_and_the_next_one_is_found() {
    let test = TestCell::new("gone");
    let service = service(&test.cell);
    let missing = service.list().map_err(|error| error.code);
    assert_eq!(missing, Err(codes::NO_EXECUTOR));
    let _executor = FakeExecutor::start(&test.cell, &[(1, CommandState::Ready)], None);
    assert_eq!(service.list().map(|all| all.len()), Ok(1));
    let status = service.status().expect("an executor");
    assert_eq!((status.executor.cycle, status.executor.fifo), (7, true));
    assert!(status.executor.grade.starts_with("RT: granted"));
    let devices = service.devices().expect("an executor");
    assert_eq!(
        (devices[0].name.as_str(), devices[0].state.as_str()),
        ("lwr", "ready")
    );
}

#[test]
fn without_an_executor_every_route_reports_it_and_the_catalogue_is_available() {
    let test = TestCell::new("rest");
    let cell = test.cell.clone();
    let _served = TestServer::start(&cell);
    // One client connects and sends nothing, another sends garbage.
    let _silent = UnixStream::connect(cell.socket()).expect("connected");
    let mut nonsense = UnixStream::connect(cell.socket()).expect("connected");
    nonsense.write_all(b"\x00\xff\r\n\r\n").expect("sent");
    for head in [
        "GET /commands",
        "POST /commands",
        "GET /commands/1",
        "POST /commands/1/start",
        "POST /commands/1/cancel",
        "POST /commands/1/abort",
        "DELETE /commands/1",
        "GET /devices",
        "GET /status",
    ] {
        let text: &[u8] = if head == "POST /commands" {
            b"net: x"
        } else {
            b""
        };
        let (status, body) = ask(&cell, head, text);
        assert_eq!((status, &body["code"]), (503, &"RCC4001".into()), "{head}");
    }
    let (status, catalogue) = ask(&cell, "GET /primitives", b"");
    assert_eq!(
        (
            status,
            catalogue.as_array().is_some_and(|all| all.len() > 30)
        ),
        (200, true)
    );
    assert_eq!(ask(&cell, "GET /openapi.json", b"").0, 200);
    assert_eq!(ask(&cell, "GET /nothing", b"").1["code"], "RCC4007");
    assert_eq!(ask(&cell, "PUT /commands", b"").1["code"], "RCC4018");
    assert_eq!(
        ask(&cell, "POST /commands", b"\xff\xfe").1["code"],
        "RCC4011"
    );
}
