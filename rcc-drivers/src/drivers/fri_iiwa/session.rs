//! The FRI dialogue with the robot, message by message: counters, session states, mirroring, inputs and outputs.
//! Pure, without clock or socket; run by the host's thread.
//!
//! Before the robot executes commands, and in the first cycles in which it does, every answer repeats (mirrors) the
//! robot's own position: otherwise it aborts the motion.

use rcc_config::DeviceConfig;
use rcc_core::impedance::{ControlMode, Impedance};
use rcc_core::message::{JOINTS_MAX, Joints};

use super::overlay::OverlayEncoder;
use super::robot_state::refusal;
pub use super::robot_state::{Refusal, RobotState};
use super::robot_values::RobotValues;
use super::station_io::StationIo;
use super::{
    COMMAND_MODE, DRIVES_OFF, ENTERING, IDLE, MONITORING, QUALITY, REJOINED, SPRINGS, STATION_IO,
};
use crate::fri_iiwa::wire::schema::{Command, CommandData, Header, Monitoring};
use crate::fri_iiwa::wire::{
    COMMAND_ID, JOINTS, Quality, SafetyState, SessionState, Version, decode, encode,
};
use rcc_driver_kit::driver::{DriverError, Exchange, Inputs, Outputs};

/// Number of cycles in which commands are executed and the driver still mirrors.
const ENTRY_CYCLES: u32 = 3;
/// After this number of consecutive out-of-order datagrams, the robot's counter is taken as restarted.
const RESTART_DATAGRAMS: u32 = 10;
/// A larger gap in the counters must be confirmed by the next datagram.
const GAP_MAX: u32 = 10;
/// Largest change of the robot's own position while commanding begins, rad.
const STILL_RAD: f64 = 1e-5;
/// Largest change of the robot's own position between a doubtful datagram and the one that confirms it, rad.
const NEAR_RAD: f64 = 0.01;

/// Settings of a device for the dialogue.
#[derive(Clone, Copy, Debug)]
pub struct SessionSettings {
    /// Version of the wire.
    pub version: Version,
    /// Lowest connection quality at which a net may start.
    pub quality_min: Quality,
}

/// State of the FRI dialogue with one robot.
#[derive(Clone, Debug)]
pub struct IiwaSession {
    settings: SessionSettings,
    io: StationIo,
    values: RobotValues,
    overlay: OverlayEncoder,
    robot: Option<RobotState>,
    out_of_order: u32,
    ticks: u64,
    /// Messages since the last answer.
    received: u32,
    own_sequence: u32,
    /// Number of consecutive messages while commands are executed.
    commanding: u32,
    /// The position of the last answer since the robot began to command, rad.
    sent: Option<Joints>,
    releasing: bool,
    refused: u64,
    /// A message that contradicts the present state; accepted once the next one confirms it.
    unconfirmed: Option<RobotState>,
}

impl IiwaSession {
    /// A session without any message yet.
    ///
    /// # Errors
    /// Returns an error if the device's robot does not have 7 joints, or for a channel that is neither an input nor an
    /// output of a station.
    pub fn new(device: &DeviceConfig, settings: SessionSettings) -> Result<Self, DriverError> {
        if device.robot.as_ref().map(|robot| robot.joints.len()) != Some(JOINTS) {
            return Err(DriverError::Robot {
                device: device.name.clone(),
                cause: "the iiwa has 7 joints: name a robot file with 7, such as robots/iiwa7.yaml",
            });
        }
        Ok(Self {
            settings,
            io: StationIo::new(device, settings.version.has_io())?,
            values: RobotValues::new(device),
            overlay: OverlayEncoder::of(device),
            robot: None,
            out_of_order: 0,
            ticks: 0,
            received: 0,
            own_sequence: 0,
            commanding: 0,
            sent: None,
            releasing: false,
            refused: 0,
            unconfirmed: None,
        })
    }

    /// Processes a message of the robot.
    ///
    /// # Errors
    /// Returns why it is refused: not a message of this version, out of order, not finite, or doubtful.
    pub fn accept(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        let result = self.accept_or_refuse(bytes);
        self.refused += u64::from(result.is_err());
        result
    }

    fn accept_or_refuse(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        let message: Monitoring =
            decode(self.settings.version, bytes).map_err(|error| Refusal {
                wire: Some(error),
                cause: "",
            })?;
        let state = RobotState::of(&message)?;
        let last = self.robot.as_ref();
        let ticks = last.map_or(1, |last| state.sequence.wrapping_sub(last.sequence));
        if ticks == 0 || ticks > u32::MAX / 2 {
            self.out_of_order += 1;
            if self.out_of_order < RESTART_DATAGRAMS {
                return Err(refusal("the counter does not increase"));
            }
            self.reset();
        }
        if let Some(implausibility) = self.implausibility_of(&state, ticks)
            && !self.is_confirmed_by(&state)
        {
            self.unconfirmed = Some(state);
            return Err(refusal(implausibility));
        }
        self.unconfirmed = None;
        self.out_of_order = 0;
        self.ticks += if self.robot.is_some() {
            u64::from(ticks)
        } else {
            1
        };
        self.received = self.received.saturating_add(1);
        self.io
            .read(message.data.as_ref().map_or(&[], |data| &data.io));
        self.commanding = match state.session {
            SessionState::CommandingActive => self.commanding.saturating_add(1),
            _ => 0,
        };
        if state.session < SessionState::CommandingWait {
            self.sent = None;
        }
        self.overlay.observe(&state);
        self.robot = Some(state);
        Ok(())
    }

    /// Returns why a message must be confirmed by the next one: until 2.5, FRI has no checksum, and while commands are
    /// executed a single message must not end that.
    fn implausibility_of(&self, state: &RobotState, ticks: u32) -> Option<&'static str> {
        let last = self.robot.as_ref()?;
        if last.session != SessionState::CommandingActive {
            return None;
        }
        let mirrored = self.commanding <= ENTRY_CYCLES;
        match () {
            () if ticks > GAP_MAX => Some("many counters were skipped"),
            () if mirrored && last.session == state.session && !state.is_near(last, STILL_RAD) => {
                Some("the robot's own position jumped while it was mirrored")
            }
            () => state.changed(last),
        }
    }

    fn is_confirmed_by(&self, state: &RobotState) -> bool {
        self.unconfirmed.as_ref().is_some_and(|unconfirmed| {
            let ticks = state.sequence.wrapping_sub(unconfirmed.sequence);
            state.changed(unconfirmed).is_none()
                && (1..=GAP_MAX).contains(&ticks)
                && state.is_near(unconfirmed, NEAR_RAD)
        })
    }

    /// Returns what the last accepted message says; `None` before the first one and after a silence.
    #[must_use]
    pub fn state(&self) -> Option<&RobotState> {
        self.robot.as_ref()
    }

    /// Returns the first channel that the robot does not list.
    #[must_use]
    pub fn missing_io(&self) -> Option<&str> {
        self.io.missing()
    }

    /// Counts a datagram that does not come from the robot.
    pub fn refuse(&mut self) {
        self.refused += 1;
    }

    /// Resets the session after a silence: the next message may have any counter.
    pub fn reset(&mut self) {
        self.robot = None;
        self.out_of_order = 0;
        self.commanding = 0;
        self.received = 0;
        self.sent = None;
        self.unconfirmed = None;
    }

    /// Stops commanding: FRI knows no request for it, so answers without a position end the motion.
    pub fn release(&mut self) {
        self.releasing = true;
    }

    /// Copies the newest measurement to `inputs` and returns the status of the exchange.
    pub fn exchange(&mut self, inputs: &mut Inputs) -> Exchange {
        self.io.fill(inputs);
        self.values.fill(self.robot.as_ref(), inputs);
        let reason = self.reason();
        let commandable = self.is_commandable();
        let robot = self.robot.as_ref();
        if let Some(robot) = robot {
            inputs.position = robot.measured;
            inputs.torque = robot.torque;
            inputs.external_torque = robot.external_torque;
            inputs.wrench = self.overlay.turn(robot.wrench);
        }
        Exchange {
            commandable,
            startable: commandable && reason == 0,
            strategy: self.strategy(),
            mirror: self.held(),
            ticks: std::mem::take(&mut self.ticks).max(1),
            period_ns: robot.map_or(1_000_000, |robot| robot.period_ns),
            quality_permille: robot
                .map_or(0, |robot| [0, 333, 667, 1000][robot.quality as usize % 4]),
            reason,
            late: 0,
            refused: self.refused,
        }
    }

    /// Returns the answer to the last message; `None` if none is due: in the state idle, between the messages that the
    /// receive multiplier counts, and in the middle of a motion that this session did not begin.
    pub fn answer(&mut self, outputs: &Outputs) -> Option<Vec<u8>> {
        let robot = self.robot.as_ref()?;
        let idle = robot.session == SessionState::Idle;
        if idle || self.received < robot.multiplier || self.has_rejoined(robot) {
            return None;
        }
        let position = self.commanded_position(robot, outputs);
        let data = self.command(robot, position.as_ref(), outputs);
        let header = Header {
            identifier: Some(COMMAND_ID),
            sequence: Some(self.own_sequence),
            reflected: Some(robot.sequence),
        };
        if robot.session >= SessionState::CommandingWait {
            self.sent = position;
        }
        let answer = Command {
            header: Some(header),
            data: (data != CommandData::default()).then_some(data),
            end: None,
        };
        self.own_sequence = self.own_sequence.wrapping_add(1);
        self.received = 0;
        encode(self.settings.version, &answer).ok()
    }

    /// Returns the set-point while the robot can be commanded, else the position at which it holds; `None` if the answer
    /// has none.
    fn commanded_position(&self, robot: &RobotState, outputs: &Outputs) -> Option<Joints> {
        let commands = robot.session >= SessionState::CommandingWait;
        // 2.x expects a header alone before the robot commands.
        if self.releasing || (!commands && self.settings.version.is_second()) {
            return None;
        }
        let finite = outputs.position.iter().all(|q| q.is_finite());
        Some(match self.is_commandable() && finite {
            true => outputs.position,
            false => self.held(),
        })
    }

    /// Returns the content of an answer: what the robot wants beside or instead of the position; zeros until it can be
    /// commanded.
    fn command(
        &self,
        robot: &RobotState,
        position: Option<&Joints>,
        outputs: &Outputs,
    ) -> CommandData {
        let mut data = CommandData {
            io: self.io.write(outputs),
            ..CommandData::default()
        };
        let Some(position) = position else {
            return data;
        };
        let commanded = self.is_commandable()
            && outputs.impedance.strategy == self.strategy() as u64
            && outputs
                .impedance
                .added
                .iter()
                .all(|value| value.is_finite());
        let added = match commanded {
            true => outputs.impedance.added,
            false => Impedance::NONE.added,
        };
        self.overlay.fill(robot, (position, &added), &mut data);
        data
    }

    /// Returns true in the middle of a motion of which this session did not mirror the beginning, after a restart of the
    /// driver or a silence. Any position would be a jolt then; without an answer the robot brakes by its own ramp.
    fn has_rejoined(&self, robot: &RobotState) -> bool {
        robot.session == SessionState::CommandingActive && self.sent.is_none()
    }

    /// Returns the position at which the robot holds the joints, rad. The interpolated position leaves out what FRI
    /// adds: it is where the arm is until the first command only.
    fn held(&self) -> Joints {
        let Some(robot) = &self.robot else {
            return [0.0; JOINTS_MAX];
        };
        let own = match robot.session {
            SessionState::CommandingWait => robot.interpolated,
            SessionState::CommandingActive => self.sent,
            _ => None,
        };
        own.or(robot.commanded).unwrap_or(robot.measured)
    }

    /// Returns the control mode in which the robot takes set-points; position control before there is a motion.
    fn strategy(&self) -> ControlMode {
        let commanded = self
            .robot
            .as_ref()
            .and_then(|robot| self.overlay.mode(robot));
        commanded.unwrap_or(ControlMode::Position)
    }

    fn is_commandable(&self) -> bool {
        let able = |robot: &RobotState| {
            !self.has_rejoined(robot) && robot.has_power() && self.overlay.mode(robot).is_some()
        };
        !self.releasing && self.commanding > ENTRY_CYCLES && self.robot.as_ref().is_some_and(able)
    }

    fn reason(&self) -> u32 {
        let Some(robot) = &self.robot else {
            return IDLE;
        };
        match () {
            () if robot.session == SessionState::Idle => IDLE,
            () if robot.safety != SafetyState::Normal as i32 => DRIVES_OFF,
            () if robot.quality < self.settings.quality_min => QUALITY,
            () if robot.session < SessionState::CommandingWait => MONITORING,
            () if !robot.drives_active() => DRIVES_OFF,
            () if self.overlay.lacks_springs(robot) => SPRINGS,
            () if self.overlay.mode(robot).is_none() => COMMAND_MODE,
            () if self.has_rejoined(robot) => REJOINED,
            () if self.commanding <= ENTRY_CYCLES => ENTERING,
            () if self.io.missing().is_some() => STATION_IO,
            () => 0,
        }
    }
}
