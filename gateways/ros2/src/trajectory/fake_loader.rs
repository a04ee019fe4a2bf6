//! A loader for tests: a function answers each request that comes to a Unix socket. A thread of its own, which ends with the
//! test program.

use std::os::unix::net::UnixListener;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use rcc_api::bodies::ErrorBody;
use rcc_testing::TempDir;
use rcc_testing::http::answer_request;
use serde_json::{Value, json};

/// An answer: its body, or the code of an error.
pub(super) type Answer = Result<Value, &'static str>;

pub(super) struct FakeLoader {
    pub socket: PathBuf,
    requests: Arc<Mutex<Vec<String>>>,
    /// The folder of the socket.
    _folder: TempDir,
}

impl FakeLoader {
    /// Answers requests, `METHOD PATH` without the query, one after the other.
    pub fn new(mut answer: impl FnMut(&str) -> Answer + Send + 'static) -> FakeLoader {
        let folder = rcc_testing::folder();
        let socket = folder.path().join("loader.sock");
        let listener = UnixListener::bind(&socket).expect("a socket");
        let requests: Arc<Mutex<Vec<String>>> = Arc::default();
        let list = Arc::clone(&requests);
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                // A client that is gone needs no answer.
                let _ = answer_request(&stream, |request| {
                    let mut list = list.lock().unwrap_or_else(PoisonError::into_inner);
                    list.push(request.line.clone());
                    drop(list);
                    answered(answer(&request.line))
                });
            }
        });
        FakeLoader {
            socket,
            requests,
            _folder: folder,
        }
    }

    /// Returns what was asked for so far, apart from what only reads.
    pub fn requests(&self) -> Vec<String> {
        let list = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let changes = list.iter().filter(|request| !request.starts_with("GET "));
        changes.cloned().collect()
    }
}

fn answered(answer: Answer) -> (u16, String) {
    let (status, body) = match answer {
        Ok(body) => (200, body),
        Err(code) => {
            let code = code.to_owned();
            let body = ErrorBody {
                code,
                ..ErrorBody::default()
            };
            (409, json!(body))
        }
    };
    (status, body.to_string())
}
