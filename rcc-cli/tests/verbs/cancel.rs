//! `cancel --wait` of a net that somebody else runs, and unloads as soon as it has ended. The loader is a thread of the test
//! that answers over TCP.

use std::net::TcpListener;

use rcc_testing::http::{HttpRequest, answer_request};
use serde_json::{Value, json};

use crate::program::{rcc_cli, texts};

/// The answer to a request.
type Answer = fn(&HttpRequest) -> (u16, Value);

/// Runs `cancel poll --wait` against a loader with these answers; returns the exit code and both texts.
fn cancel(answer: Answer) -> (Option<i32>, String, String) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("loopback");
    let url = format!("http://{}", listener.local_addr().expect("an address"));
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            // A client that has gone needs no answer.
            let _ = answer_request(&stream, |request| {
                let (status, body) = answer(request);
                (status, body.to_string())
            });
        }
    });
    let folder = rcc_testing::folder();
    let mut command = rcc_cli(&[
        "--url",
        &url,
        "--timeout",
        "20s",
        "cancel",
        "poll",
        "--wait",
    ]);
    command
        .env("RCC_RUNTIME_DIR", folder.path())
        .env_remove("RCC_CELL");
    texts(command.output().expect("rcc-cli runs"))
}

/// The answer of a loader whose command 7 was canceled, and unloaded by whoever ran it: it is in the list of the last that
/// were, by its id.
fn unloaded(reason: &str, request: &HttpRequest) -> (u16, Value) {
    if request.line == "POST /commands/poll/cancel" {
        return (200, json!({"id": 7, "net": "poll", "cycle": 100}));
    }
    if request.line == "GET /commands/7" && request.query == "unloaded=true" {
        let ended = json!({
            "id": 7, "net": "poll", "state": "terminated", "reason": reason, "can_cancel": true, "cycles": 90,
            "started_cycle": 20, "ended_cycle": 110, "exec_last_ns": 0, "exec_max_ns": 0,
        });
        return (200, ended);
    }
    let body =
        json!({"code": "RCC3001", "message": "command 7 not found", "help": "see `rcc-cli ls`"});
    (404, body)
}

#[test]
fn a_net_that_its_runner_unloads_is_canceled_nevertheless() {
    let (code, out, errors) = cancel(|request| unloaded("canceled", request));
    assert_eq!(code, Some(8), "{out}{errors}");
    assert!(out.starts_with("poll#7  terminated (canceled)"), "{out}");
}

#[test]
fn a_net_that_finished_before_it_could_be_canceled_is_a_success() {
    let (code, out, errors) = cancel(|request| unloaded("finished", request));
    assert_eq!(code, Some(0), "{out}{errors}");
    assert!(out.contains("before it could be canceled"), "{out}");
}
