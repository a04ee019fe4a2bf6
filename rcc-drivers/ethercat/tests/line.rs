//! `ethercrab` against `ethercat-sim` over a veth pair, in a network namespace of the test's thread, which ends with it.
//! Skipped with words without the right to make one.

use std::io::{BufRead, BufReader};
use std::ops::ControlFlow;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rcc_drivers::sim::line_server::ControlClient;
use rcc_ethercat::session::{
    Application, ClockOptions, Cycle, ExpectedTerminal, FrameCounts, Loss, SessionError,
    SessionOptions, TerminalImage,
};
use rcc_ethercat::terminals::{MODELS, Model, VENDOR};
use rcc_ethercat::wire::Interface;
use rcc_testing::namespace::{FAR, NEAR, in_namespace};
use serde_json::Value;

/// The simulator and its control port; dropping it ends the process.
struct Simulator {
    process: Child,
    control: ControlClient,
    folder: std::path::PathBuf,
}

impl Simulator {
    fn ask(&mut self, request: &str) -> Value {
        let answer = self.control.ask(request).expect("an answer");
        let answer: Value = serde_json::from_str(&answer).expect("JSON");
        assert!(answer.get("error").is_none(), "{request}: {answer}");
        answer
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Runs `test` with a simulated line on [`FAR`], in a namespace of its own.
fn with_line(name: &'static str, test: impl FnOnce(Simulator) + Send + 'static) {
    in_namespace(name, move || {
        let folder = std::env::temp_dir().join(format!("{name}-{}", std::process::id()));
        let socket = folder.join("line.sock");
        let mut process = Command::new(env!("CARGO_BIN_EXE_ethercat-sim"))
            .args([&format!("--nic={FAR}"), "--control"])
            .arg(&socket)
            .stdout(Stdio::piped())
            .spawn()
            .expect("the simulator");
        let mut ready = String::new();
        let output = process.stdout.take().expect("its output");
        BufReader::new(output)
            .read_line(&mut ready)
            .expect("a line");
        assert!(ready.starts_with("ethercat-sim ready"), "{ready}");
        let control = ControlClient::connect(&socket).expect("the control port");
        test(Simulator {
            process,
            control,
            folder,
        });
    });
}

fn options() -> SessionOptions {
    let terminal = |model: &Model| ExpectedTerminal {
        name: model.name.to_owned(),
        vendor: VENDOR,
        product: model.product,
        watchdog: None,
        objects: Vec::new(),
        sync0: false,
    };
    SessionOptions {
        interface: Interface::Nic(NEAR.to_owned()),
        line: MODELS.iter().take(4).map(terminal).collect(),
        period: Duration::from_millis(1),
        timeout: Duration::from_millis(50),
        clocks: None,
    }
}

/// An application that only exchanges.
struct Plain<F>(F);

impl<F: FnMut(&mut [TerminalImage], Cycle) -> ControlFlow<()>> Application for Plain<F> {
    fn cycle(&mut self, image: &mut [TerminalImage], cycle: Cycle) -> ControlFlow<()> {
        (self.0)(image, cycle)
    }
}

fn run(
    options: &SessionOptions,
    cycle: impl FnMut(&mut [TerminalImage], Cycle) -> ControlFlow<()>,
) -> Result<(), SessionError> {
    rcc_ethercat::session::run(options, &FrameCounts::default(), &mut Plain(cycle))
}

#[test]
fn process_data_flow_both_ways() {
    with_line("process-data", |mut sim| {
        sim.ask(r#"{"set":{"terminal":1,"channel":3,"value":1}}"#);
        sim.ask(r#"{"set":{"terminal":3,"channel":2,"value":-77}}"#);
        let mut complete = 0;
        let result = run(&options(), |image, cycle| {
            image[1].outputs[0] = 0b101;
            image[3].outputs[2..4].copy_from_slice(&4321_i16.to_le_bytes());
            if cycle != Cycle::Complete {
                return ControlFlow::Continue(());
            }
            complete += 1;
            assert_eq!(image[0].inputs, [0b100]);
            assert_eq!(image[2].inputs[4..8], [0, 0, 0xb3, 0xff]);
            if complete < 1000 {
                return ControlFlow::Continue(());
            }
            let state = sim.ask(r#"{"state":null}"#);
            let outputs = |terminal: usize| state["terminals"][terminal]["outputs"].to_string();
            assert_eq!(outputs(1), "[1,0,1,0,0,0,0,0]");
            assert_eq!(outputs(3), "[0,4321,0,0]");
            ControlFlow::Break(())
        });
        assert_eq!((result, complete), (Ok(()), 1000));
    });
}

#[test]
fn a_pulled_cable_is_a_lost_exchange_and_never_a_value() {
    with_line("pulled-cable", |mut sim| {
        sim.ask(r#"{"set":{"terminal":1,"channel":1,"value":1}}"#);
        let (mut before, mut lost) = (0, 0);
        let result = run(&options(), |image, cycle| {
            match cycle {
                Cycle::Complete if before < 10 => {
                    before += 1;
                    if before == 10 {
                        sim.ask(r#"{"pull":2}"#);
                        sim.ask(r#"{"set":{"terminal":1,"channel":1,"value":0}}"#);
                    }
                }
                // The line is put back together after the watchdogs have expired.
                Cycle::Lost(Loss::WorkingCounter { have, want }) if before == 10 => {
                    assert_eq!((have, want), (1, 6));
                    assert_eq!(image[0].inputs, [1], "the last complete exchange");
                    lost += 1;
                    let state = sim.ask(r#"{"state":null}"#);
                    if state["terminals"][1]["state"] == "SAFEOP"
                        && state["terminals"][3]["state"] == "SAFEOP"
                    {
                        sim.ask(r#"{"plug":null}"#);
                    }
                }
                Cycle::Complete => panic!("a value although terminal 2 is in SAFEOP"),
                _ => {}
            }
            ControlFlow::Continue(())
        });
        assert!(lost > 0);
        let Err(SessionError::Left { position, name, .. }) = result else {
            panic!("{result:?}");
        };
        assert_eq!((position, name.as_str()), (2, "EL2008"));
        // The next session finds the line in any state, and brings it to OP again, in the same process.
        let again = run(&options(), |_, cycle| match cycle {
            Cycle::Complete => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        });
        assert_eq!(again, Ok(()));
    });
}

#[test]
fn a_terminal_that_was_without_power_ends_the_session_when_it_is_back() {
    with_line("without-power", |mut sim| {
        let (mut complete, mut lost) = (0, 0);
        let result = run(&options(), |_, cycle| {
            match cycle {
                Cycle::Complete => {
                    complete += 1;
                    if complete == 10 {
                        sim.ask(r#"{"kill":3}"#);
                    }
                }
                Cycle::Lost(Loss::WorkingCounter { have, want }) if complete >= 10 => {
                    lost += 1;
                    // Until then the terminals in front of it get their outputs.
                    if lost <= 500 {
                        assert_eq!((have, want), (3, 6));
                    }
                    if lost == 500 {
                        sim.ask(r#"{"start":3}"#);
                    }
                }
                _ => {}
            }
            ControlFlow::Continue(())
        });
        assert_eq!(result, Err(SessionError::Restarted));
        assert!(lost >= 500, "{lost}");
        let again = run(&options(), |_, cycle| match cycle {
            Cycle::Complete => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        });
        assert_eq!(again, Ok(()));
    });
}

#[test]
fn another_line_is_told_by_its_position() {
    with_line("another-line", |_sim| {
        let mut options = options();
        options.line.swap(1, 2);
        let result = run(&options, |_, _| ControlFlow::Continue(()));
        let words =
            "terminal 2 is EL2008 (vendor 0x2, product 0x07d83052); the configuration names EL3064";
        assert_eq!(result.unwrap_err().to_string(), words);
        options.line.truncate(1);
        let result = run(&options, |_, _| ControlFlow::Continue(()));
        assert_eq!(result, Err(SessionError::Count { have: 4, want: 1 }));
        options.interface = Interface::Nic("nowhere9".to_owned());
        let result = run(&options, |_, _| ControlFlow::Continue(()));
        assert!(
            matches!(result, Err(SessionError::Nic { .. })),
            "{result:?}"
        );
    });
}

#[test]
fn a_line_without_clocks_is_not_started_with_distributed_clocks() {
    with_line("no-clocks", |_sim| {
        let shift = Duration::from_micros(500);
        let mut options = SessionOptions {
            clocks: Some(ClockOptions { shift }),
            ..options()
        };
        let result = run(&options, |_, _| ControlFlow::Break(()));
        assert_eq!(result, Err(SessionError::NoClock));
        options.line[1].sync0 = true;
        let result = run(&options, |_, _| ControlFlow::Break(()));
        let name = "EL2008".to_owned();
        assert_eq!(result, Err(SessionError::NoSync { position: 2, name }));
    });
}
