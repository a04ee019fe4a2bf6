//! Measures typical nets and writes docs/performance-nets.md: `cargo run --release -p rcc-bench --example nets`. One
//! thread; subjects that are compared are measured in turns in one run.

mod fragment;
mod load;
mod predecessor;
mod reading;
#[path = "../performance/table.rs"]
mod table;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use rcc_bench::measure::Effort;
use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::message::{Joints, Measurement};
use rcc_engine::net::{Evaluation, Net};

/// Many short stretches: on a busy machine some of them fall between two disturbances.
const EFFORT: Effort = Effort {
    rounds: 9,
    stretches: 15,
    stretch: Duration::from_millis(1),
};
/// Period of all nets, s.
const PERIOD_S: f64 = 1e-3;

fn main() -> Result<(), Box<dyn Error>> {
    let head = head()?;
    let sections = [
        load::section()?,
        fragment::section()?,
        reading::section()?,
        predecessor::section()?,
    ];
    let text = format!("{head}\n{}", sections.join("\n"));
    let output = root().join("docs/performance-nets.md");
    std::fs::write(&output, text)?;
    eprintln!("nets: wrote {}", output.display());
    Ok(())
}

fn head() -> Result<String, Box<dyn Error>> {
    let print = |program: &str, arguments: &[&str]| -> Result<String, Box<dyn Error>> {
        let output = Command::new(program).args(arguments).output()?;
        Ok(String::from_utf8(output.stdout)?.trim().to_owned())
    };
    let load = std::fs::read_to_string("/proc/loadavg")?;
    Ok(format!(
        "# Performance of nets\n\n\
         Made by a program; do not edit: `cargo run --release -p rcc-bench --example nets`. [performance.md](performance.md) has the \
         interpreter, whole cycles and each primitive.\n\n\
         {}, commit {}, {}; load average when it began: {}. With a load above the number of cores other programs ran meanwhile: \
         only ratios within a table count then. ns are medians of {} rounds of {} stretches of {} ms, in turns, hot.\n",
        print("date", &["-u", "+%F %H:%M UTC"])?,
        print("git", &["rev-parse", "--short", "HEAD"])?,
        print("rustc", &["--version"])?,
        load.split(' ').next().unwrap_or("unknown"),
        EFFORT.rounds,
        EFFORT.stretches,
        EFFORT.stretch.as_millis(),
    ))
}

/// Returns the root folder of the repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A running net, and the devices that it sees.
struct RunningNet {
    net: Box<Net>,
    models: Vec<DeviceModel>,
    devices: Vec<DeviceInput>,
}

impl RunningNet {
    /// Runs one cycle, with the arm where it was commanded to be. Restarts the net at its end.
    fn step(&mut self) {
        if self.net.evaluate(&self.models, &self.devices, PERIOD_S) != Evaluation::Running {
            self.net.reset();
        }
    }
}

/// Returns devices that are present, with all digital inputs known, and arms at rest at `hold`.
fn devices(models: &[DeviceModel], hold: Joints) -> Vec<DeviceInput> {
    let measured = |model: &DeviceModel| {
        let mut measurement: Measurement = bytemuck::Zeroable::zeroed();
        measurement.digital_known = u64::MAX;
        if model.arm.is_some() {
            measurement.joints = model.joints;
            measurement.position = hold;
            measurement.hold = hold;
        }
        DeviceInput {
            present: true,
            measurement,
        }
    };
    models.iter().map(measured).collect()
}
