//! The measurement datagram of the simulated controller.
//! Pure; run by the clock thread once per tick.

use super::krc::Krc;
use super::model::{LWR_4_PLUS, geometry};
use super::{JOINTS, Joints};
use crate::fri_lwr::wire::{FriControlStrategy, MeasurementDatagram, SessionState};
use crate::sim::arm::dynamics::{friction_torque, gravity_torque, mass_matrix};
use crate::sim::arm::environment::wire_wrench;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::quality::WINDOW;

impl Krc {
    /// The torques (external wrench, weight of the links and friction, no inertia), the mass matrix and the temperature
    /// (constant) are approximations.
    pub(super) fn datagram(&self) -> MeasurementDatagram {
        let figures = self.quality.figures();
        let (base, desired) = (geometry(&self.base), geometry(&self.robot.desired));
        let narrow = |values: &Joints| values.map(|value| value as f32);
        let external = self.robot.geometry.joint_torque(&self.robot.wrench);
        let gravity = gravity_torque(&LWR_4_PLUS, &self.robot.arm.position);
        let masses = mass_matrix(&LWR_4_PLUS, &self.robot.arm.position);
        let friction = friction_torque(&LWR_4_PLUS, &self.robot.arm.velocity);
        let measured: Joints =
            std::array::from_fn(|joint| external[joint] + gravity[joint] + friction[joint]);
        let answered = figures.answered as f32 / WINDOW as f32;
        MeasurementDatagram {
            send_sequence: self.sequence(),
            reflected_sequence: self.last_answer_sequence.unwrap_or(0),
            krl: self.to_pc,
            timestamp: self.robot.time_s as f32,
            state: if self.in_command_state() {
                SessionState::Command
            } else {
                SessionState::Monitor
            },
            quality: self.quality.quality(),
            measurement_period: self.settings.period_s as f32,
            command_period: self.settings.period_s as f32,
            safety_limits: self.settings.safety_limits as f32,
            answer_rate: answered,
            latency: figures.latency_s as f32,
            jitter: figures.jitter_s as f32,
            miss_rate: 1.0 - answered,
            miss_count: self.counts.missed as u32,
            power: if self.drives_on() { 0x7f } else { 0 },
            control: match self.settings.strategy {
                ControlLaw::Position => FriControlStrategy::Position,
                ControlLaw::CartesianImpedance => FriControlStrategy::CartesianImpedance,
                ControlLaw::JointImpedance => FriControlStrategy::JointImpedance,
            },
            error: self.fault.map_or(0, |fault| fault.drive_bits()),
            warning: 0,
            temperature: [30.0; JOINTS],
            measured_position: narrow(&self.robot.arm.position),
            measured_pose: self.robot.geometry.pose(),
            commanded_position: narrow(&self.base),
            commanded_position_offset: std::array::from_fn(|i| {
                (self.robot.desired[i] - self.base[i]) as f32
            }),
            commanded_pose: base.pose(),
            commanded_pose_offset: desired.offset_from(&base),
            measured_torque: narrow(&measured),
            external_torque: narrow(&external),
            external_tcp_wrench: wire_wrench(&self.robot.wrench),
            jacobian: self.robot.geometry.wire_jacobian(),
            mass_matrix: std::array::from_fn(|i| masses[i / JOINTS][i % JOINTS] as f32),
            gravity: narrow(&gravity),
        }
    }
}
