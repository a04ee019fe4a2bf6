//! The FRI dialogue with the robot, message by message: counters, session states, mirroring, inputs and outputs.
//! Pure, without clock or socket; run by the host's thread.
//!
//! Before the robot executes commands, and in the first cycles in which it does, every answer repeats (mirrors) the
//! robot's own position: otherwise it aborts the motion.

use std::fmt;

use rcc_config::DeviceConfig;
use rcc_core::impedance::ControlMode;
use rcc_core::message::{JOINTS_MAX, Joints};

use super::station_io::StationIo;
use super::{COMMAND_MODE, DRIVES_OFF, ENTERING, IDLE, MONITORING, QUALITY, REJOINED, STATION_IO};
use crate::driver::{DriverError, Exchange, Inputs, Outputs};
use crate::fri_iiwa::wire::schema::{
    CartesianVector, Command, CommandData, Header, JointValues, Monitoring, Redundancy,
    Transformation,
};
use crate::fri_iiwa::wire::{
    COMMAND_ID, ClientCommandMode, DriveState, JOINTS, Quality, SafetyState, SessionState, Version,
    WireError, decode, encode,
};

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

/// What a device's settings say about the dialogue.
#[derive(Clone, Copy, Debug)]
pub struct SessionSettings {
    /// Version of the wire.
    pub version: Version,
    /// Lowest connection quality at which a net may start.
    pub quality_min: Quality,
}

/// Why a datagram is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// The bytes are not the expected message.
    pub wire: Option<WireError>,
    /// Otherwise, what is wrong in the message.
    pub cause: &'static str,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.wire {
            Some(error) => error.fmt(f),
            None => f.write_str(self.cause),
        }
    }
}

fn refusal(cause: &'static str) -> Refusal {
    Refusal { wire: None, cause }
}

/// What one message says. Enumerations that only people read are as on the wire; -1 = missing.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotState {
    sequence: u32,
    /// State of the session.
    pub session: SessionState,
    /// Rating of the connection.
    pub quality: Quality,
    /// State of the safety controller.
    pub safety: i32,
    /// Operating mode.
    pub operation: i32,
    /// Controller of the joints.
    pub control: i32,
    /// What the motion's overlay lets a client command.
    pub command_mode: i32,
    drives_active: bool,
    period_ns: u64,
    multiplier: u32,
    measured: Joints,
    torque: Joints,
    external_torque: Joints,
    wrench: [f64; 6],
    /// 1.x.
    commanded: Option<Joints>,
    /// The robot's own position, without the client's overlay: only while it commands.
    interpolated: Option<Joints>,
    pose: Option<Transformation>,
    redundancy: Option<Redundancy>,
}

impl RobotState {
    fn of(message: &Monitoring) -> Result<Self, Refusal> {
        let connection = message
            .connection
            .ok_or(refusal("`connection` is missing"))?;
        let session = connection.session.and_then(SessionState::from_wire);
        let session = session.ok_or(refusal("unknown session state"))?;
        let quality = connection.quality.and_then(Quality::from_wire);
        let quality = quality.ok_or(refusal("unknown quality"))?;
        let period_ms = connection
            .send_period_ms
            .filter(|ms| (1..=100).contains(ms));
        let period_ms = period_ms.ok_or(refusal("the send period is not from 1 to 100 ms"))?;
        let data = message.data.as_ref();
        let data = data.ok_or(refusal("the measured values are missing"))?;
        let measured = joints(data.measured_position.as_ref())?;
        let measured = measured.ok_or(refusal("the measured position is missing"))?;
        let ipo = message.interpolator.as_ref();
        let interpolated = joints(ipo.and_then(|ipo| ipo.position.as_ref()))?;
        if session >= SessionState::CommandingWait && interpolated.is_none() {
            return Err(refusal("the interpolated position is missing"));
        }
        let robot = message.robot.as_ref();
        let unknown = [f64::NAN; JOINTS_MAX];
        let word = |value: Option<i32>| value.unwrap_or(-1);
        Ok(Self {
            sequence: message
                .header
                .and_then(|header| header.sequence)
                .unwrap_or(0),
            session,
            quality,
            safety: word(robot.and_then(|robot| robot.safety)),
            operation: word(robot.and_then(|robot| robot.operation)),
            control: word(robot.and_then(|robot| robot.control)),
            command_mode: word(ipo.and_then(|ipo| ipo.command_mode)),
            drives_active: robot.is_some_and(|robot| {
                let active = DriveState::Active as i32;
                robot.drives.len() == JOINTS && robot.drives.iter().all(|drive| *drive == active)
            }),
            period_ns: u64::from(period_ms) * 1_000_000,
            multiplier: connection.receive_multiplier.unwrap_or(1).max(1),
            measured,
            torque: joints(data.measured_torque.as_ref())?.unwrap_or(unknown),
            external_torque: joints(data.external_torque.as_ref())?.unwrap_or(unknown),
            wrench: wrench(data.external_force.as_ref())?,
            commanded: joints(data.commanded_position.as_ref())?,
            interpolated,
            pose: ipo.and_then(|ipo| ipo.pose.clone()),
            redundancy: ipo.and_then(|ipo| ipo.redundancy),
        })
    }

    fn has_power(&self) -> bool {
        self.safety == SafetyState::Normal as i32 && self.drives_active
    }

    /// Returns what differs from another message of the same session although it rarely changes.
    fn changed(&self, other: &RobotState) -> Option<&'static str> {
        let rows = [
            ("the session state changed", self.session != other.session),
            (
                "the command mode changed",
                self.command_mode != other.command_mode,
            ),
            (
                "power or safety changed",
                self.has_power() != other.has_power(),
            ),
            ("the send period changed", self.period_ns != other.period_ns),
            (
                "the receive multiplier changed",
                self.multiplier != other.multiplier,
            ),
        ];
        rows.into_iter().find(|row| row.1).map(|row| row.0)
    }

    fn is_near(&self, other: &RobotState, bound_rad: f64) -> bool {
        let (Some(one), Some(other)) = (self.interpolated, other.interpolated) else {
            return self.interpolated.is_none() && other.interpolated.is_none();
        };
        one.iter()
            .zip(other)
            .all(|(one, other)| (one - other).abs() <= bound_rad)
    }
}

/// State of the FRI dialogue with one robot.
#[derive(Clone, Debug)]
pub struct IiwaSession {
    settings: SessionSettings,
    io: StationIo,
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
    /// Returns an error if the device's robot does not have 7 joints, or for a channel that is no input or output of a
    /// station.
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
        if let Some(doubt) = self.doubt_about(&state, ticks)
            && !self.is_confirmed_by(&state)
        {
            self.unconfirmed = Some(state);
            return Err(refusal(doubt));
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
        self.robot = Some(state);
        Ok(())
    }

    /// Returns why a message must be confirmed by the next one: until 2.5, FRI has no checksum, and while commands are
    /// executed a single message must not end that.
    fn doubt_about(&self, state: &RobotState, ticks: u32) -> Option<&'static str> {
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
        let reason = self.reason();
        let commandable = self.is_commandable();
        let robot = self.robot.as_ref();
        if let Some(robot) = robot {
            inputs.position = robot.measured;
            inputs.torque = robot.torque;
            inputs.external_torque = robot.external_torque;
            inputs.wrench = robot.wrench;
        }
        Exchange {
            commandable,
            startable: commandable && reason == 0,
            strategy: ControlMode::Position,
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

    /// Returns the content of an answer: in the overlays that are not commanded, what the robot wants beside or instead
    /// of the position.
    fn command(
        &self,
        robot: &RobotState,
        position: Option<&Joints>,
        outputs: &Outputs,
    ) -> CommandData {
        let mut data = CommandData {
            position: position.map(values),
            io: self.io.write(outputs),
            ..CommandData::default()
        };
        if position.is_none() || robot.session < SessionState::CommandingWait {
            return data;
        }
        match ClientCommandMode::from_wire(robot.command_mode) {
            Some(ClientCommandMode::Wrench) => {
                data.wrench = Some(CartesianVector {
                    element: vec![0.0; 6],
                });
            }
            Some(ClientCommandMode::Torque) => data.torque = Some(values(&[0.0; JOINTS_MAX])),
            Some(ClientCommandMode::CartesianPose) => {
                data.position = None;
                data.pose.clone_from(&robot.pose);
                data.redundancy = robot.redundancy;
            }
            _ => {}
        }
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

    fn is_commandable(&self) -> bool {
        let able = |robot: &RobotState| {
            !self.has_rejoined(robot)
                && robot.has_power()
                && robot.command_mode == ClientCommandMode::JointPosition as i32
        };
        !self.releasing && self.commanding > ENTRY_CYCLES && self.robot.as_ref().is_some_and(able)
    }

    fn reason(&self) -> u32 {
        let Some(robot) = &self.robot else {
            return IDLE;
        };
        let overlay = robot.command_mode == ClientCommandMode::JointPosition as i32;
        match () {
            () if robot.session == SessionState::Idle => IDLE,
            () if robot.safety != SafetyState::Normal as i32 => DRIVES_OFF,
            () if robot.quality < self.settings.quality_min => QUALITY,
            () if robot.session < SessionState::CommandingWait => MONITORING,
            () if !robot.drives_active => DRIVES_OFF,
            () if !overlay => COMMAND_MODE,
            () if self.has_rejoined(robot) => REJOINED,
            () if self.commanding <= ENTRY_CYCLES => ENTERING,
            () if self.io.missing().is_some() => STATION_IO,
            () => 0,
        }
    }
}

/// Returns the seven values, if they are there.
fn joints(values: Option<&JointValues>) -> Result<Option<Joints>, Refusal> {
    let Some(values) = values else {
        return Ok(None);
    };
    if values.value.iter().any(|value| !value.is_finite()) {
        return Err(refusal("a value of a joint is not finite"));
    }
    let mut joints = [0.0; JOINTS_MAX];
    for (place, value) in joints.iter_mut().zip(&values.value) {
        *place = *value;
    }
    Ok(Some(joints))
}

fn values(joints: &Joints) -> JointValues {
    JointValues {
        value: joints.iter().take(JOINTS).copied().collect(),
    }
}

/// Returns `[fx fy fz tx ty tz]`, N and N·m; the wire has the torques about z, y, x. Unknown before 2.7.
fn wrench(vector: Option<&CartesianVector>) -> Result<[f64; 6], Refusal> {
    let Some(vector) = vector else {
        return Ok([f64::NAN; 6]);
    };
    match vector.element.as_slice() {
        [fx, fy, fz, tz, ty, tx] if vector.element.iter().all(|value| value.is_finite()) => {
            Ok([*fx, *fy, *fz, *tx, *ty, *tz])
        }
        _ => Err(refusal("the external force is not finite")),
    }
}
