//! Runs a rule against the subject on loopback, or against a real device that `RCC_DEVICE_<DRIVER>` names.
//! Test code only.
//!
//! `RCC_DEVICE_FRI_LWR='{"listen": "192.168.0.10:49938"}'` gives settings; `=configs/cells/mine.yaml` takes the first
//! device of that driver. On a real device nothing moves and no output changes: rules that would do so are skipped by
//! name. `RCC_DEVICE_OUTPUTS=1` allows the outputs of a device without a robot to be switched on and off.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rcc_config::{CellConfig, DeviceConfig};
use rcc_core::message::{CommandImage, SetPoint};
use rcc_os::clock::monotonic_ns;

use super::driver_bench::all_on;
use super::fault_path::free_udp;
use super::{Subject, TIMEOUT};
use crate::driver::{Driver, Inputs, Outputs};
use crate::host::device_session::DeviceSession;

/// Seeds of a rule with faults, unless `RCC_SEED` gives one.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=2;
/// How long the first datagram of a real device may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// Number of exchanges with a real device.
const EXCHANGES: usize = 200;

/// Permitted actions on a real device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OnReal {
    /// Runs the rule itself, which does not reach the device.
    Same,
    /// Only listens.
    Listen,
    /// Writes outputs, if that is permitted.
    Outputs,
}

/// Rules that can be run against a real device; all others are skipped there.
const ON_REAL: &[(&str, OnReal)] = &[
    ("opens_what_is_right", OnReal::Same),
    ("refuses_a_setting_that_it_does_not_have", OnReal::Same),
    ("refuses_each_setting_of_another_form", OnReal::Same),
    ("refuses_each_setting_out_of_range", OnReal::Same),
    ("says_which_setting_is_missing", OnReal::Same),
    ("refuses_each_channel_of_a_wrong_address", OnReal::Same),
    ("refuses_two_outputs_at_one_address", OnReal::Same),
    ("refuses_a_robot_that_it_cannot_move", OnReal::Same),
    ("replays_its_capture", OnReal::Same),
    ("replays_a_recording", OnReal::Same),
    ("tells_what_it_knows", OnReal::Listen),
    ("carries_outputs_there_and_inputs_back", OnReal::Outputs),
];

/// Only one rule at a time may use a real device.
static ALONE: Mutex<()> = Mutex::new(());

/// Runs a rule against the subject, or its safe part against the real device.
pub fn run<S: Subject>(name: &str, rule: fn()) {
    let variable = format!("RCC_DEVICE_{}", S::NAME.to_uppercase().replace('-', "_"));
    let Some(text) = std::env::var_os(&variable) else {
        return rule();
    };
    let device = real::<S>(&text.to_string_lossy());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    match ON_REAL.iter().find(|row| row.0 == name).map(|row| row.1) {
        Some(OnReal::Same) => rule(),
        Some(OnReal::Listen) => listen::<S>(&device),
        Some(OnReal::Outputs) => match std::env::var("RCC_DEVICE_OUTPUTS").as_deref() {
            Ok("1") if device.robot.is_none() => blink::<S>(&device),
            _ => eprintln!(
                "skipped on the real device: {name} (it changes outputs: RCC_DEVICE_OUTPUTS=1, and no robot)"
            ),
        },
        None => eprintln!("skipped on the real device: {name} (it needs the simulated one)"),
    }
}

/// Returns the device that the variable describes.
fn real<S: Subject>(text: &str) -> DeviceConfig {
    if text.trim_start().starts_with('{') {
        return DeviceConfig {
            settings: serde_json::from_str(text).expect("the variable has settings as JSON"),
            ..S::device(free_udp())
        };
    }
    let cell =
        CellConfig::load_offline(Path::new(text)).unwrap_or_else(|faults| panic!("{faults}"));
    let device = cell
        .devices
        .into_iter()
        .find(|device| device.driver.is(S::NAME));
    device.unwrap_or_else(|| panic!("{text} has no device with the driver {}", S::NAME))
}

/// Only receives: an arm without answers stays in monitor state, and an output that is not written keeps its value.
fn listen<S: Subject>(device: &DeviceConfig) {
    let mut driver = S::Driver::open(device).unwrap_or_else(|error| panic!("{error}"));
    let (begin, mut heard) = (Instant::now(), 0);
    while heard < EXCHANGES {
        let mut inputs = Inputs::NONE;
        match driver.receive(TIMEOUT, &mut inputs) {
            Ok(exchange) => {
                heard += 1;
                assert!(
                    exchange.ticks >= 1 && exchange.period_ns > 0,
                    "{exchange:?}"
                );
                assert!(exchange.quality_permille <= 1000, "{exchange:?}");
                assert!(
                    exchange.mirror.iter().all(|q| q.is_finite()),
                    "{exchange:?}"
                );
                let [digital, ..] = device.model().channels;
                assert_eq!(inputs.digital_known, (1 << digital) - 1);
            }
            Err(error) => assert!(
                heard > 0 || begin.elapsed() < PATIENCE,
                "the real device is not heard: {error}"
            ),
        }
    }
}

/// Switches all outputs on for a while, then releases them.
fn blink<S: Subject>(device: &DeviceConfig) {
    let mut driver = S::Driver::open(device).unwrap_or_else(|error| panic!("{error}"));
    let mut session = DeviceSession::new(device, monotonic_ns());
    let mut image = Box::new(CommandImage::new(1, 1_000_000));
    let (begin, mut heard) = (Instant::now(), 0);
    while heard < EXCHANGES {
        let mut inputs = Inputs::NONE;
        let Ok(exchange) = driver.receive(TIMEOUT, &mut inputs) else {
            assert!(
                heard > 0 || begin.elapsed() < PATIENCE,
                "the real device is not heard"
            );
            continue;
        };
        heard += 1;
        let on = heard < EXCHANGES / 2;
        let point = if on {
            all_on(device, 1)
        } else {
            SetPoint::NONE
        };
        image.push(image.head.sequence + 1, monotonic_ns(), point);
        session.observe(monotonic_ns(), Some(&image));
        let outputs: Outputs = session.exchange(monotonic_ns(), &inputs, &exchange);
        driver
            .send(&outputs)
            .unwrap_or_else(|error| panic!("{error}"));
    }
}

/// Returns the seed of rules that need only one.
pub fn seed() -> u64 {
    chosen().unwrap_or(1)
}

fn chosen() -> Option<u64> {
    let text = std::env::var("RCC_SEED").ok()?;
    Some(text.parse().expect("RCC_SEED is a number"))
}

/// Runs a rule with each of its seeds; a failure names its seed.
pub fn with_seeds(rule: impl Fn(u64)) {
    let seeds: Vec<u64> = match chosen() {
        Some(seed) => vec![seed],
        None => SEEDS.collect(),
    };
    for seed in seeds {
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| rule(seed))) {
            eprintln!("RCC_SEED={seed} repeats this");
            resume_unwind(panic);
        }
    }
}
