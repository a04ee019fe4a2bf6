//! A cell without a supervisor, whose processes a test starts, kills and restarts any number of times: a supervisor
//! gives up after a few deaths. Runs on the threads of the test harness.

use std::collections::BTreeMap;
use std::fs::File;
use std::ops::Deref;
use std::process::{Child, Command, ExitStatus, Stdio};

use nix::sys::signal::Signal;
use rcc_config::CellConfig;
use rcc_core::message::DeviceState;
use rcc_ipc::clean;
use rcc_os::process_instance::ProcessInstance;
use rcc_protocol::Role;

use crate::cell_fixture::{CellFixture, ExecutorBoards};
use crate::processes::{ends_with_test, signal};
use crate::programs::{program, repository};
use crate::waiting::await_some;

/// A cell without a supervisor, and its child processes by name.
#[derive(Debug)]
pub struct UnsupervisedCell {
    place: CellFixture,
    children: BTreeMap<String, Child>,
}

impl UnsupervisedCell {
    /// Prepares the demo cell with its configuration edited by `change`; starts no process.
    pub fn new(change: impl Fn(String) -> String) -> UnsupervisedCell {
        UnsupervisedCell {
            place: CellFixture::new(&repository().join("configs/cells/demo.yaml"), change),
            children: BTreeMap::new(),
        }
    }

    /// Starts all processes of the demo cell and waits until its devices are ready.
    pub fn demo() -> UnsupervisedCell {
        let mut cell = UnsupervisedCell::new(|text| text);
        for name in ["lwr-sim", "io-sim"] {
            cell.start_simulator(name);
        }
        cell.start_executor();
        cell.start_loader();
        for device in ["lwr", "io"] {
            cell.start_driver(device);
        }
        cell.await_devices();
        cell
    }

    /// Starts a simulator of the configuration.
    pub fn start_simulator(&mut self, name: &str) {
        let config = CellConfig::load(self.config(), &BTreeMap::new());
        let config = config.unwrap_or_else(|faults| panic!("{faults}"));
        let simulator = config
            .simulators
            .iter()
            .find(|simulator| simulator.name == name);
        let simulator = simulator.unwrap_or_else(|| panic!("no simulator {name}"));
        let mut command = Command::new(program(&simulator.program));
        command
            .args(&simulator.arguments)
            .arg("--control")
            .arg(self.cell().simulator_socket(name))
            .env("RCC_RUNTIME_DIR", self.folder())
            .env("RCC_STATE_DIR", self.state_dir());
        self.spawn(name, command);
    }

    /// Starts the executor, waits until it is announced, and returns its process id.
    pub fn start_executor(&mut self) -> u32 {
        let command = self.ours("rcc-exec");
        self.spawn("executor", command);
        self.await_announced("executor", Role::Executor, "exec")
    }

    /// Starts the loader, waits until it answers, and returns its process id.
    pub fn start_loader(&mut self) -> u32 {
        let command = self.ours("rcc-loader");
        self.spawn("loader", command);
        await_some("the loader to answer", || {
            self.try_rest("GET", "/status", "")
        });
        self.children["loader"].id()
    }

    /// Starts the driver of a device and returns its process id.
    pub fn start_driver(&mut self, device: &str) -> u32 {
        let mut command = self.ours("rcc-driver");
        // The priority that a supervisor gives it.
        command.args(["--device", device, "--priority", "70"]);
        self.spawn(device, command)
    }

    /// Waits until the executor reads the board of the driver started last and the device is ready.
    pub fn await_driver(&self, watch: &ExecutorBoards, device: &str) {
        let pid = self.pid(device);
        let config = CellConfig::load(self.config(), &BTreeMap::new());
        let config = config.unwrap_or_else(|faults| panic!("{faults}"));
        let (index, _) = config.device(device).expect("a device of the cell");
        await_some(&format!("driver {pid} of {device} to be ready"), || {
            let row = watch.tables().devices[index];
            let seen = ProcessInstance::from_incarnation(row.incarnation).pid == pid;
            (seen && row.state == DeviceState::Ready as u32).then_some(())
        });
    }

    /// Sends a signal to a process, waits until it is dead, and runs the janitor as a supervisor does.
    pub fn end(&mut self, name: &str, with: Signal) {
        let mut child = self.children.remove(name).expect("it was started");
        signal(child.id(), with);
        child.wait().expect("the process is a child of this one");
        self.clean();
    }

    /// Runs the janitor until it succeeds, like a supervisor.
    pub fn clean(&self) {
        await_some("the janitor", || {
            clean::run_janitor(self.cell(), clean::JANITOR_TIMEOUT).ok()
        });
    }

    /// Returns the exit status of a child if it has exited. The child is then forgotten and can be started again.
    pub fn ended(&mut self, name: &str) -> Option<ExitStatus> {
        let child = self.children.get_mut(name).expect("it was started");
        let status = child
            .try_wait()
            .expect("the process is a child of this one");
        if status.is_some() {
            self.children.remove(name);
        }
        status
    }

    /// Returns the output of all processes started under this name in this cell.
    pub fn log(&self, name: &str) -> String {
        std::fs::read_to_string(self.folder().join(format!("{name}.log"))).unwrap_or_default()
    }

    /// Returns the process id of a child.
    pub fn pid(&self, name: &str) -> u32 {
        self.children[name].id()
    }

    /// Ends all processes in order, removes the cell's files, and asserts that nothing is left.
    pub fn stop(mut self) {
        for name in ["executor", "loader", "lwr", "io", "lwr-sim", "io-sim"] {
            if let Some(mut child) = self.children.remove(name) {
                signal(child.id(), Signal::SIGTERM);
                let status = child.wait().expect("the process is a child of this one");
                assert!(status.success(), "{name}: {status}\n{}", self.logs());
            }
        }
        clean::remove_cell(self.cell()).expect("all processes of the cell have ended");
        self.assert_nothing_left();
    }

    fn ours(&self, name: &str) -> Command {
        let mut command = self.program(name);
        command
            .arg("--config")
            .arg(self.config())
            .arg("--parent-death");
        command
    }

    fn spawn(&mut self, name: &str, mut command: Command) -> u32 {
        let path = self.folder().join(format!("{name}.log"));
        let log = File::options().create(true).append(true).open(path);
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log.expect("a log can be written"));
        let child = ends_with_test(&mut command).spawn();
        let child = child.unwrap_or_else(|error| panic!("{name}: {error}"));
        let pid = child.id();
        self.children.insert(name.to_owned(), child);
        pid
    }

    fn await_announced(&mut self, name: &str, role: Role, label: &str) -> u32 {
        let pid = self.pid(name);
        let Self { place, children } = self;
        await_some(&format!("{name} to be announced"), || {
            let child = children.get_mut(name).expect("it was started");
            if let Some(status) = child.try_wait().expect("the child can be asked") {
                panic!("{name} ended ({status}):\n{}", place.logs());
            }
            let announced = place.cell().announced(role, label).ok().flatten()?;
            (announced.pid == pid).then_some(())
        });
        pid
    }
}

impl Deref for UnsupervisedCell {
    type Target = CellFixture;

    fn deref(&self) -> &CellFixture {
        &self.place
    }
}

impl Drop for UnsupervisedCell {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("{}", self.logs());
        }
        for child in self.children.values_mut() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
