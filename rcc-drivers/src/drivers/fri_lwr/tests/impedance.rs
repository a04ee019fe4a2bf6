//! Impedance set-points, from the command board to the bytes of the answer, against the simulated controller.

use rcc_core::impedance::{ControlMode, Impedance};

use super::*;
use crate::fri_lwr::wire::CMD_SIZE;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::arm::wall_fixture::{
    JointLoad, assert_joint_stiffness, assert_stiffness, wall_behind,
};

const CARTESIAN: ControlLaw = ControlLaw::CartesianImpedance;
const JOINT: ControlLaw = ControlLaw::JointImpedance;

/// Returns a ready fixture whose controller runs this strategy.
fn bench(strategy: ControlLaw) -> FriFixture {
    let mut bench = FriFixture::new();
    bench.krc = Krc::new(KrcSettings {
        strategy,
        ..KrcSettings::default()
    });
    bench.wait_for(DeviceState::Ready);
    assert_eq!(bench.faults(), 0);
    bench.answers.clear();
    bench
}

/// Different values along and about x, y and z.
fn soft() -> Impedance {
    Impedance {
        strategy: ControlMode::CartesianImpedance as u64,
        stiffness: [1000.0, 1100.0, 1200.0, 100.0, 110.0, 120.0, 0.0, 0.0],
        damping: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.0, 0.0],
        added: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0],
    }
}

fn joints() -> Impedance {
    Impedance {
        strategy: ControlMode::JointImpedance as u64,
        stiffness: [100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 0.0],
        damping: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.0],
        added: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0.0],
    }
}

fn held(owner: u64, bench: &FriFixture, impedance: Impedance) -> SetPoint {
    SetPoint {
        impedance,
        ..command(owner, bench.measured().hold, false)
    }
}

/// Returns `count` binary32 numbers at a byte offset of the last answer, taken from the layout table.
fn floats(answer: &CommandDatagram, offset: usize, count: usize) -> Vec<f32> {
    let bytes: [u8; CMD_SIZE] = answer.encode();
    let field = bytes[offset..offset + 4 * count].chunks(4);
    field
        .map(|four| f32::from_le_bytes(four.try_into().expect("four bytes")))
        .collect()
}

fn flags_of(answer: &CommandDatagram) -> u32 {
    let bytes = answer.encode();
    u32::from_le_bytes(bytes[140..144].try_into().expect("four bytes"))
}

#[test]
fn cartesian_set_points_go_out_with_their_flags_in_kukas_order() {
    let mut bench = bench(CARTESIAN);
    let entry = held(1, &bench, soft());
    (0..600).for_each(|_| bench.cycle(entry));
    assert_eq!((bench.faults(), bench.state()), (0, DeviceState::Commanded));
    let last = *bench.answers.last().expect("answers");
    // CARTDAMP, CARTSTIFF, TCPFT, CARTPOS, JNTPOS.
    assert_eq!(flags_of(&last), 0x3501);
    assert_eq!(floats(&last, 248, 6), [1.0, 2.0, 3.0, 6.0, 5.0, 4.0]);
    assert_eq!(
        floats(&last, 328, 6),
        [1000.0, 1100.0, 1200.0, 120.0, 110.0, 100.0]
    );
    assert_eq!(floats(&last, 352, 6), [0.1, 0.2, 0.3, 0.6, 0.5, 0.4]);
    // Fields of the other strategy stay zero.
    assert_eq!(floats(&last, 220, 7), [0.0; 7]);
    assert_eq!(floats(&last, 272, 14), [0.0; 14]);
}

#[test]
fn joint_set_points_go_out_with_their_flags() {
    let mut bench = bench(JOINT);
    let entry = held(1, &bench, joints());
    (0..600).for_each(|_| bench.cycle(entry));
    assert_eq!((bench.faults(), bench.state()), (0, DeviceState::Commanded));
    let last = *bench.answers.last().expect("answers");
    // JNTDAMP, JNTSTIFF, JNTTRQ, JNTPOS.
    assert_eq!(flags_of(&last), 0x0035);
    assert_eq!(floats(&last, 220, 7), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    assert_eq!(
        floats(&last, 272, 7),
        [100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0]
    );
    assert_eq!(floats(&last, 300, 7), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]);
    assert_eq!(floats(&last, 248, 6), [0.0; 6]);
    assert_eq!(floats(&last, 328, 12), [0.0; 12]);
}

#[test]
fn the_flags_are_the_same_from_the_first_answer_to_the_last() {
    for (strategy, flags) in [
        (ControlLaw::Position, 0x1),
        (CARTESIAN, 0x3501),
        (JOINT, 0x35),
    ] {
        let mut bench = FriFixture::new();
        bench.krc = Krc::new(KrcSettings {
            strategy,
            ..KrcSettings::default()
        });
        // The controller sends first, so its strategy is known from the first answer on.
        bench.wait_for(DeviceState::Ready);
        assert!(bench.answers.len() > 100);
        assert!(bench.answers.iter().all(|answer| flags_of(answer) == flags));
        // All fields that the flags select are within their ranges.
        assert_eq!(bench.faults(), 0);
    }
}

#[test]
fn a_motion_in_cartesian_impedance_commands_the_pose_of_its_joints() {
    let mut bench = bench(CARTESIAN);
    let hold = bench.measured().hold;
    for cycle in 0..=500 {
        let mut entry = held(1, &bench, soft());
        entry.position = hold;
        entry.position[0] += 0.3 * part(cycle, 500);
        entry.impedance.added = [0.0; JOINTS_MAX];
        bench.cycle(entry);
    }
    bench.wait_for(DeviceState::Ready);
    // In each cycle the controller compares the pose with the joint positions: tolerance 1 mm, 0.01 rad.
    assert_eq!(bench.faults(), 0);
    assert_eq!(bench.measured().hold[0], hold[0] + 0.3);
    let place = |answer: &CommandDatagram| [3, 7, 11].map(|place| answer.cartesian_position[place]);
    let end = bench.answers.last().expect("answers");
    let (first, last) = (place(&bench.answers[0]), place(end));
    let turned = |angle: f32| {
        [
            first[0] * angle.cos() - first[1] * angle.sin(),
            first[0] * angle.sin() + first[1] * angle.cos(),
            first[2],
        ]
    };
    for (is, wanted) in last.into_iter().zip(turned(0.3)) {
        assert!((is - wanted).abs() < 1e-5, "{is} {wanted}");
    }
}

#[test]
fn null_and_the_loss_of_the_executor_take_the_force_away_and_keep_the_springs() {
    for lost in [false, true] {
        let mut bench = bench(CARTESIAN);
        let entry = held(1, &bench, soft());
        (0..600).for_each(|_| bench.cycle(entry));
        for _ in 0..600 {
            if lost {
                bench.now_ns += MS;
                bench.exchange();
            } else {
                bench.cycle(SetPoint::NONE);
            }
        }
        assert_eq!(bench.faults(), 0);
        let last = *bench.answers.last().expect("answers");
        assert_eq!(floats(&last, 248, 6), [0.0; 6], "lost: {lost}");
        assert_eq!(
            floats(&last, 328, 6),
            [1000.0, 1100.0, 1200.0, 120.0, 110.0, 100.0]
        );
        assert_ne!(bench.state(), DeviceState::Commanded);
    }
}

#[test]
fn a_net_for_another_strategy_is_not_followed_and_the_driver_says_why() {
    let strategies = [ControlLaw::Position, CARTESIAN, JOINT];
    let asked = [Impedance::NONE, soft(), joints()];
    for (runs, strategy) in strategies.into_iter().enumerate() {
        for (wants, impedance) in asked.into_iter().enumerate() {
            let mut bench = bench(strategy);
            assert_eq!(bench.measured().strategy, runs as u64);
            let mut entry = held(1, &bench, impedance);
            entry.position[0] += 1e-4;
            (0..50).for_each(|_| bench.cycle(entry));
            let followed = bench.state() == DeviceState::Commanded;
            assert_eq!(followed, runs == wants, "{runs} {wants}");
            if !followed {
                assert_eq!(bench.measured().reason, reason::STRATEGY);
                let first = bench.answers[0].joint_position;
                assert!(
                    bench
                        .answers
                        .iter()
                        .all(|answer| answer.joint_position == first)
                );
            }
        }
    }
}

#[test]
fn without_limits_of_impedance_the_device_is_not_ready_in_it() {
    let mut device = lwr();
    let robot = device.robot.as_mut().expect("an arm");
    robot.impedance = None;
    let mut bench = FriFixture::new();
    bench.fri = FriSession::new(&device, SessionSettings::default()).expect("7 joints");
    bench.session = DeviceSession::new(&device, 0);
    bench.krc = Krc::new(KrcSettings {
        strategy: CARTESIAN,
        ..KrcSettings::default()
    });
    (0..500).for_each(|_| bench.cycle(SetPoint::NONE));
    assert_eq!(bench.state(), DeviceState::Online);
    assert_eq!(bench.measured().reason, STRATEGY);
}

#[test]
fn the_driver_checks_each_set_point_again() {
    let bad: [fn(&mut Impedance); 4] = [
        |impedance| impedance.stiffness[2] = 6000.0,
        |impedance| impedance.damping[2] = 1.5,
        |impedance| impedance.added[2] = 500.0,
        |impedance| impedance.stiffness[2] += 50.0,
    ];
    for change in bad {
        let mut bench = bench(CARTESIAN);
        let entry = held(1, &bench, soft());
        (0..600).for_each(|_| bench.cycle(entry));
        let mut wrong = entry;
        change(&mut wrong.impedance);
        (0..50).for_each(|_| bench.cycle(wrong));
        assert_eq!(
            (bench.faults(), bench.measured().reason),
            (0, reason::LIMIT)
        );
        assert!(bench.session.violation().is_some());
    }
}

#[test]
fn an_invalid_pose_is_not_commanded() {
    let mut wrong = measurement(1);
    wrong.control = FriControlStrategy::CartesianImpedance;
    wrong.commanded_pose = [0.0; 12];
    let mut session = session();
    for sequence in 1..20 {
        wrong.send_sequence = sequence;
        assert!(session.accept(&wrong.encode()));
    }
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    assert_eq!((exchange.commandable, exchange.reason), (false, POSE));
}

/// Returns a bench whose arm has been pressed for 4 s into a wall that stands 5 mm behind the commanded flange, with its
/// normal along `axis`.
fn pressed(strategy: ControlLaw, impedance: Impedance, axis: usize) -> FriFixture {
    let mut bench = bench(strategy);
    let hold = bench.measured().hold;
    let flange = lwr().model().arm.expect("kinematics").forward(&hold);
    let wall = wall_behind(flange.position, axis);
    bench.krc.execute(wall).expect("a wall");
    let entry = held(1, &bench, impedance);
    (0..4000).for_each(|_| bench.cycle(entry));
    assert_eq!((bench.faults(), bench.state()), (0, DeviceState::Commanded));
    bench
}

#[test]
fn against_a_wall_the_arm_shows_the_cartesian_stiffness_that_was_commanded() {
    for axis in 0..3 {
        for stiffness in [200.0, 1000.0, 4000.0] {
            let mut impedance = Impedance {
                added: Impedance::NONE.added,
                damping: [0.7; JOINTS_MAX],
                ..soft()
            };
            (impedance.damping[6], impedance.damping[7]) = (0.0, 0.0);
            impedance.stiffness[axis] = stiffness;
            let bench = pressed(CARTESIAN, impedance, axis);
            let arm = lwr().model().arm.expect("kinematics");
            let at = |joints: &Joints| arm.forward(joints).position[axis];
            let measured = bench.measured();
            let displacement = at(&measured.position) - at(&measured.hold);
            assert!(displacement > 1e-3);
            assert_stiffness(measured.wrench[axis], displacement, stiffness);
        }
    }
}

#[test]
fn against_a_wall_each_joint_shows_the_stiffness_that_was_commanded() {
    let impedance = Impedance {
        added: Impedance::NONE.added,
        damping: [0.7, 0.7, 0.7, 0.7, 0.7, 0.7, 0.7, 0.0],
        ..joints()
    };
    for axis in 0..3 {
        let bench = pressed(JOINT, impedance, axis);
        let measured = bench.measured();
        let loaded = assert_joint_stiffness(&JointLoad {
            external: &measured.external_torque,
            added: &[0.0; JOINTS_MAX],
            measured: &measured.position,
            held: &measured.hold,
            stiffness: &impedance.stiffness,
        });
        assert!(loaded > 0, "axis {axis}");
    }
}
