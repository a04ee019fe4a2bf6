//! Threads that the system cannot create, and threads that panic while an arm moves: a program reports that it is ready
//! with all of its threads or ends with a message, and never continues without one. Run by the threads of the test
//! harness.

use std::io::Read;
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};

use nix::sys::signal::Signal;
use rcc_tests::injection::traced;
use rcc_tests::processes::{ends_with_test, signal};
use rcc_tests::simulator::{ANSWERS_LOST, assert_within_limits};
use rcc_tests::{UnsupervisedCell, await_some, nets};

/// More threads than any program creates.
const THREADS_MAX: usize = 16;

/// A program under strace, which is killed when the test ends, also if the test fails.
struct TracedProgram(Child);

impl Drop for TracedProgram {
    fn drop(&mut self) {
        // strace takes its tracee along; both may be dead already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts the program once for each of its threads, and lets the creation of another one fail each time. Until all
/// threads are created, the program must end with a failure and a message, and must not report that it is ready.
fn refuse_each_thread(cell: &UnsupervisedCell, name: &str, program: &str, arguments: &[&str]) {
    if !can_trace() {
        eprintln!("skipped: {name}: strace is missing or may not trace");
        return;
    }
    for number in 1..=THREADS_MAX {
        let path = cell.folder().join("notify-threads");
        let _ = std::fs::remove_file(&path);
        let socket = UnixDatagram::bind(&path).expect("a socket");
        socket.set_nonblocking(true).expect("a socket");
        let inject = format!("inject=clone3:error=EAGAIN:when={number}");
        let options = ["-o", "/dev/null", "-e", "trace=clone3", "-e", &inject];
        let mut command = traced(cell, program, arguments, &options.map(str::to_owned));
        command
            .env("NOTIFY_SOCKET", &path)
            .env("RUST_BACKTRACE", "0")
            .stderr(Stdio::piped());
        let mut strace =
            TracedProgram(ends_with_test(&mut command).spawn().expect("strace starts"));
        let mut buffer = [0; 4096];
        let mut ready = false;
        let status = await_some("the end of the program, or READY", || {
            let notified = socket
                .recv(&mut buffer)
                .is_ok_and(|size| String::from_utf8_lossy(&buffer[..size]).contains("READY=1"));
            ready |= notified;
            let status = strace.0.try_wait().expect("the child is ours");
            (ready || status.is_some()).then_some(status)
        });
        if ready {
            assert!(number > 3, "{name}: ready without its thread {number}");
            return;
        }
        let mut words = String::new();
        let stderr = strace.0.stderr.as_mut().expect("stderr is piped");
        stderr.read_to_string(&mut words).expect("text");
        let code = status.and_then(|status| status.code());
        assert_eq!(
            code,
            Some(1),
            "{name}, thread {number}: {status:?}\n{words}"
        );
        assert!(
            words.contains("cannot create"),
            "{name}, thread {number}:\n{words}"
        );
        cell.clean();
    }
    panic!("{name} has more than {THREADS_MAX} threads");
}

fn can_trace() -> bool {
    let trace = Command::new("strace")
        .args(["-f", "-o", "/dev/null", "true"])
        .output();
    trace.is_ok_and(|output| output.status.success())
}

#[test]
fn an_executor_reports_ready_with_all_its_threads_or_ends() {
    let cell = UnsupervisedCell::new(|text| text);
    refuse_each_thread(&cell, "executor", "rcc-exec", &[]);
}

#[test]
fn a_loader_reports_ready_with_all_its_threads_or_ends() {
    let cell = UnsupervisedCell::new(|text| text);
    refuse_each_thread(&cell, "loader", "rcc-loader", &[]);
}

#[test]
fn a_driver_reports_ready_with_all_its_threads_or_ends() {
    let cell = UnsupervisedCell::new(|text| text);
    refuse_each_thread(&cell, "lwr", "rcc-driver", &["--device", "lwr"]);
    refuse_each_thread(&cell, "io", "rcc-driver", &["--device", "io"]);
}

#[test]
fn a_helper_that_panics_brings_the_arm_to_rest_on_its_path_and_the_executor_ends() {
    let mut cell = UnsupervisedCell::demo();
    cell.end("executor", Signal::SIGKILL);
    let trigger = cell.folder().join("panic");
    let mut command = cell.program("rcc-exec");
    command
        .arg("--config")
        .arg(cell.config())
        .arg("--parent-death");
    command.env(
        "RCC_TEST_PANIC",
        format!("net-builder@{}", trigger.display()),
    );
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    let mut executor = TracedProgram(ends_with_test(&mut command).spawn().expect("it starts"));
    cell.await_devices();
    let mut arm = cell.simulator("lwr-sim");
    arm.reset_statistics();
    let line = cell.run(&nets::line("line", 0.2, 0.05));
    arm.await_motion();
    std::fs::write(&trigger, "").expect("a file");
    let status = executor.0.wait().expect("the child is ours");
    let mut words = String::new();
    let stderr = executor.0.stderr.as_mut().expect("stderr is piped");
    stderr.read_to_string(&mut words).expect("text");
    assert_eq!(status.code(), Some(1), "{words}");
    assert!(
        words.contains("the helper thread `net-builder` panicked"),
        "{words}"
    );
    assert_within_limits(&arm.await_rest(), &ANSWERS_LOST);
    arm.assert_still(1000);
    // The net was canceled as by SIGTERM, so the driver did not have to stop the arm.
    let (events, _) = cell.cli_exits(0, &["events"]);
    let canceling = format!("line#{line} canceling");
    assert!(events.contains(&canceling), "{events}");
    assert!(!events.contains("brings the device to rest"), "{events}");
}

#[test]
fn status_shows_each_helper_with_its_age_and_its_limit() {
    let cell = UnsupervisedCell::demo();
    let status = cell.rest("GET", "/status", "").body;
    let helpers = status["helpers"].as_array().expect("a list");
    let names: Vec<_> = helpers
        .iter()
        .filter_map(|row| row["name"].as_str())
        .collect();
    for name in [
        "intake",
        "net-builder",
        "pump",
        "incidents",
        "events",
        "notify",
        "maintenance",
        "memory",
        "history",
        "workers",
        "stop-0",
        "stop-1",
    ] {
        assert!(names.contains(&name), "{names:?}");
    }
    assert!(
        helpers.iter().all(|row| row["state"] == "running"),
        "{status:#}"
    );
    let pid = cell.pid("executor");
    signal(pid, Signal::SIGSTOP);
    // The stopped executor no longer updates its table; the loader still answers and shows its age.
    let hanging = await_some("status to show a helper that hangs", || {
        let status = cell.try_rest("GET", "/status", "")?.body;
        let rows = status["helpers"].as_array()?.clone();
        rows.into_iter()
            .find(|row| row["name"] == "pump" && row["state"] == "hanging")
    });
    assert!(
        hanging["age_ns"].as_u64() > hanging["limit_ns"].as_u64(),
        "{hanging}"
    );
    signal(pid, Signal::SIGCONT);
    await_some("all helpers to run again", || {
        let status = cell.try_rest("GET", "/status", "")?.body;
        let rows = status["helpers"].as_array()?.clone();
        rows.iter()
            .all(|row| row["state"] == "running")
            .then_some(())
    });
    cell.stop();
}
