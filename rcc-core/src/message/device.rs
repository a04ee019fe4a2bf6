//! What a driver and the executor tell each other about a device: its state and measurements, and the set-points.

use bytemuck::{Pod, Zeroable};

use super::{ANALOG_MAX, JOINTS_MAX, Joints, MAGIC, SET_POINTS};
use crate::impedance::Impedance;

/// The state of a device, as reported by its driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum DeviceState {
    /// The driver runs but cannot reach the device.
    Offline = 0,
    /// The device answers but cannot be commanded now.
    Online = 1,
    /// At rest at its hold set-point; a net may command it.
    Ready = 2,
    /// Follows a net's set-points.
    Commanded = 3,
    /// Being brought to rest by its driver.
    Stopping = 4,
}

impl DeviceState {
    /// All states, in order of their numbers.
    pub const ALL: [DeviceState; 5] = [
        DeviceState::Offline,
        DeviceState::Online,
        DeviceState::Ready,
        DeviceState::Commanded,
        DeviceState::Stopping,
    ];

    /// Returns the state of a number that came from another process; unknown numbers are `Offline`.
    pub fn from_number(number: u32) -> DeviceState {
        Self::ALL
            .get(number as usize)
            .copied()
            .unwrap_or(DeviceState::Offline)
    }

    /// Returns the display name.
    pub fn name(self) -> &'static str {
        match self {
            DeviceState::Offline => "offline",
            DeviceState::Online => "online",
            DeviceState::Ready => "ready",
            DeviceState::Commanded => "commanded",
            DeviceState::Stopping => "stopping",
        }
    }
}

/// Driver → executor: the newest measurement of a device.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Measurement {
    /// [`MAGIC`].
    pub magic: u64,
    /// +1 for each exchange with the device.
    pub sequence: u64,
    /// CLOCK_MONOTONIC of that exchange.
    pub stamp_ns: u64,
    /// Periods of the device since its driver started, including those without an exchange.
    pub periods: u64,
    /// Period as reported by the device, ns; 0 = not known.
    pub period_ns: u64,
    /// [`DeviceState`].
    pub state: u32,
    /// Quality of the connection in thousandths, 1000 is best.
    pub quality_permille: u32,
    /// Reason why the device is not ready: a number that the driver's announcement explains, 0 = no reason.
    pub reason: u32,
    /// Number of joints, 0 for plain I/O.
    pub joints: u32,
    /// [`crate::impedance::ControlMode`] that the device runs, as a number.
    pub strategy: u64,
    /// Measured position, rad.
    pub position: Joints,
    /// The set-point that the driver currently sends, rad: a net's set-points as they are played, or the hold position
    /// while no net commands the device.
    pub hold: Joints,
    /// Measured torque, N·m.
    pub torque: Joints,
    /// Torque not explained by the dynamic model, N·m.
    pub external_torque: Joints,
    /// External force and torque at the flange `[fx fy fz tx ty tz]`, N and N·m, in the sensor frame of the device.
    pub wrench: [f64; 6],
    /// Bit i: digital input i.
    pub digital: u64,
    /// Bit i: digital input i is known.
    pub digital_known: u64,
    /// Analog inputs in SI units; NaN is unknown.
    pub analog: [f64; ANALOG_MAX],
    /// Bit i: value that the driver sends to digital output i, commanded or after release.
    pub digital_out: u64,
    /// Bit i: the driver sends a value to digital output i; an output with `on_release: hold` has none before the first
    /// command.
    pub digital_out_known: u64,
    /// Values that the driver sends to the analog outputs, SI units; NaN = none.
    pub analog_out: [f64; ANALOG_MAX],
    /// Incarnation of the executor whose board the driver follows, 0 = none.
    pub executor: u64,
    /// Logical time of the last set-point sent, ns.
    pub played_ns: u64,
    /// Logical time up to which all set-points have been played and the arm is at rest at `hold`, ns; 0 while it moves.
    pub settled_ns: u64,
    /// Number of set-points left to play when the last one was taken.
    pub margin: u64,
    /// Number of exchanges in which the driver answered late or lost an answer.
    pub late: u64,
    /// Number of refused datagrams (size, identity, order).
    pub refused: u64,
    /// Number of times that the driver had no fresh set-point while commanded.
    pub starved: u64,
}

/// The commands of one cycle for a device.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct SetPoint {
    /// Logical time, ns: one period per evaluated cycle, independent of the wall clock.
    pub logical_ns: u64,
    /// Number of the engagement: counts up whenever a net takes the arm. 0 = none.
    pub owner: u64,
    /// 1 = `position` is a command; 0 = no command (null, or no net commands the arm).
    pub has_position: u64,
    /// Joint set-point, rad.
    pub position: Joints,
    /// Impedance; valid only with `position`.
    pub impedance: Impedance,
    /// Bit i: value of digital output i.
    pub digital: u64,
    /// Bit i: digital output i is commanded.
    pub digital_commanded: u64,
    /// Analog outputs in SI units; NaN = no command.
    pub analog: [f64; ANALOG_MAX],
}

impl SetPoint {
    /// No commands.
    pub const NONE: SetPoint = SetPoint {
        logical_ns: 0,
        owner: 0,
        has_position: 0,
        position: [0.0; JOINTS_MAX],
        impedance: Impedance::NONE,
        digital: 0,
        digital_commanded: 0,
        analog: [f64::NAN; ANALOG_MAX],
    };
}

/// Executor → driver: the source of the set-points, and the number of the newest.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CommandHead {
    /// [`MAGIC`].
    pub magic: u64,
    /// Incarnation of the executor.
    pub executor: u64,
    /// Number of evaluated cycles: the number of the newest set-point.
    pub sequence: u64,
    /// CLOCK_MONOTONIC at which the newest set-point was written.
    pub stamp_ns: u64,
    /// Period of the executor, ns.
    pub period_ns: u64,
    /// Sequence of the measurement that the newest set-point was computed from, 0 = none.
    pub seen: u64,
}

/// Executor → driver: the last set-points of a device. Each process keeps its own image; only the head and one
/// set-point per cycle are transferred.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct CommandImage {
    /// Source of the set-points.
    pub head: CommandHead,
    /// Ring of the last cycles; the newest is `set_points[sequence % SET_POINTS]`.
    pub set_points: [SetPoint; SET_POINTS],
}

impl CommandImage {
    /// Returns the set-point of cycle `sequence` if the ring still has it; cycles count from 1.
    pub fn at(&self, sequence: u64) -> Option<&SetPoint> {
        let age = self.head.sequence.checked_sub(sequence)?;
        let place = (sequence % SET_POINTS as u64) as usize;
        let point = self.set_points.get(place)?;
        let is_it = Some(point.logical_ns) == sequence.checked_mul(self.head.period_ns);
        (sequence > 0 && age < SET_POINTS as u64 && is_it).then_some(point)
    }

    /// Creates the image of an executor that has written nothing yet.
    pub const fn new(executor: u64, period_ns: u64) -> CommandImage {
        CommandImage {
            head: CommandHead {
                magic: MAGIC,
                executor,
                sequence: 0,
                stamp_ns: 0,
                period_ns,
                seen: 0,
            },
            set_points: [SetPoint::NONE; SET_POINTS],
        }
    }

    /// Stores `point` as the newest set-point, of cycle `sequence`; its logical time is computed from the cycle.
    pub fn push(&mut self, sequence: u64, stamp_ns: u64, point: SetPoint) {
        (self.head.sequence, self.head.stamp_ns) = (sequence, stamp_ns);
        let logical_ns = sequence.wrapping_mul(self.head.period_ns);
        let point = SetPoint {
            logical_ns,
            ..point
        };
        self.keep(sequence, point);
    }

    /// Stores `point` unchanged in the place of cycle `sequence`.
    pub fn keep(&mut self, sequence: u64, point: SetPoint) {
        let place = (sequence % SET_POINTS as u64) as usize;
        if let Some(place) = self.set_points.get_mut(place) {
            *place = point;
        }
    }
}
