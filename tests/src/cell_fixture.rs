//! The fixture of a test cell: its folder, its configuration with free ports, and access over REST, programs,
//! announcements and boards. Runs on the threads of the test harness.

use std::collections::BTreeMap;
use std::fs;
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use rcc_core::message::{CycleStatus, Tables};
use rcc_ipc::{BoardReader, Cell, Session};
use rcc_protocol::control::{STATUS, TABLES};
use rcc_protocol::{Announcement, Role};
use serde_json::Value;

use crate::processes::{self, signal};
use crate::programs::program;
use crate::rest::{self, Reply};
use crate::simulator::Simulator;
use crate::turns::{self, Permit};
pub use crate::waiting::{LIMIT, await_some, await_told, await_within};

/// Cell name used by every test; the cells differ in their folders.
pub const NAME: &str = "test";

/// A cell's folder, configuration and ports, with methods to control and query it.
#[derive(Debug)]
pub struct CellFixture {
    cell: Cell,
    base: PathBuf,
    config: PathBuf,
    ports: BTreeMap<String, u16>,
    files: AtomicU32,
    /// Name of the network namespace in which its programs run; `None`: that of the test.
    namespace: Option<String>,
    _permit: Permit,
}

impl CellFixture {
    /// Creates a folder with a copy of the configuration `config`, edited by `change`. Ports that the file leaves open
    /// are chosen here, so that the test can reach the simulators.
    pub fn new(config: &Path, change: impl Fn(String) -> String) -> CellFixture {
        // In memory: iceoryx2 syncs its files to the disk, which takes seconds while other processes keep the disk
        // busy.
        let memory = Path::new("/dev/shm");
        let usual = std::env::temp_dir();
        CellFixture::below(
            if memory.is_dir() { memory } else { &usual },
            config,
            change,
        )
    }

    /// Like [`CellFixture::new`], with the new folder below `parent`.
    pub fn below(parent: &Path, config: &Path, change: impl Fn(String) -> String) -> CellFixture {
        let base = new_folder(parent);
        let folder = config.parent().expect("a configuration is in a folder");
        let folder = folder.canonicalize().expect("it exists");
        let text = fs::read_to_string(config).expect("the configuration can be read");
        let text = change(text);
        // Relative paths are relative to the configuration file, and the copy is in another folder.
        let text = text.replace("../robots/", &format!("{}/../robots/", folder.display()));
        let (text, ports) = choose_ports(&text);
        let config = base.join("cell.yaml");
        fs::write(&config, text).expect("the configuration can be written");
        CellFixture {
            cell: Cell::in_folders(NAME, &base.join(NAME), base.join("state/cells").join(NAME))
                .expect("a short path"),
            base,
            config,
            ports,
            files: AtomicU32::new(0),
            namespace: None,
            _permit: turns::beside(),
        }
    }

    /// Runs the programs of the cell in this network namespace, which exists.
    #[must_use]
    pub fn in_namespace(mut self, name: &str) -> CellFixture {
        self.namespace = Some(name.to_owned());
        self
    }

    /// Returns the cell.
    pub fn cell(&self) -> &Cell {
        &self.cell
    }

    /// Returns the path of the edited configuration file.
    pub fn config(&self) -> &Path {
        &self.config
    }

    /// Returns the folder that belongs to this test alone.
    pub fn folder(&self) -> &Path {
        &self.base
    }

    /// Returns the folder for what outlives the cell (`RCC_STATE_DIR`).
    pub fn state_dir(&self) -> PathBuf {
        self.base.join("state")
    }

    /// Returns the number of a named port of the configuration.
    pub fn port(&self, name: &str) -> u16 {
        self.ports[name]
    }

    /// Connects to the control socket of a simulator of the configuration.
    pub fn simulator(&self, name: &str) -> Simulator {
        Simulator::connect(&self.cell.simulator_socket(name))
    }

    /// Returns the command for an RCC program that takes `--cell`, set up for this cell.
    pub fn program(&self, name: &str) -> Command {
        self.program_at(&program(name))
    }

    /// Like [`CellFixture::program`], for a program that the workspace does not have.
    pub fn program_at(&self, path: &Path) -> Command {
        let mut command = match &self.namespace {
            None => Command::new(path),
            Some(namespace) => {
                let mut command = Command::new("ip");
                command.args(["netns", "exec", namespace]);
                command.arg(path);
                command
            }
        };
        command
            .args(["--cell", NAME])
            .env("RCC_RUNTIME_DIR", &self.base)
            .env("RCC_STATE_DIR", self.state_dir())
            .env("NO_COLOR", "1")
            .stdin(Stdio::null());
        command
    }

    /// Runs `rcc-cli` with these arguments and waits until it exits.
    pub fn cli(&self, arguments: &[&str]) -> Output {
        let mut command = self.program("rcc-cli");
        command.args(arguments).output().expect("rcc-cli runs")
    }

    /// Runs `rcc-cli`, asserts its exit code, and returns its stdout and stderr.
    pub fn cli_exits(&self, exit: i32, arguments: &[&str]) -> (String, String) {
        let output = self.cli(arguments);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        let ended = output.status.code();
        assert_eq!(
            ended,
            Some(exit),
            "{arguments:?}: {out}\n{err}\n{}",
            self.logs()
        );
        (out, err)
    }

    /// Writes `text` to a new file in the test's folder and returns the path.
    pub fn file(&self, text: &str) -> PathBuf {
        // Relaxed: the numbers only need to differ.
        let number = self.files.fetch_add(1, Ordering::Relaxed);
        let path = self.base.join(format!("file-{number}.yaml"));
        fs::write(&path, text).expect("the file can be written");
        path
    }

    /// Sends one request to the loader; `None` if the loader cannot be reached.
    pub fn try_rest(&self, method: &str, path: &str, body: &str) -> Option<Reply> {
        rest::request(&self.cell.socket(), method, path, body.as_bytes()).ok()
    }

    /// Sends one request to the loader; panics if the loader cannot be reached.
    pub fn rest(&self, method: &str, path: &str, body: &str) -> Reply {
        rest::request(&self.cell.socket(), method, path, body.as_bytes())
            .unwrap_or_else(|error| panic!("{method} {path}: {error}\n{}", self.logs()))
    }

    /// Returns the value of a port of a command, given by its id or the name of its net.
    pub fn value(&self, command: impl std::fmt::Display, port: &str) -> Value {
        let path = format!("/commands/{command}/values?ports={port}");
        let reply = self.rest("GET", &path, "");
        assert_eq!(reply.status, 200, "{reply:?}");
        reply.body["values"][0]["value"].clone()
    }

    /// Loads a net and waits until it is `ready` or `rejected`; returns the command's id and row.
    pub fn load_any(&self, text: &str) -> (u64, Value) {
        let loaded = self.rest("POST", "/commands", text);
        assert_eq!(loaded.status, 202, "{loaded:?}");
        assert_eq!(loaded.body["state"], "loading", "{loaded:?}");
        let id = loaded.body["id"].as_u64().expect("an id");
        let row = await_some(&format!("command {id} to be loaded"), || {
            let row = self.state(id);
            (row["state"] != "loading").then_some(row)
        });
        (id, row)
    }

    /// Loads a net, asserts that it becomes `ready`, and returns the command's id.
    pub fn load(&self, text: &str) -> u64 {
        let (id, row) = self.load_any(text);
        assert_eq!(row["state"], "ready", "{row}\n{}", self.logs());
        id
    }

    /// Requests the operation `what` (`start`, `cancel` or `abort`) for a command.
    pub fn operate(&self, id: u64, what: &str) -> Reply {
        self.rest("POST", &format!("/commands/{id}/{what}"), "")
    }

    /// Requests `start`, `cancel` or `abort` and asserts that the request succeeds.
    pub fn done(&self, id: u64, what: &str) {
        let reply = self.operate(id, what);
        assert_eq!(reply.status, 200, "{what} {id}: {reply:?}\n{}", self.logs());
    }

    /// Starts a command, and retries while START is refused because its device is still coming to rest.
    pub fn start_when_ready(&self, id: u64) {
        await_some(&format!("the start of {id}"), || {
            let reply = self.operate(id, "start");
            let later = reply.code() == "RCC3008";
            assert!(reply.status == 200 || later, "{reply:?}\n{}", self.logs());
            (reply.status == 200).then_some(())
        });
    }

    /// Loads a net and starts it as soon as its device allows it; returns the command's id.
    pub fn run(&self, text: &str) -> u64 {
        let id = self.load(text);
        self.start_when_ready(id);
        id
    }

    /// Returns the row of a command.
    pub fn state(&self, id: u64) -> Value {
        let reply = self.rest("GET", &format!("/commands/{id}"), "");
        assert_eq!(reply.status, 200, "{reply:?}\n{}", self.logs());
        reply.body
    }

    /// Waits until a command is terminated, even if the loader dies meanwhile; returns its row.
    pub fn await_end(&self, id: u64) -> Value {
        await_some(&format!("the end of command {id}"), || {
            let reply = self.try_rest("GET", &format!("/commands/{id}"), "")?;
            (reply.body["state"] == "terminated").then_some(reply.body)
        })
    }

    /// Waits until a command is terminated and asserts the reason.
    pub fn assert_ends(&self, id: u64, reason: &str) {
        let row = self.await_end(id);
        assert_eq!(row["reason"], reason, "{row}\n{}", self.logs());
    }

    /// Returns the row of a device; `None` while the loader or the executor is not running.
    pub fn device(&self, name: &str) -> Option<Value> {
        let reply = self.try_rest("GET", "/devices", "")?;
        let rows = reply.body.as_array()?.clone();
        rows.into_iter().find(|row| row["name"] == name)
    }

    /// Waits until a device is in this state.
    pub fn await_device(&self, name: &str, state: &str) {
        await_some(&format!("device {name} to be {state}"), || {
            (self.device(name)?["state"] == state).then_some(())
        });
    }

    /// Waits until every device is ready.
    pub fn await_devices(&self) {
        await_some("all devices to be ready", || {
            let reply = self.try_rest("GET", "/devices", "")?;
            let rows = reply.body.as_array()?;
            let ready = rows.iter().all(|row| row["state"] == "ready");
            (ready && !rows.is_empty()).then_some(())
        });
    }

    /// Waits until a process with this role and label is announced and returns its announcement.
    pub fn announced(&self, role: Role, label: &str) -> Announcement {
        await_some(&format!("{role} {label} to be announced"), || {
            self.cell.announced(role, label).ok().flatten()
        })
    }

    /// Kills a process of the cell with SIGKILL and returns its incarnation.
    pub fn kill(&self, role: Role, label: &str) -> u64 {
        let announced = self.announced(role, label);
        assert!(
            signal(announced.pid, Signal::SIGKILL),
            "{role} {label} has already exited"
        );
        announced.incarnation
    }

    /// Waits until a process with another incarnation than `dead` is announced and alive.
    pub fn await_successor(&self, role: Role, label: &str, dead: u64) -> Announcement {
        // A helper thread that waits for a slow disk counts as hung only after a minute.
        await_within(2 * LIMIT, &format!("a successor of {role} {label}"), || {
            let announced = self.cell.announced(role, label).ok().flatten()?;
            (announced.incarnation != dead && announced.liveness().is_alive()).then_some(announced)
        })
    }

    /// Opens the executor's boards in the role of a monitor.
    pub fn watch(&self) -> ExecutorBoards {
        let session = Session::join(&self.cell, Role::Monitor, "watch").expect("a cell");
        let executor = self.announced(Role::Executor, "exec");
        let status = session.open_board(&executor.services[STATUS]);
        let tables = session.open_board(&executor.services[TABLES]);
        ExecutorBoards {
            status: status.expect("the status board"),
            tables: tables.expect("the tables board"),
            _session: session,
        }
    }

    /// Returns the last 30 lines of each log of the cell.
    pub fn logs(&self) -> String {
        let mut text = String::new();
        let runs = fs::read_dir(self.cell.state().logs_dir())
            .into_iter()
            .flatten();
        let newest = runs.flatten().map(|entry| entry.path()).max();
        for folder in std::iter::once(self.base.clone()).chain(newest) {
            let entries = fs::read_dir(folder).into_iter().flatten().flatten();
            let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
            paths.sort();
            for path in paths
                .iter()
                .filter(|path| path.extension().is_some_and(|e| e == "log"))
            {
                let log = fs::read_to_string(path).unwrap_or_default();
                let lines: Vec<&str> = log.lines().collect();
                let shown = lines[lines.len().saturating_sub(30)..].join("\n");
                let name = path.file_name().unwrap_or_default().display();
                text.push_str(&format!("--- {name}\n{shown}\n"));
            }
        }
        text
    }

    /// Waits until every process of the cell is dead. Announcements are checked too: an exiting process is still alive
    /// when its environment in `/proc` is already empty.
    pub fn await_dead(&self) {
        await_some("all processes to be dead", || {
            let announced = self.cell.announced_all().expect("a list");
            let dead = announced
                .iter()
                .all(|announced| announced.liveness().is_dead());
            (dead && processes::with_runtime_dir(&self.base).is_empty()).then_some(())
        });
    }

    /// Asserts that the ended cell left no process, no shared memory and no file in its runtime folder.
    pub fn assert_nothing_left(&self) {
        let left = self.cell.leftovers().expect("/dev/shm can be listed");
        assert!(
            left.is_empty(),
            "left in shared memory: {left:?}\n{}",
            self.logs()
        );
        let running = processes::with_runtime_dir(&self.base);
        let lines: Vec<_> = running
            .iter()
            .map(|pid| processes::command_line(*pid))
            .collect();
        assert!(
            lines.is_empty(),
            "still running: {lines:?}\n{}",
            self.logs()
        );
        let files = files_below(self.cell.runtime_dir());
        assert!(files.is_empty(), "left in the runtime folder: {files:?}");
    }
}

impl Drop for CellFixture {
    /// Kills the remaining processes and removes all files. Only this cell's processes have the folder in their
    /// environment.
    fn drop(&mut self) {
        let begun = Instant::now();
        loop {
            let running = processes::with_runtime_dir(&self.base);
            for pid in &running {
                signal(*pid, Signal::SIGKILL);
            }
            if running.is_empty() || begun.elapsed() > Duration::from_secs(5) {
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        // Errors are ignored: files that could not be removed remain visible in /dev/shm and the temporary folder.
        for file in self.cell.leftovers().unwrap_or_default() {
            let _ = fs::remove_file(file);
        }
        let _ = fs::remove_dir_all(self.cell.iox_root());
        let _ = fs::remove_dir_all(&self.base);
    }
}

/// Readers of the executor's status and table boards.
pub struct ExecutorBoards {
    status: BoardReader<CycleStatus>,
    tables: BoardReader<Tables>,
    _session: Session,
}

impl ExecutorBoards {
    /// Returns the newest status.
    pub fn status(&self) -> CycleStatus {
        self.status.read()
    }

    /// Returns the newest tables.
    pub fn tables(&self) -> Tables {
        self.tables.read()
    }

    /// Waits until the executor has computed `count` further cycles.
    pub fn await_cycles(&self, count: u64) {
        let begun = self.status().cycle;
        await_some(&format!("{count} cycles"), || {
            (self.status().cycle > begun + count).then_some(())
        });
    }
}

/// Returns all files below a folder, recursively.
pub fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            files.extend(files_below(&path));
        } else {
            files.push(path);
        }
    }
    files
}

fn new_folder(parent: &Path) -> PathBuf {
    static NUMBER: AtomicU32 = AtomicU32::new(0);
    // Short, because the path of a Unix socket is limited to 107 bytes. Relaxed: the numbers only need to differ.
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let folder = parent.join(format!("rcc-t{}-{number}", std::process::id()));
    fs::create_dir_all(&folder).expect("a temporary folder");
    folder.canonicalize().expect("it was just made")
}

/// Replaces the values of the line `ports: {…}` with ports that are free now; returns the text and the ports by name.
fn choose_ports(text: &str) -> (String, BTreeMap<String, u16>) {
    let mut ports = BTreeMap::new();
    let mut lines = Vec::new();
    for line in text.lines() {
        let list = line
            .strip_prefix("ports: {")
            .and_then(|rest| rest.strip_suffix('}'));
        let Some(list) = list else {
            lines.push(line.to_owned());
            continue;
        };
        for (name, _) in list.split(',').filter_map(|pair| pair.split_once(':')) {
            ports.insert(name.trim().to_owned(), new_port());
        }
        let chosen: Vec<String> = ports
            .iter()
            .map(|(name, port)| format!("{name}: {port}"))
            .collect();
        lines.push(format!("ports: {{{}}}", chosen.join(", ")));
    }
    (lines.join("\n") + "\n", ports)
}

/// Returns an unused port below the ephemeral range of the system: a driver that is killed must find its port free
/// when it is restarted.
fn new_port() -> u16 {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    const FIRST: u32 = 12_000;
    const COUNT: u32 = 20_000;
    loop {
        // Relaxed: the numbers only need to differ. The process id separates the ranges of concurrent test processes.
        let number = NEXT.fetch_add(1, Ordering::Relaxed) + std::process::id() * 97;
        let port = (FIRST + number % COUNT) as u16;
        let free = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok()
            && UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).is_ok();
        if free {
            return port;
        }
    }
}
