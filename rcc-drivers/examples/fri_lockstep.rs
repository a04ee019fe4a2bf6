//! The FRI drivers and the simulated robots in lock-step, without a clock: each strategy of the LWR, and each overlay of the
//! iiwa in every version, for as many cycles as the first argument says (100,000 by default).
//! `cargo run --release -p rcc-drivers --example fri_lockstep`. Run by the main thread.
//!
//! Every message must be answered that is due, no counter skipped, no answer refused, and no fault raised.

#![deny(clippy::print_stderr)]

use std::error::Error;
use std::path::Path;

use rcc_config::{CellConfig, DeviceConfig};
use rcc_core::impedance::{ControlMode, Impedance};
use rcc_core::message::JOINTS_MAX;
use rcc_driver_kit::driver::{Exchange, Inputs, Outputs};
use rcc_drivers::drivers::fri_iiwa::session::{IiwaSession, SessionSettings as IiwaSettings};
use rcc_drivers::drivers::fri_lwr::fri_session::{FriSession, SessionSettings as LwrSettings};
use rcc_drivers::fri_iiwa::wire::{Quality, Version};
use rcc_drivers::sim::arm::impedance::{ControlLaw, ImpedanceSettings};
use rcc_drivers::sim::iiwa::cabinet::Cabinet;
use rcc_drivers::sim::iiwa::settings::{OverlayMode, Settings as CabinetSettings};
use rcc_drivers::sim::lwr::krc::Krc;
use rcc_drivers::sim::lwr::settings::{KrlProgram, Settings as KrcSettings};

/// Amplitude (rad) and angular frequency (rad/s) of the commanded motion.
const AMPLITUDE: f64 = 0.1;
const RATE: f64 = 2.0;
/// Cycles until commands must be executed.
const ENTRY: u64 = 400;

type Done = Result<(), Box<dyn Error>>;

/// Commands of the driver in one run: a motion that begins at rest where the robot holds the arm, and forces.
struct Commands {
    origin: Option<[f64; JOINTS_MAX]>,
    time_s: f64,
    step_s: f64,
}

impl Commands {
    fn every(step_s: f64) -> Self {
        Self {
            origin: None,
            time_s: 0.0,
            step_s,
        }
    }

    fn next(&mut self, exchange: &Exchange) -> Outputs {
        if !exchange.commandable {
            return Outputs {
                position: exchange.mirror,
                ..Outputs::NONE
            };
        }
        let origin = *self.origin.get_or_insert(exchange.mirror);
        self.time_s += self.step_s;
        let moved = AMPLITUDE * (1.0 - (RATE * self.time_s).cos());
        let mut position = origin;
        for joint in position.iter_mut().take(7) {
            *joint += moved;
        }
        let mut impedance = Impedance {
            strategy: exchange.strategy as u64,
            ..Impedance::NONE
        };
        if exchange.strategy != ControlMode::Position {
            let stiffness = match exchange.strategy {
                ControlMode::CartesianImpedance => {
                    [2000.0, 2000.0, 2000.0, 200.0, 200.0, 200.0, 0.0, 0.0]
                }
                _ => [1000.0; JOINTS_MAX],
            };
            impedance.stiffness = stiffness;
            impedance.damping = [0.7; JOINTS_MAX];
            impedance.added[0] = 2.0 * (RATE * self.time_s).sin();
        }
        Outputs {
            position,
            impedance,
            ..Outputs::NONE
        }
    }
}

fn device(cell: &str) -> Result<DeviceConfig, Box<dyn Error>> {
    let path = format!("{}/../configs/cells/{cell}", env!("CARGO_MANIFEST_DIR"));
    let mut cell =
        CellConfig::load_offline(Path::new(&path)).map_err(|faults| faults.to_string())?;
    let mut device = cell.devices.remove(0);
    device.channels.clear();
    Ok(device)
}

fn fails(what: String) -> Done {
    Err(what.into())
}

/// Runs one strategy of the LWR.
fn lwr(law: ControlLaw, cycles: u64) -> Done {
    let settings = KrcSettings {
        strategy: law,
        script: KrlProgram::Auto,
        ..KrcSettings::default()
    };
    let mut commands = Commands::every(settings.period_s);
    let mut krc = Krc::new(settings);
    let mut session = FriSession::new(&device("lwr.yaml")?, LwrSettings::default())?;
    let mut inputs = Inputs::NONE;
    for cycle in 0..cycles {
        let Some(bytes) = krc.tick(1) else {
            return fails(format!("{law:?}: nothing was sent in cycle {cycle}"));
        };
        if !session.accept(&bytes) {
            return fails(format!("{law:?}: cycle {cycle} was not accepted"));
        }
        let exchange = session.exchange(&mut inputs);
        let answer = session.answer(&commands.next(&exchange));
        krc.receive(&answer, 1e-4)?;
        if cycle > ENTRY && !exchange.commandable {
            return fails(format!(
                "{law:?}: cycle {cycle}: {:?}",
                krc.snapshot().robot.faults
            ));
        }
    }
    let state = krc.snapshot();
    let counts = state.counts;
    if (counts.missed, counts.faults, counts.refused) != (0, 0, 0) {
        return fails(format!("{law:?}: {counts:?} {:?}", state.robot.faults));
    }
    println!(
        "lwr  {law:?}: {} answered, {} entry",
        counts.answered, counts.entries
    );
    Ok(())
}

/// Runs one overlay of the iiwa.
fn iiwa(version: Version, overlay: OverlayMode, multiplier: u32, cycles: u64) -> Done {
    let law = overlay.needed_law().unwrap_or(ControlLaw::Position);
    let settings = CabinetSettings {
        version,
        overlay,
        law,
        multiplier,
        impedance: ImpedanceSettings::default_for(law),
        ..CabinetSettings::default()
    };
    let name = format!("{version:?} {overlay:?} × {multiplier}");
    let mut commands = Commands::every(settings.period_s());
    let mut cabinet = Cabinet::new(settings);
    let session_settings = IiwaSettings {
        version,
        quality_min: Quality::Good,
    };
    let mut session = IiwaSession::new(&device("iiwa-impedance.yaml")?, session_settings)?;
    let mut inputs = Inputs::NONE;
    let entry = ENTRY * u64::from(multiplier);
    for cycle in 0..cycles + entry {
        let before = cabinet.sequence();
        let Some(bytes) = cabinet.tick(1) else {
            return fails(format!("{name}: nothing was sent in cycle {cycle}"));
        };
        if cabinet.sequence() != before.wrapping_add(1) {
            return fails(format!("{name}: counters were skipped in cycle {cycle}"));
        }
        if let Err(refusal) = session.accept(&bytes) {
            return fails(format!("{name}: cycle {cycle}: {refusal}"));
        }
        let exchange = session.exchange(&mut inputs);
        if let Some(answer) = session.answer(&commands.next(&exchange)) {
            cabinet.receive(&answer, 1e-4)?;
        }
        if cycle > entry && !exchange.startable {
            let faults = cabinet.snapshot().robot.faults;
            return fails(format!(
                "{name}: cycle {cycle}: reason {} {faults:?}",
                exchange.reason
            ));
        }
    }
    let state = cabinet.snapshot();
    let counts = state.counts;
    if (counts.missed, counts.faults, counts.refused) != (0, 0, 0) {
        return fails(format!("{name}: {counts:?} {:?}", state.robot.faults));
    }
    println!(
        "iiwa {name}: {} answered, {} entry",
        counts.answered, counts.entries
    );
    Ok(())
}

fn main() -> Done {
    let cycles = std::env::args()
        .nth(1)
        .map(|text| text.parse())
        .transpose()?;
    let cycles: u64 = cycles.unwrap_or(100_000);
    for law in [
        ControlLaw::Position,
        ControlLaw::CartesianImpedance,
        ControlLaw::JointImpedance,
    ] {
        lwr(law, cycles)?;
    }
    for version in [Version::V1_11, Version::V1_14, Version::V2_5, Version::V2_7] {
        for overlay in [
            OverlayMode::Position,
            OverlayMode::Wrench,
            OverlayMode::Torque,
            OverlayMode::CartesianPose,
        ] {
            if overlay == OverlayMode::CartesianPose && !version.is_second() {
                continue;
            }
            for multiplier in [1, 5] {
                iiwa(version, overlay, multiplier, cycles)?;
            }
        }
    }
    Ok(())
}
