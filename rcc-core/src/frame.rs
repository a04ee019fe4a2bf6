//! The view of kernels: the arenas of one running net, the latched devices and the commands to write.
//!
//! The real-time thread builds a `Frame` for each net each cycle; it only borrows. Slot access never panics: an index
//! outside the arena reads as null and writes nothing (`Plan::check` excludes both).

mod slot;

pub use crate::joints::ArmMotion;
pub use crate::path::PrepareFault;
pub use slot::{
    Bool, Channel, Device, Element, Int, MotionIndex, Real, Rotation, Slot, Spatial, Value, Vector3,
};

use crate::impedance::{Impedance, ImpedanceLimits};
use crate::joints::{JOINTS_MAX, JointLimits, Joints};
use crate::kinematics::Arm;
use crate::message::{ANALOG_MAX, Measurement};
use crate::path::{MotionBuilder, Motions};
use crate::pose::Pose;
use crate::rotation::{self, Quaternion};
use crate::types::NULL_REAL;
use crate::workspace::Workspace;

/// The static model of a device, from the cell's configuration.
#[derive(Clone, Copy, Debug)]
pub struct DeviceModel {
    /// Number of joints, 0 for plain I/O.
    pub joints: u32,
    /// Kinematics, if the device is an arm.
    pub arm: Option<Arm>,
    /// Limits that the guard enforces.
    pub limits: JointLimits,
    /// Largest distance of a net's first set-point from the hold set-point, rad per joint.
    pub first_tolerance_rad: f64,
    /// Pose of its base in the world frame of the cell.
    pub base: Pose,
    /// Region that the arm may occupy, `None` = unrestricted; checked before a net starts and by the guard for each
    /// set-point.
    pub workspace: Option<Workspace>,
    /// Number of digital inputs, digital outputs, analog inputs, analog outputs.
    pub channels: [u32; 4],
    /// Limits of impedance set-points, `None` = the arm is commanded in position only.
    pub impedance: Option<ImpedanceLimits>,
}

impl DeviceModel {
    /// Returns true if the joints are linear axes: positions are in m.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        self.arm.is_some_and(|arm| arm.is_linear())
    }

    /// A plain I/O device without channels.
    pub const NONE: DeviceModel = DeviceModel {
        joints: 0,
        arm: None,
        limits: JointLimits {
            lower: [0.0; JOINTS_MAX],
            upper: [0.0; JOINTS_MAX],
            velocity_max: [0.0; JOINTS_MAX],
            acceleration_max: [0.0; JOINTS_MAX],
            jerk_max: [0.0; JOINTS_MAX],
            joints: 0,
        },
        first_tolerance_rad: 0.0,
        base: Pose::IDENTITY,
        workspace: None,
        channels: [0; 4],
        impedance: None,
    };
}

/// A device's newest measurement, latched at the beginning of the cycle.
#[derive(Clone, Copy, Debug)]
pub struct DeviceInput {
    /// False if the board is stale or the device offline: its ports are null.
    pub present: bool,
    /// The measurement; meaningless if not present.
    pub measurement: Measurement,
}

/// The commands of all nets to a device in one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceOutput {
    /// True if `position` is a command.
    pub has_position: bool,
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

impl DeviceOutput {
    /// No commands.
    pub const NONE: DeviceOutput = DeviceOutput {
        has_position: false,
        position: [0.0; JOINTS_MAX],
        impedance: Impedance::NONE,
        digital: 0,
        digital_commanded: 0,
        analog: [NULL_REAL; ANALOG_MAX],
    };
}

/// Everything that one net may read and write in one cycle.
pub struct Frame<'a> {
    /// Arena of `Real` and composites.
    pub reals: &'a mut [f64],
    /// Arena of `Bool`.
    pub bools: &'a mut [u8],
    /// Arena of `Int`.
    pub ints: &'a mut [i64],
    /// Kinematics and limits, by device index.
    pub models: &'a [DeviceModel],
    /// Latched measurements, by device index.
    pub devices: &'a [DeviceInput],
    /// First cycle only: the motion with which each claimed arm starts, by device index: that of the net before, or rest
    /// at the hold set-point. `None`: not claimed, or not known.
    pub arms: &'a [Option<ArmMotion>],
    /// Commands, by device index.
    pub outputs: &'a mut [DeviceOutput],
    /// The motions of the net.
    pub motions: &'a mut dyn Motions,
    /// Period, s.
    pub dt_s: f64,
    /// Number of cycles of this net that were evaluated before this one.
    pub cycle: u64,
    /// CANCEL was requested.
    pub cancel_requested: bool,
    /// Set by `Termination`.
    pub terminated: bool,
    /// Number of conditions of `Termination` that were not true, up to the first true one: the index of the outcome if
    /// the net terminated.
    pub outcome: u32,
    /// Set by a motion whose computation failed.
    pub motion_failed: bool,
}

impl Frame<'_> {
    /// Reads a value; `None` outside of the arena. A null pose contains NaN.
    #[inline(always)]
    pub fn get<T: Value>(&self, slot: Slot<T>) -> Option<T> {
        T::get(T::Element::arena(self), slot.index())
    }

    /// Writes a value; `None` outside of the arena. An infinite number is written as null, and so is a pose that is not
    /// finite.
    #[inline(always)]
    pub fn put<T: Value>(&mut self, slot: Slot<T>, value: T) -> Option<()> {
        value.put(T::Element::arena_mut(self), slot.index())
    }

    /// Reads `N` reals; `None` if an element is null or not finite.
    #[inline(always)]
    pub fn composite<const N: usize>(&self, slot: Slot<[Real; N]>) -> Option<[f64; N]> {
        let values = self.get(slot)?;
        let finite = values.iter().all(|value: &f64| value.is_finite());
        finite.then_some(values)
    }

    /// Writes `N` reals; `None`, or any element that is not finite, writes null in every element.
    #[inline(always)]
    pub fn put_composite<const N: usize>(
        &mut self,
        slot: Slot<[Real; N]>,
        value: Option<[f64; N]>,
    ) -> Option<()> {
        let finite = value.filter(|value| value.iter().all(|element| element.is_finite()));
        self.put(slot, finite.unwrap_or([NULL_REAL; N]))
    }

    /// Reads a rotation, normalized; `None` if it is null or cannot be normalized.
    #[inline(always)]
    pub fn rotation(&self, slot: Slot<Rotation>) -> Option<Quaternion> {
        rotation::unit(self.get(slot)?)
    }

    /// Reads a pose with normalized orientation; `None` if it is null or its orientation cannot be normalized.
    #[inline(always)]
    pub fn known_pose(&self, slot: Slot<Pose>) -> Option<Pose> {
        let [x, y, z, qx, qy, qz, qw] = self.composite(slot.cast())?;
        Some(Pose {
            position: [x, y, z],
            orientation: rotation::unit([qx, qy, qz, qw])?,
        })
    }

    /// Writes a pose; `None` or a pose that is not finite is written as null.
    #[inline(always)]
    pub fn put_pose(&mut self, slot: Slot<Pose>, pose: Option<Pose>) -> Option<()> {
        self.put_composite(slot.cast(), pose.map(|pose| pose.to_slots()))
    }

    /// Reads the `width` joints that begin at `first`; `None` if any of them is null.
    pub fn joints(&self, first: Slot<Real>, width: u32) -> Option<Joints> {
        let values = self.reals.get(first.index() as usize..)?;
        joints_from(values.get(..width as usize)?)
    }

    /// Writes the `width` joints that begin at `first`, an infinite one as null; `None` writes null in every element.
    pub fn put_joints(
        &mut self,
        first: Slot<Real>,
        width: u32,
        value: Option<&Joints>,
    ) -> Option<()> {
        let value = value.copied().unwrap_or([NULL_REAL; JOINTS_MAX]);
        let tail = self.reals.get_mut(first.index() as usize..)?;
        for (place, value) in tail.iter_mut().zip(value).take(width as usize) {
            *place = value.stored();
        }
        Some(())
    }

    /// Returns the measurement of a device; `None` if it is not present.
    #[inline]
    pub fn measured(&self, device: Device) -> Option<&Measurement> {
        let input = self.devices.get(device.0 as usize)?;
        input.present.then_some(&input.measurement)
    }

    /// Returns the commands to a device.
    #[inline]
    pub fn output(&mut self, device: Device) -> Option<&mut DeviceOutput> {
        self.outputs.get_mut(device.0 as usize)
    }
}

impl<'a> Frame<'a> {
    /// Returns the kinematics of a device; `None` if it has none.
    #[inline]
    pub fn arm(&self, device: Device) -> Option<&'a Arm> {
        let models: &'a [DeviceModel] = self.models;
        models.get(device.0 as usize)?.arm.as_ref()
    }

    /// Returns the joint limits of a device.
    #[inline]
    pub fn limits(&self, device: Device) -> Option<&'a JointLimits> {
        let models: &'a [DeviceModel] = self.models;
        models.get(device.0 as usize).map(|model| &model.limits)
    }

    /// Returns the kinematics of a device and the joint positions at `joints`; `None` if a position is null or not
    /// finite.
    pub fn arm_at(
        &self,
        device: Device,
        joints: Slot<Real>,
        width: u32,
    ) -> Option<(&'a Arm, Joints)> {
        let joints = self.joints(joints, width)?;
        let finite = joints.iter().all(|joint| joint.is_finite());
        self.arm(device).filter(|_| finite).map(|arm| (arm, joints))
    }
}

/// Copies at most [`JOINTS_MAX`] values; `None` if one of them is null.
pub fn joints_from(values: &[f64]) -> Option<Joints> {
    let mut joints = [0.0; JOINTS_MAX];
    for (place, value) in joints.iter_mut().zip(values) {
        *place = *value;
    }
    joints.iter().all(|value| !value.is_nan()).then_some(joints)
}

/// The view of `prepare`, off the real-time thread, when a command becomes ready.
pub struct Preparation<'a> {
    /// The initial arena of `Real`.
    pub reals: &'a mut [f64],
    /// The initial arena of `Int`.
    pub ints: &'a [i64],
    /// The initial arena of `Bool`.
    pub bools: &'a [u8],
    /// Kinematics and limits, by device index.
    pub models: &'a [DeviceModel],
    /// The hold set-point of each device, rad; `None` if it is not known.
    pub holds: &'a [Option<Joints>],
    /// Builds the motions of the net.
    pub motions: &'a mut dyn MotionBuilder,
    /// Period of the net, s.
    pub dt_s: f64,
}

impl Preparation<'_> {
    /// Reads a value; null outside of the arena.
    pub fn get<T: Value>(&self, slot: Slot<T>) -> T {
        T::get(T::Element::initial(self), slot.index()).unwrap_or(T::NULL)
    }

    /// Writes reals; does nothing outside of the arena.
    pub fn put<T: Value<Element = Real>>(&mut self, slot: Slot<T>, value: T) {
        value.put(self.reals, slot.index());
    }

    /// Returns the kinematics of an arm and its hold set-point, rad.
    ///
    /// # Errors
    /// Returns `NoArm` if the device has no kinematics, `HoldUnknown` if the hold set-point of the device is
    /// not known.
    pub fn arm_at_rest(&self, device: Device) -> Result<(Arm, Joints), PrepareFault> {
        arm_at_rest(self.models, self.holds, device.0)
    }
}

/// Returns the kinematics of an arm and its hold set-point, rad.
///
/// # Errors
/// Returns `NoArm` if the device has no kinematics, `HoldUnknown` if the hold set-point of the device is not
/// known.
pub fn arm_at_rest(
    models: &[DeviceModel],
    holds: &[Option<Joints>],
    device: u32,
) -> Result<(Arm, Joints), PrepareFault> {
    let model = models.get(device as usize);
    let arm = model
        .and_then(|model| model.arm)
        .ok_or(PrepareFault::NoArm { device })?;
    let hold = holds.get(device as usize).copied().flatten();
    let hold = hold.ok_or(PrepareFault::HoldUnknown { device })?;
    Ok((arm, hold))
}
