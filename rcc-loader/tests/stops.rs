//! Tests that CANCEL, ABORT and requests by name are not delayed by loads in flight, missing files, exhausted quotas,
//! or clients that are gone. Each test has a cell of its own.

#[path = "server/fake_executor.rs"]
#[allow(dead_code)]
mod fake_executor;
#[path = "server/test_server.rs"]
mod test_server;

use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use fake_executor::{FakeExecutor, TestCell};
use rcc_api::codes;
use rcc_api::command_file::CommandFile;
use rcc_core::message::CommandState;
use rcc_ipc::Cell;
use rcc_loader::server::bodies::SET_TEXT_MAX;
use rcc_loader::server::caller::Caller;
use rcc_loader::server::connection::UNIX;
use rcc_loader::server::service::Operation;
use rcc_loader::server::store::CommandStore;
use rcc_protocol::control::Call;
use test_server::{LIMIT, TestServer, answer, ask, install, service};

fn line() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/nets/line.yaml");
    std::fs::read_to_string(path).expect("the net of figure 3")
}

/// Starts a fake executor with commands in these states and with these names, as a dead loader left them.
fn commands(test: &TestCell, rows: &[(u64, CommandState, &str)]) -> FakeExecutor {
    let states: Vec<_> = rows.iter().map(|(id, state, _)| (*id, *state)).collect();
    let executor = FakeExecutor::start(&test.cell, &states, None);
    let store = CommandStore::of(&test.cell, executor.incarnation);
    for (id, _, net) in rows {
        let file = CommandFile {
            id: *id,
            net: (*net).to_owned(),
            ..CommandFile::default()
        };
        store.write(&file).expect("written");
    }
    executor
}

fn send(cell: &Cell, head: &str, lines: &str, body: &[u8]) -> UnixStream {
    let mut stream = UnixStream::connect(cell.socket()).expect("connected");
    stream.set_read_timeout(Some(LIMIT)).expect("a time limit");
    let length = body.len();
    let head = format!(
        "{head} HTTP/1.1\r\nhost: x\r\nconnection: close\r\n{lines}content-length: {length}\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).expect("sent");
    stream.write_all(body).expect("sent");
    stream
}

fn is_start(call: &Call) -> bool {
    matches!(call, Call::Start { .. })
}

#[test]
fn requests_by_name_need_no_file() {
    let test = TestCell::new("no-file");
    let rows = [
        (3, CommandState::Ready, "lamp"),
        (4, CommandState::Running, "weld"),
    ];
    let executor = commands(&test, &rows);
    let service = service(&test.cell);
    let id = service
        .reserve(&Caller::default(), &line())
        .expect("a row is free");
    install(&service, id, &line(), "line.yaml");
    std::fs::remove_dir_all(test.cell.commands_dir()).expect("removed");
    let names: Vec<String> = service
        .list()
        .expect("a list")
        .into_iter()
        .map(|row| row.net)
        .collect();
    assert_eq!(names, ["lamp", "weld", "line"]);
    let done = |name, what| {
        service
            .operate(&Caller::default(), name, what)
            .map(|done| done.net)
    };
    assert_eq!(done("weld", Operation::Abort), Ok("weld".to_owned()));
    assert_eq!(done("line", Operation::START), Ok("line".to_owned()));
    assert_eq!(
        service
            .detail("lamp", false)
            .map(|detail| detail.command.id),
        Ok(3)
    );
    drop(executor);
}

#[test]
fn an_abort_does_not_wait_for_a_load_that_the_executor_has_not_answered() {
    let test = TestCell::new("in-flight");
    let executor = commands(&test, &[(4, CommandState::Running, "weld")]);
    let service = Arc::new(service(&test.cell));
    let id = service
        .reserve(&Caller::default(), &line())
        .expect("a row is free");
    executor.hold(true);
    let loading = {
        let service = Arc::clone(&service);
        std::thread::spawn(move || install(&service, id, &line(), "line.yaml"))
    };
    executor.wait_for_calls(1, |call| matches!(call, Call::Install { .. }));
    let done = service.operate(&Caller::default(), "weld", Operation::Abort);
    assert_eq!(done.map(|done| done.id), Ok(4));
    assert!(!loading.is_finished(), "the load is still in flight");
    executor.hold(false);
    loading.join().expect("loaded");
}

#[test]
fn a_request_that_was_given_up_is_not_started_but_an_abort_is() {
    let test = TestCell::new("given-up");
    let rows = [
        (3, CommandState::Ready, "lamp"),
        (4, CommandState::Running, "weld"),
    ];
    let executor = commands(&test, &rows);
    let service = service(&test.cell);
    let over = Caller::until(Some(Instant::now()));
    let start = service.operate(&over, "lamp", Operation::START);
    assert_eq!(start.map_err(|error| error.code), Err(codes::GIVEN_UP));
    assert_eq!(executor.count(is_start), 0);
    let abort = service.operate(&over, "weld", Operation::Abort);
    assert_eq!(abort.map(|done| done.id), Ok(4));
}

#[test]
fn a_request_whose_client_left_before_its_turn_is_not_done() {
    let test = TestCell::new("left");
    let rows = [
        (3, CommandState::Ready, "lamp"),
        (4, CommandState::Ready, "weld"),
    ];
    let executor = commands(&test, &rows);
    let _served = TestServer::start(&test.cell);
    executor.hold(true);
    let first = send(&test.cell, "POST /commands/lamp/start", "", b"");
    executor.wait_for_calls(1, is_start);
    // This request waits for the first one, and announces how long it waits.
    let pending = send(
        &test.cell,
        "POST /commands/weld/start",
        "rcc-timeout-ms: 50\r\n",
        b"",
    );
    let left = send(&test.cell, "POST /commands/weld/start", "", b"");
    // The loader has received its head and body when it has answered a request that came later.
    assert_eq!(ask(&test.cell, "GET /commands/weld?brief=true", b"").0, 200);
    // One that came later and waits as long, for the executor itself: when it is given up, so is the pending one.
    let later = send(
        &test.cell,
        "POST /leases",
        "rcc-timeout-ms: 50\r\n",
        br#"{"expires_ms": 60000}"#,
    );
    let (status, body) = answer(later);
    assert_eq!(status, 504, "{body}");
    drop(left);
    assert_eq!(ask(&test.cell, "GET /commands/weld?brief=true", b"").0, 200);
    executor.hold(false);
    assert_eq!(answer(first).0, 200);
    let (status, body) = answer(pending);
    assert_eq!((status, &body["code"]), (504, &"RCC4022".into()), "{body}");
    assert_eq!(ask(&test.cell, "POST /commands/3/start", b"").0, 200);
    let starts =
        |id: u64| executor.count(|call| matches!(call, Call::Start { id: of, .. } if *of == id));
    assert_eq!((starts(3), starts(4)), (2, 0));
}

#[test]
fn a_client_that_has_used_up_its_quota_can_still_abort() {
    let test = TestCell::new("places");
    let rows = [
        (3, CommandState::Ready, "lamp"),
        (4, CommandState::Running, "weld"),
    ];
    let executor = commands(&test, &rows);
    let _served = TestServer::start(&test.cell);
    assert_eq!(ask(&test.cell, "GET /commands", b"").0, 200);
    executor.hold(true);
    let held: Vec<_> = (0..UNIX.connections_of_peer)
        .map(|_| send(&test.cell, "POST /commands/lamp/start", "", b""))
        .collect();
    let begun = Instant::now();
    while ask(&test.cell, "GET /primitives", b"").0 != 429 {
        assert!(begun.elapsed() < LIMIT, "never too many");
    }
    let (status, body) = ask(&test.cell, "POST /commands/weld/abort", b"");
    assert_eq!((status, &body["id"]), (200, &4.into()), "{body}");
    executor.hold(false);
    assert!(held.into_iter().all(|stream| answer(stream).0 == 200));
}

#[test]
fn each_route_limits_the_size_of_its_body() {
    let test = TestCell::new("bodies");
    let rows = [
        (3, CommandState::Ready, "lamp"),
        (4, CommandState::Running, "weld"),
    ];
    let _executor = commands(&test, &rows);
    let _served = TestServer::start(&test.cell);
    let long = vec![b' '; SET_TEXT_MAX + 1];
    for (head, body) in [
        ("POST /commands/lamp/start", &long[..]),
        ("POST /switch", &long),
        ("PUT /commands/lamp/inputs", &long),
        ("GET /commands", b"{}"),
        ("DELETE /commands/lamp", b"{}"),
        ("GET /primitives", b"{}"),
        ("POST /incidents", b"{}"),
    ] {
        let (status, body) = ask(&test.cell, head, body);
        assert_eq!((status, &body["code"]), (413, &"RCC4006".into()), "{head}");
    }
    // A request to stop the arm is not refused because of its body.
    assert_eq!(ask(&test.cell, "POST /commands/weld/abort", &long).0, 200);
}
