//! The driver with programs in Python, which every machine that builds RCC has.
//! Test code only.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rcc_config::{DeviceConfig, OnRelease};
use rcc_core::primitive::ChannelKind::{AnalogInput, AnalogOutput, DigitalInput, DigitalOutput};
use rcc_core::unit::Unit;
use rcc_driver_kit::conformance;
use rcc_driver_kit::driver::{Driver, DriverError, Exchange, Inputs, LinkError, Outputs};
use serde_json::{Value, json};

use super::{ENDED, LATE, RANGE, STARTING, Software};

/// Longest wait for a program; Python starts slowly on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);
/// Answers each line; `values` is an expression of `frame` and `outputs`.
const ANSWERING: &str = "
import json, sys, time
for line in sys.stdin:
    message = json.loads(line)
    frame, outputs = message['frame'], message['outputs']
    print(json.dumps({'frame': frame, 'values': VALUES}), flush=True)
";

fn device(program: &str) -> DeviceConfig {
    let settings =
        json!({"command": ["python3", "-c", program], "period": "1 ms", "timeout": "10 s"});
    let safe = Some(OnRelease::Safe(0.0));
    let rows = [
        ("lamp", DigitalOutput, json!("lamp"), safe, None),
        ("gain", AnalogOutput, json!("gain"), safe, None),
        ("found", DigitalInput, json!("found"), None, None),
        ("x", AnalogInput, json!("x"), None, None),
        ("age", AnalogInput, json!("age"), None, None),
    ];
    let mut device = conformance::device("software", settings, &rows);
    device.channels[4].unit = Unit::SECOND;
    device
}

fn answering(values: &str) -> Software {
    opened(&device(&ANSWERING.replace("VALUES", values)))
}

fn opened(device: &DeviceConfig) -> Software {
    Software::open(device).unwrap_or_else(|error| panic!("{error}"))
}

fn with_setting(key: &str, value: Value) -> Result<Software, DriverError> {
    let mut device = device("pass");
    device.settings[key] = value;
    Software::open(&device)
}

/// Exchanges until `wanted` is true.
fn until(
    driver: &mut Software,
    outputs: &Outputs,
    wanted: impl Fn(&Result<Exchange, LinkError>, &Inputs) -> bool,
) -> Inputs {
    let end = Instant::now() + PATIENCE;
    let mut last = None;
    while Instant::now() < end {
        let mut inputs = Inputs::NONE;
        let result = driver.receive(Duration::from_millis(10), &mut inputs);
        if result.is_ok() {
            driver.send(outputs).expect("it never fails");
        }
        if wanted(&result, &inputs) {
            return inputs;
        }
        last = Some(result);
    }
    panic!("not within {PATIENCE:?}: {last:?}");
}

fn lost(reason: u32) -> impl Fn(&Result<Exchange, LinkError>, &Inputs) -> bool {
    move |result, _| *result == Err(LinkError::Lost { reason })
}

#[test]
fn outputs_go_there_and_values_come_back_with_their_age() {
    let mut driver = answering("{'x': outputs['gain'], 'found': outputs['lamp']}");
    let mut outputs = Outputs::NONE;
    (outputs.digital, outputs.digital_set) = (1, 1);
    outputs.analog[0] = 0.25;
    let inputs = until(&mut driver, &outputs, |result, inputs| {
        result.is_ok() && inputs.analog[0] == 0.25
    });
    assert_eq!((inputs.digital & 1, inputs.digital_known & 1), (1, 1));
    let age = inputs.analog[1];
    assert!(age > 0.0 && age < PATIENCE.as_secs_f64(), "{age}");
    // An output without a value is null to the program, and comes back as unknown.
    let inputs = until(&mut driver, &Outputs::NONE, |result, inputs| {
        result.is_ok() && inputs.analog[0].is_nan()
    });
    assert_eq!(inputs.digital_known & 1, 0);
}

#[test]
fn a_value_that_is_left_out_is_unknown_and_one_of_the_wrong_type_too() {
    let mut driver = answering("{'x': True, 'other': 1} if frame % 2 else {'x': 1.0, 'found': 1}");
    let one = |result: &Result<Exchange, LinkError>, inputs: &Inputs| {
        result.is_ok() && inputs.analog[0] == 1.0 && inputs.digital_known & 1 == 0
    };
    until(&mut driver, &Outputs::NONE, one);
    until(&mut driver, &Outputs::NONE, |result, inputs| {
        result.is_ok() && inputs.analog[0].is_nan()
    });
}

#[test]
fn a_value_outside_of_its_range_is_unknown_and_the_reason_says_so() {
    let mut device = device(&ANSWERING.replace("VALUES", "{'x': 1.0 if frame % 2 else 3.0}"));
    device.channels[3].range = Some([0.0, 2.0]);
    let mut driver = opened(&device);
    let is = |reason: u32, value: fn(f64) -> bool| {
        move |result: &Result<Exchange, LinkError>, inputs: &Inputs| {
            result.is_ok_and(|exchange| exchange.reason == reason) && value(inputs.analog[0])
        }
    };
    until(&mut driver, &Outputs::NONE, is(RANGE, f64::is_nan));
    until(&mut driver, &Outputs::NONE, is(0, |value| value == 1.0));
}

#[test]
fn a_program_that_ends_is_lost_and_is_started_again() {
    let mut driver = answering("{'x': float(frame)} if frame < 5 else sys.exit(3)");
    for _ in 0..2 {
        until(&mut driver, &Outputs::NONE, |result, inputs| {
            result.is_ok() && inputs.analog[0] == 4.0
        });
        until(&mut driver, &Outputs::NONE, lost(ENDED));
        until(&mut driver, &Outputs::NONE, |result, _| result.is_ok());
    }
    let link = driver.diagnosis().expect("counters").link();
    assert!(link["starts"].as_u64() >= Some(3), "{link}");
    assert!(
        link["last_words"]
            .as_str()
            .is_some_and(|words| words.contains("exit status: 3")),
        "{link}"
    );
}

#[test]
fn a_program_that_cannot_be_started_is_said_to_have_ended() {
    let mut device = device("");
    device.settings["command"] = json!(["./no-such-program"]);
    let mut driver = opened(&device);
    until(&mut driver, &Outputs::NONE, lost(ENDED));
}

#[test]
fn a_program_that_is_silent_is_starting_and_one_that_hangs_has_no_values_any_more() {
    let mut driver = opened(&device("import sys\nsys.stdin.read()"));
    until(&mut driver, &Outputs::NONE, lost(STARTING));

    let mut device =
        device(&ANSWERING.replace("VALUES", "{'x': 1.0} if frame < 5 else time.sleep(1000)"));
    device.settings["timeout"] = json!("100 ms");
    let mut driver = opened(&device);
    until(&mut driver, &Outputs::NONE, |_, inputs| {
        inputs.analog[0] == 1.0
    });
    let hanging = |result: &Result<Exchange, LinkError>, inputs: &Inputs| {
        result.is_ok_and(|exchange| exchange.reason == LATE && exchange.late > 10)
            && inputs.analog[0].is_nan()
    };
    let inputs = until(&mut driver, &Outputs::NONE, hanging);
    assert!(
        inputs.analog[1] > 0.1,
        "the age goes on: {}",
        inputs.analog[1]
    );
}

#[test]
fn a_line_that_is_no_answer_is_refused_counted_and_told() {
    for (line, words) in [
        ("'hello'", "expected value"),
        ("'{\"values\": {\"x\": 1e999}}'", "number out of range"),
        ("'{\"frame\": 7, \"values\": {}}'", "frame 7"),
        ("'{\"values\": {}, \"vlaues\": {}}'", "vlaues"),
        ("'x' * 100000", "longer than"),
    ] {
        let program =
            format!("import sys\nfor _ in range(3): print({line}, flush=True)\nsys.stdin.read()");
        let mut driver = opened(&device(&program));
        let counters = driver.diagnosis().expect("counters");
        until(&mut driver, &Outputs::NONE, |_, _| {
            let link = counters.link();
            link["last_words"]
                .as_str()
                .is_some_and(|last| last.contains(words))
        });
        assert!(
            driver
                .receive(Duration::from_millis(10), &mut Inputs::NONE.clone())
                .is_err()
        );
    }
}

#[test]
fn a_slow_program_survives_a_line_that_is_no_answer() {
    // The line comes while the first frame is outstanding, so that a second one is sent; it takes longer than a period.
    let program = "
import json, sys, time
for line in sys.stdin:
    frame = json.loads(line)['frame']
    if frame in (1, 9):
        print('loading the model', flush=True)
    time.sleep(0.05)
    print(json.dumps({'frame': frame, 'values': {'x': float(frame)}}), flush=True)
";
    let mut device = device(program);
    device.settings["period"] = json!("10 ms");
    let mut driver = opened(&device);
    until(&mut driver, &Outputs::NONE, |result, inputs| {
        result.is_ok_and(|exchange| exchange.refused == 2) && inputs.analog[0] >= 20.0
    });
    let link = driver.diagnosis().expect("counters").link();
    assert_eq!((&link["starts"], &link["refused"]), (&json!(1), &json!(2)));
    let words = link["last_words"].as_str().unwrap_or_default();
    assert!(words.contains("expected value"), "{words}");
}

/// A program that ignores the end of its input. It writes the ids of a process that it starts and of itself to this file,
/// and gives values once.
fn stubborn(file: &Path) -> String {
    format!(
        "import os, subprocess, sys, time\nchild = subprocess.Popen(['sleep', '1000'])\n\
         open({file:?}, 'w').write(f'{{child.pid}} {{os.getpid()}}\\n')\n\
         print('{{\"values\": {{}}}}', flush=True)\ntime.sleep(1000)"
    )
}

/// Process ids in this file, once the program has written them.
fn pids(file: &Path) -> Option<Vec<u32>> {
    let text = std::fs::read_to_string(file).ok()?;
    let words = text.strip_suffix('\n')?.split(' ');
    words.map(|word| word.parse().ok()).collect()
}

fn has_ended(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat"));
    stat.map_or(true, |stat| stat.contains(") Z ") || stat.contains(") X "))
}

#[test]
fn a_driver_that_ends_ends_its_program_and_all_that_it_started() {
    let folder = rcc_testing::folder();
    let file = folder.path().join("pids");
    let mut driver = opened(&device(&stubborn(&file)));
    until(&mut driver, &Outputs::NONE, |result, _| result.is_ok());
    drop(driver);
    for pid in pids(&file).expect("process ids") {
        assert!(has_ended(pid), "process {pid} lives on");
    }
}

/// Names the file of [`stubborn`] to the process that is a driver for this test.
const DRIVER: &str = "RCC_TEST_SOFTWARE_DRIVER";

#[test]
fn a_driver_that_is_killed_leaves_neither_its_program_nor_what_that_started() {
    if let Some(file) = std::env::var_os(DRIVER) {
        let _driver = opened(&device(&stubborn(Path::new(&file))));
        // The process that started it kills it, or has died itself.
        let _ = std::io::stdin().read_line(&mut String::new());
        return;
    }
    let folder = rcc_testing::folder();
    let file = folder.path().join("pids");
    let (_, tests) = module_path!().split_once("::").expect("a module");
    let name = "a_driver_that_is_killed_leaves_neither_its_program_nor_what_that_started";
    let mut driver = Command::new(std::env::current_exe().expect("this test"))
        .args(["--exact", &format!("{tests}::{name}")])
        .env(DRIVER, &file)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .expect("this test once more");
    let pids = wait_for("the program", || pids(&file));
    assert!(!pids.iter().any(|pid| has_ended(*pid)), "{pids:?}");
    driver.kill().expect("SIGKILL");
    driver.wait().expect("it has ended");
    wait_for("the end of the program and its child", || {
        pids.iter().all(|pid| has_ended(*pid)).then_some(())
    });
}

/// Waits until there is a value.
fn wait_for<T>(what: &str, mut found: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(value) = found() {
            return value;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("{what}: not within {PATIENCE:?}");
}

#[test]
fn a_program_that_closes_its_output_and_goes_on_is_ended_and_started_again() {
    let program = "import os, time\nos.close(1)\ntime.sleep(1000)";
    let mut driver = opened(&device(program));
    let counters = driver.diagnosis().expect("counters");
    until(&mut driver, &Outputs::NONE, |_, _| {
        counters.link()["starts"].as_u64() >= Some(2)
    });
}

#[test]
fn what_is_wrong_in_the_configuration_is_named() {
    for (key, value) in [
        ("command", json!([])),
        ("command", json!("python3")),
        ("command", json!([1])),
        ("period", json!("0 ms")),
        ("timeout", json!(3)),
        ("periode", json!("1 ms")),
    ] {
        let error = with_setting(key, value).expect_err(key).to_string();
        assert!(error.contains(key), "{error}");
    }
    for (channel, address) in [(0, json!(1)), (2, json!("")), (3, json!("age"))] {
        let mut device = device("pass");
        device.channels[channel].address = address;
        let name = device.channels[channel].name.clone();
        let error = Software::open(&device).expect_err("refused").to_string();
        assert!(error.contains(&name), "{error}");
    }
}
