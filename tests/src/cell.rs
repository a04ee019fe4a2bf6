//! A cell of one test: own name, runtime folder, shared-memory prefix and ports; ended and checked for
//! left-overs when dropped.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rcc_config::ports::{Protocol, free_port};
use rcc_core::message::{CycleStatus, Tables};
use rcc_ipc::control::{STATUS, TABLES};
use rcc_ipc::{Announcement, BoardReader, Cell, Role, Session};
use serde_json::Value;

use crate::programs::{program, repository};
use crate::simulator::Simulator;

/// Generous: a shared machine may stall, and a test that waits this long has failed anyway.
pub const LIMIT: Duration = Duration::from_secs(60);

/// Name of every test's cell; the folders differ.
const NAME: &str = "test";

/// A running cell, supervised by `rcc-cli up`.
pub struct TestCell {
    cell: Cell,
    base: PathBuf,
    config: PathBuf,
    up: Child,
    ports: BTreeMap<String, u16>,
    commands: AtomicU32,
}

impl TestCell {
    /// Starts the demo cell's configuration.
    pub fn demo() -> TestCell {
        TestCell::start(&repository().join("configs/cells/demo.yaml"), |text| text)
    }

    /// Starts a cell from a configuration file after `change` was applied to its text. Ports that the file leaves
    /// open are chosen here, so that the test can reach the simulators.
    pub fn start(config: &Path, change: impl Fn(String) -> String) -> TestCell {
        let base = new_folder();
        let folder = config
            .parent()
            .expect("a configuration is in a folder")
            .canonicalize()
            .expect("it exists");
        let text = change(fs::read_to_string(config).expect("the configuration can be read"));
        // Relative paths are relative to the file, which moves.
        let text = text.replace("../robots/", &format!("{}/../robots/", folder.display()));
        let (text, ports) = choose_ports(text);
        let config = base.join("cell.yaml");
        fs::write(&config, text).expect("the configuration can be written");
        let log = fs::File::create(base.join("up.log")).expect("a log can be written");
        let up = Command::new(program("rcc-cli"))
            .args(["--cell", NAME, "up"])
            .arg(&config)
            .env("RCC_RUNTIME_DIR", &base)
            .stdout(log.try_clone().expect("a handle"))
            .stderr(log)
            .stdin(Stdio::null())
            .spawn()
            .expect("rcc-cli starts");
        let cell = Cell::at(NAME, &base.join(NAME)).expect("a short path");
        let mut test = TestCell {
            cell,
            base,
            config,
            up,
            ports,
            commands: AtomicU32::new(0),
        };
        test.await_ready();
        test
    }

    fn await_ready(&mut self) {
        let begun = Instant::now();
        loop {
            let devices = self.cli(&["--output", "json", "devices"]);
            let text = String::from_utf8_lossy(&devices.stdout).into_owned();
            let ready = text.matches("\"ready\"").count();
            if devices.status.success() && ready > 0 && ready == text.matches("\"state\"").count() {
                return;
            }
            if let Some(status) = self.up.try_wait().expect("the child can be asked") {
                panic!("rcc-cli up ended ({status}):\n{}", self.log());
            }
            assert!(
                begun.elapsed() < LIMIT,
                "the cell is not ready: {text}\n{}",
                self.log()
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// What `rcc-cli up` and its children printed.
    pub fn log(&self) -> String {
        fs::read_to_string(self.base.join("up.log")).unwrap_or_default()
    }

    /// The cell.
    pub fn cell(&self) -> &Cell {
        &self.cell
    }

    /// The configuration file in use.
    pub fn config(&self) -> &Path {
        &self.config
    }

    /// A folder of this test.
    pub fn folder(&self) -> &Path {
        &self.base
    }

    /// Process id of `rcc-cli up`.
    pub fn supervisor(&self) -> u32 {
        self.up.id()
    }

    /// `rcc-cli` in this cell, ready to be given arguments.
    pub fn command(&self) -> Command {
        let mut command = Command::new(program("rcc-cli"));
        command
            .args(["--cell", NAME])
            .env("RCC_RUNTIME_DIR", &self.base)
            .stdin(Stdio::null());
        command
    }

    /// Any program of ours in this cell.
    pub fn program(&self, name: &str) -> Command {
        let mut command = Command::new(program(name));
        command
            .args(["--cell", NAME])
            .env("RCC_RUNTIME_DIR", &self.base)
            .stdin(Stdio::null());
        command
    }

    /// Runs `rcc-cli` with these arguments to its end.
    pub fn cli(&self, arguments: &[&str]) -> Output {
        self.command()
            .args(arguments)
            .output()
            .expect("rcc-cli runs")
    }

    /// Runs `rcc-cli --output json` and returns what it printed; it must succeed.
    pub fn json(&self, arguments: &[&str]) -> Value {
        let output = self
            .command()
            .args(["--output", "json"])
            .args(arguments)
            .output()
            .expect("rcc-cli runs");
        let text = String::from_utf8_lossy(&output.stdout);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success(),
            "{arguments:?}: {}\n{text}\n{errors}\n{}",
            output.status,
            self.log()
        );
        serde_json::from_str(text.trim())
            .unwrap_or_else(|error| panic!("{arguments:?}: {text:?}: {error}"))
    }

    /// Writes a net into the test's folder.
    pub fn net(&self, text: &str) -> PathBuf {
        // Relaxed: only different numbers are wanted.
        let number = self.commands.fetch_add(1, Ordering::Relaxed);
        let path = self.base.join(format!("net-{number}.yaml"));
        fs::write(&path, text).expect("the net can be written");
        path
    }

    /// Loads a net and waits until it is ready; returns its id as text.
    pub fn load(&self, net: &Path) -> String {
        let loaded = self.json(&["load", net.to_str().expect("a plain path")]);
        loaded["id"]
            .as_u64()
            .map(|id| id.to_string())
            .unwrap_or_else(|| panic!("no id in {loaded}"))
    }

    /// State and, once terminated, reason of a command.
    pub fn state(&self, id: &str) -> (String, Option<String>) {
        let state = self.json(&["state", id]);
        let text = |key: &str| state[key].as_str().map(str::to_owned);
        (
            text("state").unwrap_or_else(|| panic!("no state in {state}")),
            text("reason"),
        )
    }

    /// Waits until a command is terminated; returns its reason.
    pub fn await_end(&self, id: &str) -> String {
        let reason = await_some(&format!("the end of command {id}"), || {
            let (state, reason) = self.state(id);
            (state == "terminated").then_some(reason)
        });
        reason.expect("a terminated command has a reason")
    }

    /// Who is announced.
    pub fn announced(&self, role: Role, label: &str) -> Announcement {
        let announced = self
            .cell
            .announced(role, label)
            .expect("announcements can be read");
        announced.unwrap_or_else(|| panic!("{role} {label} is not announced\n{}", self.log()))
    }

    /// Kills a process of the cell and returns its incarnation.
    pub fn kill(&self, role: Role, label: &str) -> u64 {
        let announced = self.announced(role, label);
        kill(pid(announced.pid), Signal::SIGKILL).expect("the process is ours");
        announced.incarnation
    }

    /// Waits until another incarnation of a process is announced and alive.
    pub fn await_successor(&self, role: Role, label: &str, dead: u64) -> Announcement {
        await_some(&format!("a successor of {role} {label}"), || {
            let announced = self.cell.announced(role, label).ok().flatten()?;
            (announced.incarnation != dead && announced.is_alive()).then_some(announced)
        })
    }

    /// Waits until a device is in this state.
    pub fn await_device(&self, device: &str, state: &str) {
        await_some(&format!("{device} {state}"), || {
            let output = self.cli(&["--output", "json", "devices"]);
            let devices: Value = serde_json::from_slice(&output.stdout).ok()?;
            let devices = devices["devices"]
                .as_array()
                .or(devices.as_array())?
                .clone();
            devices
                .iter()
                .any(|row| row["name"] == device && row["state"] == state)
                .then_some(())
        });
    }

    /// The control port of a simulator, by the name of its port in the configuration.
    pub fn simulator(&self, port: &str) -> Simulator {
        Simulator::connect(self.ports[port])
    }

    /// The number of a port of the configuration.
    pub fn port(&self, name: &str) -> u16 {
        self.ports[name]
    }

    /// The executor's boards, read as a monitor would.
    pub fn watch(&self) -> Watch {
        let session =
            Session::join(&self.cell, Role::Monitor, "test").expect("the cell can be joined");
        let executor = self.announced(Role::Executor, "exec");
        let status = session
            .open_board(&executor.services[STATUS])
            .expect("the status board");
        let tables = session
            .open_board(&executor.services[TABLES])
            .expect("the tables board");
        Watch {
            status,
            tables,
            _session: session,
        }
    }

    /// Ends the cell as Ctrl-C does and checks that nothing is left.
    pub fn stop(mut self) {
        self.end();
        self.check_clean();
    }

    fn end(&mut self) {
        let begun = Instant::now();
        if self.up.try_wait().ok().flatten().is_none() {
            // Refused only if it ended between the two calls.
            let _ = kill(pid(self.up.id()), Signal::SIGTERM);
        }
        while begun.elapsed() < LIMIT {
            if self.up.try_wait().ok().flatten().is_some() {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn check_clean(&self) {
        let left = self.cell.leftovers().expect("/dev/shm can be listed");
        assert!(
            left.is_empty(),
            "left in shared memory: {left:?}\n{}",
            self.log()
        );
        let processes = processes_in(&self.base);
        assert!(
            processes.is_empty(),
            "still running: {processes:?}\n{}",
            self.log()
        );
    }
}

impl Drop for TestCell {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("--- log of the cell\n{}---", self.log());
        }
        self.end();
        // Whatever a failed test left behind: nothing else carries this folder in its environment.
        let _ = kill(pid(self.up.id()), Signal::SIGKILL);
        let _ = self.up.wait();
        for process in processes_in(&self.base) {
            let _ = kill(pid(process), Signal::SIGKILL);
        }
        for file in self.cell.leftovers().unwrap_or_default() {
            let _ = fs::remove_file(file);
        }
        let _ = fs::remove_dir_all(&self.base);
    }
}

/// The executor's boards.
pub struct Watch {
    status: BoardReader<CycleStatus>,
    tables: BoardReader<Tables>,
    _session: Session,
}

impl Watch {
    /// The newest counters.
    pub fn status(&self) -> CycleStatus {
        self.status.read()
    }

    /// The newest tables.
    pub fn tables(&self) -> Tables {
        self.tables.read()
    }
}

/// Waits until `ask` gives something, with a generous limit.
pub fn await_some<T>(what: &str, mut ask: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(value) = ask() {
            return value;
        }
        assert!(begun.elapsed() < LIMIT, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn pid(pid: u32) -> Pid {
    Pid::from_raw(pid.cast_signed())
}

/// Processes that were started with this runtime folder.
fn processes_in(base: &Path) -> Vec<u32> {
    let wanted = format!("RCC_RUNTIME_DIR={}", base.display());
    let own = std::process::id();
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    pids.filter(|pid| *pid != own)
        .filter(|pid| {
            let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
            environment
                .split(|byte| *byte == 0)
                .any(|entry| entry == wanted.as_bytes())
        })
        .collect()
}

fn new_folder() -> PathBuf {
    static NUMBER: AtomicU32 = AtomicU32::new(0);
    // Short, because the path of a Unix socket is limited to 107 bytes.
    let name = format!(
        "rcc-t{}-{}",
        std::process::id(),
        NUMBER.fetch_add(1, Ordering::Relaxed)
    );
    let folder = std::env::temp_dir().join(name);
    fs::create_dir_all(&folder).expect("a temporary folder");
    folder
}

/// Replaces `auto udp` and `auto tcp` by ports that are free now.
fn choose_ports(text: String) -> (String, BTreeMap<String, u16>) {
    let mut ports = BTreeMap::new();
    let lines = text.lines().map(|line| {
        let Some(list) = line
            .strip_prefix("ports: {")
            .and_then(|rest| rest.strip_suffix('}'))
        else {
            return line.to_owned();
        };
        let chosen = list
            .split(',')
            .filter_map(|pair| pair.split_once(':'))
            .map(|(name, kind)| {
                let protocol = if kind.contains("udp") {
                    Protocol::Udp
                } else {
                    Protocol::Tcp
                };
                let port = free_port(protocol).expect("a free port");
                ports.insert(name.trim().to_owned(), port);
                format!("{}: {port}", name.trim())
            });
        format!("ports: {{{}}}", chosen.collect::<Vec<_>>().join(", "))
    });
    let text = lines.collect::<Vec<_>>().join("\n");
    (text, ports)
}
