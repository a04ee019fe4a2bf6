//! Connections that are kept open: each request on them is checked and counted like one on a connection of its own, and
//! idle ones take nothing from others.

use std::io::{BufRead, BufReader, Read, Write};

use rcc_core::message::CommandState;

use super::*;
use crate::fake_executor::FakeExecutor;

/// Sends a request and reads its answer, and no more; returns the status and whether the server closes the connection.
fn exchange_one<S: Read + Write>(stream: &mut BufReader<S>, request: &str) -> (u16, bool) {
    stream.get_mut().write_all(request.as_bytes()).unwrap();
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        assert_ne!(stream.read_line(&mut head).unwrap(), 0, "closed: {head}");
    }
    let head = head.to_lowercase();
    let length = head
        .lines()
        .find_map(|line| line.strip_prefix("content-length: "));
    let mut body = vec![0; length.map_or(0, |length| length.parse().unwrap())];
    stream.read_exact(&mut body).unwrap();
    let status = head
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    (status.unwrap(), head.contains("connection: close"))
}

fn kept(line: &str, lines: &str) -> String {
    format!("{line} HTTP/1.1\r\nhost: x\r\n{lines}\r\n")
}

#[test]
fn a_connection_carries_requests_until_the_client_closes_it() {
    let test = TestCell::new("kept");
    let _served = TestServer::start(&test.cell);
    let mut stream = BufReader::new(connect(&test.cell));
    for _ in 0..50 {
        let constant = kept("GET /primitives", "");
        assert_eq!(exchange_one(&mut stream, &constant), (200, false));
        let set = kept("PUT /commands/x/inputs", "content-length: 2\r\n") + "{}";
        assert_eq!(exchange_one(&mut stream, &set), (503, false), "no executor");
    }
    let last = kept("GET /primitives", "connection: close\r\n");
    assert_eq!(exchange_one(&mut stream, &last), (200, true));
    assert_eq!(stream.read(&mut [0]).unwrap(), 0, "closed");
}

#[test]
fn each_request_of_a_kept_open_connection_needs_the_token_and_counts() {
    let test = TestCell::new("counted");
    let served = TestServer::with(&test.cell, &tcp(&test.cell));
    let address = served.address.unwrap();
    let mut stream = BufReader::new(connect_from(1, address));
    let right = kept("GET /nothing", &with_token());
    assert_eq!(exchange_one(&mut stream, &right), (404, false));
    let wrong = kept("GET /nothing", "");
    assert_eq!(exchange_one(&mut stream, &wrong), (401, true));
    assert_eq!(stream.read(&mut [0]).unwrap(), 0, "closed");
    let mut stream = BufReader::new(connect_from(1, address));
    let limit = Instant::now() + LIMIT;
    let refused = loop {
        let answer = exchange_one(&mut stream, &right);
        if answer != (404, false) {
            break answer;
        }
        assert!(Instant::now() < limit, "never refused");
    };
    assert_eq!(refused, (429, true), "too many requests per second");
}

#[test]
fn a_request_that_is_answered_before_its_body_has_arrived_closes_the_connection() {
    let test = TestCell::new("unread");
    let _served = TestServer::start(&test.cell);
    let mut stream = BufReader::new(connect(&test.cell));
    let large = kept("GET /primitives", "content-length: 100\r\n");
    assert_eq!(exchange_one(&mut stream, &large), (413, true));
    // These bytes belong to the body of the refused request, so they are not read as another request.
    let _ = stream
        .get_mut()
        .write_all(kept("GET /primitives", "").as_bytes());
    let mut rest = Vec::new();
    let _ = stream.read_to_end(&mut rest);
    assert_eq!(String::from_utf8_lossy(&rest), "");
}

#[test]
fn idle_connections_give_way_and_an_abort_is_carried_out_beside_them() {
    let test = TestCell::new("idle");
    let rows = [(4, CommandState::Running)];
    let executor = FakeExecutor::start(&test.cell, &rows, None);
    let _served = TestServer::start(&test.cell);
    let constant = kept("GET /primitives", "");
    let mut idle: Vec<_> = (0..HEADS_MAX + 20)
        .map(|_| {
            let mut stream = BufReader::new(connect(&test.cell));
            assert_eq!(exchange_one(&mut stream, &constant), (200, false));
            stream
        })
        .collect();
    assert_eq!(ask(&test.cell, "POST /commands/4/abort", b"").0, 200);
    assert!(another_process_is_served(&test.cell));
    // They hold no place of a request, although their process has many more of them than it may have requests.
    assert_eq!(ask(&test.cell, "GET /primitives", b"").0, 200);
    // The oldest ones were closed, and the newest one carries on.
    assert_eq!(idle[0].read(&mut [0]).unwrap(), 0);
    let newest = idle.last_mut().unwrap();
    assert_eq!(
        exchange_one(newest, &kept("POST /commands/4/abort", "")),
        (200, false)
    );
    drop(executor);
}
