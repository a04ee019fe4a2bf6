//! Runs the loader's listeners in a thread of the test, with client functions for them.
#![allow(dead_code)] // Each test program uses only a part of it.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rcc_config::{AccessConfig, CellConfig, auto_ports};
use rcc_ipc::{Cell, Session};
use rcc_loader::server::executor::ExecutorLink;
use rcc_loader::server::listeners::Listeners;
use rcc_loader::server::routes;
use rcc_loader::server::service::Service;
use rcc_process::Helpers;
use rcc_protocol::Role;
use serde_json::Value;
use tracing_subscriber::fmt::MakeWriter;

/// Much longer than any step takes; only a failing test reaches it.
pub const LIMIT: Duration = Duration::from_secs(60);

pub fn config() -> CellConfig {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/cells/demo.yaml");
    let ports: BTreeMap<String, u16> = auto_ports(&path)
        .expect("ports")
        .into_iter()
        .map(|(name, _)| (name, 1))
        .collect();
    CellConfig::load(&path, &ports).expect("the demo's configuration")
}

pub fn service(cell: &Cell) -> Service {
    let session = Session::join(cell, Role::Loader, "loader").expect("join");
    Service::new(ExecutorLink::new(session), config())
}

/// Serves on the cell's socket until it is dropped.
pub struct TestServer {
    /// Address of its TCP listener.
    pub address: Option<std::net::SocketAddr>,
    log: Log,
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl TestServer {
    pub fn start(cell: &Cell) -> TestServer {
        TestServer::with(cell, &AccessConfig::default())
    }

    pub fn with(cell: &Cell, access: &AccessConfig) -> TestServer {
        let service = Arc::new(service(cell));
        let listeners = Listeners::open(cell, access).expect("listeners");
        let address = listeners.address();
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let log = Log::default();
        let writer = log.clone();
        let thread = std::thread::spawn(move || {
            let subscriber = tracing_subscriber::fmt()
                .with_ansi(false)
                .with_writer(writer);
            let _guard = tracing::subscriber::set_default(subscriber.finish());
            let runtime = tokio::runtime::Builder::new_current_thread()
                .enable_all()
                .build()
                .expect("a runtime");
            let router = routes::router(service, &Helpers::default()).expect("threads");
            runtime.block_on(async {
                tokio::select! {
                    served = listeners.serve(tokio::runtime::Handle::current(), router) => served.expect("served"),
                    _ = stopped => {}
                }
            });
        });
        TestServer {
            address,
            log,
            stop: Some(stop),
            thread: Some(thread),
        }
    }
}

impl TestServer {
    /// Returns the log so far.
    pub fn log(&self) -> String {
        String::from_utf8_lossy(&self.log.0.lock().expect("a log")).into_owned()
    }
}

/// A log in memory.
#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<u8>>>);

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().expect("a log").write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl<'a> MakeWriter<'a> for Log {
    type Writer = Log;

    fn make_writer(&'a self) -> Log {
        self.clone()
    }
}

impl Drop for TestServer {
    fn drop(&mut self) {
        self.stop.take();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Sends one request on the cell's socket; returns status and body.
pub fn ask(cell: &Cell, head: &str, body: &[u8]) -> (u16, Value) {
    let stream = UnixStream::connect(cell.socket()).expect("connected");
    stream.set_read_timeout(Some(LIMIT)).expect("a time limit");
    let length = body.len();
    let head = format!(
        "{head} HTTP/1.1\r\nhost: x\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n"
    );
    exchange(stream, &[head.as_bytes(), body].concat())
}

/// Sends the bytes and reads to the end; returns status and body. A server that disconnects a client need not read
/// everything.
pub fn exchange(mut stream: impl Read + Write, bytes: &[u8]) -> (u16, Value) {
    let _ = stream.write_all(bytes);
    answer(stream)
}

/// Reads to the end; returns status and body.
pub fn answer(mut stream: impl Read) -> (u16, Value) {
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    let text = String::from_utf8_lossy(&answer).into_owned();
    let status = text.split(' ').nth(1);
    let status = status.and_then(|status| status.parse().ok());
    let body = text.split_once("\r\n\r\n").map_or("", |(_, body)| body);
    (
        status.unwrap_or(0),
        serde_json::from_str(body).unwrap_or_default(),
    )
}

/// Compiles a text and installs it under this id.
pub fn install(service: &Service, id: u64, text: &str, file: &str) {
    let compiled = service.compile(text, file);
    service.install(id, text.to_owned(), compiled);
}
