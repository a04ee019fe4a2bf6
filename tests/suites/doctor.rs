//! `rcc-cli doctor` for this machine, and for a device without a connection, for each cause that users have met. Each
//! test has a cell of its own; the senders are sockets of the test.

use std::net::{SocketAddr, UdpSocket};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_drivers::fri_lwr::wire::{FriControlStrategy, MeasurementDatagram, SessionState};
use rcc_protocol::Role;
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::signal;
use rcc_tests::{TestCell, await_some, program, repository};
use serde_json::{Value, json};

/// Returns the demo's configuration without a running cell; if `peer` is given, the driver accepts only that sender.
fn stopped(peer: Option<&str>) -> CellFixture {
    let line = "      listen: 127.0.0.1:${fri}";
    let peer = peer
        .map(|peer| format!("      peer: {peer}\n"))
        .unwrap_or_default();
    CellFixture::new(&repository().join("configs/cells/demo.yaml"), |text| {
        text.replace(line, &format!("{peer}{line}"))
    })
}

/// Returns the report of `doctor fri lwr` about the cell's file; asserts its exit code.
fn report(place: &CellFixture, exit: i32) -> Value {
    let file = place.config().to_str().expect("plain").to_owned();
    let output = Command::new(program("rcc-cli"))
        .env("RCC_RUNTIME_DIR", place.folder())
        .env("RCC_STATE_DIR", place.state_dir())
        .env_remove("RCC_CELL")
        .stdin(Stdio::null())
        .args(["--cell", &file, "--output", "json", "doctor", "fri", "lwr"])
        .output()
        .expect("rcc-cli runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(exit), "{text}\n{errors}");
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{text}\n{errors}\n{error}"))
}

/// Returns the stage that failed, and its finding as JSON.
fn failure(place: &CellFixture) -> (String, String) {
    let report = report(place, 1);
    let findings = report["findings"].as_array().expect("findings");
    let last = findings.last().expect("one at least").to_string();
    (report["failed"].as_str().expect("a stage").to_owned(), last)
}

/// Sets a flag when it is dropped, also if the test fails.
struct FlagOnDrop<'a>(&'a AtomicBool);

impl Drop for FlagOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Sends `bytes` to the driver's port every millisecond while `what` runs, with increasing sequence numbers.
fn while_sending<T>(place: &CellFixture, from: &str, bytes: &[u8], what: impl FnOnce() -> T) -> T {
    let socket = UdpSocket::bind(from).expect("a loopback address");
    let to = SocketAddr::from(([127, 0, 0, 1], place.port("fri")));
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        // Relaxed: no other data is published with the flag. The scope waits for the thread.
        scope.spawn(|| {
            let mut bytes = bytes.to_vec();
            for sequence in (0..=u16::MAX).cycle() {
                if let Some(place) = bytes.get_mut(..2) {
                    place.copy_from_slice(&sequence.to_le_bytes());
                }
                // Fails while nobody listens on the port.
                let _ = socket.send_to(&bytes, to);
                if over.load(Ordering::Relaxed) {
                    return;
                }
                thread::sleep(Duration::from_millis(1));
            }
        });
        let _over = FlagOnDrop(&over);
        what()
    })
}

fn datagram() -> Vec<u8> {
    MeasurementDatagram {
        state: SessionState::Monitor,
        control: FriControlStrategy::Position,
        measurement_period: 0.001,
        power: 0x7f,
        ..MeasurementDatagram::default()
    }
    .encode()
    .to_vec()
}

#[test]
fn missing_datagrams_are_found_without_a_driver() {
    let place = stopped(None);
    let (stage, words) = failure(&place);
    assert_eq!(stage, "datagrams", "{words}");
    assert!(
        words.contains("no datagrams arrive at 127.0.0.1"),
        "{words}"
    );
}

#[test]
fn the_process_that_uses_the_port_is_named() {
    let place = stopped(None);
    let _taken = UdpSocket::bind(("127.0.0.1", place.port("fri"))).expect("it is free");
    let (stage, words) = failure(&place);
    assert_eq!(stage, "port", "{words}");
    assert!(
        words.contains(&format!("(pid {})", std::process::id())),
        "{words}"
    );
}

#[test]
fn a_sender_at_another_address_is_named() {
    let place = stopped(Some("127.0.0.1:49938"));
    let (stage, words) = while_sending(&place, "127.0.0.2:0", &datagram(), || failure(&place));
    assert_eq!(stage, "sender", "{words}");
    assert!(
        words.contains("came from 127.0.0.2:") && words.contains("accepts only 127.0.0.1:49938"),
        "{words}"
    );
}

#[test]
fn invalid_datagrams_and_other_versions_are_distinguished() {
    let place = stopped(None);
    let mut older = datagram();
    older[6..8].copy_from_slice(&0x2005_u16.to_le_bytes());
    for (bytes, wanted) in [
        (b"hello world".to_vec(), "datagrams of 11 bytes"),
        (older, "0x2005"),
    ] {
        let (stage, words) = while_sending(&place, "127.0.0.1:0", &bytes, || failure(&place));
        assert_eq!(stage, "version", "{words}");
        assert!(words.contains(wanted), "{words}");
    }
}

#[test]
fn a_controller_that_sends_passes_although_no_driver_answers() {
    let place = stopped(None);
    let report = while_sending(&place, "127.0.0.1:0", &datagram(), || report(&place, 0));
    assert!(
        report["failed"].is_null() && report["history"].is_null(),
        "{report}"
    );
    assert!(report.to_string().contains("no driver answers"), "{report}");
}

#[test]
fn a_running_device_passes_and_bad_quality_is_found() {
    let cell = TestCell::demo();
    let (out, _) = cell.cli_exits(0, &["--output", "json", "devices"]);
    let rows: Value = serde_json::from_str(&out).expect("JSON");
    assert_eq!(rows[0]["name"], "lwr", "{rows}");
    await_some("a history of the device", || {
        let (out, _) = cell.cli_exits(0, &["--output", "json", "devices"]);
        let rows: Value = serde_json::from_str(&out).ok()?;
        let history = &rows[0]["history"];
        let bars = history["sparkline"].as_str()?.chars().count();
        (bars > 0 && history["peer"].as_str()?.starts_with("127.0.0.1:")).then_some(())
    });
    await_some("the connection to be found good", || {
        let output = cell.cli(&["--output", "json", "doctor", "device", "lwr"]);
        let report: Value = serde_json::from_slice(&output.stdout).ok()?;
        (report["failed"].is_null() && output.status.success()).then_some(())
    });
    let mut simulator = cell.simulator("lwr-sim");
    assert_eq!(simulator.ask(&json!({"drop": {"percent": 90}}))["ok"], true);
    await_some("the quality to be found bad", || {
        let output = cell.cli(&["--output", "json", "doctor", "fri", "lwr"]);
        let report: Value = serde_json::from_slice(&output.stdout).ok()?;
        (report["failed"] == "quality").then_some(())
    });
    // A stopped driver makes no progress.
    let driver = cell.announced(Role::Driver, "lwr");
    assert!(signal(driver.pid, Signal::SIGSTOP));
    let found = await_some("the stopped driver to be found", || {
        let output = cell.cli(&["--output", "json", "doctor", "fri", "lwr"]);
        let report: Value = serde_json::from_slice(&output.stdout).ok()?;
        // `up` may have restarted it by now, which is correct, too.
        let replaced = cell.announced(Role::Driver, "lwr").pid != driver.pid;
        (report["failed"] == "driver" || replaced).then_some(report)
    });
    signal(driver.pid, Signal::SIGCONT);
    assert_eq!(found["schema"], 1, "{found}");
}

#[test]
fn the_machine_is_graded_and_status_shows_it() {
    let cell = TestCell::demo();
    let state = cell.folder().join("state");
    let mut doctor = cell.program("rcc-cli");
    let output = doctor
        .env("RCC_STATE_DIR", &state)
        .args(["--output", "json", "doctor", "--measure", "1s"])
        .output()
        .expect("rcc-cli runs");
    let report: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(report["schema"], 1);
    assert_eq!(report["asked"]["stale_after_ns"], 250_000_000, "{report}");
    assert!(report["measured"]["cycles"].as_u64() > Some(0), "{report}");
    let prevents = report["worst"] == "fail";
    assert_eq!(output.status.code(), Some(i32::from(prevents)), "{report}");
    let mut status = cell.program("rcc-cli");
    let output = status
        .env("RCC_STATE_DIR", &state)
        .arg("status")
        .output()
        .expect("rcc-cli runs");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let grade = report["grade"].as_str().expect("a grade");
    assert!(
        text.contains(&format!("machine   grade {grade} for 1.0 ms, measured")),
        "{text}"
    );
    cell.stop();
}

#[test]
fn leftovers_of_a_dead_cell_are_found_and_removed() {
    let mut cell = TestCell::demo();
    // No process may end in an orderly way.
    assert!(signal(cell.supervisor(), Signal::SIGSTOP));
    for process in cell.cell().announced_all().expect("a list") {
        signal(process.pid, Signal::SIGKILL);
    }
    cell.kill_supervisor();
    cell.await_dead();
    let (out, _) = cell.cli_exits(0, &["doctor", "--measure", "0"]);
    assert!(out.contains("cell test is dead and left"), "{out}");
    // A running cell is not touched.
    let other = TestCell::demo();
    let (out, _) = cell.cli_exits(0, &["doctor", "--clean"]);
    assert!(out.contains("removed  cell test"), "{out}");
    assert_eq!(other.device("lwr").expect("a row")["losses"], 0);
    let (out, _) = cell.cli_exits(0, &["doctor", "--clean"]);
    assert!(out.contains("no leftovers"), "{out}");
    assert!(cell.cell().leftovers().expect("a list").is_empty());
}

#[test]
fn an_ordinary_user_is_told_which_permissions_are_missing() {
    if !nix::unistd::getuid().is_root() {
        eprintln!("skipped: only root can become another user");
        return;
    }
    let place = stopped(None);
    let mut command = Command::new("setpriv");
    command
        .args(["--reuid=65534", "--regid=65534", "--clear-groups", "--"])
        .arg(program("rcc-cli"))
        .args(["--output", "json", "doctor", "--measure", "100ms"])
        .env("RCC_RUNTIME_DIR", place.folder().join("none/rcc"))
        .env("RCC_STATE_DIR", "/proc/none")
        .env_remove("RCC_CELL")
        .stdin(Stdio::null());
    let Ok(output) = command.output() else {
        eprintln!("skipped: setpriv not found");
        return;
    };
    let report: Value = match serde_json::from_slice(&output.stdout) {
        Ok(report) => report,
        Err(error) => panic!("{error}: {}", String::from_utf8_lossy(&output.stderr)),
    };
    let of = |name: &str| {
        let findings = report["findings"].as_array().expect("findings");
        findings
            .iter()
            .find(|finding| finding["check"] == name)
            .cloned()
            .unwrap_or_default()
    };
    assert_eq!(of("runtime-folder")["level"], "fail", "{report}");
    assert_eq!(output.status.code(), Some(1));
    for name in ["fifo", "memory-lock"] {
        let finding = of(name);
        assert!(
            finding["level"] == "ok" || finding["fix"].is_string(),
            "{finding}"
        );
    }
    assert!(report["measured"]["cycles"].as_u64().is_some(), "{report}");
}
