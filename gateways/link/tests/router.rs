//! A router that is killed and started again while a topic flows through it. Run by the threads of the test harness.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use rcc_link::fleet;
use rcc_link::keys::CellKeys;
use zenoh::{Session, Wait};

/// Longest wait for anything that must happen.
const LIMIT: Duration = Duration::from_secs(60);
/// How often the router is killed.
const KILLS: u32 = 3;

/// A process that ends with the test.
struct Router(Child);

impl Router {
    fn start(endpoint: &str) -> Router {
        // `cargo test` builds examples beside the folder of this test's program.
        let own = std::env::current_exe().expect("a path");
        let program = own
            .ancestors()
            .nth(2)
            .expect("a folder")
            .join("examples/router");
        let mut command = Command::new(&program);
        let child = command.arg(endpoint).stdout(Stdio::piped()).spawn();
        let mut child = child.unwrap_or_else(|error| panic!("{}: {error}", program.display()));
        let mut line = String::new();
        let stdout = child.stdout.take().expect("a pipe");
        BufReader::new(stdout).read_line(&mut line).expect("a line");
        assert_eq!(line, "ready\n");
        Router(child)
    }
}

impl Drop for Router {
    fn drop(&mut self) {
        self.0.kill().expect("it is a child");
        self.0.wait().expect("it is a child");
    }
}

fn connected(endpoint: &str) -> Session {
    fleet::connect_by_router(&[endpoint.to_owned()], None).expect("a session")
}

/// Publishes numbers until one that was published after the call arrives; returns the next number.
fn await_arrival(from: &Session, arrived: &Receiver<u64>, first: u64) -> u64 {
    let key = CellKeys::of("lab/a").topic("belt/position").expect("a key");
    let until = Instant::now() + LIMIT;
    for number in first.. {
        from.put(&key, number.to_string())
            .wait()
            .expect("published");
        while let Ok(seen) = arrived.recv_timeout(Duration::from_millis(5)) {
            if seen >= first {
                return number + 1;
            }
        }
        assert!(Instant::now() < until, "nothing arrives after {first}");
    }
    unreachable!("numbers do not end")
}

#[test]
fn a_topic_flows_again_when_a_killed_router_is_back() {
    let port = rcc_config::free_port(rcc_config::Protocol::Tcp).expect("a port");
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let mut router = Router::start(&endpoint);
    let (gives, takes) = (connected(&endpoint), connected(&endpoint));
    let (told, arrived) = channel();
    let key = CellKeys::of("lab/a").topics("**");
    let subscriber = takes.declare_subscriber(key).callback(move |sample| {
        let text = String::from_utf8_lossy(&sample.payload().to_bytes()).into_owned();
        // The receiver ends with the test.
        let _ = told.send(text.parse().expect("a number"));
    });
    subscriber.background().wait().expect("a subscription");
    let mut next = await_arrival(&gives, &arrived, 0);
    for _ in 0..KILLS {
        drop(router);
        // Nothing holds a message back for later: what is published meanwhile is lost, and nobody waits.
        for _ in 0..100 {
            let key = CellKeys::of("lab/a").topic("belt/position").expect("a key");
            gives.put(&key, next.to_string()).wait().expect("published");
            next += 1;
        }
        let lost = next;
        router = Router::start(&endpoint);
        next = await_arrival(&gives, &arrived, lost);
    }
}
