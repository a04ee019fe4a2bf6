//! An arm of one to seven revolute axes in any arrangement, or of one to six linear axes. Forward kinematics and Jacobian are exact; the inverse is
//! numeric, with a bounded number of steps and without heap. Used by the loader and by the real-time thread.
//!
//! Product of exponentials (Lynch and Park, Modern Robotics, Cambridge 2017, section 4.1): each axis is a line in the base
//! frame while all joints are 0. The inverse is damped least squares after Levenberg and Marquardt, with damping in
//! proportion to the squared residual (Sugihara, IEEE T-RO 27(5), 2011).

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen, Vector3, Vector6};

use super::ArmJacobian;
use super::axes::{AXES_MAX, matrix, rows};
use super::branch::Unreachable;
use super::links::LinkPoints;
use super::singularity::{Singularity, SingularityKind};
use crate::joints::{JOINTS_MAX, Joints};
use crate::pose::Pose;

/// Maximum number of steps of the numeric inverse.
pub const STEPS_MAX: u32 = 40;

/// Largest residual of a solution: position in m and rotation in rad, as one vector.
pub const RESIDUAL_MAX: f64 = 1e-11;

/// A hint with at most this residual is the solution: rounding.
const HINT_RESIDUAL: f64 = 1e-14;

/// Below this residual one more step reaches the limit of rounding, because steps converge quadratically.
const LAST_STEP: f64 = 1e-10;

/// No joint moves further than this in a step, rad: beyond, the linear model of the arm is of no use.
const STEP_MAX_RAD: f64 = 0.6;

/// Least squared damping; keeps the noise of rounding small where the Jacobian loses rank.
const DAMPING_MIN: f64 = 1e-14;

/// Squared damping in relation to the squared residual: at first, and its range.
const DAMPING_FIRST: f64 = 0.02;
const DAMPING_LEAST: f64 = 1e-5;

/// A residual that is not small enough and would change by less than this fraction is a local minimum.
const STANDSTILL: f64 = 1e-12;

/// Squared lengths that deviate less than this from 1 count as 1, so that normalising twice changes nothing.
const UNIT_TOLERANCE: f64 = 1e-15;

/// Iterations after which the singular values count as unknown. Six values need about twelve.
const EIGEN_ITERATIONS: usize = 96;

/// The axis of a joint in the base frame, with all joints at 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointAxis {
    /// A point on the axis, m; also an end of a link where the arm is drawn.
    pub point: [f64; 3],
    /// Direction, by the right-hand rule; of any length but 0.
    pub direction: [f64; 3],
}

impl JointAxis {
    const NONE: JointAxis = JointAxis {
        point: [0.0; 3],
        direction: [0.0; 3],
    };
}

/// Axes and flange of an arm, all of them revolute, or all of them linear: then "rad" below is m. Seven axes leave one degree of freedom: the position of the redundant joint then is the arm
/// angle, which a pose does not determine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SerialArm {
    axes: [JointAxis; AXES_MAX],
    count: usize,
    redundant_joint: usize,
    flange: Pose,
    linear: bool,
}

/// Axes and flange at one joint position, base frame.
struct SerialFrames {
    directions: [Vector3<f64>; AXES_MAX],
    points: [Vector3<f64>; AXES_MAX],
    flange: Vector3<f64>,
    rotation: Matrix3<f64>,
}

/// The columns of the Jacobian; 0 beyond the axes.
type Columns = SMatrix<f64, 6, AXES_MAX>;

/// Where the numeric inverse ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumericSolution {
    /// Joint positions, rad.
    pub joints: Joints,
    /// Remaining distance from the pose: m and rad, as one vector.
    pub residual: f64,
    /// Number of steps, 0 to [`STEPS_MAX`].
    pub steps: u32,
}

/// Joint positions on the way to a pose.
struct Iterate {
    joints: SVector<f64, AXES_MAX>,
    frames: SerialFrames,
    error: Vector6<f64>,
    residual: f64,
}

impl SerialArm {
    /// Creates an arm from its axes, from the base to the flange, and the flange in the base frame with all joints at 0.
    /// `redundant_joint`, from 0, counts for seven axes only. `None` for no axis, more than seven, an axis without
    /// direction, a redundant joint that does not exist, or numbers that are not finite.
    #[must_use]
    pub fn new(axes: &[JointAxis], flange: Pose, redundant_joint: usize) -> Option<SerialArm> {
        let count = axes.len();
        let redundant_joint = if count == AXES_MAX {
            redundant_joint
        } else {
            0
        };
        if count == 0 || redundant_joint >= count {
            return None;
        }
        let mut all = [JointAxis::NONE; AXES_MAX];
        for (place, axis) in all.get_mut(..count)?.iter_mut().zip(axes) {
            let finite = axis.point.iter().all(|x| x.is_finite());
            *place = JointAxis {
                point: finite.then_some(axis.point)?,
                direction: normalised(axis.direction)?,
            };
        }
        let flange = Pose {
            orientation: normalised(flange.orientation)?,
            ..flange
        };
        flange.is_finite().then_some(SerialArm {
            axes: all,
            count,
            redundant_joint,
            flange,
            linear: false,
        })
    }

    /// Creates a machine of linear axes: each joint moves by its position (m) along its direction. Points are ends of links where
    /// it is drawn. `None` for no axis, more than six, an axis without direction, or numbers that are not finite.
    #[must_use]
    pub fn of_linear_axes(axes: &[JointAxis], flange: Pose) -> Option<SerialArm> {
        let arm = SerialArm::new(axes, flange, 0)?;
        (axes.len() < AXES_MAX).then_some(SerialArm {
            linear: true,
            ..arm
        })
    }

    /// Returns true if the axes are linear: joint positions are in m.
    #[must_use]
    pub const fn is_linear(&self) -> bool {
        self.linear
    }

    /// Returns the axes, from the base to the flange; directions have length 1.
    #[must_use]
    pub fn axes(&self) -> &[JointAxis] {
        self.axes.get(..self.count).unwrap_or(&[])
    }

    /// Returns the flange in the base frame with all joints at 0.
    #[must_use]
    pub fn flange(&self) -> Pose {
        self.flange
    }

    /// Returns the redundant joint, from 0; `None` for fewer than seven axes.
    #[must_use]
    pub fn redundant_joint(&self) -> Option<usize> {
        (self.count == AXES_MAX).then_some(self.redundant_joint)
    }

    /// Returns the number of axes, 1 to [`AXES_MAX`].
    #[must_use]
    pub const fn joints(&self) -> usize {
        self.count
    }

    /// Returns the flange pose in the base frame, for joints in rad. NaN in, NaN out.
    #[must_use]
    pub fn forward(&self, joints: &Joints) -> Pose {
        let frames = self.frames(&used(joints));
        Pose::from_rotation_matrix(frames.flange.into(), &rows(&frames.rotation))
    }

    /// Returns the base, the point of each axis, and the flange in the base frame, m.
    #[must_use]
    pub fn link_points(&self, joints: &Joints) -> LinkPoints {
        let frames = self.frames(&used(joints));
        let points = frames.points.iter().take(self.count);
        let ends = core::iter::once(Vector3::zeros())
            .chain(points.copied())
            .chain([frames.flange]);
        LinkPoints::of(ends.map(Into::into))
    }

    /// Returns the geometric Jacobian for joints in rad.
    #[must_use]
    pub fn jacobian(&self, joints: &Joints) -> ArmJacobian {
        let columns = self.columns(&self.frames(&used(joints)));
        let mut jacobian = [[0.0; JOINTS_MAX]; 6];
        for (row, from) in jacobian.iter_mut().zip(columns.row_iter()) {
            for (place, value) in row.iter_mut().zip(from.iter()) {
                *place = *value;
            }
        }
        jacobian
    }

    /// Returns the position of the redundant joint, rad; `None` for fewer than seven axes.
    #[must_use]
    pub fn arm_angle(&self, joints: &Joints) -> Option<f64> {
        joints.get(self.redundant_joint()?).copied()
    }

    /// Returns the smallest singular value of the Jacobian (of those that the number of axes allows), with 1 m weighted as
    /// 1 rad, at most 1: 0 where the flange loses a direction of motion.
    #[must_use]
    pub fn singularity(&self, joints: &Joints) -> Singularity {
        let columns = self.columns(&self.frames(&used(joints)));
        Singularity {
            kind: SingularityKind::Rank,
            distance: self.least_singular_value(&columns).unwrap_or(f64::NAN),
        }
    }

    /// Returns the joints (rad) that bring the flange to `pose` (base frame), found from `hint` (rad); with seven axes the
    /// redundant joint is at `arm_angle` (rad). A hint that reaches the pose is the solution. Joint limits are not checked.
    ///
    /// # Errors
    /// Returns `Unreachable` if [`STEPS_MAX`] steps do not reach the pose to [`RESIDUAL_MAX`], or an argument is null.
    pub fn inverse(
        &self,
        pose: &Pose,
        arm_angle: f64,
        hint: &Joints,
    ) -> Result<Joints, Unreachable> {
        let NumericSolution {
            joints, residual, ..
        } = self.solve(pose, arm_angle, hint)?;
        // Written so that NaN is refused.
        if residual <= RESIDUAL_MAX {
            Ok(joints)
        } else {
            Err(Unreachable::NoSolution { residual })
        }
    }

    /// As [`SerialArm::inverse`], and returns where the steps ended even if that is not the pose.
    ///
    /// # Errors
    /// Returns [`Unreachable::NotFinite`] if an argument is null.
    pub fn solve(
        &self,
        pose: &Pose,
        arm_angle: f64,
        hint: &Joints,
    ) -> Result<NumericSolution, Unreachable> {
        let (redundant, start) = self.start(arm_angle, hint);
        if !pose.is_finite() || !start.iter().all(|q| q.is_finite()) {
            return Err(Unreachable::NotFinite);
        }
        let target = Target {
            position: Vector3::from(pose.position),
            rotation: matrix(&pose.rotation_matrix()),
        };
        let mut here = self.iterate(start, &target);
        let (mut damping, mut steps) = (DAMPING_FIRST, 0);
        while steps < STEPS_MAX && (steps > 0 || here.residual > HINT_RESIDUAL) {
            steps += 1;
            let last = here.residual <= LAST_STEP;
            let mut columns = self.columns(&here.frames);
            if let Some(redundant) = redundant {
                columns.column_mut(redundant).fill(0.0);
            }
            let square = damping * here.residual * here.residual + DAMPING_MIN;
            let Some(step) = damped_step(&columns, &here.error, square, self.step_max()) else {
                damping *= 8.0;
                continue;
            };
            let there = self.iterate(here.joints + step, &target);
            if there.residual < here.residual {
                let standstill = here.residual - there.residual < STANDSTILL * here.residual;
                here = there;
                damping = libm::fmax(damping * 0.2, DAMPING_LEAST);
                if standstill && !last {
                    break;
                }
            } else {
                damping *= 8.0;
            }
            if last {
                break;
            }
        }
        Ok(NumericSolution {
            joints: all(&here.joints),
            residual: here.residual,
            steps,
        })
    }

    /// Returns the redundant joint and the joints to begin with.
    fn start(&self, arm_angle: f64, hint: &Joints) -> (Option<usize>, SVector<f64, AXES_MAX>) {
        let mut start = used(hint);
        for unused in start.iter_mut().skip(self.count) {
            *unused = 0.0;
        }
        let redundant = self.redundant_joint();
        if let Some(place) = redundant.and_then(|joint| start.get_mut(joint)) {
            *place = arm_angle;
        }
        (redundant, start)
    }

    /// Returns how far a joint moves in a step: the model of linear axes is exact.
    fn step_max(&self) -> f64 {
        if self.linear { f64::MAX } else { STEP_MAX_RAD }
    }

    fn iterate(&self, joints: SVector<f64, AXES_MAX>, target: &Target) -> Iterate {
        let frames = self.frames(&joints);
        let error = target.error(&frames);
        Iterate {
            joints,
            residual: error.norm(),
            frames,
            error,
        }
    }

    fn frames(&self, joints: &SVector<f64, AXES_MAX>) -> SerialFrames {
        let (mut rotation, mut shift) = (Matrix3::identity(), Vector3::zeros());
        let mut frames = SerialFrames {
            directions: [Vector3::zeros(); AXES_MAX],
            points: [Vector3::zeros(); AXES_MAX],
            flange: Vector3::zeros(),
            rotation,
        };
        let places = frames.directions.iter_mut().zip(&mut frames.points);
        for ((axis, joint), (direction, point)) in self.axes().iter().zip(joints).zip(places) {
            let (along, on) = (Vector3::from(axis.direction), Vector3::from(axis.point));
            *direction = rotation * along;
            *point = rotation * on + shift;
            if self.linear {
                shift += along * *joint;
            } else {
                rotation *= turned_about(&along, libm::sincos(*joint));
                shift = *point - rotation * on;
            }
        }
        frames.flange = rotation * Vector3::from(self.flange.position) + shift;
        frames.rotation = rotation * matrix(&self.flange.rotation_matrix());
        frames
    }

    fn columns(&self, frames: &SerialFrames) -> Columns {
        let mut columns = Columns::zeros();
        let axes = frames.directions.iter().zip(&frames.points);
        for (mut column, (direction, point)) in columns.column_iter_mut().zip(axes) {
            let (linear, angular) = match self.linear {
                true => (*direction, Vector3::zeros()),
                false => (direction.cross(&(frames.flange - point)), *direction),
            };
            let values = linear.iter().chain(angular.iter());
            for (place, value) in column.iter_mut().zip(values) {
                *place = *value;
            }
        }
        columns
    }

    /// Returns the smallest of the singular values that are not 0 by the number of axes, at most 1.
    fn least_singular_value(&self, columns: &Columns) -> Option<f64> {
        let square = columns * columns.transpose();
        if !square.iter().all(|x| x.is_finite()) {
            return None;
        }
        let eigen = SymmetricEigen::try_new(square, f64::EPSILON, EIGEN_ITERATIONS)?;
        let mut values: [f64; 6] = eigen.eigenvalues.into();
        values.sort_unstable_by(f64::total_cmp);
        let most = if self.linear { 3 } else { 6 };
        let least = values
            .iter()
            .rev()
            .nth(self.count.min(most).checked_sub(1)?)?;
        Some(libm::sqrt(libm::fmax(*least, 0.0)).min(1.0))
    }
}

/// The pose that the numeric inverse looks for.
struct Target {
    position: Vector3<f64>,
    rotation: Matrix3<f64>,
}

impl Target {
    /// Returns the way from the flange to the pose: m, and the rotation vector in base axes, rad.
    fn error(&self, frames: &SerialFrames) -> Vector6<f64> {
        let way = self.position - frames.flange;
        let turn = rotation_vector(&(self.rotation * frames.rotation.transpose()));
        Vector6::new(way.x, way.y, way.z, turn.x, turn.y, turn.z)
    }
}

/// Returns the step of damped least squares, no joint further than `step_max`; `None` if rounding makes the
/// equations unsolvable. `square` is the squared damping.
fn damped_step(
    columns: &Columns,
    error: &Vector6<f64>,
    square: f64,
    step_max: f64,
) -> Option<SVector<f64, AXES_MAX>> {
    let mut normal = columns.tr_mul(columns);
    for index in 0..AXES_MAX {
        if let Some(diagonal) = normal.get_mut((index, index)) {
            *diagonal += square;
        }
    }
    let step = normal.cholesky()?.solve(&columns.tr_mul(error));
    let furthest = step.amax();
    Some(if furthest > step_max {
        step * (step_max / furthest)
    } else {
        step
    })
}

/// Returns the rotation about an axis of length 1 by an angle with this sine and cosine (Rodrigues).
fn turned_about(axis: &Vector3<f64>, (sin, cos): (f64, f64)) -> Matrix3<f64> {
    let (x, y, z) = (axis.x, axis.y, axis.z);
    let rest = 1.0 - cos;
    Matrix3::new(
        cos + x * x * rest,
        x * y * rest - z * sin,
        x * z * rest + y * sin,
        y * x * rest + z * sin,
        cos + y * y * rest,
        y * z * rest - x * sin,
        z * x * rest - y * sin,
        z * y * rest + x * sin,
        cos + z * z * rest,
    )
}

/// Returns the rotation vector of a rotation matrix, rad; near a half turn about one of the two axes.
fn rotation_vector(m: &Matrix3<f64>) -> Vector3<f64> {
    let twice = Vector3::new(m.m32 - m.m23, m.m13 - m.m31, m.m21 - m.m12);
    let (sin, cos) = (0.5 * twice.norm(), 0.5 * (m.trace() - 1.0));
    if sin > 1e-6 {
        return twice * (0.5 * libm::atan2(sin, cos) / sin);
    }
    if cos > 0.0 {
        return twice * 0.5;
    }
    // Half a turn: the axis is the longest column of R + 1.
    let mut axis = Vector3::zeros();
    for column in (m + Matrix3::identity()).column_iter() {
        if column.norm_squared() > axis.norm_squared() {
            axis = column.into();
        }
    }
    let length = axis.norm();
    if length > 0.0 {
        axis * (core::f64::consts::PI / length)
    } else {
        Vector3::repeat(f64::NAN)
    }
}

fn used(&[q1, q2, q3, q4, q5, q6, q7, _]: &Joints) -> SVector<f64, AXES_MAX> {
    [q1, q2, q3, q4, q5, q6, q7].into()
}

fn all(joints: &SVector<f64, AXES_MAX>) -> Joints {
    let [q1, q2, q3, q4, q5, q6, q7] = (*joints).into();
    [q1, q2, q3, q4, q5, q6, q7, 0.0]
}

/// Returns a vector with length 1; `None` if it has none, or is not finite.
fn normalised<const N: usize>(vector: [f64; N]) -> Option<[f64; N]> {
    let square: f64 = vector.iter().map(|x| x * x).sum();
    if !square.is_finite() || square < 1e-12 {
        return None;
    }
    if (square - 1.0).abs() <= UNIT_TOLERANCE {
        return Some(vector);
    }
    let length = libm::sqrt(square);
    Some(vector.map(|x| x / length))
}
