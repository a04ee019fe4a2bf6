//! A software device whose program is killed, stopped, slow, lying or flooding, or crashes at its start: its port is null with
//! a reason, or the device is lost with one; it recovers by itself; and neither the arm of the same cell nor its cycle notices.
//! Run by the threads of the test harness, in one cell.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use nix::sys::signal::Signal;
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::journal::Journal;
use rcc_tests::lateness::{LatenessMonitor, LatenessReport};
use rcc_tests::processes::{command_line, signal, with_runtime_dir};
use rcc_tests::simulator::assert_within_limits;
use rcc_tests::{TestCell, await_some, nets, repository};

/// Core and priority of the executor: above the executors of tests that run at the same time.
const CORE: usize = 1;
const PRIORITY: u8 = 84;

/// Answers truly, or as the file `mode` says; a new one is read at each line.
const PROGRAM: &str = r#"
import json, os, sys, time

def mode():
    try:
        return open("mode").read()
    except OSError:
        return ""

if mode() == "crash":
    sys.exit("it crashes")
for line in sys.stdin:
    frame = json.loads(line)["frame"]
    now, true = mode(), json.dumps({"frame": frame, "values": {"x": 1.0, "found": True}})
    text = {
        "garbage": "\x00{]" + "x" * 100,
        "not a number": '{"frame": %d, "values": {"x": NaN}}' % frame,
        "infinite": '{"frame": %d, "values": {"x": 1e999}}' % frame,
        "out of range": '{"frame": %d, "values": {"x": 1e6}}' % frame,
        "other type": '{"frame": %d, "values": {"x": "one", "found": 1}}' % frame,
        "wrong names": '{"frame": %d, "values": {"y": 1.0}}' % frame,
        "from the future": json.dumps({"frame": frame + 1000, "values": {"x": 1.0, "found": True}}),
        "without an end": true * 2000,
    }.get(now, true)
    if now == "slow":
        time.sleep(1.0)
    if now == "flooding":
        sys.stderr.write("what is this?\n" * 2000)
    if now == "too many":
        text = "\n".join([true, "no answer"] * 500)
    sys.stdout.write(text if now == "without an end" else text + "\n")
    sys.stdout.flush()
"#;

/// Lies that make every value of the program null, and the words that `rcc-cli devices` has for each.
const NULL: [(&str, &str); 8] = [
    ("garbage", "answers later than settings.timeout"),
    ("not a number", "answers later than settings.timeout"),
    ("infinite", "answers later than settings.timeout"),
    ("other type", "answers later than settings.timeout"),
    ("from the future", "answers later than settings.timeout"),
    ("slow", "answers later than settings.timeout"),
    ("out of range", "outside of its channel's range"),
    // Each value that is left out is null, without a reason of the device.
    ("wrong names", ""),
];

/// The cell with its program, and the net that reads it.
struct EyeCell {
    cell: TestCell,
    mode: PathBuf,
    seen: u64,
    lines: u32,
}

impl EyeCell {
    fn start() -> EyeCell {
        let eye = "devices:
  eye:
    driver: software
    settings: {command: [python3, eye.py], period: 10 ms, timeout: 300 ms}
    channels:
      x:     {kind: analog input, address: x, unit: m, range: [0 m, 2 m]}
      found: {kind: digital input, address: found}
      lamp:  {kind: digital output, address: lamp, on_release: {safe: false}}
";
        let executor = format!("{{priority: {PRIORITY}, core: {CORE}}}");
        let demo = repository().join("configs/cells/demo.yaml");
        let place = CellFixture::new(&demo, |text| {
            text.replace("devices:\n", eye)
                .replace("{priority: 80}", &executor)
        });
        fs::write(place.folder().join("eye.py"), PROGRAM).expect("a file");
        let mode = place.folder().join("mode");
        let cell = TestCell::in_fixture(place);
        let seen = cell.run(
            "net: seen
primitives:
  cancel: {type: Cancel}
  x: {type: AnalogInput, parameters: {device: eye, channel: x}}
  end: {type: Termination, inputs: {done: cancel.requested}}
  watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: x.out}}
",
        );
        let own = EyeCell {
            cell,
            mode,
            seen,
            lines: 0,
        };
        own.await_recovery();
        own
    }

    /// The program answers in this way from its next line on.
    fn answer(&self, mode: &str) {
        fs::write(&self.mode, mode).expect("a file");
    }

    /// Returns what the net sees; `None`: null.
    fn x(&self) -> Option<f64> {
        let path = format!("/commands/{}/values?ports=x.out", self.seen);
        self.cell.rest("GET", &path, "").body["values"][0]["value"].as_f64()
    }

    /// Returns the process id of the program; `None` while it is not running.
    fn program(&self) -> Option<u32> {
        let pids = with_runtime_dir(self.cell.folder()).into_iter();
        let mut programs =
            pids.filter(|pid| command_line(*pid).iter().any(|word| word == "eye.py"));
        programs.next()
    }

    fn await_null(&self, words: &str) {
        await_some(&format!("null with `{words}`"), || {
            let reason = self.cell.device("eye")?["reason"].to_string();
            (self.x().is_none() && reason.contains(words)).then_some(())
        });
    }

    fn await_lost(&self, words: &str) {
        await_some(&format!("the device to be lost with `{words}`"), || {
            let row = self.cell.device("eye")?;
            let is_lost = row["state"] == "offline" && row["reason"].to_string().contains(words);
            (is_lost && self.x().is_none()).then_some(())
        });
    }

    fn await_recovery(&self) {
        await_some("the program's value", || {
            (self.x() == Some(1.0) && self.cell.device("eye")?["state"] == "ready").then_some(())
        });
    }

    /// Moves the arm there and back alternately; the motion must end as planned whatever `meanwhile` does.
    fn while_the_arm_moves(&mut self, meanwhile: impl FnOnce(&EyeCell)) {
        self.lines += 1;
        let y = if self.lines % 2 == 1 { 0.15 } else { 0.0 };
        let line = self.cell.run(&nets::line("line", y, 0.1));
        meanwhile(self);
        self.cell.assert_ends(line, "finished");
    }
}

#[test]
fn whatever_a_program_does_its_values_are_null_or_lost_and_the_arm_does_not_notice() {
    let mut eye = EyeCell::start();
    let mut arm = eye.cell.simulator("lwr-sim");
    arm.reset_statistics();
    let lateness = LatenessMonitor::start(&eye.cell, CORE, PRIORITY, &Arc::<Journal>::default());
    for (mode, words) in NULL {
        eye.while_the_arm_moves(|eye| {
            eye.answer(mode);
            eye.await_null(words);
            eye.answer("");
            eye.await_recovery();
        });
    }
    for mode in ["too many", "flooding"] {
        eye.while_the_arm_moves(|eye| {
            eye.answer(mode);
            // It answers correctly besides.
            eye.await_recovery();
        });
        assert_eq!(eye.x(), Some(1.0), "{mode}");
        eye.answer("");
    }
    eye.while_the_arm_moves(|eye| {
        eye.answer("without an end");
        eye.await_lost("has ended");
        eye.answer("");
        eye.await_recovery();
    });
    eye.while_the_arm_moves(|eye| {
        let program = eye.program().expect("it runs");
        signal(program, Signal::SIGSTOP);
        eye.await_null("answers later than settings.timeout");
        signal(program, Signal::SIGCONT);
        eye.await_recovery();
        assert_eq!(eye.program(), Some(program), "it was not started again");
    });
    eye.while_the_arm_moves(|eye| {
        signal(eye.program().expect("it runs"), Signal::SIGKILL);
        eye.await_lost("has ended");
        eye.await_recovery();
    });
    eye.while_the_arm_moves(|eye| {
        eye.answer("crash");
        signal(eye.program().expect("it runs"), Signal::SIGKILL);
        eye.await_lost("has ended");
        let (out, _) = eye.cell.cli_exits(0, &["devices"]);
        assert!(out.contains("has ended or cannot be started"), "{out}");
        eye.answer("");
        eye.await_recovery();
    });
    assert_within_limits(&arm.await_rest(), &[]);
    match lateness.map(LatenessMonitor::finish) {
        Some(report) => {
            let words = words(&report);
            assert!(report.unexplained == 0 && report.consecutive, "{words}");
            assert_eq!(report.dropped_records, 0, "{words}");
            eprintln!("{words}");
        }
        None => eprintln!("skipped: causes of late cycles (no real-time priority)"),
    }
    drop(arm);
    let EyeCell { cell, seen, .. } = eye;
    cell.done(seen, "cancel");
    cell.assert_ends(seen, "canceled");
    cell.stop();
}

/// Returns what is told of the cycles.
fn words(report: &LatenessReport) -> String {
    format!(
        "{} cycles, {} late: {} with the machine, {} by steal time, {} unexplained",
        report.cycles, report.late, report.by_machine, report.by_steal, report.unexplained
    )
}
