//! The monitoring message of the simulated cabinet.
//! Pure; run by the clock thread once per tick.

use super::Joints;
use super::cabinet::Cabinet;
use super::pose::{REDUNDANT_JOINT, to_wire};
use super::settings::{OverlayMode, law_on_wire};
use crate::fri_iiwa::wire::schema::{
    CartesianVector, Connection, Header, Interpolator, JointValues, MonitorData, Monitoring,
    Redundancy, Robot, TimeStamp,
};
use crate::fri_iiwa::wire::{JOINTS, MONITORING_ID, Overlay, Version};
use crate::sim::arm::dynamics::{friction_torque, gravity_torque};
use crate::sim::arm::model::geometry;

impl Cabinet {
    pub(super) fn message(&self) -> Monitoring {
        Monitoring {
            header: Some(Header {
                identifier: Some(MONITORING_ID),
                sequence: Some(self.sequence()),
                reflected: Some(self.last_answer.unwrap_or(0)),
            }),
            robot: Some(Robot {
                joints: Some(JOINTS as i32),
                safety: Some(self.safety as i32),
                drives: vec![self.drives as i32; JOINTS],
                operation: Some(self.settings.selector.on_wire() as i32),
                control: Some(law_on_wire(self.law()) as i32),
            }),
            data: Some(self.monitor_data()),
            connection: Some(Connection {
                session: Some(self.session() as i32),
                quality: Some(self.quality.quality() as i32),
                send_period_ms: Some(self.settings.period_ms),
                receive_multiplier: Some(self.settings.multiplier),
            }),
            interpolator: self.has_motion().then(|| self.interpolator()),
            ..Monitoring::default()
        }
    }

    /// Torques hold the external wrench, the weight of the links and friction, no inertia; they are approximate, as the
    /// masses are.
    fn monitor_data(&self) -> MonitorData {
        let (version, model) = (self.settings.version, self.settings.arm.model());
        let external = self.robot.geometry.joint_torque(&self.robot.wrench);
        let gravity = gravity_torque(model, &self.robot.arm.position);
        let friction = friction_torque(model, &self.robot.arm.velocity);
        let measured: Joints =
            std::array::from_fn(|joint| external[joint] + gravity[joint] + friction[joint]);
        let held: Joints = std::array::from_fn(|joint| gravity[joint] + friction[joint]);
        let second = version.is_second();
        let [fx, fy, fz, tx, ty, tz] = self.robot.wrench;
        MonitorData {
            measured_position: values(&self.robot.arm.position),
            measured_torque: values(&measured),
            commanded_position: (!second).then(|| all(&self.robot.desired)),
            commanded_torque: values(&held),
            external_torque: values(&external),
            external_force: (version == Version::V2_7).then(|| CartesianVector {
                element: vec![fx, fy, fz, tz, ty, tx],
            }),
            io: match version.has_io() {
                true => self.station.listed(),
                false => Vec::new(),
            },
            measured_pose: second.then(|| to_wire(&self.robot.geometry)),
            redundancy: second.then(|| redundancy(&self.robot.arm.position)),
            timestamp: Some(TimeStamp {
                seconds: Some(self.robot.time_s as u32),
                nanoseconds: Some((self.robot.time_s.fract() * 1e9) as u32),
            }),
        }
    }

    fn interpolator(&self) -> Interpolator {
        let second = self.settings.version.is_second();
        let own = geometry(self.settings.arm.model(), &self.interpolated);
        Interpolator {
            position: values(&self.interpolated),
            pose: second.then(|| to_wire(&own)),
            redundancy: second.then(|| redundancy(&self.interpolated)),
            command_mode: Some(self.settings.overlay.on_wire() as i32),
            overlay: Some(match self.settings.overlay {
                OverlayMode::CartesianPose => Overlay::Cartesian as i32,
                _ => Overlay::Joint as i32,
            }),
            tracking_performance: Some(f64::from(u8::from(self.is_commanded()))),
        }
    }
}

fn redundancy(position: &Joints) -> Redundancy {
    Redundancy {
        strategy: Some(0),
        value: Some(position[REDUNDANT_JOINT]),
    }
}

fn all(joints: &Joints) -> JointValues {
    JointValues {
        value: joints.to_vec(),
    }
}

fn values(joints: &Joints) -> Option<JointValues> {
    Some(all(joints))
}
