//! `SerialArm`: forward kinematics against pinocchio 4.1.0, the Jacobian against differences, and how often, how exactly
//! and in how many steps the numeric inverse finds a pose. Runs off any real-time thread; the data is in
//! `tests/data/kinematics` of the workspace, made by `serial_arms.py` there.

use rcc_core::frame::joints_from;
use rcc_core::kinematics::{
    Arm, JointAxis, PARAMETERS, RESIDUAL_MAX, STEPS_MAX, SerialArm, Unreachable,
};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::pose::Pose;
use rcc_testing::{Random, Rng, arms};

/// A `SerialArm` and the range of its random positions, rad.
struct TestArm {
    name: &'static str,
    arm: SerialArm,
    ranges: Vec<[f64; 2]>,
}

fn test_arms() -> [TestArm; 3] {
    let full = vec![[-std::f64::consts::PI, std::f64::consts::PI]; 6];
    let of = |name, arm, ranges| TestArm { name, arm, ranges };
    [
        of("ur5e", arms::ur5e(), full.clone()),
        of("ur10e", arms::ur10e(), full),
        of("panda", arms::panda(), arms::PANDA_JOINTS.to_vec()),
    ]
}

/// The rows of golden data: joints and flange.
fn golden(name: &str, joints: usize) -> Vec<(Joints, Pose)> {
    let path = format!(
        "{}/../tests/data/kinematics/{name}.csv",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
    let rows = text.lines().skip(1).map(|line| {
        let row: Vec<f64> = line.split(',').map(|x| x.parse().unwrap()).collect();
        let (q, pose) = row.split_at(joints);
        let pose = Pose::from_slots(pose.try_into().unwrap());
        (joints_from(q).unwrap(), pose)
    });
    rows.collect()
}

fn random_joints(ranges: &[[f64; 2]], random: &mut Rng) -> Joints {
    let mut joints = [0.0; JOINTS_MAX];
    for (joint, [lower, upper]) in joints.iter_mut().zip(ranges) {
        *joint = lower + (upper - lower) * random.unit();
    }
    joints
}

#[test]
fn forward_agrees_with_the_golden_data() {
    for TestArm { name, arm, .. } in test_arms() {
        let rows = golden(name, arm.joints());
        assert_eq!(rows.len(), 1000, "{name}");
        let mut worst = 0.0_f64;
        for (joints, want) in rows {
            let got = arm.forward(&joints);
            worst = worst.max(got.distance_to(&want)).max(got.angle_to(&want));
        }
        println!("{name}: {worst:.1e} m or rad");
        assert!(worst < 1e-12, "{name}: {worst}");
    }
}

#[test]
fn the_jacobian_agrees_with_differences() {
    const STEP: f64 = 1e-6;
    let mut random = Rng::with_seed(7);
    for TestArm { name, arm, ranges } in test_arms() {
        for _ in 0..200 {
            let joints = random_joints(&ranges, &mut random);
            let jacobian = Arm::Serial(arm).jacobian(&joints);
            for joint in 0..JOINTS_MAX {
                let moved = |by: f64| {
                    let mut moved = joints;
                    moved[joint] += by;
                    arm.forward(&moved)
                };
                let (before, behind) = (moved(-STEP), moved(STEP));
                let turn = before.orientation_difference(&behind);
                for row in 0..3 {
                    let linear = (behind.position[row] - before.position[row]) / (2.0 * STEP);
                    assert!((jacobian[row][joint] - linear).abs() < 1e-8, "{name}");
                    let angular = turn[row] / (2.0 * STEP);
                    assert!((jacobian[row + 3][joint] - angular).abs() < 1e-8, "{name}");
                }
            }
        }
    }
}

trait Turned {
    /// The rotation vector from this orientation to another one, in base axes.
    fn orientation_difference(&self, other: &Pose) -> [f64; 3];
}

impl Turned for Pose {
    fn orientation_difference(&self, other: &Pose) -> [f64; 3] {
        rcc_core::rotation::log(rcc_core::rotation::product(
            other.orientation,
            rcc_core::rotation::inverse(self.orientation),
        ))
    }
}

/// How often, how exactly and in how many steps poses are found.
struct InverseCounts {
    share: f64,
    worst: f64,
    steps: Vec<u32>,
}

/// Solves 1,000 poses from a hint that `hint` makes of the joints.
fn solved(
    TestArm { arm, ranges, .. }: &TestArm,
    random: &mut Rng,
    hint: impl Fn(&Joints, &mut Rng) -> Joints,
) -> InverseCounts {
    const POSES: usize = 1000;
    let (mut found, mut worst, mut steps) = (0, 0.0_f64, Vec::new());
    for _ in 0..POSES {
        let joints = random_joints(ranges, random);
        let pose = arm.forward(&joints);
        let angle = arm.arm_angle(&joints).unwrap_or(0.0);
        let start = hint(&joints, random);
        let ended = arm.solve(&pose, angle, &start).unwrap();
        assert!(ended.steps <= STEPS_MAX);
        steps.push(ended.steps);
        match arm.inverse(&pose, angle, &start) {
            Ok(solution) => {
                found += 1;
                let there = arm.forward(&solution);
                worst = worst
                    .max(there.distance_to(&pose))
                    .max(there.angle_to(&pose));
            }
            Err(Unreachable::NoSolution { residual }) => assert!(residual > RESIDUAL_MAX),
            Err(other) => panic!("{other}"),
        }
    }
    steps.sort_unstable();
    InverseCounts {
        share: found as f64 / POSES as f64,
        worst,
        steps,
    }
}

#[test]
fn the_inverse_finds_poses_near_its_hint_and_most_far_from_it() {
    for arm in test_arms() {
        let mut random = Rng::with_seed(11);
        let near = |joints: &Joints, random: &mut Rng| {
            joints.map(|q| q + 0.2 * (2.0 * random.unit() - 1.0))
        };
        let far = |_: &Joints, random: &mut Rng| random_joints(&arm.ranges, random);
        let near = solved(&arm, &mut random, near);
        let far = solved(&arm, &mut random, far);
        for (what, counts, least) in [("0.2 rad away", near, 0.98), ("anywhere", far, 0.5)] {
            let InverseCounts {
                share,
                worst,
                steps,
            } = counts;
            let at = |share: f64| steps[((steps.len() - 1) as f64 * share) as usize];
            println!(
                "{}: hint {what}: {:.1} % solved, worst residual {worst:.1e}, steps p50 {} p90 {} p99 {} max {}",
                arm.name,
                100.0 * share,
                at(0.5),
                at(0.9),
                at(0.99),
                at(1.0)
            );
            assert!(share >= least, "{}: hint {what}: {share}", arm.name);
            assert!(worst < 1e-11, "{}: hint {what}: {worst}", arm.name);
        }
    }
}

#[test]
fn a_hint_that_reaches_the_pose_is_the_solution() {
    let mut random = Rng::with_seed(5);
    for TestArm { name, arm, ranges } in test_arms() {
        for _ in 0..200 {
            let joints = random_joints(&ranges, &mut random);
            let angle = arm.arm_angle(&joints).unwrap_or(0.0);
            let found = arm.inverse(&arm.forward(&joints), angle, &joints);
            assert_eq!(found, Ok(joints), "{name}");
        }
    }
}

#[test]
fn joints_follow_a_path_of_small_steps_without_a_jump() {
    let arm = arms::ur5e();
    let mut joints = arms::radians([10.0, -80.0, 100.0, -110.0, -90.0, 20.0]);
    let begin = arm.forward(&joints);
    for step in 1..=1000 {
        let mut pose = begin;
        pose.position[1] += 2e-4 * f64::from(step);
        let next = arm.inverse(&pose, 0.0, &joints).unwrap();
        let ended = arm.solve(&pose, 0.0, &joints).unwrap();
        assert!(ended.residual < 1e-14 && ended.steps <= 3, "{ended:?}");
        for (now, before) in next.iter().zip(joints) {
            assert!((now - before).abs() < 2e-3, "{step}: {next:?}");
        }
        joints = next;
    }
}

#[test]
fn fewer_axes_reach_the_poses_of_their_own_and_no_others() {
    let arm = arms::planar();
    let joints = [0.3, 0.8, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0];
    let pose = arm.forward(&joints);
    let found = arm.inverse(&pose, 0.0, &[0.2, 0.6, -0.2, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let found = found.unwrap();
    for (got, want) in found.iter().zip(joints) {
        assert!((got - want).abs() < 1e-9, "{found:?}");
    }
    let mut above = pose;
    above.position[2] += 1e-3;
    let Err(Unreachable::NoSolution { residual }) = arm.inverse(&above, 0.0, &joints) else {
        panic!("1 mm above the plane")
    };
    assert!((residual - 1e-3).abs() < 1e-9, "{residual}");
    // One axis.
    let one = SerialArm::new(&arm.axes()[..1], arm.flange(), 0).unwrap();
    let found = one
        .inverse(&one.forward(&[1.2; 8]), 0.0, &[0.9; 8])
        .unwrap();
    assert!((found[0] - 1.2).abs() < 1e-12 && found[1..] == [0.0; 7]);
}

#[test]
fn a_redundant_joint_is_where_it_is_wanted() {
    let arm = arms::panda();
    let joints = arms::radians([10.0, 20.0, 5.0, -100.0, 10.0, 120.0, 30.0]);
    let pose = arm.forward(&joints);
    for angle in [-0.3, 0.0, 0.4] {
        let found = arm.inverse(&pose, angle, &joints).unwrap();
        assert_eq!(found[2], angle);
        assert!(arm.forward(&found).distance_to(&pose) < 1e-11);
    }
}

#[test]
fn null_and_poses_out_of_reach_are_refused() {
    for TestArm { arm, .. } in test_arms() {
        let joints = [0.1, -1.0, 0.3, -1.2, 0.2, 1.0, 0.1, 0.0];
        let pose = arm.forward(&joints);
        let null = Err(Unreachable::NotFinite);
        assert_eq!(arm.inverse(&Pose::NULL, 0.0, &joints), null);
        assert_eq!(arm.inverse(&pose, 0.0, &[f64::NAN; 8]), null);
        let far = Pose::from_xyz_rpy([9.0, 0.0, 0.0], [0.0; 3]);
        let ended = arm.solve(&far, 0.0, &joints).unwrap();
        assert!(ended.steps <= STEPS_MAX && ended.residual > 5.0);
        let refused = arm.inverse(&far, 0.0, &joints);
        assert!(matches!(refused, Err(Unreachable::NoSolution { .. })));
    }
    let nan = arms::panda().inverse(&Pose::IDENTITY, f64::NAN, &[0.0; 8]);
    assert_eq!(nan, Err(Unreachable::NotFinite));
}

#[test]
fn half_a_turn_of_the_flange_is_found() {
    let arm = arms::ur5e();
    let joints = arms::radians([10.0, -80.0, 100.0, -110.0, -90.0, 20.0]);
    let mut turned = joints;
    turned[5] += std::f64::consts::PI;
    let pose = arm.forward(&turned);
    let found = arm.inverse(&pose, 0.0, &joints).unwrap();
    assert!(arm.forward(&found).angle_to(&pose) < 1e-11);
}

#[test]
fn a_singularity_is_near_where_the_jacobian_loses_rank() {
    let arm = arms::ur5e();
    let bent = arms::radians([10.0, -80.0, 100.0, -110.0, -90.0, 20.0]);
    assert!(arm.singularity(&bent).distance > 0.05);
    for singular in [
        // Elbow stretched; wrist axes 4 and 6 parallel.
        [10.0, -80.0, 0.0, -110.0, -90.0, 20.0],
        [10.0, -80.0, 100.0, -110.0, 0.0, 20.0],
    ] {
        let near = arm.singularity(&arms::radians(singular));
        assert!(near.distance < 1e-7, "{near:?}");
    }
    let planar = arms::planar();
    assert!(
        planar
            .singularity(&[0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
            .distance
            > 0.05
    );
    assert!(planar.singularity(&[0.0; 8]).distance < 1e-7);
    assert!(planar.singularity(&[f64::NAN; 8]).distance.is_nan());
}

#[test]
fn parameters_make_the_same_arm_again() {
    let fewer = SerialArm::new(&arms::ur5e().axes()[..2], Pose::IDENTITY, 0).unwrap();
    for arm in [arms::ur5e(), arms::panda(), arms::planar(), fewer, gantry()] {
        let (kind, parameters) = Arm::Serial(arm).parameters();
        let again = Arm::from_parameters(kind, &parameters);
        assert_eq!(again, Some(Arm::Serial(arm)));
    }
    assert_eq!(Arm::from_parameters(3, &[f64::NAN; PARAMETERS]), None);
    assert_eq!(Arm::from_parameters(3, &[9.0; PARAMETERS]), None);
}

#[test]
fn an_arm_needs_one_to_seven_axes_with_directions() {
    let axis = |direction| JointAxis {
        point: [0.0; 3],
        direction,
    };
    let up = axis([0.0, 0.0, 3.0]);
    assert_eq!(SerialArm::new(&[], Pose::IDENTITY, 0), None);
    assert_eq!(SerialArm::new(&[up; 8], Pose::IDENTITY, 0), None);
    assert_eq!(SerialArm::new(&[up; 7], Pose::IDENTITY, 7), None);
    assert_eq!(SerialArm::new(&[axis([0.0; 3])], Pose::IDENTITY, 0), None);
    assert_eq!(SerialArm::new(&[up], Pose::NULL, 0), None);
    let arm = SerialArm::new(&[up], Pose::IDENTITY, 0).unwrap();
    assert_eq!(arm.axes(), [axis([0.0, 0.0, 1.0])]);
}

/// A gantry: along x, then along a slanted axis, then down.
fn gantry() -> SerialArm {
    let axis = |point, direction| JointAxis { point, direction };
    let axes = [
        axis([0.0, 0.0, 1.0], [2.0, 0.0, 0.0]),
        axis([0.5, 0.1, 1.0], [0.0, 0.6, 0.8]),
        axis([0.5, 0.4, 1.2], [0.0, 0.0, -1.0]),
    ];
    let flange = Pose::from_xyz_rpy([0.5, 0.4, 0.9], [std::f64::consts::PI, 0.0, 0.3]);
    SerialArm::of_linear_axes(&axes, flange).unwrap()
}

#[test]
fn linear_axes_move_the_flange_along_their_directions_and_never_turn_it() {
    let (arm, mut random) = (Arm::Serial(gantry()), Rng::with_seed(4));
    let zero = arm.forward(&[0.0; JOINTS_MAX]);
    for _ in 0..1000 {
        let mut joints = [0.0; JOINTS_MAX];
        for joint in joints.iter_mut().take(3) {
            *joint = random.uniform(-20.0, 20.0);
        }
        let [x, slant, down, ..] = joints;
        let pose = arm.forward(&joints);
        let want = [x, 0.6 * slant, 0.8 * slant - down];
        let moved = rcc_core::vector::subtract(pose.position, zero.position);
        for (have, want) in moved.into_iter().zip(want) {
            assert!((have - want).abs() < 1e-12, "{moved:?}");
        }
        assert!(pose.angle_to(&zero) < 1e-12);
        // From a hint far away: no joint is shifted by turns, as an angle would be.
        let hint = [7.0, -9.0, 13.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let found = arm.inverse(&pose, 0.0, arm.branch(&joints), &hint).unwrap();
        for (have, want) in found.into_iter().zip(joints) {
            assert!((have - want).abs() < 1e-9, "{found:?} {joints:?}");
        }
    }
    let jacobian = arm.jacobian(&[0.3; JOINTS_MAX]);
    let column = |joint: usize| jacobian.map(|row| row[joint]);
    assert_eq!(column(0), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(column(1), [0.0, 0.6, 0.8, 0.0, 0.0, 0.0]);
    assert_eq!(column(3), [0.0; 6]);
    assert!(arm.singularity(&[0.0; JOINTS_MAX]).distance > 0.1);
}

#[test]
fn linear_axes_reach_no_other_orientation_and_none_is_redundant() {
    let arm = Arm::Serial(gantry());
    assert!(arm.is_linear() && !Arm::Serial(arms::ur5e()).is_linear());
    let turned = Pose::from_xyz_rpy([0.5, 0.4, 0.9], [0.0, 0.0, 0.0]);
    let found = arm.inverse(&turned, 0.0, arm.branch(&[0.0; 8]), &[0.0; 8]);
    assert!(
        matches!(found, Err(Unreachable::NoSolution { .. })),
        "{found:?}"
    );
    let up = JointAxis {
        point: [0.0; 3],
        direction: [0.0, 0.0, 1.0],
    };
    assert_eq!(SerialArm::of_linear_axes(&[up; 7], Pose::IDENTITY), None);
    assert_eq!(SerialArm::of_linear_axes(&[], Pose::IDENTITY), None);
}
