//! A loader for tests, which notes its requests and answers them as the test says. Each request has a thread, so that one
//! answer may wait for another request.

use std::fs;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::os::unix::net::UnixListener;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use rcc_api::bodies::ErrorBody;
use rcc_api::codes::ErrorCode;

use crate::http::{read_body, read_head, write_answer};

/// An answer: done, or refused with a code.
pub type FakeAnswer = Result<(), ErrorCode>;

/// A folder of one test; removed when it is dropped.
#[derive(Debug)]
pub struct TestFolder(pub PathBuf);

impl TestFolder {
    /// Creates the folder.
    pub fn new() -> TestFolder {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("rcc-robotics-api-{}-{number}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        fs::create_dir_all(&folder).expect("a folder");
        TestFolder(folder)
    }
}

impl Drop for TestFolder {
    fn drop(&mut self) {
        // What is left there harms nobody.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The loader; it answers until the test ends.
#[derive(Debug)]
pub struct FakeLoader {
    requests: Arc<Mutex<Vec<String>>>,
}

impl FakeLoader {
    /// Listens at a socket in this folder; `answer` gets each request without the prefix `/commands/`: `n/start`.
    pub fn start(
        folder: &TestFolder,
        answer: impl Fn(&str) -> FakeAnswer + Send + Sync + 'static,
    ) -> FakeLoader {
        let listener = UnixListener::bind(socket(folder)).expect("a socket");
        let requests = Arc::<Mutex<Vec<String>>>::default();
        let (noted, answer) = (Arc::clone(&requests), Arc::new(answer));
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let (noted, answer) = (Arc::clone(&noted), Arc::clone(&answer));
                let mut stream = stream.expect("a connection");
                std::thread::spawn(move || {
                    let head = read_head(&mut stream).expect("a head");
                    read_body(&head, &mut stream).expect("a body");
                    let path = head.path.trim_start_matches("/commands/");
                    lock(&noted).push(path.to_owned());
                    let (status, body) = match answer(path) {
                        Ok(()) => (200, "{}".to_owned()),
                        Err(code) => (code.status, error(code)),
                    };
                    // A client that is gone needs no answer.
                    let _ = write_answer(&mut stream, status, "application/json", &body);
                });
            }
        });
        FakeLoader { requests }
    }

    /// Returns the requests so far, without `/commands/`, in the order in which they came.
    pub fn requests(&self) -> Vec<String> {
        lock(&self.requests).clone()
    }
}

/// Returns the socket of the loader that is started in this folder.
pub fn socket(folder: &TestFolder) -> PathBuf {
    folder.0.join("loader.sock")
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

fn error(code: ErrorCode) -> String {
    let body = ErrorBody {
        code: code.code.to_owned(),
        message: code.title.to_owned(),
        ..ErrorBody::default()
    };
    serde_json::to_string(&body).expect("JSON")
}
