//! The command line of `lwr-sim`. Thresholds that KUKA does not publish are our own, and marked as such.
//! Read once, by the main thread.

use super::settings::{Acknowledge, EntryQuality, KrlLoopback, KrlProgram, Settings};
use super::{JOINTS, Joints};
use crate::sim::arm::command_stream::SupervisedLimits;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::number_list::NumberList;
use crate::sim::robot_options::{RobotOptionError, RobotOptions, check_ranges};
use clap::Parser;
use std::str::FromStr;

/// A simulated controller (KRC) of a KUKA LWR 4+: speaks FRI 1.0 over UDP, sends first, and moves a simulated arm.
#[derive(Clone, Debug, Parser)]
#[command(name = "lwr-sim", version = rcc_protocol::version::version())]
pub struct Options {
    /// What every simulated arm has.
    #[command(flatten)]
    pub robot: RobotOptions,
    /// Period of both directions, ms (KUKA: 1 to 100)
    #[arg(long, value_name = "MS", default_value_t = 1.0)]
    pub period_ms: f64,
    /// How the KRL program enters command mode: with first-app (KUKA's samples) the PC writes `$FRI_FRM_INT[1]`, 1 and 10
    /// request it, 0 and 2 end it; with stanford `$FRI_FRM_INT[16]`, 10 and 20; with centro `$FRI_FRM_INT[2]`, 1 and 0;
    /// with auto it begins as soon as its conditions hold
    #[arg(long, value_enum, default_value = "first-app")]
    pub krl: KrlProgram,
    /// Quality that the KRL program waits for before it enters command mode
    #[arg(long, value_enum, default_value = "ok")]
    pub entry_quality: EntryQuality,
    /// Control strategy that the KRL program has chosen, `$STIFFNESS.STRATEGY` 10, 20 or 30: under impedance control
    /// the arm yields; what the command flags leave out is taken from `$STIFFNESS`. The PC may choose another one in
    /// monitor mode (INT[2], INT[15] or INT[1] in the order of --krl), and so may the control port
    #[arg(long, value_enum, default_value = "position")]
    pub strategy: ControlLaw,
    /// Who acknowledges a fault: the KRL program once the arm has been at rest for 0.5 s and the PC mirrors, or the
    /// control port (the 0.5 s are our own value)
    #[arg(long, value_enum, default_value = "auto")]
    pub ack: Acknowledge,
    /// Supervised positions, ±degrees (values that users read from a controller's files)
    #[arg(
        long,
        value_name = "J1,…,J7",
        default_value = "170,120,170,120,170,120,170"
    )]
    pub position_limits: NumberList<JOINTS>,
    /// Supervised velocities, degrees/s (values that users read from a controller's files)
    #[arg(
        long,
        value_name = "J1,…,J7",
        default_value = "120,120,160,160,250,220,220"
    )]
    pub velocity_limits: NumberList<JOINTS>,
    /// Supervised accelerations, degrees/s² (values that users read from a controller's files)
    #[arg(
        long,
        value_name = "J1,…,J7",
        default_value = "1200,1200,1600,1600,2500,4400,4400"
    )]
    pub acceleration_limits: NumberList<JOINTS>,
    /// Factor on the supervised velocities and accelerations, above 0 up to 1
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    pub safety_limits: f64,
    /// Loops `$FRI_FRM_BOOL[FROM]` back to `$FRI_TO_BOOL[TO]`
    #[arg(long, value_name = "FROM=TO")]
    pub wire_bool: Vec<KrlLoopback>,
    /// Loops `$FRI_FRM_REA[FROM]` back to `$FRI_TO_REA[TO]`
    #[arg(long, value_name = "FROM=TO")]
    pub wire_real: Vec<KrlLoopback>,
}

/// Why an option is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OptionError {
    /// An invalid loopback.
    #[error("invalid loopback `{0}`: write FROM=TO with numbers from 1 to 16")]
    Wire(String),
    /// An option that every simulated arm has.
    #[error(transparent)]
    Robot(#[from] RobotOptionError),
}

impl FromStr for KrlLoopback {
    type Err = OptionError;

    fn from_str(text: &str) -> Result<Self, OptionError> {
        let number = |part: &str| {
            part.trim()
                .parse()
                .ok()
                .filter(|number| (1..=16).contains(number))
        };
        text.split_once('=')
            .and_then(|(from, to)| {
                Some(Self {
                    from: number(from)?,
                    to: number(to)?,
                })
            })
            .ok_or_else(|| OptionError::Wire(text.to_owned()))
    }
}

impl Options {
    /// Returns the controller's settings.
    ///
    /// # Errors
    /// Returns an error for the first number that is out of range.
    pub fn settings(&self) -> Result<Settings, OptionError> {
        let (period, safety) = (self.period_ms, self.safety_limits);
        check_ranges([
            (
                "period-ms",
                period,
                "from 1 to 100",
                (1.0..=100.0).contains(&period),
            ),
            (
                "safety-limits",
                safety,
                "above 0 and at most 1",
                safety > 0.0 && safety <= 1.0,
            ),
        ])?;
        Ok(Settings {
            period_s: period * 1e-3,
            script: self.krl,
            entry_quality: self.entry_quality,
            strategy: self.strategy,
            acknowledge: self.ack,
            safety_limits: safety,
            boolean_wires: self.wire_bool.clone(),
            real_wires: self.wire_real.clone(),
            robot: self.robot.settings(self.limits())?,
        })
    }

    fn limits(&self) -> SupervisedLimits {
        let radians = |numbers: &NumberList<JOINTS>| -> Joints { numbers.0.map(f64::to_radians) };
        SupervisedLimits {
            position: radians(&self.position_limits),
            velocity: radians(&self.velocity_limits),
            acceleration: radians(&self.acceleration_limits),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::number_list::ListError;

    fn parsed(arguments: &[&str]) -> Options {
        let fixed = ["lwr-sim", "--driver", "127.0.0.1:1"];
        Options::try_parse_from(fixed.iter().chain(arguments)).unwrap()
    }

    #[test]
    fn without_options_the_settings_are_the_documented_defaults() {
        assert_eq!(parsed(&[]).settings(), Ok(Settings::default()));
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_its_option() {
        for (arguments, part) in [
            (["--period-ms", "0.5"], "period-ms"),
            (["--safety-limits", "0"], "safety-limits"),
            (["--bandwidth", "nan"], "bandwidth"),
            (["--acceleration-filter-ms", "nan"], "acceleration-filter"),
            (["--start", "0,0,0,-3,0,0,0"], "joint 4"),
            (["--wall", "0,0,0,0,0,0,1,1"], "normal"),
        ] {
            let error = parsed(&arguments).settings().unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn a_list_of_the_wrong_length_and_a_wire_out_of_range_are_refused() {
        assert_eq!(
            "1,2".parse::<NumberList<3>>(),
            Err(ListError::Count { want: 3, have: 2 })
        );
        assert_eq!(
            "1,inf,2".parse::<NumberList<3>>(),
            Err(ListError::Number("inf".into()))
        );
        assert_eq!(
            "1=17".parse::<KrlLoopback>(),
            Err(OptionError::Wire("1=17".into()))
        );
        assert_eq!(
            "3=4".parse::<KrlLoopback>(),
            Ok(KrlLoopback { from: 3, to: 4 })
        );
    }
}
