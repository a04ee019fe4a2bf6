//! Connections that fail for a moment: a process without free file descriptors. Run by one thread, because the limit holds
//! for the whole test program.

mod common;

use std::time::Duration;

use common::{TestCell, wait_for};
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use rcc_ipc::{Client, Server, Session};
use rcc_protocol::Role;

/// Runs `action` while no file can be opened.
fn without_descriptors<R>(action: impl FnOnce() -> R) -> R {
    let (soft, hard) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
    setrlimit(Resource::RLIMIT_NOFILE, 3, hard).unwrap();
    let result = action();
    setrlimit(Resource::RLIMIT_NOFILE, soft, hard).unwrap();
    result
}

/// Returns what the client gets for a request that the server sends back.
fn echo(client: &Client, server: &Server) -> Option<Vec<u8>> {
    std::thread::scope(|scope| {
        let asking = scope.spawn(|| client.call(b"hello", Duration::from_secs(5)).ok());
        while !asking.is_finished() {
            if let Some(request) = server.poll().unwrap() {
                let bytes = request.bytes().to_vec();
                request.answer(&bytes).unwrap();
            }
            std::thread::yield_now();
        }
        asking.join().unwrap()
    })
}

#[test]
fn a_moment_without_descriptors_cuts_off_no_client_and_no_subscriber() {
    let cell = TestCell::new();
    let session = Session::join(&cell, Role::Executor, "exec").unwrap();

    let server = session.serve("ask").unwrap();
    let client = session.client(server.service()).unwrap();
    let polled = without_descriptors(|| server.poll());
    assert!(polled.unwrap().is_none());
    // A request that came meanwhile may be lost; the next one is not.
    let answer = wait_for(|| echo(&client, &server));
    assert_eq!(answer, b"hello");

    let mut publisher = session.publisher::<u64>("values").unwrap();
    let mut subscriber = session.subscribe::<u64>(publisher.service()).unwrap();
    without_descriptors(|| publisher.publish(&[1])).unwrap();
    assert_eq!(
        subscriber.next_batch().unwrap(),
        None,
        "the connection failed"
    );
    let values = wait_for(|| {
        publisher.publish(&[2]).unwrap();
        subscriber.next_batch().unwrap()
    });
    assert_eq!(values, [2]);
}
