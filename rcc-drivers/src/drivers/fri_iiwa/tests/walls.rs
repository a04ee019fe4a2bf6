//! The arm pressed against a virtual wall, from the command board to the measured force: driver and simulated cabinet in
//! virtual time, with steps of 1 ms.

use std::path::Path;

use rcc_config::{CellConfig, RobotConfig};
use rcc_core::impedance::{ControlMode, Impedance};
use rcc_core::message::{CommandImage, DeviceState, Joints, Measurement, SetPoint};

use super::*;
use crate::sim::arm::impedance::{ControlLaw, ImpedanceSettings};
use crate::sim::arm::wall_fixture::{
    JointLoad, assert_joint_stiffness, assert_stiffness, wall_behind,
};
use crate::sim::iiwa::cabinet::Cabinet;
use crate::sim::iiwa::settings::{OverlayMode, Settings as CabinetSettings};
use rcc_driver_kit::host::device_session::DeviceSession;

const MS: u64 = 1_000_000;
/// Stiffness about the axes, N·m/rad.
const ROTATION: f64 = 200.0;
const DAMPING: f64 = 0.7;

/// Returns the iiwa of the cell for impedance control, described by `robot`, whose application has springs with this
/// stiffness along the axes (N/m) or in the joints (N·m/rad).
fn sprung_iiwa(robot: &str, stiffness: f64) -> DeviceConfig {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs");
    let cell = CellConfig::load_offline(&configs.join("cells/iiwa-impedance.yaml"));
    let cell = cell.expect("the example's configuration");
    let mut device = cell.device("iiwa").expect("the example's arm").1.clone();
    let springs = device.robot.as_ref().and_then(|robot| robot.impedance);
    let path = configs.join("robots").join(robot);
    let text = std::fs::read_to_string(&path).expect("a robot's file");
    let mut robot = RobotConfig::parse(&text, robot).expect("a valid robot's file");
    let mut springs = springs.expect("the example's springs");
    (springs.translation, springs.joint) = ([stiffness; 2], [stiffness; 2]);
    springs.rotation = [ROTATION; 2];
    springs.damping = [DAMPING; 2];
    robot.impedance = Some(springs);
    device.robot = Some(robot);
    device
}

/// Cabinet, driver and executor in one virtual time.
struct IiwaFixture {
    device: DeviceConfig,
    cabinet: Cabinet,
    dialogue: IiwaSession,
    session: DeviceSession,
    image: CommandImage,
    now_ns: u64,
}

impl IiwaFixture {
    fn ready(device: DeviceConfig, version: Version, overlay: OverlayMode) -> Self {
        let law = overlay.needed_law().expect("an overlay of forces");
        let springs = device.robot.as_ref().and_then(|robot| robot.impedance);
        let stiffness = springs.expect("springs").joint[0];
        let mut impedance = ImpedanceSettings::default_for(law);
        impedance.stiffness = [stiffness; JOINTS];
        if law == ControlLaw::CartesianImpedance {
            impedance.stiffness[3..6].fill(ROTATION);
        }
        let mut fixture = Self {
            cabinet: Cabinet::new(CabinetSettings {
                version,
                overlay,
                law,
                impedance,
                ..CabinetSettings::default()
            }),
            dialogue: session_of(&device, version),
            session: DeviceSession::new(&device, 0),
            image: CommandImage::new(1, MS),
            now_ns: 0,
            device,
        };
        for _ in 0..5000 {
            if fixture.state() == DeviceState::Ready {
                return fixture;
            }
            fixture.cycle(SetPoint::NONE);
        }
        panic!("not ready: {:?}", fixture.cabinet.snapshot());
    }

    fn measured(&self) -> &Measurement {
        self.session.measurement()
    }

    fn state(&self) -> DeviceState {
        DeviceState::from_number(self.measured().state)
    }

    fn cycle(&mut self, entry: SetPoint) {
        self.now_ns += MS;
        let next = self.image.head.sequence + 1;
        self.image.push(next, self.now_ns, entry);
        let bytes = self.cabinet.tick(1).expect("the session is open");
        self.dialogue.accept(&bytes).expect("a good message");
        let mut inputs = Inputs::NONE;
        let exchange = self.dialogue.exchange(&mut inputs);
        self.session.observe(self.now_ns, Some(&self.image));
        let outputs = self.session.exchange(self.now_ns, &inputs, &exchange);
        let answer = self.dialogue.answer(&outputs).expect("an answer is due");
        self.cabinet.receive(&answer, 1e-4).expect("a good answer");
    }

    /// Returns the flange in the frame of the robot's file, m.
    fn flange(&self, joints: &Joints) -> [f64; 3] {
        let arm = self.device.model().arm.expect("kinematics");
        arm.forward(joints).position
    }

    /// Presses the arm for 3 s into a wall whose normal is `axis` of the cabinet's base.
    fn press(&mut self, axis: usize, strategy: ControlMode, stiffness: f64) {
        let wall = wall_behind(self.cabinet.snapshot().robot.flange_position, axis);
        self.cabinet.execute(wall).expect("a wall");
        let mut impedance = Impedance {
            strategy: strategy as u64,
            ..Impedance::NONE
        };
        let elements = match strategy {
            ControlMode::CartesianImpedance => 6,
            _ => JOINTS,
        };
        impedance.stiffness[..elements].fill(stiffness);
        if strategy == ControlMode::CartesianImpedance {
            impedance.stiffness[3..6].fill(ROTATION);
        }
        impedance.damping[..elements].fill(DAMPING);
        impedance.added = [0.0; JOINTS_MAX];
        let entry = SetPoint {
            owner: 1,
            has_position: 1,
            position: self.measured().hold,
            impedance,
            ..SetPoint::NONE
        };
        (0..3000).for_each(|_| self.cycle(entry));
        let faults = self.cabinet.snapshot().robot.faults;
        assert!(faults.is_empty(), "{faults:?}");
        assert_eq!(self.state(), DeviceState::Commanded);
    }
}

#[test]
fn against_a_wall_each_joint_shows_the_stiffness_of_the_application() {
    let rows = [
        (Version::V1_11, 0, 200.0),
        (Version::V1_14, 1, 700.0),
        (Version::V2_5, 2, 1000.0),
        (Version::V2_7, 0, 2000.0),
    ];
    for (version, axis, stiffness) in rows {
        let device = sprung_iiwa("iiwa7.yaml", stiffness);
        let mut fixture = IiwaFixture::ready(device, version, OverlayMode::Torque);
        fixture.press(axis, ControlMode::JointImpedance, stiffness);
        let measured = fixture.measured();
        let loaded = assert_joint_stiffness(&JointLoad {
            external: &measured.external_torque,
            added: &[0.0; JOINTS_MAX],
            measured: &measured.position,
            held: &measured.hold,
            stiffness: &[stiffness; JOINTS],
        });
        assert!(loaded > 0, "{version:?} axis {axis}");
    }
}

#[test]
fn against_a_wall_the_flange_shows_the_stiffness_of_the_application_in_the_frame_of_the_robots_file()
 {
    // Only 2.7 tells the force at the flange.
    for robot in ["iiwa7.yaml", "iiwa7_turned.yaml"] {
        for (axis, stiffness) in [(0, 500.0), (1, 2000.0), (2, 4000.0)] {
            let device = sprung_iiwa(robot, stiffness);
            let mut fixture = IiwaFixture::ready(device, Version::V2_7, OverlayMode::Wrench);
            fixture.press(axis, ControlMode::CartesianImpedance, stiffness);
            let measured = fixture.measured();
            let (is, held) = (measured.position, measured.hold);
            let displacement = fixture.flange(&is)[axis] - fixture.flange(&held)[axis];
            assert!(displacement.abs() > 1e-4, "{robot} axis {axis}");
            assert_stiffness(measured.wrench[axis], displacement, stiffness);
        }
    }
}
