//! Contents of one message of the robot, and the reasons for which a message is refused.
//! Pure; run by the host's thread.

use std::fmt;

use rcc_core::message::{JOINTS_MAX, Joints};

use crate::fri_iiwa::wire::schema::{
    CartesianVector, JointValues, Monitoring, Redundancy, Transformation,
};
use crate::fri_iiwa::wire::{DriveState, JOINTS, Quality, SafetyState, SessionState, WireError};

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

pub(super) fn refusal(cause: &'static str) -> Refusal {
    Refusal { wire: None, cause }
}

/// Contents of one message. Enumerations that only people read are as on the wire; -1 = missing.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotState {
    pub(super) sequence: u32,
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
    /// Quantity that the motion's overlay lets a client command.
    pub command_mode: i32,
    /// State of each drive.
    pub drives: Vec<i32>,
    pub(super) period_ns: u64,
    pub(super) multiplier: u32,
    pub(super) measured: Joints,
    pub(super) torque: Joints,
    /// NaN if the message has none.
    pub(super) commanded_torque: Joints,
    pub(super) external_torque: Joints,
    pub(super) wrench: [f64; 6],
    /// 1.x.
    pub(super) commanded: Option<Joints>,
    /// The robot's own position, without the client's overlay: only while it commands.
    pub(super) interpolated: Option<Joints>,
    /// The pose of `interpolated`; 2.x.
    pub(super) pose: Option<Transformation>,
    /// The redundancy of `interpolated`; 2.x.
    pub(super) redundancy: Option<Redundancy>,
    /// The redundancy of the measured position; 2.x.
    pub(super) measured_redundancy: Option<Redundancy>,
    /// From 0 to 1; NaN if the message has none.
    pub(super) tracking: f64,
}

impl RobotState {
    pub(super) fn of(message: &Monitoring) -> Result<Self, Refusal> {
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
            drives: robot.map_or_else(Vec::new, |robot| robot.drives.clone()),
            period_ns: u64::from(period_ms) * 1_000_000,
            multiplier: connection.receive_multiplier.unwrap_or(1).max(1),
            measured,
            torque: joints(data.measured_torque.as_ref())?.unwrap_or(unknown),
            commanded_torque: joints(data.commanded_torque.as_ref())?.unwrap_or(unknown),
            external_torque: joints(data.external_torque.as_ref())?.unwrap_or(unknown),
            wrench: wrench(data.external_force.as_ref())?,
            commanded: joints(data.commanded_position.as_ref())?,
            interpolated,
            pose: ipo.and_then(|ipo| ipo.pose.clone()),
            redundancy: ipo.and_then(|ipo| ipo.redundancy),
            measured_redundancy: data.redundancy,
            tracking: ipo
                .and_then(|ipo| ipo.tracking_performance)
                .unwrap_or(f64::NAN),
        })
    }

    /// Returns true if all drives are active.
    pub(super) fn drives_active(&self) -> bool {
        let active = DriveState::Active as i32;
        self.drives.len() == JOINTS && self.drives.iter().all(|drive| *drive == active)
    }

    pub(super) fn has_power(&self) -> bool {
        self.safety == SafetyState::Normal as i32 && self.drives_active()
    }

    /// Returns what differs from another message of the same session although it rarely changes.
    pub(super) fn changed(&self, other: &RobotState) -> Option<&'static str> {
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

    pub(super) fn is_near(&self, other: &RobotState, bound_rad: f64) -> bool {
        let (Some(one), Some(other)) = (self.interpolated, other.interpolated) else {
            return self.interpolated.is_none() && other.interpolated.is_none();
        };
        one.iter()
            .zip(other)
            .all(|(one, other)| (one - other).abs() <= bound_rad)
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
