//! Tests that no load leaves a row of the executor's table behind that nobody knows, and that one client's loads do not
//! keep out those of others. Each test has a cell of its own.

#[path = "server/fake_executor.rs"]
#[allow(dead_code)]
mod fake_executor;
#[path = "server/test_server.rs"]
mod test_server;

use std::io::{Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use fake_executor::{FakeExecutor, TestCell};
use rcc_api::codes;
use rcc_loader::server::caller::Caller;
use rcc_protocol::control::Call;
use test_server::{LIMIT, TestServer, ask, service};

const TEXT: &str = "net: small\nprimitives:\n  cancel: {type: Cancel}\n  \
                    end: {type: Termination, inputs: {done: cancel.requested}}\n";

fn is_reserve(call: &Call) -> bool {
    matches!(call, Call::Reserve)
}

#[test]
fn a_load_whose_client_goes_before_it_is_told_the_id_leaves_no_row() {
    let test = TestCell::new("gone");
    let executor = FakeExecutor::start(&test.cell, &[], None);
    let _served = TestServer::start(&test.cell);
    executor.hold(true);
    let mut stream = UnixStream::connect(test.cell.socket()).expect("connected");
    stream.set_read_timeout(Some(LIMIT)).expect("a time limit");
    let length = TEXT.len();
    let head = format!("POST /commands HTTP/1.1\r\nhost: x\r\ncontent-length: {length}\r\n\r\n");
    stream.write_all(head.as_bytes()).expect("sent");
    stream.write_all(TEXT.as_bytes()).expect("sent");
    executor.wait_for_calls(1, is_reserve);
    stream.shutdown(Shutdown::Write).expect("open until now");
    // The loader has noticed that the client is gone when it closes the connection.
    let mut nothing = Vec::new();
    stream.read_to_end(&mut nothing).expect("closed");
    assert!(nothing.is_empty(), "{nothing:?}");
    executor.hold(false);
    executor.wait_for_calls(1, |call| matches!(call, Call::Unload { id: 101 }));
    assert_eq!(
        executor.count(|call| matches!(call, Call::Install { .. })),
        0
    );
    let (status, commands) = ask(&test.cell, "GET /commands", b"");
    assert_eq!((status, commands), (200, serde_json::json!([])));
}

#[test]
fn a_reservation_whose_answer_came_too_late_is_rejected_after_a_while() {
    let test = TestCell::new("late");
    let executor = FakeExecutor::start(&test.cell, &[], None);
    let service = service(&test.cell);
    // The first call attaches, and rejects the commands that a dead loader was loading.
    service.list().expect("a list");
    executor.hold(true);
    let soon = Caller::until(Some(Instant::now() + Duration::from_millis(50)));
    assert!(service.reserve(&soon, TEXT).is_err());
    executor.hold(false);
    let known = service.reserve(&Caller::default(), TEXT);
    let is_reject = |call: &Call| matches!(call, Call::Reject { .. });
    service.reject_unclaimed(Duration::from_secs(3600));
    assert_eq!(executor.count(is_reject), 0, "it may still be on its way");
    service.reject_unclaimed(Duration::ZERO);
    assert_eq!(
        executor.count(|call| matches!(call, Call::Reject { id: 101 })),
        1
    );
    assert_eq!(executor.count(is_reject), 1, "{known:?} is being loaded");
    let lost = service.detail("101", true).expect("there").command;
    assert_eq!(
        (lost.state.as_str(), lost.diagnostics[0].code.as_str()),
        ("rejected", codes::GIVEN_UP.code)
    );
}
