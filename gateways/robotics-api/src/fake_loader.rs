//! A loader for tests, which notes its requests and answers them as the test says. Each request has a thread, so that one
//! answer may wait for another request.

use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::os::unix::net::UnixListener;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use rcc_api::bodies::{CommandDetail, CommandView, ErrorBody};
use rcc_api::codes::ErrorCode;
use rcc_testing::TempDir;

use crate::http::{read_body, read_head, write_answer};

/// An answer: done, or refused with a code.
pub type FakeAnswer = Result<(), ErrorCode>;

/// The loader; it answers until the test ends.
#[derive(Debug)]
pub struct FakeLoader {
    requests: Arc<Mutex<Vec<String>>>,
    state: Arc<Mutex<&'static str>>,
}

impl FakeLoader {
    /// Listens at a socket in this folder; `answer` gets each request without the prefix `/commands/`: `n/start`.
    pub fn start(
        folder: &TempDir,
        answer: impl Fn(&str) -> FakeAnswer + Send + Sync + 'static,
    ) -> FakeLoader {
        let listener = UnixListener::bind(socket(folder)).expect("a socket");
        let requests = Arc::<Mutex<Vec<String>>>::default();
        let state = Arc::new(Mutex::new("ready"));
        let (noted, answer) = (Arc::clone(&requests), Arc::new(answer));
        let told = Arc::clone(&state);
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let (noted, answer) = (Arc::clone(&noted), Arc::clone(&answer));
                let told = Arc::clone(&told);
                let mut stream = stream.expect("a connection");
                std::thread::spawn(move || {
                    let head = read_head(&mut stream).expect("a head");
                    read_body(&head, &mut stream).expect("a body");
                    let path = head.path.trim_start_matches("/commands/");
                    lock(&noted).push(path.to_owned());
                    let (status, body) = match answer(path) {
                        Ok(()) if head.method == "GET" => (200, detail(path, *lock(&told))),
                        Ok(()) => (200, "{}".to_owned()),
                        Err(code) => (code.status, error(code)),
                    };
                    // A client that is gone needs no answer.
                    let _ = write_answer(&mut stream, status, "application/json", &body);
                });
            }
        });
        FakeLoader { requests, state }
    }

    /// Sets the state that is told of each net that is asked for; it is `ready` at first.
    pub fn tell(&self, state: &'static str) {
        *lock(&self.state) = state;
    }

    /// Returns the requests so far, without `/commands/`, in the order in which they came.
    pub fn requests(&self) -> Vec<String> {
        lock(&self.requests).clone()
    }
}

/// Returns the socket of the loader that is started in this folder.
pub fn socket(folder: &TempDir) -> PathBuf {
    folder.path().join("loader.sock")
}

/// Returns both ends of a TCP connection over the loopback interface.
pub fn connected_pair() -> (TcpStream, TcpStream) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).expect("a port");
    let address = listener.local_addr().expect("an address");
    let client = TcpStream::connect(address).expect("a connection");
    (listener.accept().expect("a connection").0, client)
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn detail(net: &str, state: &str) -> String {
    let body = CommandDetail {
        command: CommandView {
            net: net.to_owned(),
            state: state.to_owned(),
            ..CommandView::default()
        },
        ..CommandDetail::default()
    };
    serde_json::to_string(&body).expect("JSON")
}

fn error(code: ErrorCode) -> String {
    let body = ErrorBody {
        code: code.code.to_owned(),
        message: code.title.to_owned(),
        ..ErrorBody::default()
    };
    serde_json::to_string(&body).expect("JSON")
}
