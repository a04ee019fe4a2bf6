//! `lying-driver`: the driver of somebody else, made with `rcc-driver-kit`, that answers truly, or as the file `lie` in the
//! cell's runtime folder says. It holds an arm of its own, whose joints are where the last set-point was.
//! The main thread exchanges.

use std::path::PathBuf;
use std::process::ExitCode;
use std::thread::sleep;
use std::time::Duration;
use std::{env, fs};

use rcc_config::DeviceConfig;
use rcc_core::impedance::ControlMode;
use rcc_core::message::{ANALOG_MAX, JOINTS_MAX, Joints};
use rcc_driver_kit::driver::{
    Driver, DriverError, Exchange, Inputs, LinkError, Outputs, PeriodTimer, Settings,
};

/// Longer than `stale_after`, shorter than a supervisor's watchdog.
const SLOW: Duration = Duration::from_millis(700);
const FOR_EVER: Duration = Duration::from_secs(3600);

/// The driver and its arm.
struct LyingDriver {
    timer: PeriodTimer,
    lie: PathBuf,
    position: Joints,
}

impl Driver for LyingDriver {
    fn open(device: &DeviceConfig) -> Result<Self, DriverError> {
        Settings::of(device).finish()?;
        Ok(LyingDriver {
            timer: PeriodTimer::new(Duration::from_millis(4)),
            lie: PathBuf::from(env::var_os("RCC_RUNTIME_DIR").unwrap_or_default()).join("lie"),
            position: [0.0; JOINTS_MAX],
        })
    }

    fn receive(&mut self, timeout: Duration, inputs: &mut Inputs) -> Result<Exchange, LinkError> {
        let ticks = self.timer.wait(timeout)?;
        let lie = self.lie();
        *inputs = Inputs {
            position: self.position,
            digital: 1,
            digital_known: 1,
            analog: [1.0; ANALOG_MAX],
            ..Inputs::NONE
        };
        let mut exchange = Exchange {
            strategy: ControlMode::Position,
            commandable: true,
            startable: true,
            mirror: self.position,
            ticks,
            period_ns: self.timer.period_ns(),
            quality_permille: 1000,
            reason: 0,
            late: 0,
            refused: 0,
        };
        match lie.as_str() {
            "a number out of range" => inputs.analog = [1e6; ANALOG_MAX],
            "no number" => (inputs.analog, inputs.position) = ([f64::NAN; _], [f64::NAN; _]),
            "infinite" => {
                (inputs.analog, inputs.position) = ([f64::INFINITY; _], [f64::INFINITY; _])
            }
            "inputs that it does not have" => (inputs.digital, inputs.digital_known) = (!0, !0),
            "a reason that nobody knows" => exchange.reason = 4_000_000,
            "no hold position" => exchange.mirror = [f64::NAN; JOINTS_MAX],
            "no period" => exchange.period_ns = 0,
            "a period of ages" => exchange.period_ns = u64::MAX,
            "time for ages" => exchange.ticks = u64::MAX,
            "too good" => exchange.quality_permille = 1001,
            "slow" => sleep(SLOW),
            "hangs" => sleep(FOR_EVER),
            "panics" => panic!("it lies that it works"),
            "ends" => std::process::exit(0),
            _ => {}
        }
        Ok(exchange)
    }

    fn send(&mut self, outputs: &Outputs) -> Result<(), LinkError> {
        self.position = outputs.position;
        match self.lie().as_str() {
            "answers slowly" => sleep(SLOW),
            "hangs in its answer" => sleep(FOR_EVER),
            _ => {}
        }
        Ok(())
    }

    fn release(&mut self) {}
}

impl LyingDriver {
    fn lie(&self) -> String {
        fs::read_to_string(&self.lie).unwrap_or_default()
    }
}

fn main() -> ExitCode {
    rcc_driver_kit::program::<LyingDriver>("lying-driver", &[])
}
