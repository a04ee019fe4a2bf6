//! Requests at the control port of the simulated cabinet: one JSON object per line, answered by one JSON object.
//! Parsed by the control port's threads; [`Cabinet::execute`] runs on the clock thread, between two ticks.
//!
//! `{"state":null}` · `{"wrench":{"force":[0,0,15],"torque":[0,0,0]}}` ·
//! `{"wall":{"point":[0,0,0.3],"normal":[0,0,1],"stiffness":5000,"damping":20}}` · `{"wall":null}` · `{"estop":null}` ·
//! `{"load":{"mass":2,"centre":[0,0,0.1]}}` · `{"load":null}` ·
//! `{"ack":null}` · `{"drives":{"on":false}}` · `{"safety":"stop2"}` · `{"mode":"t1"}` · `{"freeze_ms":200}` ·
//! `{"drop":{"percent":10}}` · `{"network":{"to_pc":{"lost":0.1},"from_pc":{"corrupted":0.1}}}` · `{"clear":null}` ·
//! `{"set_io":{"name":"FRI.In_Part","value":1}}` · `{"session":{"open":false}}` · `{"start_motion":null}` ·
//! `{"stop_motion":null}` · `{"motion":{"control":"joint-impedance","overlay":"torque"}}` · `{"reset_statistics":null}` ·
//! `{"trace":{"path":"trace.csv"}}` · `{"trace":null}` · `{"flush":null}` · `{"quit":null}`.
//! `safety` takes normal, stop0, stop1 and stop2; `mode` t1, t2 and aut. `motion` chooses what the next motion is, and may
//! hold `stiffness` (seven numbers, or six: x y z rx ry rz) and `damping`. A trace must be below the folder of the socket,
//! which is also the base of relative paths. `clear` ends every requested fault, and acknowledges. A command without content
//! may also be a bare name, `"state"`. Answers: `{"ok":true}`, `{"error":"…"}`, or the state.

use super::JOINTS;
use super::cabinet::Cabinet;
use super::settings::{ControlSettings, MotionStart, OverlayError, OverlayMode, Selector};
use super::statistics::Snapshot;
use crate::fri_iiwa::wire::{DriveState, Quality, SafetyState, SessionState};
use crate::sim::arm::dynamics::FlangeLoad;
use crate::sim::arm::environment::Wall;
use crate::sim::arm::impedance::{ControlLaw, ImpedanceSettings, RATIO, STIFFNESS, count, kind};
use crate::sim::network::NetworkRates;
use crate::sim::requests::{
    ControlAnswer, DriveSwitch, DropRate, InjectedWrench, RequestError, TraceFile,
};
use crate::sim::robot_snapshot::RobotSnapshot;
use serde::Deserialize;

/// A request at the control port.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CabinetRequest {
    /// Returns the whole state.
    State,
    /// Injects a wrench on the flange, base axes, until the next request.
    Wrench(InjectedWrench),
    /// Replaces or removes the obstacle.
    Wall(Option<Wall>),
    /// Replaces or removes the load at the flange.
    Load(Option<FlangeLoad>),
    /// Presses the emergency stop.
    Estop,
    /// Releases the emergency stop and acknowledges the fault.
    Ack,
    /// Switches the drives on or off.
    Drives(DriveSwitch),
    /// The safety controller stops the robot, or releases it.
    Safety(SafetyRequest),
    /// Turns the selector of operating modes.
    Mode(Selector),
    /// Sends nothing for this number of milliseconds; the cabinet's own time continues.
    FreezeMs(u64),
    /// Drops a share of the client's answers.
    Drop(DropRate),
    /// Loses, delays, duplicates, reorders, truncates and corrupts datagrams, from now on.
    Network(NetworkRates),
    /// Ends all faults that were requested: network, wrench, wall, load, stops, drives.
    Clear,
    /// Sets an input of the station.
    SetIo(SignalValue),
    /// Opens or closes the session.
    Session(SessionSwitch),
    /// The application starts a motion as soon as its conditions hold.
    StartMotion,
    /// The application ends the motion, and starts no other one.
    StopMotion,
    /// Chooses control law and overlay of the next motion.
    Motion(MotionChoice),
    /// Resets counters, faults and extremes.
    ResetStatistics,
    /// Starts a trace into a file, or ends it.
    Trace(Option<TraceFile>),
    /// Waits until the trace has been written to its file.
    Flush,
    /// Ends the application, and the simulator with it.
    Quit,
}

/// State of the safety controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SafetyRequest {
    /// No stop.
    Normal,
    /// Drives off at once.
    Stop0,
    /// Drives off after a ramp.
    Stop1,
    /// At rest, drives on.
    Stop2,
}

/// An input of the station and its new value.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignalValue {
    /// `Group.Name`.
    pub name: String,
    /// 0 or 1, a whole number, or a real one.
    pub value: f64,
}

/// State of the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionSwitch {
    /// The session is open.
    pub open: bool,
}

/// Control law, overlay and springs of the next motion.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionChoice {
    /// Controller of the joints.
    pub control: ControlLaw,
    /// Quantity that the overlay lets the client command.
    pub overlay: OverlayMode,
    /// Stiffness: seven numbers for joints, six for x y z rx ry rz; absent: the usual ones.
    #[serde(default)]
    pub stiffness: Option<Vec<f64>>,
    /// Damping ratio of each spring; absent: 0.7.
    #[serde(default)]
    pub damping: Option<f64>,
}

/// Why springs are refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SpringError {
    /// Another number of springs.
    #[error("{have} numbers as stiffness; this control law has {want} springs")]
    Count {
        /// Springs of the control law.
        want: usize,
        /// Given.
        have: usize,
    },
    /// A stiffness is out of range.
    #[error("stiffness {value} is out of range: {least} to {greatest}")]
    Stiffness {
        /// Given.
        value: f64,
        /// Least.
        least: f64,
        /// Greatest.
        greatest: f64,
    },
    /// A damping ratio is out of range.
    #[error("damping {0} is out of range: 0 to 1")]
    Damping(f64),
}

/// Returns the springs of a control law; without numbers, the usual ones.
///
/// # Errors
/// Returns an error for another number of springs than the law has, or for a number out of range.
pub fn springs(
    law: ControlLaw,
    stiffness: Option<&[f64]>,
    damping: Option<f64>,
) -> Result<ImpedanceSettings, SpringError> {
    let mut impedance = ImpedanceSettings::default_for(law);
    if let Some(stiffness) = stiffness {
        let (want, have) = (count(law), stiffness.len());
        if want != have {
            return Err(SpringError::Count { want, have });
        }
        for (element, &value) in stiffness.iter().enumerate() {
            let [least, greatest] = STIFFNESS[kind(law, element)];
            if !(least..=greatest).contains(&value) {
                return Err(SpringError::Stiffness {
                    value,
                    least,
                    greatest,
                });
            }
            impedance.stiffness[element] = value;
        }
    }
    if let Some(ratio) = damping {
        if !(RATIO[0]..=RATIO[1]).contains(&ratio) {
            return Err(SpringError::Damping(ratio));
        }
        impedance.damping = [ratio; JOINTS];
    }
    Ok(impedance)
}

/// Why a command was refused.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// A reason that all simulated robots have.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// No input of the station has this name, or its type cannot have the value.
    #[error("the station has no input `{name}` that can be {value}")]
    Io {
        /// Requested.
        name: String,
        /// Requested.
        value: f64,
    },
    /// The emergency stop is still pressed.
    #[error("the emergency stop is pressed: send `ack`")]
    EmergencyStop,
    /// A motion runs.
    #[error("a motion runs: send `stop_motion`, and choose when `at_rest` is true")]
    Motion,
    /// The overlay does not fit.
    #[error(transparent)]
    Overlay(#[from] OverlayError),
    /// The springs are out of range.
    #[error(transparent)]
    Springs(#[from] SpringError),
}

impl Cabinet {
    /// Executes a command. Commands about the trace are handled elsewhere and ignored here.
    ///
    /// # Errors
    /// Returns an error for values out of range, or what cannot be done at present; nothing has changed then.
    pub fn execute(
        &mut self,
        request: CabinetRequest,
    ) -> Result<ControlAnswer<Snapshot>, ControlError> {
        match request {
            CabinetRequest::State => {
                return Ok(ControlAnswer::State(Box::new(self.snapshot())));
            }
            CabinetRequest::Wrench(wrench) => self.robot.environment.injected = wrench.elements(),
            CabinetRequest::Wall(wall) => self.robot.set_wall(wall)?,
            CabinetRequest::Load(load) => self.robot.set_load(load)?,
            CabinetRequest::Network(rates) => self.robot.set_network(rates)?,
            CabinetRequest::SetIo(SignalValue { name, value }) => {
                if !self.station.set_input(&name, value) {
                    return Err(ControlError::Io { name, value });
                }
            }
            CabinetRequest::FreezeMs(time_ms) => {
                self.robot
                    .withhold(time_ms as f64 * 1e-3, self.settings.period_s());
            }
            CabinetRequest::Drop(rate) => self.robot.drop_percent = rate.checked()?,
            CabinetRequest::ResetStatistics => self.reset_statistics(),
            CabinetRequest::Trace(_) | CabinetRequest::Flush => {}
            other => self.operate(other)?,
        }
        Ok(ControlAnswer::Done)
    }

    /// Executes what a person does at the pendant, or the application.
    fn operate(&mut self, request: CabinetRequest) -> Result<(), ControlError> {
        match request {
            CabinetRequest::Estop => self.press_emergency_stop(),
            CabinetRequest::Ack if !self.acknowledge() => return Err(RequestError::Moving.into()),
            CabinetRequest::Drives(DriveSwitch { on }) => self.switch_drives(on),
            CabinetRequest::Safety(SafetyRequest::Normal) if self.robot.emergency_stop => {
                return Err(ControlError::EmergencyStop);
            }
            CabinetRequest::Safety(safety) => self.stop_safely(match safety {
                SafetyRequest::Normal => SafetyState::Normal,
                SafetyRequest::Stop0 => SafetyState::Stop0,
                SafetyRequest::Stop1 => SafetyState::Stop1,
                SafetyRequest::Stop2 => SafetyState::Stop2,
            }),
            CabinetRequest::Mode(selector) => self.turn_selector(selector),
            CabinetRequest::Clear => {
                self.robot.clear(&self.settings.robot);
                self.switch_drives(true);
                if !self.acknowledge() {
                    return Err(RequestError::Moving.into());
                }
            }
            CabinetRequest::Session(SessionSwitch { open: true }) => self.open_session(),
            CabinetRequest::Session(SessionSwitch { open: false }) => self.close_session(),
            CabinetRequest::StartMotion => {
                self.motion_wanted = true;
                if self.settings.motion == MotionStart::Manual
                    && self.safety == SafetyState::Normal
                    && self.is_at_rest()
                {
                    self.fault = None;
                }
            }
            CabinetRequest::StopMotion => self.motion_wanted = false,
            CabinetRequest::Motion(choice) => {
                if self.has_motion() || !self.is_at_rest() {
                    return Err(ControlError::Motion);
                }
                let MotionChoice {
                    control: law,
                    overlay,
                    ..
                } = choice;
                overlay.check(law, self.settings.version)?;
                let impedance = springs(law, choice.stiffness.as_deref(), choice.damping)?;
                self.choose(ControlSettings {
                    law,
                    overlay,
                    impedance,
                });
            }
            CabinetRequest::Quit => self.close(),
            _ => {}
        }
        Ok(())
    }

    fn turn_selector(&mut self, selector: Selector) {
        if self.settings.selector != selector && self.has_motion() {
            self.fail(super::fault::CabinetFault::OperatingMode);
        }
        self.settings.selector = selector;
    }

    /// Returns the whole state.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            robot: RobotSnapshot {
                waiting_for: self.wait_reason.map(|reason| reason.to_string()),
                fault: self.fault.map(|fault| fault.to_string()),
                last_refusal: self.last_refusal.as_ref().map(ToString::to_string),
                drives_on: self.drives == DriveState::Active,
                at_rest: self.is_at_rest(),
                ..self.robot.snapshot(self.quality.figures())
            },
            session: session_word(self.session()),
            quality: quality_word(self.quality.quality()),
            control: self.settings.law,
            overlay: self.settings.overlay,
            operation: self.settings.selector,
            safety: match self.safety {
                SafetyState::Normal => "normal",
                SafetyState::Stop0 => "stop0",
                SafetyState::Stop1 => "stop1",
                SafetyState::Stop2 => "stop2",
            },
            drives: match self.drives {
                DriveState::Off => "off",
                DriveState::Transitioning => "transitioning",
                DriveState::Active => "active",
            },
            added: self.robot.impedance.added,
            counts: self.counts,
            io: self.station.states(),
        }
    }
}

fn session_word(session: SessionState) -> &'static str {
    match session {
        SessionState::Idle => "idle",
        SessionState::MonitoringWait => "monitoring-wait",
        SessionState::MonitoringReady => "monitoring-ready",
        SessionState::CommandingWait => "commanding-wait",
        SessionState::CommandingActive => "commanding-active",
    }
}

fn quality_word(quality: Quality) -> &'static str {
    match quality {
        Quality::Poor => "poor",
        Quality::Fair => "fair",
        Quality::Good => "good",
        Quality::Excellent => "excellent",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::iiwa::settings::Settings;
    use crate::sim::requests::to_line;

    fn parse(line: &str) -> CabinetRequest {
        serde_json::from_str(line).unwrap_or_else(|error| panic!("{line}: {error}"))
    }

    #[test]
    fn every_documented_line_is_a_request() {
        let text = include_str!("control.rs");
        let lines: Vec<&str> = text
            .lines()
            .filter_map(|line| line.strip_prefix("//! "))
            .take_while(|line| !line.starts_with("`safety` takes"))
            .flat_map(|line| line.split('`'))
            .filter(|part| part.starts_with('{'))
            .collect();
        assert_eq!(lines.len(), 25, "{lines:?}");
        for line in lines {
            parse(line);
        }
    }

    #[test]
    fn a_value_out_of_range_is_refused_and_changes_nothing() {
        let mut cabinet = Cabinet::new(Settings::default());
        for (line, words) in [
            (r#"{"drop":{"percent":101}}"#, "percentage"),
            (r#"{"set_io":{"name":"FRI.None","value":1}}"#, "FRI.None"),
            (r#"{"network":{"to_pc":{"lost":2}}}"#, "probability"),
            (
                r#"{"motion":{"control":"position","overlay":"torque"}}"#,
                "JointImpedance",
            ),
            (
                r#"{"motion":{"control":"position","overlay":"cartesian-pose"}}"#,
                "FRI 1.x",
            ),
            (
                r#"{"motion":{"control":"joint-impedance","overlay":"torque","stiffness":[1]}}"#,
                "7 springs",
            ),
            (
                r#"{"motion":{"control":"joint-impedance","overlay":"torque","damping":2}}"#,
                "damping 2",
            ),
        ] {
            let refused = cabinet.execute(parse(line)).map(|_| ());
            let text = refused.expect_err(line).to_string();
            assert!(text.contains(words), "{line}: {text}");
        }
        assert_eq!(cabinet.settings, Settings::default());
    }

    #[test]
    fn an_answer_is_one_line() {
        let cabinet = Cabinet::new(Settings::default());
        let state = ControlAnswer::State(Box::new(cabinet.snapshot()));
        let line = to_line(Ok::<_, ControlError>(state));
        assert!(!line.contains('\n') && line.contains("\"session\":\"monitoring-wait\""));
    }
}
