//! Requests between threads and processes. Run by the test program's threads and by child processes of it.

mod common;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use common::{LIMIT, Peer, TestCell, part, refused, run_janitor, wait_for};
use rcc_ipc::{AnswerError, CallError, Client, RequestError, Server, Session};
use rcc_protocol::Role;
use rcc_protocol::control::{REQUEST_MAX, RESPONSE_MAX};

const SOON: Duration = Duration::from_millis(50);

/// The child process.
#[test]
fn peer() {
    let Some((part, cell, label)) = part() else {
        return;
    };
    let session = Session::join(&cell, Role::Driver, &label).unwrap();
    if let Some(service) = part.strip_prefix("call ") {
        // A client that calls until it is killed, with requests of all sizes.
        let client = session.client(service).unwrap();
        let _announced = cell.announce(&session.announcement()).unwrap();
        for size in (0..).step_by(1000) {
            client.call(&vec![7; size % 100_000], LIMIT).unwrap();
        }
        return;
    }
    let server = session.serve("ask").unwrap();
    let announcement = session.announcement().service("ask", server.service());
    let _announced = cell.announce(&announcement).unwrap();
    loop {
        match (server.poll().unwrap(), part.as_str()) {
            (Some(request), "echo") => request.clone_answer(),
            (Some(request), _) => std::mem::forget(request),
            (None, _) => std::thread::yield_now(),
        }
    }
}

trait CloneAnswer {
    fn clone_answer(self);
}

impl CloneAnswer for rcc_ipc::Request {
    /// Answers with the received bytes, truncated to the maximum length.
    fn clone_answer(self) {
        let bytes = self.bytes()[..self.bytes().len().min(RESPONSE_MAX)].to_vec();
        self.answer(&bytes).unwrap();
    }
}

/// Runs `ask` while another thread echoes every request.
fn while_echoing(server: &Server, ask: impl FnOnce()) {
    let end = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !end.load(Ordering::Relaxed) {
                match server.poll().unwrap() {
                    Some(request) => request.clone_answer(),
                    None => std::thread::yield_now(),
                }
            }
        });
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(ask));
        end.store(true, Ordering::Relaxed);
        if let Err(panic) = outcome {
            std::panic::resume_unwind(panic);
        }
    });
}

fn in_one_process(cell: &TestCell) -> (Session, Server, Client) {
    let session = Session::join(cell, Role::Loader, "loader").unwrap();
    let server = session.serve("ask").unwrap();
    let client = session.client(server.service()).unwrap();
    (session, server, client)
}

#[test]
fn an_answer_comes_back_from_another_process() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Loader, "loader").unwrap();
    let (_peer, announcement) = Peer::announced(&cell, "echo", "lwr");
    let client = session.client(&announcement.services["ask"]).unwrap();
    for size in [0, 1, 100, 4095, 4096, 5000, RESPONSE_MAX, 300_000, 3] {
        let request: Vec<u8> = (0..size).map(|index| index as u8).collect();
        let answer = client.call(&request, LIMIT).unwrap();
        assert_eq!(answer, request[..size.min(RESPONSE_MAX)]);
    }
}

#[test]
fn the_longest_request_arrives_and_a_longer_one_is_refused() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    while_echoing(&server, || {
        let mut request = vec![1; REQUEST_MAX];
        assert_eq!(client.call(&request, LIMIT).unwrap(), vec![1; RESPONSE_MAX]);
        request.push(1);
        let error = refused(client.call(&request, LIMIT));
        assert!(
            matches!(error, CallError::TooLarge { size, max: REQUEST_MAX } if size == REQUEST_MAX + 1)
        );
        assert_eq!(client.call(b"still here", LIMIT).unwrap(), b"still here");
    });
}

#[test]
fn a_long_request_leaves_no_file_and_maps_no_more_than_a_short_one() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    while_echoing(&server, || {
        client.call(b"short", LIMIT).unwrap();
        let sizes = || -> (usize, u64) {
            let all = cell.leftovers().unwrap();
            let bytes = all.iter().map(|path| path.metadata().unwrap().len());
            (all.len(), bytes.sum())
        };
        let before = sizes();
        assert!(before.1 < 2 << 20, "a server and a client take {before:?}");
        assert_eq!(
            client.call(&vec![1; REQUEST_MAX], LIMIT).unwrap().len(),
            RESPONSE_MAX
        );
        assert_eq!(sizes(), before);
    });
}

#[test]
fn the_janitor_removes_spill_files_of_killed_clients_and_timed_out_requests_leave_none() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    let files = || -> Vec<_> {
        let mut all = cell.leftovers().unwrap();
        all.retain(|path| {
            path.file_name()
                .unwrap()
                .to_string_lossy()
                .starts_with("request-")
        });
        all
    };
    refused(client.call(&vec![1; REQUEST_MAX], SOON));
    assert_eq!(files().len(), 0);
    // As a killed process leaves it: no process has this start time.
    let dead = format!("{:016x}-0", u64::from(std::process::id()));
    let orphans = ["request", "wake"].map(|kind| cell.iox_root().join(format!("{kind}-{dead}")));
    for orphan in &orphans {
        std::fs::write(orphan, "").unwrap();
    }
    run_janitor(&cell).unwrap();
    assert!(orphans.iter().all(|orphan| !orphan.exists()));
    drop(server);
}

#[test]
fn an_answer_too_long_is_refused_and_the_client_told() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    std::thread::scope(|scope| {
        let call = scope.spawn(|| client.call(b"?", LIMIT));
        let request = wait_for(|| server.poll().unwrap());
        let error = refused(request.answer(&vec![0; RESPONSE_MAX + 1]));
        assert!(matches!(error, AnswerError::TooLarge { .. }), "{error}");
        let error = refused(call.join().unwrap());
        assert!(matches!(error, CallError::Unanswered { .. }), "{error}");
    });
}

#[test]
fn a_request_may_be_answered_later_and_by_another_thread() {
    let cell = TestCell::new();
    let (session, server, first) = in_one_process(&cell);
    let second = session.client(server.service()).unwrap();
    std::thread::scope(|scope| {
        let one = scope.spawn(|| first.call(b"one", LIMIT));
        let kept = wait_for(|| server.poll().unwrap());
        let two = scope.spawn(|| second.call(b"two", LIMIT));
        wait_for(|| server.poll().unwrap()).answer(b"2").unwrap();
        assert_eq!(two.join().unwrap().unwrap(), b"2");
        assert_eq!(kept.bytes(), b"one");
        scope.spawn(move || kept.answer(b"1").unwrap());
        assert_eq!(one.join().unwrap().unwrap(), b"1");
    });
}

#[test]
fn a_server_that_hangs_causes_a_timeout_and_can_serve_again() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    for _ in 0..10 {
        let error = refused(client.call(b"nobody looks", SOON));
        assert!(
            matches!(error, CallError::Timeout { waited: SOON, .. }),
            "{error}"
        );
    }
    while_echoing(&server, || {
        assert_eq!(client.call(b"now", LIMIT).unwrap(), b"now")
    });
}

#[test]
fn requests_that_were_given_up_are_not_served() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    refused(client.call(b"given up", SOON));
    assert!(server.poll().unwrap().is_none());
}

#[test]
fn an_answer_to_a_request_given_up_is_not_taken_for_the_next_one() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    let taken = AtomicBool::new(false);
    std::thread::scope(|scope| {
        // Call until the server holds a request that its client has given up.
        let call = scope.spawn(|| {
            while !taken.load(Ordering::Relaxed) {
                let error = refused(client.call(b"old", SOON));
                assert!(matches!(error, CallError::Timeout { .. }), "{error}");
            }
        });
        let kept = wait_for(|| server.poll().unwrap());
        taken.store(true, Ordering::Relaxed);
        call.join().unwrap();
        assert!(!kept.is_awaited());
        let next = scope.spawn(|| client.call(b"new", LIMIT));
        let request = wait_for(|| server.poll().unwrap());
        kept.answer(b"to the old one").unwrap();
        request.answer(b"to the new one").unwrap();
        assert_eq!(next.join().unwrap().unwrap(), b"to the new one");
    });
}

#[test]
fn a_server_that_was_closed_is_gone() {
    let cell = TestCell::new();
    let (session, server, client) = in_one_process(&cell);
    let service = server.service().to_owned();
    drop(server);
    let error = refused(client.call(b"?", LIMIT));
    assert!(matches!(error, CallError::ServerGone { .. }), "{error}");
    drop(client);
    let error = refused(session.client(&service));
    assert!(
        matches!(error, RequestError::DoesNotExist { .. }),
        "{error}"
    );
}

#[test]
fn a_server_closed_while_it_holds_the_request_is_gone() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    std::thread::scope(|scope| {
        let call = scope.spawn(|| client.call(b"?", LIMIT));
        let request = wait_for(|| server.poll().unwrap());
        drop(server);
        drop(request);
        let error = refused(call.join().unwrap());
        assert!(matches!(error, CallError::ServerGone { .. }), "{error}");
    });
}

#[test]
fn a_server_killed_while_it_holds_the_request_is_gone() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Loader, "loader").unwrap();
    let (peer, announcement) = Peer::announced(&cell, "hang", "lwr");
    let client = session.client(&announcement.services["ask"]).unwrap();
    std::thread::scope(|scope| {
        let call = scope.spawn(|| client.call(b"?", LIMIT));
        peer.kill();
        let error = refused(call.join().unwrap());
        assert!(matches!(error, CallError::ServerGone { .. }), "{error}");
    });
    let error = refused(client.call(b"again", LIMIT));
    assert!(matches!(error, CallError::ServerGone { .. }), "{error}");
}

#[test]
fn eight_clients_are_served_at_once() {
    let cell = TestCell::new();
    let (session, server, _client) = in_one_process(&cell);
    while_echoing(&server, || {
        std::thread::scope(|scope| {
            for index in 0..8_u8 {
                let client = session.client(server.service()).unwrap();
                scope.spawn(move || {
                    for size in (0..200).map(|step| step * 81) {
                        let request = vec![index; size];
                        assert_eq!(client.call(&request, LIMIT).unwrap(), request);
                    }
                });
            }
        });
    });
}

#[test]
fn killed_clients_change_nothing_for_the_server_and_leave_nothing() {
    let cell = TestCell::new();
    let (_session, server, client) = in_one_process(&cell);
    let part = format!("call {}", server.service());
    while_echoing(&server, || {
        assert_eq!(
            client.call(&[5; 200_000], LIMIT).unwrap(),
            [5; RESPONSE_MAX]
        );
        run_janitor(&cell).unwrap();
        let before = cell.files();
        for _ in 0..20 {
            let (peer, _) = Peer::announced(&cell, &part, "caller");
            peer.kill();
            assert_eq!(client.call(b"me too", LIMIT).unwrap(), b"me too");
            run_janitor(&cell).unwrap();
        }
        assert_eq!(client.call(b"and now", LIMIT).unwrap(), b"and now");
        run_janitor(&cell).unwrap();
        assert_eq!(cell.files(), before, "only files of live processes remain");
    });
}
