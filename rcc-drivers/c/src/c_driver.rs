//! A driver whose functions are written in C, as the host sees it.
//! Run by the host's thread; counters are read by others.

use std::ffi::CString;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkDiagnosis, LinkError, Outputs, to_raw,
};
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::{ChannelConfig, DeviceConfig};
use rcc_driver_kit::rcc_core::primitive::ChannelKind;
use rcc_driver_kit::serde_json::{Value, json};
use rcc_driver_kit::tracing;

use crate::check::{self, Expected};
use crate::ffi::{
    Description, OK, OpenArguments, OpenDriver, REFUSED, RawError, RawExchange, RawInputs,
    RawOutputs, SILENT,
};
use crate::reasons::{FAILED, INVALID};
use crate::{channel_argument, setting_value};

/// Shortest time between two lines in the log.
const LOG_PAUSE: Duration = Duration::from_secs(1);

/// Everything unknown: what C finds in `rcc_inputs`.
pub const UNKNOWN_INPUTS: RawInputs = RawInputs {
    position: [f64::NAN; 8],
    torque: [f64::NAN; 8],
    external_torque: [f64::NAN; 8],
    wrench: [f64::NAN; 6],
    analog: [f64::NAN; 16],
    digital: [-1; 64],
};

/// The initial value of `rcc_exchange` for C.
pub const USUAL_EXCHANGE: RawExchange = RawExchange {
    mirror: [f64::NAN; 8],
    period_s: f64::NAN,
    ticks: 1,
    late: 0,
    refused: 0,
    quality: 1000,
    reason: 0,
    commandable: 1,
};

/// Names the table of a driver: [`Driver::open`] gets none.
pub trait DriverTable: Send + 'static {
    /// Returns the table; `None` before there is one.
    fn description() -> Option<&'static Description>;
}

/// A driver of the table that `T` names.
#[derive(Debug)]
pub struct CDriver<T> {
    open: OpenDriver,
    reasons: &'static [Reason],
    joints: usize,
    digital_inputs: usize,
    digital_outputs: usize,
    analog_inputs: Vec<ChannelConfig>,
    analog_outputs: Vec<ChannelConfig>,
    counters: Arc<Counters>,
    last_told: Option<Instant>,
    table: PhantomData<fn() -> T>,
}

/// Statistics of the C code, for the user.
#[derive(Debug, Default)]
struct Counters {
    exchanges: AtomicU64,
    errors: AtomicU64,
    invalid: AtomicU64,
    /// Written on errors only.
    last_words: Mutex<String>,
}

impl LinkDiagnosis for Counters {
    fn link(&self) -> Value {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let words = self.last_words.lock();
        json!({
            "exchanges": count(&self.exchanges),
            "errors": count(&self.errors),
            "invalid_values": count(&self.invalid),
            "last_words": *words.unwrap_or_else(PoisonError::into_inner),
        })
    }
}

impl<T: DriverTable> Driver for CDriver<T> {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        let table = T::description().ok_or_else(|| DriverError::UnknownDriver {
            device: device.name.clone(),
            driver: device.driver.to_string(),
            known: "none: rcc_driver_main was not called".to_owned(),
        })?;
        let arguments = arguments(table, device)?;
        let open = OpenDriver::open(table, &arguments)
            .map_err(|(result, error)| refusal(table, device, result, &error))?;
        let channels = |kind| device.channels_of(kind).cloned().collect::<Vec<_>>();
        Ok(Self {
            open,
            reasons: table.reasons,
            joints: device.robot.as_ref().map_or(0, |robot| robot.joints.len()),
            digital_inputs: device.channels_of(ChannelKind::DigitalInput).count(),
            digital_outputs: device.channels_of(ChannelKind::DigitalOutput).count(),
            analog_inputs: channels(ChannelKind::AnalogInput),
            analog_outputs: channels(ChannelKind::AnalogOutput),
            counters: Arc::default(),
            last_told: None,
            table: PhantomData,
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let (mut raw, mut status) = (UNKNOWN_INPUTS, USUAL_EXCHANGE);
        let timeout_s = timeout.as_secs_f64();
        let (result, error) = self.open.receive(timeout_s, &mut raw, &mut status);
        self.outcome("receive", result, &error)?;
        let expected = Expected {
            joints: self.joints,
            digital_inputs: self.digital_inputs,
            analog_inputs: &self.analog_inputs,
            reasons: self.reasons,
        };
        let checked = check::exchange(&expected, &raw, &status);
        let (read, unknown) = check::inputs(&expected, &raw);
        if let Some(invalid) = checked.as_ref().err().copied().or(unknown) {
            self.counters.invalid.fetch_add(1, Ordering::Relaxed);
            self.tell(&format!("receive: {invalid}"));
        }
        let exchange = checked.map_err(|_| LinkError::Lost { reason: INVALID })?;
        self.counters.exchanges.fetch_add(1, Ordering::Relaxed);
        *inputs = read;
        Ok(exchange)
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        let mut raw = RawOutputs {
            position: outputs.position,
            analog: [f64::NAN; 16],
            digital: [-1; 64],
        };
        let digital = raw.digital.iter_mut().enumerate();
        for (bit, place) in digital.take(self.digital_outputs) {
            if outputs.digital_set >> bit & 1 == 1 {
                *place = i8::from(outputs.digital >> bit & 1 == 1);
            }
        }
        let channels = self.analog_outputs.iter().zip(outputs.analog);
        for (place, (channel, value)) in raw.analog.iter_mut().zip(channels) {
            *place = to_raw(channel, value);
        }
        let (result, error) = self.open.send(&raw);
        self.outcome("send", result, &error)
    }

    fn release(&mut self) {
        self.open.release();
    }

    fn reasons(&self) -> Option<&'static [Reason]> {
        Some(self.reasons)
    }

    fn diagnosis(&self) -> Option<Arc<dyn LinkDiagnosis>> {
        Some(Arc::clone(&self.counters) as Arc<dyn LinkDiagnosis>)
    }
}

impl<T> CDriver<T> {
    /// Returns what the result of a function means; its words go to the log.
    fn outcome(
        &mut self,
        function: &'static str,
        result: i32,
        error: &RawError,
    ) -> Result<(), LinkError> {
        match result {
            OK => Ok(()),
            SILENT => Err(LinkError::Silent),
            _ => {
                self.counters.errors.fetch_add(1, Ordering::Relaxed);
                let (at, text) = error.words();
                self.tell(&format!("{function} returned {result}: {at} {text}"));
                Err(LinkError::Lost { reason: FAILED })
            }
        }
    }

    /// Keeps words for `doctor`, and writes them to the log, but not in every cycle.
    fn tell(&mut self, words: &str) {
        let last = self.counters.last_words.lock();
        words.clone_into(&mut last.unwrap_or_else(PoisonError::into_inner));
        if self.last_told.is_none_or(|at| at.elapsed() > LOG_PAUSE) {
            self.last_told = Some(Instant::now());
            tracing::warn!("the driver's C code: {words}");
        }
    }
}

fn arguments(table: &Description, device: &DeviceConfig) -> Result<OpenArguments, DriverError> {
    let settings = setting_value::read(table, device)?;
    let robot = |cause| DriverError::Robot {
        device: device.name.clone(),
        cause,
    };
    match (&device.robot, table.has_arm) {
        (Some(_), false) => Err(robot("this driver moves no arm: remove `robot`")),
        (None, true) => Err(robot(
            "this driver moves an arm: name its file, for example `robot: robots/lwr4plus.yaml`",
        )),
        (robot, _) => Ok(OpenArguments {
            // A name has no NUL.
            name: CString::new(device.name.as_str()).unwrap_or_default(),
            // At most JOINTS_MAX.
            joints: robot.as_ref().map_or(0, |robot| robot.joints.len() as u32),
            command_timeout_s: device.command_timeout_ns as f64 * 1e-9,
            settings,
            channels: channel_argument::read(table, device)?,
        }),
    }
}

/// Returns the error for what `open` returned: `at` names a setting, a channel, or the robot.
fn refusal(
    table: &Description,
    device: &DeviceConfig,
    result: i32,
    error: &RawError,
) -> DriverError {
    let (at, cause) = error.words();
    let setting = table.settings.iter().find(|row| row.key == at);
    let channel = device.channels.iter().find(|channel| channel.name == at);
    let device = device.name.clone();
    match (result, setting, channel) {
        (REFUSED, Some(row), _) => DriverError::Setting {
            device,
            key: at,
            cause,
            expected: row.expected,
        },
        (REFUSED, None, Some(_)) => DriverError::Channel {
            device,
            channel: at,
            cause,
            expected: table.address,
        },
        (REFUSED, None, None) if at == "robot" => DriverError::Robot {
            device,
            // Once per program, which ends with it.
            cause: cause.leak(),
        },
        _ => DriverError::System {
            device,
            key: setting.map_or("open", |row| row.key),
            value: at,
            source: std::io::Error::other(cause),
        },
    }
}
