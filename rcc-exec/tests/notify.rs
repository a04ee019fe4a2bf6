//! The executor under a supervisor whose part the test plays: it says READY only when it is, its heartbeat is that of
//! its cycle, and its exit code tells whether starting again can help. Run by the threads of the test harness.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::sys::{ptrace, wait};
use nix::unistd::Pid;

/// Longer than anything here takes on any machine.
const LIMIT: Duration = Duration::from_secs(60);
/// The watchdog's time; the executor's heartbeat comes four times in it.
const WATCHDOG: Duration = Duration::from_millis(800);

/// A cell's folder, a supervisor's socket and the executor.
struct Supervised {
    folder: PathBuf,
    socket: UnixDatagram,
    executor: Child,
}

impl Supervised {
    fn start(name: &str, change: impl Fn(String) -> String) -> Supervised {
        let folder = PathBuf::from(format!(
            "/dev/shm/rcc-exec-notify-{name}-{}",
            std::process::id()
        ));
        fs::create_dir_all(&folder).unwrap();
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
        let robots = configs.join("robots").canonicalize().unwrap();
        let text = fs::read_to_string(configs.join("cells/demo.yaml")).unwrap();
        let text = text.replace("../robots", robots.to_str().unwrap());
        let config = folder.join("cell.yaml");
        fs::write(&config, change(text)).unwrap();
        let path = folder.join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_read_timeout(Some(LIMIT)).unwrap();
        let executor = Command::new(env!("CARGO_BIN_EXE_rcc-exec"))
            .args(["--cell", "demo", "--parent-death"])
            .env("RCC_CONFIG", config)
            .env("RCC_PORTS", "fri=1,fri_control=2,io=3,io_control=4")
            .env("RCC_RUNTIME_DIR", &folder)
            .env("NOTIFY_SOCKET", path)
            .env("WATCHDOG_USEC", WATCHDOG.as_micros().to_string())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        Supervised {
            folder,
            socket,
            executor,
        }
    }

    /// The next words, `None` if none come within the socket's limit.
    fn words(&self) -> Option<String> {
        let mut buffer = [0; 4096];
        match self.socket.recv(&mut buffer) {
            Ok(size) => Some(String::from_utf8(buffer[..size].to_vec()).unwrap()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => None,
            Err(error) => panic!("{error}"),
        }
    }

    /// The next words with this one among them.
    fn await_words(&self, wanted: &str) -> String {
        loop {
            let words = self.words();
            let words = words.unwrap_or_else(|| panic!("{wanted} did not come"));
            if words.lines().any(|line| line.starts_with(wanted)) {
                return words;
            }
        }
    }

    fn pid(&self) -> Pid {
        Pid::from_raw(self.executor.id().cast_signed())
    }

    fn rt_thread(&self) -> Pid {
        let tasks = fs::read_dir(format!("/proc/{}/task", self.executor.id())).unwrap();
        let found = tasks.flatten().find(|task| {
            let name = fs::read_to_string(task.path().join("comm")).unwrap_or_default();
            name.trim() == "rcc-rt"
        });
        let name = found.expect("the thread runs").file_name();
        Pid::from_raw(name.to_str().unwrap().parse().unwrap())
    }

    fn stop(&mut self) -> ExitStatus {
        kill(self.pid(), Signal::SIGTERM).unwrap();
        self.executor.wait().unwrap()
    }

    /// Nothing but status lines comes within the watchdog's time, twice.
    fn assert_no_heartbeat(&self) {
        self.socket.set_nonblocking(true).unwrap();
        while self.words().is_some() {}
        self.socket.set_nonblocking(false).unwrap();
        // One look may have been under way when the thread stopped.
        self.socket.set_read_timeout(Some(WATCHDOG)).unwrap();
        let mut beats = 0;
        while let Some(words) = self.words() {
            beats += u32::from(words.contains("WATCHDOG=1"));
            assert!(beats <= 1, "a heartbeat without a cycle: {words}");
        }
        self.socket.set_read_timeout(Some(LIMIT)).unwrap();
    }
}

impl Drop for Supervised {
    fn drop(&mut self) {
        let _ = self.executor.kill();
        let _ = self.executor.wait();
        // What an executor that was killed leaves in shared memory.
        if let Ok(cell) = rcc_ipc::Cell::at("demo", &self.folder.join("demo")) {
            let _ = rcc_ipc::clean::remove_cell(&cell);
        }
        let _ = fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn ready_comes_when_the_executor_is_announced_and_stopping_before_it_ends() {
    let mut supervised = Supervised::start("ready", |text| text);
    let words = supervised.words().expect("READY comes");
    assert!(words.lines().any(|line| line == "READY=1"), "{words}");
    let status = words.lines().find(|line| line.starts_with("STATUS="));
    let status = status.expect("a status comes with it");
    assert!(status.contains("1000 Hz, 0 nets"), "{status}");
    assert!(
        status.contains("RT granted") || status.contains("DEGRADED: not real-time: "),
        "{status}"
    );
    let announced = supervised.folder.join("demo/processes/executor-exec.json");
    assert!(announced.is_file(), "READY came before the announcement");
    supervised.await_words("WATCHDOG=1");
    let status = supervised.stop();
    assert!(status.success(), "{status}");
    supervised.await_words("STOPPING=1");
}

#[test]
fn no_cycle_no_heartbeat() {
    let mut supervised = Supervised::start("heart", |text| text);
    supervised.await_words("READY=1");
    let thread = supervised.rt_thread();
    if let Err(error) = ptrace::seize(thread, ptrace::Options::empty()) {
        eprintln!("skipped: the system lets no test stop a single thread ({error})");
        return;
    }
    ptrace::interrupt(thread).unwrap();
    wait::waitpid(thread, Some(wait::WaitPidFlag::__WALL)).unwrap();
    supervised.assert_no_heartbeat();
    ptrace::detach(thread, None).unwrap();
    supervised.await_words("WATCHDOG=1");
    assert!(supervised.stop().success());
}

#[test]
fn required_real_time_that_is_not_granted_ends_for_good() {
    let mut supervised = Supervised::start("required", |text| {
        text.replace("{priority: 80}", "{priority: 80, core: 4095, rt: required}")
    });
    let status = supervised.executor.wait().unwrap();
    assert_eq!(status.code(), Some(77));
    let mut words = String::new();
    let mut stderr = supervised.executor.stderr.take().unwrap();
    std::io::Read::read_to_string(&mut stderr, &mut words).unwrap();
    assert!(words.contains("core 4095 was refused"), "{words}");
    assert!(words.contains("rt: required"), "{words}");
    supervised.socket.set_nonblocking(true).unwrap();
    assert_eq!(supervised.words(), None, "READY must not come");
}
