//! Requests of a client about its lease. Run by the test harness; a thread of the test answers as a loader does.

use std::net::TcpListener;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rcc_testing::http::answer_request;
use serde_json::{Value, json};

use super::*;
use crate::{Cell, CommandView, OnClientLoss, StatusView};

/// A loader as far as leases are concerned.
#[derive(Default)]
struct ToldLoader {
    /// Method and path of each request.
    asked: Vec<String>,
    granted: u64,
    expired: Vec<u64>,
    /// The command has finished, and somebody else has unloaded it.
    is_unloaded: bool,
}

impl ToldLoader {
    fn answer(&mut self, request: &str, body: &Value) -> (u16, Value) {
        self.asked.push(request.to_owned());
        let part = request.split("/leases/").nth(1);
        let lease = part.and_then(|part| part.split('/').next()?.parse().ok());
        if let Some(lease) = lease.or(body["lease"].as_u64())
            && self.expired.contains(&lease)
        {
            let code = codes::UNKNOWN_LEASE.code;
            return (
                404,
                json!({"code": code, "message": "it does not exist, or has expired"}),
            );
        }
        let mut view = CommandView {
            state: "ready".to_owned(),
            ..CommandView::default()
        };
        if self.is_unloaded && request.starts_with("DELETE /commands/") {
            let code = codes::UNKNOWN_COMMAND.code;
            return (
                404,
                json!({"code": code, "message": "there is no command 0"}),
            );
        }
        let is_started = self.asked.iter().any(|asked| asked.ends_with("/start"));
        if self.is_unloaded && is_started {
            (view.state, view.reason) = ("terminated".to_owned(), Some("finished".to_owned()));
        }
        let answer = match request {
            "POST /leases" => {
                self.granted += 1;
                json!({"lease": self.granted, "expires_ms": body["expires_ms"]})
            }
            "GET /status" => json!(StatusView::default()),
            "POST /commands" => json!({"id": 0, "state": "loading"}),
            _ if lease.is_some() => json!({"lease": lease, "cycle": 1}),
            _ if request.starts_with("POST") => json!({"id": 0, "net": "a", "cycle": 7}),
            _ => json!(view),
        };
        (200, answer)
    }
}

/// Starts a loader; returns it with its address. It ends with the process of the test.
fn loader() -> (Arc<Mutex<ToldLoader>>, String) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let url = format!("http://{}", listener.local_addr().expect("an address"));
    let loader = Arc::new(Mutex::new(ToldLoader::default()));
    let served = Arc::clone(&loader);
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            // A client that was dropped does not read.
            let _ = answer_request(&stream.expect("a connection"), |request| {
                let body = serde_json::from_slice(&request.body).unwrap_or_default();
                let (status, answer) = told(&served).answer(&request.line, &body);
                (status, answer.to_string())
            });
        }
    });
    (loader, url)
}

fn told(loader: &Mutex<ToldLoader>) -> MutexGuard<'_, ToldLoader> {
    loader.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the leases that were ended.
fn ended(loader: &Mutex<ToldLoader>) -> Vec<String> {
    let told = told(loader);
    let ended = told
        .asked
        .iter()
        .filter_map(|asked| asked.strip_prefix("DELETE "));
    ended.map(str::to_owned).collect()
}

#[test]
fn a_lease_of_which_start_says_that_it_has_expired_is_not_ended() {
    let (loader, url) = loader();
    let cell = Cell::remote(&url, None).expect("a loader");
    // The thread that renews does not notice.
    let cell = cell.with_lost_after(Duration::from_secs(3600));
    let command = cell.load("net: a").expect("it is ready");
    command.start_with(OnClientLoss::Cancel).expect("a start");
    told(&loader).expired.push(1);
    command
        .start_with(OnClientLoss::Cancel)
        .expect("a start with another lease");
    assert_eq!(ended(&loader), [""; 0]);
    drop(cell);
    assert_eq!(ended(&loader), ["/leases/2"]);
}

#[test]
fn a_lease_of_which_a_renewal_says_that_it_has_expired_is_not_ended() {
    let (loader, url) = loader();
    let cell = Cell::remote(&url, None).expect("a loader");
    let cell = cell.with_lost_after(Duration::from_millis(100));
    let command = cell.load("net: a").expect("it is ready");
    command.start_with(OnClientLoss::Cancel).expect("a start");
    told(&loader).expired.push(1);
    let begun = Instant::now();
    while !cell.connection.lease.is_lost() {
        assert!(
            begun.elapsed() < Duration::from_secs(60),
            "{:?}",
            told(&loader).asked
        );
        std::thread::yield_now();
    }
    drop(cell);
    assert_eq!(ended(&loader), [""; 0]);
}

#[test]
fn a_net_that_finished_is_no_failure_if_somebody_else_unloads_it_first() {
    let (loader, url) = loader();
    told(&loader).is_unloaded = true;
    let cell = Cell::remote(&url, None).expect("a loader");
    let outcome = cell.run("net: a").expect("it has finished");
    assert_eq!(outcome.reason, "finished");
    let unloads = ended(&loader);
    assert_eq!(
        unloads
            .iter()
            .filter(|one| one.starts_with("/commands/"))
            .count(),
        1
    );
}

#[test]
fn a_renewal_without_an_answer_leaves_time_for_others() {
    for (expires_ms, renewal_ms) in [(50, 50), (200, 100), (1000, 200), (3_600_000, 720_000)] {
        let most = renewal_max(Duration::from_millis(expires_ms));
        assert_eq!(most, Duration::from_millis(renewal_ms));
    }
}
