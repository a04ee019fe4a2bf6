//! A cell with a line of EtherCAT terminals (`configs/cells/ethercat.yaml`): over UDP as it is shipped, and over raw Ethernet
//! between two interfaces in a network namespace of the test, whose cable is pulled. Each test has a cell of its own.

use std::process::Command;

use rcc_protocol::Role;
use rcc_testing::namespace::{FAR, NEAR, in_namespace, plug_cable, pull_cable};
use rcc_tests::cell_fixture::CellFixture;
use rcc_tests::processes::ends_with_test;
use rcc_tests::records::RecordCollector;
use rcc_tests::simulator::Simulator;
use rcc_tests::{TestCell, await_some, program, repository};
use serde_json::{Value, json};

/// Number of times that the cable is pulled.
const PULLS: usize = 3;
/// Number of single exchanges with a wrong working counter.
const SINGLE_MISSES: u64 = 20;

/// Switches lamp, clamp and pressure on, and monitors what comes back; ends by CANCEL.
const ALL_ON: &str = "
net: all-on
primitives:
  lamp:     {type: DigitalOutput, parameters: {device: line, channel: lamp}, inputs: {in: true}}
  clamp:    {type: DigitalOutput, parameters: {device: line, channel: clamp}, inputs: {in: true}}
  pressure: {type: AnalogOutput, parameters: {device: line, channel: pressure}, inputs: {in: 500000 Pa}}
  lamp_on:  {type: DigitalInput, parameters: {device: line, channel: lamp_on}}
  door:     {type: DigitalInput, parameters: {device: line, channel: door_closed}}
  measured: {type: AnalogInput, parameters: {device: line, channel: pressure_measured}}
  level:    {type: AnalogInput, parameters: {device: line, channel: level}}
  cancel:   {type: Cancel}
  end:      {type: Termination, inputs: {done: cancel.requested}}
  watch:    {type: Monitor, inputs: {value: measured.out}}
discard: [lamp_on.out, door.out, level.out]
";

/// Raw number of 500 kPa and of the safe value, 100 kPa.
const HALF: i64 = 16384;
const SAFE: i64 = 3277;

fn shipped() -> std::path::PathBuf {
    repository().join("configs/cells/ethercat.yaml")
}

/// Puts the line on the interfaces of the namespace, and gives a busy machine time.
fn on_ethernet(text: String) -> String {
    let text = text
        .replace("udp 127.0.0.1:${line}", NEAR)
        .replace("--udp=127.0.0.1:${line}", &format!("--nic={FAR}"))
        .replace("ports: {line: auto udp}\n", "");
    patient(text)
}

fn patient(text: String) -> String {
    text.replace("timeout: 10 ms", "timeout: 50 ms")
        .replace("watchdog: 100 ms", "watchdog: 500 ms")
}

/// Counts of exchanges since the driver started, from its next diagnosis: it writes one each second.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ExchangeCounts {
    complete: u64,
    wrong: u64,
    silent: u64,
}

impl ExchangeCounts {
    fn of(cell: &CellFixture) -> ExchangeCounts {
        let read = || {
            let path = cell.cell().drivers_dir().join("line.json");
            let text = std::fs::read_to_string(path).ok()?;
            let link = serde_json::from_str::<Value>(&text).ok()?["link"].take();
            Some(ExchangeCounts {
                complete: link["complete"].as_u64()?,
                wrong: link["wrong_working_counter"].as_u64()?,
                silent: link["silent"].as_u64()?,
            })
        };
        let newest = await_some("a diagnosis", read);
        await_some("the next diagnosis", || {
            read().filter(|next| *next != newest)
        })
    }

    /// Asserts that `missed` exchanges had a wrong working counter since `before`, except for those that a stall of the machine
    /// left without an answer.
    fn assert_missed(self, before: ExchangeCounts, missed: u64) {
        let wrong = self.wrong - before.wrong;
        let lost = wrong + self.silent - before.silent;
        assert!(
            wrong <= missed && missed <= lost,
            "{missed} missed: {before:?}, {self:?}"
        );
    }
}

fn outputs(line: &mut Simulator) -> (Value, Value) {
    let state = line.state();
    let row = |position: usize| state["terminals"][position]["outputs"].clone();
    (row(1), row(3))
}

/// Waits for the end of a command because its device was lost.
fn assert_lost(cell: &CellFixture, id: u64) {
    let row = cell.await_end(id);
    let words = row.to_string();
    assert!(words.contains("device lost"), "{words}");
}

/// Waits until the terminals drive these outputs.
fn await_outputs(line: &mut Simulator, lamps: Value, pressure: i64) {
    let wanted = (lamps, json!([pressure, 0, 0, 0]));
    await_some(&format!("the outputs {wanted:?}"), || {
        (outputs(line) == wanted).then_some(())
    });
}

/// Lamp and clamp as they are, all other outputs off.
fn lamps(lamp: u8, clamp: u8) -> Value {
    json!([lamp, clamp, 0, 0, 0, 0, 0, 0])
}

#[test]
fn the_shipped_cell_switches_outputs_and_reads_inputs() {
    let cell = TestCell::start(&shipped(), patient);
    let mut line = cell.simulator("line-sim");
    let door = json!({"set": {"terminal": 1, "channel": 2, "value": 1}});
    let level = json!({"set": {"terminal": 3, "channel": 2, "value": 3276}});
    for set in [door, level] {
        assert_eq!(line.ask(&set)["ok"], true);
    }
    let id = cell.run(ALL_ON);
    await_outputs(&mut line, lamps(1, 1), HALF);
    await_some("the inputs that belong to the outputs", || {
        let measured = cell.value(id, "measured.out").as_f64()?;
        let level = cell.value(id, "level.out").as_f64()?;
        let on = cell.value(id, "lamp_on.out") == true && cell.value(id, "door.out") == true;
        (on && (measured - 5e5).abs() < 16.0 && (level - 1.0).abs() < 1e-3).then_some(())
    });
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    await_outputs(&mut line, lamps(0, 1), SAFE);
    let (words, _) = cell.cli_exits(0, &["doctor", "ethercat", "line"]);
    for part in [
        "the line has the 4 terminals of the configuration",
        "all terminals are in OP",
        "a simulated line at",
    ] {
        assert!(words.contains(part), "{words}");
    }
    cell.stop();
}

#[test]
fn a_pulled_cable_loses_the_device_and_nothing_starts_by_itself_when_it_is_back() {
    in_namespace("a_pulled_cable", || {
        let cell = TestCell::start(&shipped(), on_ethernet);
        let mut line = cell.simulator("line-sim");
        for _ in 0..PULLS {
            let id = cell.run(ALL_ON);
            await_outputs(&mut line, lamps(1, 1), HALF);
            pull_cable();
            cell.await_device("line", "offline");
            assert_lost(&cell, id);
            // The terminals switch off by themselves: off, and the analog one to its safe value.
            await_outputs(&mut line, lamps(0, 0), SAFE);
            plug_cable();
            cell.await_device("line", "ready");
            // The clamp too stays off until a net commands it.
            await_outputs(&mut line, lamps(0, 0), SAFE);
            let commands = cell.rest("GET", "/commands", "").body;
            let running = commands.as_array().expect("rows").iter();
            assert_eq!(running.filter(|row| row["state"] == "running").count(), 0);
        }
        cell.stop();
    });
}

#[test]
fn a_line_without_power_and_its_simulator_come_back() {
    in_namespace("a_line_without_power", || {
        let cell = TestCell::start(&shipped(), on_ethernet);
        let mut line = cell.simulator("line-sim");
        line.ask(&json!({"kill": 3}));
        cell.await_device("line", "offline");
        let (words, _) = cell.cli_exits(1, &["doctor", "device", "line"]);
        assert!(
            words.contains("terminal") || words.contains("terminals"),
            "{words}"
        );
        line.ask(&json!({"start": 3}));
        cell.await_device("line", "ready");
        // The process of the line dies; `up` starts it again, with its terminals in INIT.
        line.ask(&json!("quit"));
        cell.await_device("line", "offline");
        cell.await_device("line", "ready");
        let mut line = cell.simulator("line-sim");
        let id = cell.run(ALL_ON);
        await_outputs(&mut line, lamps(1, 1), HALF);
        cell.done(id, "cancel");
        cell.assert_ends(id, "canceled");
        cell.stop();
    });
}

#[test]
fn a_wrong_working_counter_is_null_at_once_and_a_loss_after_the_configured_number() {
    let cell = TestCell::start(&shipped(), |text| {
        // Without a complete exchange for `command_timeout` the device is lost, too.
        patient(text)
            .replace("lost_after: 5", "lost_after: 2000")
            .replace(
                "driver: ethercat",
                "driver: ethercat\n    command_timeout: 9 s",
            )
    });
    let mut line = cell.simulator("line-sim");
    let id = cell.run(&ALL_ON.replace("Monitor,", "Monitor, parameters: {rate: 1000 Hz},"));
    await_outputs(&mut line, lamps(1, 1), HALF);
    let losses = |cell: &TestCell| cell.device("line").expect("a row")["losses"].clone();
    let (lost, before) = (losses(&cell), ExchangeCounts::of(&cell));
    // Each single exchange is null. The executor sees most of them: an exchange may pass between two of its cycles.
    let records = RecordCollector::follow(&cell);
    for _ in 0..SINGLE_MISSES {
        let frames = |line: &mut Simulator| line.state()["frames"].as_u64().expect("frames");
        let begun = frames(&mut line);
        line.ask(&json!({"miss": {"terminal": 1, "frames": 1}}));
        await_some("values between the misses", || {
            (frames(&mut line) > begun + 10).then_some(())
        });
    }
    let records = records.finish();
    let mut of_net = records.iter().filter(|record| record.command == id);
    assert!(
        of_net.any(|record| record.values[0].is_nan()),
        "no null among {} records",
        records.len()
    );
    ExchangeCounts::of(&cell).assert_missed(before, SINGLE_MISSES);
    line.ask(&json!({"miss": {"terminal": 1, "frames": 1500}}));
    await_some("null while a terminal takes no part", || {
        cell.value(id, "measured.out").is_null().then_some(())
    });
    await_some("values again", || cell.value(id, "measured.out").as_f64());
    assert_eq!(cell.state(id)["state"], "running");
    ExchangeCounts::of(&cell).assert_missed(before, SINGLE_MISSES + 1500);
    assert_eq!(losses(&cell), lost, "fewer than lost_after");
    line.ask(&json!({"miss": {"terminal": 1, "frames": 1_000_000}}));
    cell.await_device("line", "offline");
    assert_lost(&cell, id);
    let row = cell.device("line").expect("a row");
    assert!(row.to_string().contains("wrong working counter"), "{row}");
    await_some("the number of lost exchanges in the log", || {
        let words = "is lost after 2000 lost exchanges";
        cell.logs().contains(words).then_some(())
    });
    // The line is still exchanged with, and gets the safe values.
    await_outputs(&mut line, lamps(0, 1), SAFE);
    line.ask(&json!({"miss": {"terminal": 1, "frames": 0}}));
    cell.await_device("line", "ready");
    cell.stop();
}

#[test]
fn the_terminals_switch_off_when_the_driver_is_killed() {
    in_namespace("the_driver_is_killed", || {
        let cell = TestCell::start(&shipped(), on_ethernet);
        let mut line = cell.simulator("line-sim");
        let id = cell.run(ALL_ON);
        await_outputs(&mut line, lamps(1, 1), HALF);
        let dead = cell.kill(Role::Driver, "line");
        // By their watchdogs, or by the start of the next driver, whichever is earlier.
        await_outputs(&mut line, lamps(0, 0), SAFE);
        assert_lost(&cell, id);
        cell.await_successor(Role::Driver, "line", dead);
        cell.await_device("line", "ready");
        // A new driver knows of no clamp.
        await_outputs(&mut line, lamps(0, 0), SAFE);
        cell.stop();
    });
}

#[test]
fn another_line_is_refused_with_the_difference() {
    let place = CellFixture::new(&shipped(), patient);
    let mut simulator = Command::new(program("ethercat-sim"));
    simulator
        .arg(format!("--udp=127.0.0.1:{}", place.port("line")))
        .arg("--terminals=EL1008,EL3064,EL2008,EL4004");
    let mut simulator = ends_with_test(&mut simulator)
        .spawn()
        .expect("the simulator");
    let file = place.config().to_str().expect("a path").to_owned();
    let output = Command::new(program("rcc-cli"))
        .env("RCC_RUNTIME_DIR", place.folder())
        .env("RCC_STATE_DIR", place.state_dir())
        .env_remove("RCC_CELL")
        .args(["--cell", &file, "doctor", "ethercat", "line"])
        .output()
        .expect("rcc-cli runs");
    simulator.kill().expect("it runs");
    simulator.wait().expect("it ends");
    let words = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(1), "{words}");
    let difference = "terminal 2 is EL3064 (vendor 0x2, product 0x0bf83052); the configuration names lamps, EL2008";
    assert!(words.contains(difference), "{words}");
    assert!(words.contains("correct `settings.terminals`"), "{words}");
}
