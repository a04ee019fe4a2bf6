//! Geometry of a simulated arm, computed from its Denavit-Hartenberg table independently of the RCC's own kinematics.
//! Pure functions; run by the simulator's clock thread.

use super::{JOINTS, Joints};

/// A 3×3 matrix, by rows.
pub type Matrix = [[f64; 3]; 3];

/// Lengths, masses and friction of an arm. Standard Denavit-Hartenberg parameters: `θ = q`, `a = 0`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmModel {
    /// Link offsets along the joint axes, m.
    pub offset: Joints,
    /// Sine of the twist angle to the next axis, which is +90°, −90° or 0.
    pub twist_sine: Joints,
    /// Masses of the links behind J1 to J7, kg.
    pub mass: Joints,
    /// Centres of mass of an upright arm, base frame, m.
    pub centre: [[f64; 3]; JOINTS],
    /// Radius of the solid sphere whose moment of inertia each link has about its centre, m.
    pub radius: f64,
    /// Dry friction, N·m.
    pub friction: Joints,
    /// Viscous friction, N·m·s/rad.
    pub damping: Joints,
}

/// Pose and Jacobian of the flange at one joint position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Rotation from flange to base coordinates.
    pub rotation: Matrix,
    /// Flange in the base frame, m.
    pub position: [f64; 3],
    /// Geometric Jacobian at the flange, base axes; rows vx vy vz wx wy wz.
    pub jacobian: [Joints; 6],
}

/// Forward kinematics and Jacobian: `A_i = Rz(q_i) Tz(d_i) Rx(α_i)`, column `[z × (p − o); z]`.
pub fn geometry(model: &ArmModel, q: &Joints) -> Geometry {
    let links = link_frames(model, q);
    let LinkFrame {
        rotation, position, ..
    } = links[JOINTS - 1];
    let mut jacobian = [[0.0; JOINTS]; 6];
    for (joint, link) in links.iter().enumerate() {
        let linear = cross(&link.axis, &difference(&position, &link.origin));
        for row in 0..3 {
            jacobian[row][joint] = linear[row];
            jacobian[row + 3][joint] = link.axis[row];
        }
    }
    Geometry {
        rotation,
        position,
        jacobian,
    }
}

/// A link at one joint position, base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkFrame {
    /// Direction of its joint's axis.
    pub axis: [f64; 3],
    /// A point of that axis, m.
    pub origin: [f64; 3],
    /// Rotation from link to base coordinates.
    pub rotation: Matrix,
    /// Origin of the link's frame, m.
    pub position: [f64; 3],
}

/// Returns the link behind each joint.
pub fn link_frames(model: &ArmModel, q: &Joints) -> [LinkFrame; JOINTS] {
    let mut rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut position = [0.0; 3];
    std::array::from_fn(|joint| {
        let (axis, origin) = (column(&rotation, 2), position);
        for (p, z) in position.iter_mut().zip(axis) {
            *p += model.offset[joint] * z;
        }
        rotation = multiply(
            &rotation,
            &joint_rotation(q[joint], model.twist_sine[joint]),
        );
        LinkFrame {
            axis,
            origin,
            rotation,
            position,
        }
    })
}

impl Geometry {
    /// Returns the velocity of the flange, m/s, base axes.
    pub fn flange_velocity(&self, joint_velocity: &Joints) -> [f64; 3] {
        std::array::from_fn(|row| {
            self.jacobian[row]
                .iter()
                .zip(joint_velocity)
                .map(|(j, v)| j * v)
                .sum()
        })
    }

    /// Returns the joint torques caused by a wrench (force N, torque Nm, base axes) on the flange, Nm: `Jᵀ F`.
    pub fn joint_torque(&self, wrench: &[f64; 6]) -> Joints {
        std::array::from_fn(|joint| {
            (0..6)
                .map(|row| self.jacobian[row][joint] * wrench[row])
                .sum()
        })
    }
}

fn joint_rotation(q: f64, twist_sine: f64) -> Matrix {
    let (s, c) = q.sin_cos();
    let twist_cosine = 1.0 - twist_sine.abs();
    [
        [c, -s * twist_cosine, s * twist_sine],
        [s, c * twist_cosine, -c * twist_sine],
        [0.0, twist_sine, twist_cosine],
    ]
}

fn column(m: &Matrix, index: usize) -> [f64; 3] {
    [m[0][index], m[1][index], m[2][index]]
}

pub(in crate::sim) fn transposed(m: &Matrix) -> Matrix {
    [column(m, 0), column(m, 1), column(m, 2)]
}

pub(in crate::sim) fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

pub(in crate::sim) fn difference(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(in crate::sim) fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
