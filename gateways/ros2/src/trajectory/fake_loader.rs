//! A loader for tests: a function answers each request that comes to a Unix socket. A thread of its own, which ends with the
//! test program.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::{fs, io, thread};

use rcc_api::bodies::ErrorBody;
use serde_json::{Value, json};

/// An answer: its body, or the code of an error.
pub(super) type Answer = Result<Value, &'static str>;

pub(super) struct FakeLoader {
    pub socket: PathBuf,
    requests: Arc<Mutex<Vec<String>>>,
}

impl FakeLoader {
    /// Answers requests, `METHOD PATH` without the query, one after the other. `name` is unique in the test program.
    pub fn new(name: &str, mut answer: impl FnMut(&str) -> Answer + Send + 'static) -> FakeLoader {
        let file = format!("rcc-ros2-{}-{name}.sock", std::process::id());
        let socket = std::env::temp_dir().join(file);
        let listener = UnixListener::bind(&socket).expect("a socket");
        let requests: Arc<Mutex<Vec<String>>> = Arc::default();
        let list = Arc::clone(&requests);
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                // A client that is gone needs no answer.
                let _ = serve(&stream, |request| {
                    let mut list = list.lock().unwrap_or_else(PoisonError::into_inner);
                    list.push(request.to_owned());
                    drop(list);
                    answer(request)
                });
            }
        });
        FakeLoader { socket, requests }
    }

    /// Returns what was asked for so far, apart from what only reads.
    pub fn requests(&self) -> Vec<String> {
        let list = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        let changes = list.iter().filter(|request| !request.starts_with("GET "));
        changes.cloned().collect()
    }
}

impl Drop for FakeLoader {
    fn drop(&mut self) {
        // It is in the folder for temporary files.
        let _ = fs::remove_file(&self.socket);
    }
}

/// Answers the one request of a connection.
fn serve(mut stream: &UnixStream, answer: impl FnOnce(&str) -> Answer) -> io::Result<()> {
    let mut reader = BufReader::new(stream);
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        if reader.read_line(&mut head)? == 0 {
            return Ok(());
        }
    }
    let length = head.lines().find_map(|line| {
        let line = line.to_ascii_lowercase();
        line.strip_prefix("content-length:")?.trim().parse().ok()
    });
    let mut body = vec![0; length.unwrap_or(0)];
    reader.read_exact(&mut body)?;
    let request = head.lines().next().unwrap_or_default();
    let request = request.trim_end_matches(" HTTP/1.1");
    let request = request.split('?').next().unwrap_or(request);
    let (status, body) = match answer(request) {
        Ok(body) => ("200 OK", body),
        Err(code) => {
            let code = code.to_owned();
            (
                "409 Conflict",
                json!(ErrorBody {
                    code,
                    ..ErrorBody::default()
                }),
            )
        }
    };
    let body = body.to_string();
    let length = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\ncontent-length: {length}\r\nconnection: close\r\n\r\n{body}"
    )
}
