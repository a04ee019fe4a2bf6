//! Poses of the arms' links, as lines between joint origins: from the joint positions that running nets measure or
//! command, or else from the driver's diagnosis file, written once per second. Run by the serving thread.

use rcc_config::DeviceConfig;
use rcc_core::frame::joints_from;
use rcc_core::kinematics::Arm;
use rcc_core::pose::Pose;
use rcc_language::structure::NetStructure;
use serde_json::{Value, json};

use super::devices;
use super::values::Column;

/// Rate at which the ports of running nets are sampled, Hz.
pub const RATE: f64 = 30.0;

/// An arm of the cell.
#[derive(Clone, Debug)]
pub struct ArmModel {
    /// Name of the device.
    pub device: String,
    /// Name of the robot.
    pub robot: String,
    /// Names of the joints.
    pub joints: Vec<String>,
    /// Range of each joint, rad; m for linear axes.
    pub ranges: Vec<[f64; 2]>,
    /// The joints are linear axes.
    pub linear: bool,
    arm: Arm,
    base: Pose,
}

/// A port that shows where an arm is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArmPort {
    /// Index of the arm.
    pub arm: usize,
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// `primitive.port`.
    pub port: String,
    /// True for measured positions, false for commanded ones.
    pub measured: bool,
}

/// The arms of the cell.
#[derive(Clone, Debug, Default)]
pub struct Arms {
    /// The arms, in the order of the cell's devices.
    pub models: Vec<ArmModel>,
    /// At most one port for each arm.
    pub ports: Vec<ArmPort>,
}

impl ArmModel {
    /// Returns the model of a device; `None` if it has no arm.
    #[must_use]
    pub fn of(device: &DeviceConfig) -> Option<ArmModel> {
        let robot = device.robot.as_ref()?;
        Some(ArmModel {
            device: device.name.clone(),
            robot: robot.name.clone(),
            joints: robot
                .joints
                .iter()
                .map(|joint| joint.name.clone())
                .collect(),
            ranges: robot
                .joints
                .iter()
                .map(|joint| [joint.lower_rad, joint.upper_rad])
                .collect(),
            linear: robot.arm.is_linear(),
            arm: robot.arm,
            base: device.base,
        })
    }

    /// Returns the ends of the links in the cell's frame, the flange's pose and the joints, for the page; `None` if a
    /// position is not known.
    #[must_use]
    pub fn placed(&self, joints: &[f64], source: &str) -> Option<Value> {
        let position = joints_from(joints)?;
        if joints.len() != self.arm.joints() || joints.iter().any(|joint| !joint.is_finite()) {
            return None;
        }
        let points = self.arm.link_points(&position);
        let origins = points.as_slice().iter().map(|point| {
            let turned = self.base.rotate(*point);
            [0, 1, 2].map(|axis| turned[axis] + self.base.position[axis])
        });
        let origins: Vec<[f64; 3]> = origins.collect();
        let flange = self.base.compose(&self.arm.forward(&position));
        Some(json!({
            "device": self.device, "source": source, "joints": joints, "origins": origins,
            "flange": {"position": flange.position, "rotation": flange.rotation_matrix()},
        }))
    }
}

impl Arms {
    /// Returns the patterns of the ports that show the arms.
    #[must_use]
    pub fn patterns(&self) -> Vec<String> {
        let ports = self.ports.iter();
        ports
            .map(|port| format!("{}#{}/{}", port.net, port.id, port.port))
            .collect()
    }

    /// Returns the port of a net that shows an arm: a measured position if there is one, else a commanded one.
    #[must_use]
    pub fn port_of(
        &self,
        arm: usize,
        (id, net): (u64, &str),
        structure: &NetStructure,
    ) -> Option<ArmPort> {
        let device = &self.models.get(arm)?.device;
        let of_device = |primitive: &&rcc_language::structure::PrimitiveInfo| {
            primitive.device.as_ref() == Some(device)
        };
        let find = |type_name: &str| {
            let mut all = structure.primitives.iter().filter(of_device);
            all.find(|primitive| primitive.type_name == type_name)
        };
        let (primitive, measured) = match find("JointState") {
            Some(primitive) => (primitive, true),
            None => (find("JointPositionCommand")?, false),
        };
        Some(ArmPort {
            arm,
            id,
            net: net.to_owned(),
            port: format!("{}.position", primitive.id),
            measured,
        })
    }

    /// Returns the arms whose positions are among the columns, for the page.
    #[must_use]
    pub fn placed(&self, columns: &[Column]) -> Vec<Value> {
        let found = self.ports.iter().filter_map(|port| {
            let mut all = columns.iter();
            let column =
                all.find(|column| column.series.id == port.id && column.series.port == port.port)?;
            let joints = numbers(column.values.last()?)?;
            let source = match port.measured {
                true => format!("measured, by {}#{}", port.net, port.id),
                false => format!("commanded by {}#{}", port.net, port.id),
            };
            self.models.get(port.arm)?.placed(&joints, &source)
        });
        found.collect()
    }

    /// Returns the arms that no port shows, from their drivers' files.
    #[must_use]
    pub fn told_by_drivers(&self, cell: &str) -> Vec<Value> {
        let all = self.models.iter().enumerate();
        let without = all.filter(|(arm, _)| self.ports.iter().all(|port| port.arm != *arm));
        let found = without.filter_map(|(_, model)| {
            let diagnosis = devices::diagnosis(cell, &model.device)?;
            model.placed(
                &numbers(&diagnosis["position"])?,
                "measured, told by the driver each second",
            )
        });
        found.collect()
    }
}

/// Returns the numbers of a list; `None` if one of them is null.
fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(Value::as_f64).collect()
}
