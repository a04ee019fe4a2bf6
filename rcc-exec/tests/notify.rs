//! Tests the executor under a supervisor played by the test: READY comes only when the executor is announced, the
//! heartbeat follows the cycle, and the exit code tells whether a restart can help. Run by the threads of the test
//! harness.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::DirBuilderExt;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::sys::{ptrace, wait};
use nix::unistd::Pid;

/// Longer than any step takes on any machine.
const LIMIT: Duration = Duration::from_secs(60);
/// The watchdog's timeout; the executor sends four heartbeats in this time.
const WATCHDOG: Duration = Duration::from_millis(800);

/// The folder of a cell, the supervisor's socket, and the executor.
struct SupervisedExecutor {
    folder: PathBuf,
    socket: UnixDatagram,
    executor: Child,
}

impl SupervisedExecutor {
    fn start(name: &str, change: impl Fn(String) -> String) -> SupervisedExecutor {
        SupervisedExecutor::start_with(name, change, |_, _| {})
    }

    /// Starts the executor; `prepare` gets the folder and the command before the start.
    fn start_with(
        name: &str,
        change: impl Fn(String) -> String,
        prepare: impl FnOnce(&Path, &mut Command),
    ) -> SupervisedExecutor {
        let folder = PathBuf::from(format!(
            "/dev/shm/rcc-exec-notify-{name}-{}",
            std::process::id()
        ));
        // Mode 0700, because it is a runtime folder.
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&folder)
            .unwrap();
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
        let robots = configs.join("robots").canonicalize().unwrap();
        let text = fs::read_to_string(configs.join("cells/demo.yaml")).unwrap();
        let text = text.replace("../robots", robots.to_str().unwrap());
        let config = folder.join("cell.yaml");
        fs::write(&config, change(text)).unwrap();
        let path = folder.join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_read_timeout(Some(LIMIT)).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_rcc-exec"));
        command
            .args(["--cell", "demo", "--parent-death"])
            .env("RCC_CONFIG", config)
            .env("RCC_PORTS", "fri=1,io=3")
            .env("RCC_RUNTIME_DIR", &folder)
            .env("RCC_STATE_DIR", folder.join("state"))
            .env("NOTIFY_SOCKET", path)
            .env("WATCHDOG_USEC", WATCHDOG.as_micros().to_string())
            .stderr(Stdio::piped());
        prepare(&folder, &mut command);
        let executor = command.spawn().unwrap();
        SupervisedExecutor {
            folder,
            socket,
            executor,
        }
    }

    /// Returns the next message, or `None` if none arrives within the socket's time limit.
    fn message(&self) -> Option<String> {
        let mut buffer = [0; 4096];
        match self.socket.recv(&mut buffer) {
            Ok(size) => Some(String::from_utf8(buffer[..size].to_vec()).unwrap()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => None,
            Err(error) => panic!("{error}"),
        }
    }

    /// Returns the next message that has a line starting with `wanted`.
    fn await_message(&self, wanted: &str) -> String {
        loop {
            let text = self.message();
            let text = text.unwrap_or_else(|| panic!("{wanted} did not come"));
            if text.lines().any(|line| line.starts_with(wanted)) {
                return text;
            }
        }
    }

    fn pid(&self) -> Pid {
        Pid::from_raw(self.executor.id().cast_signed())
    }

    fn rt_thread(&self) -> Pid {
        self.thread("rcc-rt")
    }

    fn thread(&self, wanted: &str) -> Pid {
        let tasks = fs::read_dir(format!("/proc/{}/task", self.executor.id())).unwrap();
        let found = tasks.flatten().find(|task| {
            let name = fs::read_to_string(task.path().join("comm")).unwrap_or_default();
            name.trim() == wanted
        });
        let name = found.expect("the thread runs").file_name();
        Pid::from_raw(name.to_str().unwrap().parse().unwrap())
    }

    fn stop(&mut self) -> ExitStatus {
        kill(self.pid(), Signal::SIGTERM).unwrap();
        self.executor.wait().unwrap()
    }

    /// Waits for the executor to end; returns its status and its stderr.
    fn end(&mut self) -> (ExitStatus, String) {
        let status = self.executor.wait().unwrap();
        let mut text = String::new();
        let mut stderr = self.executor.stderr.take().unwrap();
        std::io::Read::read_to_string(&mut stderr, &mut text).unwrap();
        (status, text)
    }

    fn events(&self) -> String {
        fs::read_to_string(self.folder.join("state/cells/demo/events.jsonl")).unwrap_or_default()
    }

    /// Asserts that no heartbeat arrives for the watchdog's time.
    fn assert_no_heartbeat(&self) {
        self.socket.set_nonblocking(true).unwrap();
        while self.message().is_some() {}
        self.socket.set_nonblocking(false).unwrap();
        // One heartbeat may have been under way when the thread stopped.
        self.socket.set_read_timeout(Some(WATCHDOG)).unwrap();
        let mut beats = 0;
        while let Some(text) = self.message() {
            beats += u32::from(text.contains("WATCHDOG=1"));
            assert!(beats <= 1, "a heartbeat without a cycle: {text}");
        }
        self.socket.set_read_timeout(Some(LIMIT)).unwrap();
    }
}

impl Drop for SupervisedExecutor {
    fn drop(&mut self) {
        let _ = self.executor.kill();
        // A thread that a failed test has stopped must be waited for by this thread, or the executor never ends.
        let flags = wait::WaitPidFlag::__WALL | wait::WaitPidFlag::__WNOTHREAD;
        while wait::waitpid(None, Some(flags)).is_ok() {}
        let _ = self.executor.wait();
        // Removes what a killed executor leaves in shared memory.
        if let Ok(cell) = rcc_ipc::Cell::at("demo", &self.folder.join("demo")) {
            let _ = rcc_ipc::clean::remove_cell(&cell);
        }
        let _ = fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn ready_comes_when_the_executor_is_announced_and_stopping_before_it_ends() {
    let mut supervised = SupervisedExecutor::start("ready", |text| text);
    let text = supervised.message().expect("READY comes");
    assert!(text.lines().any(|line| line == "READY=1"), "{text}");
    let status = text.lines().find(|line| line.starts_with("STATUS="));
    let status = status.expect("a status comes with it");
    assert!(status.contains("1000 Hz, 0 nets"), "{status}");
    assert!(
        status.contains("RT granted") || status.contains("DEGRADED: not real-time: "),
        "{status}"
    );
    let announced = supervised.folder.join("demo/processes/executor-exec.json");
    assert!(announced.is_file(), "READY came before the announcement");
    supervised.await_message("WATCHDOG=1");
    let status = supervised.stop();
    assert!(status.success(), "{status}");
    supervised.await_message("STOPPING=1");
}

#[test]
fn no_cycle_no_heartbeat() {
    let mut supervised = SupervisedExecutor::start("heart", |text| text);
    supervised.await_message("READY=1");
    let thread = supervised.rt_thread();
    if let Err(error) = ptrace::seize(thread, ptrace::Options::empty()) {
        eprintln!("skipped: the system does not allow ptrace ({error})");
        return;
    }
    ptrace::interrupt(thread).unwrap();
    wait::waitpid(thread, Some(wait::WaitPidFlag::__WALL)).unwrap();
    supervised.assert_no_heartbeat();
    ptrace::detach(thread, None).unwrap();
    supervised.await_message("WATCHDOG=1");
    assert!(supervised.stop().success());
}

#[test]
fn missing_required_real_time_ends_the_executor_with_exit_code_77() {
    let mut supervised = SupervisedExecutor::start("required", |text| {
        text.replace("{priority: 80}", "{priority: 80, core: 4095, rt: required}")
    });
    let status = supervised.executor.wait().unwrap();
    assert_eq!(status.code(), Some(77));
    let mut text = String::new();
    let mut stderr = supervised.executor.stderr.take().unwrap();
    std::io::Read::read_to_string(&mut stderr, &mut text).unwrap();
    assert!(text.contains("core 4095 was refused"), "{text}");
    assert!(text.contains("rt: required"), "{text}");
    supervised.socket.set_nonblocking(true).unwrap();
    assert_eq!(supervised.message(), None, "READY must not come");
}

/// Stops one thread of a running executor until the heartbeat stops, then lets it continue.
fn hang(helper: &str) {
    let mut supervised = SupervisedExecutor::start(&format!("hang-{helper}"), |text| text);
    supervised.await_message("READY=1");
    let thread = supervised.thread(helper);
    if let Err(error) = ptrace::seize(thread, ptrace::Options::empty()) {
        eprintln!("skipped: the system does not allow ptrace ({error})");
        return;
    }
    ptrace::interrupt(thread).unwrap();
    wait::waitpid(thread, Some(wait::WaitPidFlag::__WALL)).unwrap();
    let status =
        supervised.await_message(&format!("STATUS=HANGS: the helper thread `{helper}` hangs"));
    assert!(status.contains("1000 Hz"), "the cycle goes on: {status}");
    supervised.assert_no_heartbeat();
    ptrace::detach(thread, None).unwrap();
    supervised.await_message("WATCHDOG=1");
    assert!(supervised.stop().success());
    let reported = supervised.events();
    let reported = reported
        .lines()
        .any(|line| line.contains("helper-hangs") && line.contains(helper));
    assert!(reported, "{}", supervised.events());
}

#[test]
fn an_intake_thread_that_hangs_stops_the_heartbeat() {
    hang("intake");
}

#[test]
fn a_pump_thread_that_hangs_stops_the_heartbeat() {
    hang("pump");
}

#[test]
fn an_event_thread_that_hangs_stops_the_heartbeat() {
    hang("events");
}

#[test]
fn a_helper_that_panics_ends_the_executor_with_its_name() {
    for helper in [
        "intake",
        "net-builder",
        "pump",
        "incidents",
        "events",
        "notify",
    ] {
        let mut trigger = PathBuf::new();
        let mut supervised = SupervisedExecutor::start_with(
            &format!("panic-{helper}"),
            |text| text,
            |folder, command| {
                trigger = folder.join("panic");
                let wanted = format!("{helper}@{}", trigger.display());
                command.env("RCC_TEST_PANIC", wanted);
            },
        );
        supervised.await_message("READY=1");
        fs::write(&trigger, "").unwrap();
        let (status, text) = supervised.end();
        assert_eq!(status.code(), Some(1), "{helper}: {status}: {text}");
        let named = format!("the helper thread `{helper}` panicked");
        assert!(text.contains(&named), "{text}");
        // Without the thread that writes events there are no events.
        let reported = supervised.events().contains(&named);
        assert!(reported || helper == "events", "{}", supervised.events());
    }
}

/// Only files with an executor's file name are considered, and only those of dead executors are removed.
#[test]
fn incomplete_incidents_of_dead_executors_are_removed_at_the_start() {
    let own = rcc_os::process_instance::ProcessInstance::current()
        .unwrap()
        .incarnation();
    // No process has this id and started at boot.
    let dead = 1 << 40 | 1;
    let name = |life: u64, rest: &str| format!("{life:016x}-7-{rest}");
    let gone = [name(dead, "fault.half"), name(dead, "late.half")];
    let stay = [
        name(own, "fault.half"),
        name(dead, "fault.rcc-incident"),
        "notes.half".to_owned(),
        "7-7-fault.half".to_owned(),
    ];
    let mut incidents = PathBuf::new();
    let path = PathBuf::from(format!("/dev/shm/rcc-exec-halves-{}", std::process::id()));
    let folder = path.display().to_string();
    let mut supervised = SupervisedExecutor::start_with(
        "halves",
        |text| format!("{text}\nrecorder: {{folder: {folder}}}\n"),
        |_, _| {
            incidents = path.join("demo/incidents");
            fs::create_dir_all(&incidents).unwrap();
            for name in gone.iter().chain(&stay) {
                fs::write(incidents.join(name), "half").unwrap();
            }
        },
    );
    supervised.await_message("READY=1");
    let begun = std::time::Instant::now();
    while gone.iter().any(|name| incidents.join(name).exists()) && begun.elapsed() < LIMIT {
        std::thread::yield_now();
    }
    let left: Vec<_> = fs::read_dir(&incidents)
        .unwrap()
        .flatten()
        .map(|file| file.file_name())
        .collect();
    // Until it ends, it may write files there.
    assert!(supervised.stop().success());
    fs::remove_dir_all(&path).unwrap();
    assert_eq!(left.len(), stay.len(), "{left:?}");
    assert!(
        stay.iter()
            .all(|name| left.iter().any(|file| file.to_str() == Some(name))),
        "{left:?}"
    );
}
