//! Measures the latency of CANCEL by name while every interface of a loader is flooded, as a distribution beside the
//! machine's own stalls. Each flood is a separate process, because the Unix socket distinguishes peers by process.
//! Runs on the main thread of an example or the thread of a test.

pub mod kinds;
pub mod report;

use std::fs;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rcc_core::message::{CommandState, EndReason};
use serde_json::Value;

use crate::cell::TestCell;
use crate::cell_fixture::ExecutorBoards;
use crate::processes::ends_with_test;
use crate::rest::{self, Reply};
use crate::waiting::await_some;
use kinds::FloodKind;
use report::{Cancel, Interface, Report};

/// Environment variable that turns a process into a flood: `KIND SOCKET ADDRESS`.
pub const FLOOD: &str = "RCC_FLOOD";
/// Access token of the flooded cell.
pub const TOKEN: &str = "0123456789abcdef0123456789abcdef";
/// Sleep of the thread that measures stalls of the machine.
const STALL_EVERY: Duration = Duration::from_millis(1);

/// Size of a run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Number of large nets loaded before the flood.
    pub nets: usize,
    /// Primitives of each large net.
    pub primitives: usize,
    /// Number of CANCELs, sent through each interface in turn.
    pub cancels: usize,
    /// Number of processes for each kind of flood.
    pub processes: usize,
    /// Kinds of floods that run.
    pub kinds: Vec<FloodKind>,
}

/// Addresses of a loader's interfaces.
#[derive(Clone, Debug)]
pub struct Interfaces {
    /// Path of the Unix socket.
    pub socket: PathBuf,
    /// Address of the TCP listener.
    pub address: SocketAddr,
}

impl Interfaces {
    /// Sends one request through an interface, over TCP with the valid token.
    ///
    /// # Errors
    /// Returns an error if the interface is not served or the response is not HTTP.
    pub fn ask(
        &self,
        interface: Interface,
        method: &str,
        path: &str,
        body: &[u8],
    ) -> std::io::Result<Reply> {
        match interface {
            Interface::Tcp => {
                let stream = TcpStream::connect(self.address)?;
                let limit = Some(Duration::from_secs(20));
                stream.set_read_timeout(limit)?;
                stream.set_write_timeout(limit)?;
                stream.set_nodelay(true)?;
                let line = format!("authorization: Bearer {TOKEN}\r\n");
                rest::over(stream, method, path, &line, body)
            }
            Interface::Unix | Interface::Cli => rest::request(&self.socket, method, path, body),
        }
    }
}

/// Returns a net with this many primitives (at least 2) that commands nothing and ends on CANCEL.
#[must_use]
pub fn net(name: &str, primitives: usize) -> String {
    let mut text = format!(
        "net: {name}\nprimitives:\n  cancel: {{type: Cancel}}\n  end: {{type: Termination, inputs: {{done: cancel.requested}}}}\n"
    );
    for number in 0..primitives.saturating_sub(2) {
        let before = match number {
            0 => "0.5".to_owned(),
            number => format!("a{}.out", number - 1),
        };
        text.push_str(&format!(
            "  a{number}: {{type: Add, inputs: {{a: {before}, b: 1.0}}}}\n"
        ));
    }
    if primitives > 2 {
        text.push_str(&format!("discard: [a{}.out]\n", primitives - 3));
    }
    text
}

/// Floods until killed if the environment variable [`FLOOD`] is set; returns at once otherwise.
pub fn flood_if_asked() {
    let Ok(order) = std::env::var(FLOOD) else {
        return;
    };
    let words: Vec<&str> = order.split(' ').collect();
    let [kind, socket, address] = words[..] else {
        panic!("{FLOOD} is KIND SOCKET ADDRESS, not `{order}`");
    };
    let interfaces = Interfaces {
        socket: PathBuf::from(socket),
        address: address.parse().expect("an address"),
    };
    FloodKind::named(kind)
        .expect("a kind of flood")
        .run(&interfaces);
}

/// Flooding processes, killed on drop.
struct Flooders(Vec<Child>);

impl Flooders {
    fn start(options: &Options, interfaces: &Interfaces, again: &dyn Fn() -> Command) -> Flooders {
        let mut all = Flooders(Vec::new());
        for kind in &options.kinds {
            for _ in 0..options.processes {
                let order = format!(
                    "{} {} {}",
                    kind.name(),
                    interfaces.socket.display(),
                    interfaces.address
                );
                let mut command = again();
                command
                    .env(FLOOD, order)
                    .stdin(Stdio::null())
                    .stdout(Stdio::null())
                    .stderr(Stdio::null());
                let child = ends_with_test(&mut command).spawn();
                all.0.push(child.expect("a process that floods"));
            }
        }
        all
    }

    /// Asserts that every flood is still running.
    fn assert_running(&mut self) {
        for child in &mut self.0 {
            let ended = child
                .try_wait()
                .expect("the process is a child of this one");
            assert!(ended.is_none(), "a flood ended by itself: {ended:?}");
        }
    }
}

impl Drop for Flooders {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // Fails only if the process has already exited.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Starts a cell that listens on the Unix socket and on TCP.
fn cell(folder: &Path) -> (TestCell, Interfaces) {
    fs::create_dir_all(folder).expect("a folder");
    let token = folder.join("token");
    let mut options = fs::File::options();
    let options = options.write(true).create(true).truncate(true).mode(0o600);
    let mut file = options.open(&token).expect("a token file");
    std::io::Write::write_all(&mut file, TOKEN.as_bytes()).expect("written");
    let free =
        TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|listener| listener.local_addr());
    let address = free.expect("a free port");
    let access = format!(
        "access: {{tcp: {{listen: {address}, token_file: {}}}}}\n",
        token.display()
    );
    let cell = TestCell::changed(|text| text + &access);
    let interfaces = Interfaces {
        socket: cell.cell().socket(),
        address,
    };
    (cell, interfaces)
}

/// Loads the large nets, floods every interface, and cancels small nets one after the other. `again` returns the
/// command that starts this program again, so that it calls [`flood_if_asked`].
pub fn run(options: &Options, again: &dyn Fn() -> Command) -> Report {
    let folder = std::env::temp_dir().join(format!("rcc-flood-{}", std::process::id()));
    let (cell, interfaces) = cell(&folder);
    for number in 0..options.nets {
        cell.load(&net(&format!("large-{number}"), options.primitives));
    }
    let loader = cell.announced(rcc_protocol::Role::Loader, "loader").pid;
    let mut report = Report::new(options.clone(), resident(loader));
    let watch = cell.watch();
    let stalls = Stalls::watch();
    let mut flooders = Flooders::start(options, &interfaces, again);
    for number in 0..options.cancels {
        let interface = Interface::ALL[number % Interface::ALL.len()];
        report
            .cancels
            .push(cancel(&cell, &interfaces, &watch, interface, number));
        report.loader_peak = report.loader_peak.max(resident(loader));
        flooders.assert_running();
    }
    drop(flooders);
    report.stalls = stalls.end();
    report.late = watch.status().late;
    let after = cell.announced(rcc_protocol::Role::Loader, "loader").pid;
    report.loader_restarted = after != loader;
    report.slow = slow(&cell);
    drop(watch);
    drop(cell);
    // Only this process uses the folder; a leftover is harmless.
    let _ = fs::remove_dir_all(&folder);
    report
}

/// Loads and starts a small net, retrying while floods occupy the command table, and cancels it once.
fn cancel(
    cell: &TestCell,
    interfaces: &Interfaces,
    watch: &ExecutorBoards,
    interface: Interface,
    number: usize,
) -> Cancel {
    let name = format!("small-{number}");
    let text = net(&name, 2);
    let retried = |what: &str, method: &str, path: &str, body: &[u8], good: u16| -> Value {
        await_some(&format!("{what} of {name}"), || {
            let reply = interfaces.ask(Interface::Unix, method, path, body).ok()?;
            (reply.status == good).then_some(reply.body)
        })
    };
    let loaded = retried("the load", "POST", "/commands", text.as_bytes(), 202);
    let id = loaded["id"].as_u64().expect("an id");
    let state = || {
        let tables = watch.tables();
        let row = tables.commands.iter().find(|row| row.id == id)?;
        Some((
            CommandState::from_number(row.state),
            EndReason::from_number(row.reason),
        ))
    };
    await_some(&format!("{name} to run"), || {
        // Refused while the floods hold all slots, or answered too late; the executor's table decides.
        let _ = interfaces.ask(
            Interface::Unix,
            "POST",
            &format!("/commands/{id}/start"),
            b"",
        );
        (state()?.0 == CommandState::Running).then_some(())
    });
    let (begun, waited_before) = (Instant::now(), waited_for_processor());
    let (answered, words) = match interface {
        Interface::Cli => {
            let output = cell.cli(&["cancel", &name]);
            let words = String::from_utf8_lossy(&output.stderr).into_owned();
            (output.status.success(), words)
        }
        interface => {
            match interfaces.ask(interface, "POST", &format!("/commands/{name}/cancel"), b"") {
                Ok(reply) => (
                    reply.status == 200,
                    format!("{} {}", reply.status, reply.error_text()),
                ),
                Err(error) => (false, error.to_string()),
            }
        }
    };
    let took = begun.elapsed();
    let waited = waited_for_processor().saturating_sub(waited_before);
    let done = await_some(&format!("the end of {name}"), || {
        let (state, reason) = state()?;
        (state == CommandState::Terminated).then_some(reason == EndReason::Canceled)
    });
    retried("the unload", "DELETE", &format!("/commands/{id}"), b"", 200);
    Cancel {
        interface,
        took,
        waited,
        answered,
        done,
        words,
    }
}

/// Returns what the loader's log tells of slow CANCELs: the time of each, and of its steps.
fn slow(cell: &TestCell) -> Vec<String> {
    let runs = fs::read_dir(cell.cell().state().logs_dir()).into_iter();
    let newest = runs.flatten().flatten().map(|entry| entry.path()).max();
    let log = newest.map(|folder| fs::read_to_string(folder.join("loader.log")));
    let log = log.and_then(Result::ok).unwrap_or_default();
    let told = |line: &str| Some(line[line.find("CANCEL took ")?..].to_owned());
    log.lines().filter_map(told).collect()
}

/// Returns how long this thread has been ready to run and had no processor, by proc_pid_schedstat(5).
fn waited_for_processor() -> Duration {
    let text = fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let ns = text.split(' ').nth(1).and_then(|ns| ns.parse().ok());
    Duration::from_nanos(ns.unwrap_or(0))
}

/// A thread that measures how late the machine wakes it from a sleep.
struct Stalls {
    stop: Arc<AtomicBool>,
    thread: thread::JoinHandle<Vec<Duration>>,
}

impl Stalls {
    fn watch() -> Stalls {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let mut all = Vec::new();
            while !stopped.load(Ordering::Relaxed) {
                let begun = Instant::now();
                thread::sleep(STALL_EVERY);
                all.push(begun.elapsed().saturating_sub(STALL_EVERY));
            }
            all
        });
        Stalls { stop, thread }
    }

    fn end(self) -> Vec<Duration> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or_default()
    }
}

/// Returns the resident memory of a process, bytes; 0 if it does not exist.
#[must_use]
pub fn resident(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok());
    kib.unwrap_or(0) << 10
}

/// Connects to a Unix socket, blocking while its backlog is full; reads and writes time out after 20 s.
pub(crate) fn connect(socket: &Path) -> Option<UnixStream> {
    let stream = UnixStream::connect(socket).ok()?;
    let limit = Some(Duration::from_secs(20));
    stream.set_read_timeout(limit).ok()?;
    stream.set_write_timeout(limit).ok()?;
    Some(stream)
}
