//! Drivers of somebody else that lie, are slow or hang: one that is made with the kit, whose values its host judges, and one that
//! writes its board itself, whose values the executor judges. Their device is null or lost, with a reason; nets that command it
//! end; and neither the arm of the same cell nor the cycle notices.
//! Run by the threads of the test harness; each test has a cell of its own.

use std::fs;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytemuck::Zeroable;
use rcc_config::CellConfig;
use rcc_core::message::{DeviceState, MAGIC, Measurement};
use rcc_ipc::Session;
use rcc_os::clock::monotonic_ns;
use rcc_protocol::control::MEASUREMENT;
use rcc_protocol::{Configuration, Role};
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::journal::Journal;
use rcc_tests::lateness::LatenessMonitor;
use rcc_tests::simulator::assert_within_limits;
use rcc_tests::{TestCell, UnsupervisedCell, await_some, nets, repository};
use serde_json::Value;

/// Core and priority of the executors: above those of tests that run at the same time.
const CORE: usize = 1;
const PRIORITY: u8 = 84;

/// Lies about a value: which ports are null (the analog input, the joint).
const NULL: [(&str, [bool; 2]); 3] = [
    ("a number out of range", [true, false]),
    ("no number", [true, true]),
    ("infinite", [true, true]),
];

/// Lies that a host can live with: all values stay true.
const HARMLESS: [&str; 2] = ["inputs that it does not have", "a reason that nobody knows"];

/// Lies for which the device is lost, until the truth is told.
const LOST: [&str; 5] = [
    "no hold position",
    "no period",
    "a period of ages",
    "time for ages",
    "too good",
];

/// Is slower than `stale_after`: the device is lost, and the same process goes on.
const SLOW: [&str; 2] = ["slow", "answers slowly"];

/// Ends, or is ended by the supervisor; another process follows.
const RESTARTED: [&str; 4] = ["panics", "ends", "hangs", "hangs in its answer"];

const DEVICES: &str = "devices:
  liar:
    driver: {program: lying-driver}
    robot: ../robots/turntable.yaml
    delay: 80 ms
    command_timeout: 250 ms
    channels:
      x:    {kind: analog input, address: 1, unit: m, range: [0 m, 2 m]}
      door: {kind: digital input, address: 1}
";

const SEEN: &str = "net: seen
primitives:
  cancel: {type: Cancel}
  x: {type: AnalogInput, parameters: {device: liar, channel: x}}
  door: {type: DigitalInput, parameters: {device: liar, channel: door}}
  state: {type: JointState, parameters: {device: liar}}
  joint: {type: At, inputs: {in: state.position, index: 0}}
  end: {type: Termination, inputs: {done: cancel.requested}}
  watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: x.out}}
  watch_joint: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: joint.out}}
  watch_door: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: door.out}}
discard: [state.hold, state.torque, state.external_torque]
";

/// Turns the liar's first joint to `to` (rad), far too slowly for the lie to come after the end.
fn turn(to: f64) -> String {
    format!(
        "net: turn
primitives:
  cancel: {{type: Cancel}}
  move: {{type: JointMotion, parameters: {{device: liar, to: [{to} rad, 0 rad], scale: 0.02}}, inputs: {{stop: cancel.requested}}}}
  robot: {{type: JointPositionCommand, parameters: {{device: liar}}, inputs: {{position: move.joints}}}}
  end: {{type: Termination, inputs: {{done: move.done}}}}
"
    )
}

/// The executor's priority and core, so that the cause of a late cycle can be found.
fn watched(text: &str) -> String {
    let executor = format!("{{priority: {PRIORITY}, core: {CORE}}}");
    text.replace("{priority: 80}", &executor)
}

fn assert_cycles_untouched(lateness: Option<LatenessMonitor>) {
    let Some(report) = lateness.map(LatenessMonitor::finish) else {
        eprintln!("skipped: causes of late cycles (no real-time priority)");
        return;
    };
    let words = format!(
        "{} cycles, {} late: {} with the machine, {} by steal time, {} unexplained",
        report.cycles, report.late, report.by_machine, report.by_steal, report.unexplained
    );
    assert!(report.unexplained == 0 && report.consecutive, "{words}");
    assert_eq!(report.dropped_records, 0, "{words}");
    eprintln!("{words}");
}

/// The demo cell with the liar, and the net that reads it.
struct LiarCell {
    cell: TestCell,
    seen: u64,
    lines: u32,
}

impl LiarCell {
    fn start() -> LiarCell {
        let demo = repository().join("configs/cells/demo.yaml");
        let place = CellFixture::new(&demo, |text| watched(&text).replace("devices:\n", DEVICES));
        let cell = TestCell::in_fixture(place);
        let seen = cell.run(SEEN);
        let liar = LiarCell {
            cell,
            seen,
            lines: 0,
        };
        liar.await_truth();
        liar
    }

    /// The driver answers in this way from its next exchange on.
    fn tell(&self, lie: &str) {
        let (new, path) = (self.cell.folder().join("lie.new"), "lie");
        fs::write(&new, lie).expect("a file");
        fs::rename(&new, self.cell.folder().join(path)).expect("the same folder");
    }

    /// Returns what the net sees; null is [`Value::Null`].
    fn sees(&self, port: &str) -> Value {
        let path = format!("/commands/{}/values?ports={port}", self.seen);
        self.cell.rest("GET", &path, "").body["values"][0]["value"].clone()
    }

    fn await_truth(&self) {
        await_some("the truth", || {
            let ready = self.cell.device("liar")?["state"] == "ready";
            let is_true = self.sees("x.out") == 1.0 && self.sees("door.out") == true;
            (ready && is_true && self.sees("joint.out").is_number()).then_some(())
        });
    }

    fn await_lost(&self, words: &str) {
        await_some(&format!("the device to be lost with `{words}`"), || {
            let row = self.cell.device("liar")?;
            let is_lost = row["state"] == "offline" && row["reason"].to_string().contains(words);
            (is_lost && self.sees("x.out").is_null() && self.sees("joint.out").is_null())
                .then_some(())
        });
    }

    /// Waits for this number of exchanges of the liar.
    fn await_exchanges(&self, number: u64) {
        let watch = self.cell.watch();
        // The first device of the configuration.
        let sequence = || watch.tables().devices[0].sequence;
        let begin = sequence();
        await_some("exchanges", || (sequence() >= begin + number).then_some(()));
    }

    /// Moves the liar's arm and the other one; the other one's motion must end as planned whatever `meanwhile` does. Returns
    /// the command that moves the liar.
    fn while_both_move(&mut self, meanwhile: impl FnOnce(&LiarCell, u64)) -> u64 {
        self.lines += 1;
        let sign = if self.lines % 2 == 1 { 1.0 } else { 0.0 };
        let turning = self.cell.load(&turn(1.0 - 2.0 * sign));
        self.cell.start_when_ready(turning);
        let line = self.cell.run(&nets::line("line", 0.15 * sign, 0.1));
        await_some("the liar's arm to be commanded", || {
            (self.cell.device("liar")?["state"] == "commanded").then_some(())
        });
        meanwhile(self, turning);
        self.cell.assert_ends(line, "finished");
        turning
    }

    /// The liar's device is lost: the net that commands it has ended with this reason.
    fn assert_lost(&self, turning: u64) {
        let row = self.cell.await_end(turning);
        assert_eq!(row["fault"]["fault"], "device lost", "{row}");
        assert_eq!(row["fault"]["device"], "liar", "{row}");
    }
}

#[test]
fn whatever_a_foreign_driver_says_its_device_is_null_or_lost_and_the_cell_does_not_notice() {
    let mut liar = LiarCell::start();
    let mut arm = liar.cell.simulator("lwr-sim");
    arm.reset_statistics();
    let lateness = LatenessMonitor::start(&liar.cell, CORE, PRIORITY, &Arc::<Journal>::default());
    for (lie, [x_is_null, joint_is_null]) in NULL {
        let turning = liar.while_both_move(|liar, turning| {
            liar.tell(lie);
            await_some(lie, || {
                let nulls =
                    [liar.sees("x.out"), liar.sees("joint.out")].map(|value| value.is_null());
                (nulls == [x_is_null, joint_is_null]).then_some(())
            });
            liar.tell("");
            liar.cell.done(turning, "cancel");
        });
        liar.cell.assert_ends(turning, "canceled");
        liar.await_truth();
    }
    for lie in HARMLESS {
        let turning = liar.while_both_move(|liar, turning| {
            liar.tell(lie);
            liar.await_exchanges(50);
            liar.cell.done(turning, "cancel");
        });
        liar.cell.assert_ends(turning, "canceled");
        liar.await_truth();
        liar.tell("");
    }
    for lie in LOST {
        let turning = liar.while_both_move(|liar, _| {
            liar.tell(lie);
            liar.await_lost("no device can have");
            liar.tell("");
        });
        liar.assert_lost(turning);
        liar.await_truth();
    }
    for lie in SLOW {
        let driver = liar.cell.announced(Role::Driver, "liar");
        let turning = liar.while_both_move(|liar, _| {
            liar.tell(lie);
            liar.await_lost("");
            liar.tell("");
        });
        liar.assert_lost(turning);
        liar.await_truth();
        let now = liar.cell.announced(Role::Driver, "liar");
        assert_eq!(
            now.incarnation, driver.incarnation,
            "it was not started again"
        );
    }
    for lie in RESTARTED {
        let driver = liar.cell.announced(Role::Driver, "liar");
        let turning = liar.while_both_move(|liar, _| {
            liar.tell(lie);
            liar.await_lost("");
            liar.tell("");
        });
        liar.assert_lost(turning);
        let dead = driver.incarnation;
        drop(liar.cell.await_successor(Role::Driver, "liar", dead));
        liar.await_truth();
    }
    assert_within_limits(&arm.await_rest(), &[]);
    assert_cycles_untouched(lateness);
    drop(arm);
    let LiarCell { cell, seen, .. } = liar;
    cell.done(seen, "cancel");
    cell.assert_ends(seen, "canceled");
    cell.stop();
}

/// A driver that uses nothing of the host: it writes whatever it likes to a board of its own.
struct BoardWriter {
    lie: Arc<Mutex<Lie>>,
    stop: Arc<AtomicBool>,
    thread: std::thread::JoinHandle<()>,
}

type Lie = fn(&mut Measurement);

fn truth(_: &mut Measurement) {}

/// Lies for which the device is lost, until the truth is told.
const LOST_BY_ITS_BOARD: [(&str, Lie); 9] = [
    ("another start of the message", |all| all.magic = 0),
    ("a stamp of the future", |all| all.stamp_ns += 1 << 50),
    ("an old stamp", |all| all.stamp_ns -= 10_000_000_000),
    ("the greatest stamp", |all| all.stamp_ns = u64::MAX),
    ("time that goes back", |all| all.sequence = 1),
    ("joints of an arm", |all| all.joints = 7),
    ("any number of joints", |all| all.joints = u32::MAX),
    ("a state that nobody knows", |all| all.state = 77),
    ("no hold position", |all| all.hold = [f64::NAN; _]),
];

/// Lies that change no value and no state.
const HARMLESS_ON_ITS_BOARD: [(&str, Lie); 4] = [
    ("all counters", |all| {
        (all.late, all.refused, all.starved, all.margin) = (u64::MAX, u64::MAX, u64::MAX, u64::MAX);
    }),
    ("a period and time for ages", |all| {
        (all.period_ns, all.periods) = (u64::MAX, u64::MAX);
    }),
    ("everything played", |all| {
        (all.played_ns, all.settled_ns, all.executor) = (u64::MAX, u64::MAX, u64::MAX);
    }),
    ("numbers that nobody knows", |all| {
        (all.reason, all.quality_permille, all.strategy) = (u32::MAX, u32::MAX, u64::MAX);
        (all.digital_known, all.digital_out, all.digital_out_known) = (!0, !0, !0);
        all.digital = !0;
        all.torque = [f64::INFINITY; _];
        all.analog_out = [f64::NEG_INFINITY; _];
    }),
];

impl BoardWriter {
    fn start(cell: &UnsupervisedCell) -> BoardWriter {
        let config = CellConfig::load(cell.config(), &Default::default());
        let config = config.unwrap_or_else(|faults| panic!("{faults}"));
        let cell = cell.cell().clone();
        let lie = Arc::new(Mutex::new(truth as Lie));
        let stop = Arc::<AtomicBool>::default();
        let (told, stopped) = (Arc::clone(&lie), Arc::clone(&stop));
        let thread = std::thread::spawn(move || {
            let session = Session::join(&cell, Role::Driver, "box").expect("a session");
            let mut board = session
                .create_board::<Measurement>(MEASUREMENT)
                .expect("a board");
            let announcement = session
                .announcement()
                .configured(Configuration::new(config.identity()).only("box"))
                .service(MEASUREMENT, board.service());
            let announced = cell.announce(&announcement).expect("the only one");
            let mut sequence = 0;
            // Relaxed: nothing else is published by it.
            while !stopped.load(Ordering::Relaxed) {
                sequence += 1;
                let mut all = Measurement {
                    magic: MAGIC,
                    sequence,
                    stamp_ns: monotonic_ns(),
                    periods: sequence,
                    period_ns: 2_000_000,
                    state: DeviceState::Ready as u32,
                    quality_permille: 1000,
                    digital: 1,
                    digital_known: 1,
                    ..Measurement::zeroed()
                };
                told.lock().expect("no panic")(&mut all);
                board.write(&all);
                std::thread::sleep(Duration::from_millis(2));
            }
            drop((announced, board, session));
        });
        BoardWriter { lie, stop, thread }
    }

    fn tell(&self, lie: Lie) {
        *self.lie.lock().expect("no panic") = lie;
    }

    fn end(self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().expect("no panic");
    }
}

#[test]
fn whatever_a_foreign_program_writes_to_its_board_its_device_is_lost_alone() {
    let mut cell = UnsupervisedCell::new(|text| {
        watched(&text).replace(
            "devices:\n",
            "devices:
  box:
    driver: {program: a-foreign-program}
    channels:
      door: {kind: digital input, address: 1}
      lamp: {kind: digital output, address: 1, on_release: {safe: false}}
",
        )
    });
    for name in ["lwr-sim", "io-sim"] {
        cell.start_simulator(name);
    }
    cell.start_executor();
    cell.start_loader();
    for device in ["lwr", "io"] {
        cell.start_driver(device);
    }
    let foreign = BoardWriter::start(&cell);
    cell.await_devices();
    let lateness = LatenessMonitor::start(&cell, CORE, PRIORITY, &Arc::<Journal>::default());
    let seen = cell.run(&nets::input("seen", "box", "door"));
    let sees = || {
        let path = format!("/commands/{seen}/values?ports=in.out");
        cell.rest("GET", &path, "").body["values"][0]["value"].clone()
    };
    let await_truth = || {
        await_some("the truth", || {
            (sees() == true && cell.device("box")?["state"] == "ready").then_some(())
        });
    };
    await_truth();
    for ((what, lie), y) in LOST_BY_ITS_BOARD
        .into_iter()
        .zip([0.15, 0.0].into_iter().cycle())
    {
        let lamp = cell.run(&nets::output("lamp", "box", "lamp"));
        let line = cell.run(&nets::line("line", y, 0.1));
        foreign.tell(lie);
        await_some(what, || {
            (sees().is_null() && cell.device("box")?["state"] == "offline").then_some(())
        });
        let row = cell.await_end(lamp);
        assert_eq!(row["fault"]["fault"], "device lost", "{what}: {row}");
        foreign.tell(truth);
        await_truth();
        cell.assert_ends(line, "finished");
    }
    let watch = cell.watch();
    for (what, lie) in HARMLESS_ON_ITS_BOARD {
        foreign.tell(lie);
        let sequence = || watch.tables().devices[0].sequence;
        let begin = sequence();
        await_some(what, || (sequence() >= begin + 50).then_some(()));
        let (out, _) = cell.cli_exits(0, &["devices"]);
        assert!(out.contains("box"), "{what}: {out}");
        await_truth();
        foreign.tell(truth);
    }
    drop(watch);
    assert_cycles_untouched(lateness);
    cell.done(seen, "cancel");
    cell.assert_ends(seen, "canceled");
    foreign.end();
    cell.stop();
}
