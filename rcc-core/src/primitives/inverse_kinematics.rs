//! `InverseKinematics`: joint positions of a seven-joint arm for a flange pose.
//!
//! The arm angle and the branch (signs of joints 2, 4, 6) are those of the arm's hold set-point when
//! the command becomes ready, and stay: the same pose always gives the same joints. Where an angle
//! is not determined (a stretched joint) the last solution decides.

use crate::frame::{Frame, Preparation, PrepareFault};
use crate::kinematics::Branch;
use crate::message::Joints;
use crate::primitive::{Entry, Kernel, Parameter, Port, PortType, Spec, State, UnitRule, each};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "InverseKinematics",
        summary: "Joint positions for a flange pose, with the arm angle and branch of the start.",
        null: "a null or unreachable pose gives null; joint limits are the guard's business",
        undefined: "the pose cannot be reached",
        inputs: &[Port::typed("pose", Type::Pose, "flange in the arm's base")],
        outputs: &[Port::new(
            "joints",
            PortType::Joints,
            UnitRule::Is(Unit::RADIAN),
            "joint positions, A1 first",
        )],
        parameters: &[Parameter::arm()],
        // arm angle, number of the branch, seven hint joints
        state: State {
            reals: 9,
            ..State::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
)
.prepared_by(prepare);

fn prepare(preparation: &mut Preparation<'_>, operands: &[u32]) -> Result<(), PrepareFault> {
    let &[_pose, _joints, device, state, _width] = operands else {
        return Ok(());
    };
    let (arm, hold) = preparation.arm_at_rest(device)?;
    let branch = f64::from(arm.branch(&hold).index());
    preparation.set_reals(state, [arm.arm_angle(&hold), branch]);
    preparation.set_reals(state + 2, hold);
    Ok(())
}

fn step(frame: &mut Frame<'_>, [pose, joints, device, state, width]: [u32; 5]) {
    let [angle, branch] = frame.reals(state);
    let hint: [f64; 7] = frame.reals(state + 2);
    let pose = frame.pose(pose);
    let solution = match (frame.arm(device), Branch::from_index(branch as u8)) {
        (Some(arm), Some(branch)) => arm.inverse(&pose, angle, branch, &hint).ok(),
        _ => None,
    };
    if let Some(solution) = solution {
        frame.set_reals(state + 2, solution);
    }
    frame.set_joints(joints, width, solution.map(padded).as_ref());
}

fn padded([q1, q2, q3, q4, q5, q6, q7]: [f64; 7]) -> Joints {
    [q1, q2, q3, q4, q5, q6, q7, 0.0]
}

#[cfg(test)]
mod tests {
    use crate::frame::PrepareFault;
    use crate::testing::Bench;

    const HOLD: [f64; 8] = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];

    #[test]
    fn the_pose_of_the_start_gives_the_joints_of_the_start() {
        let mut bench = Bench::new("InverseKinematics");
        bench.hold = Some(HOLD);
        bench.prepare().unwrap();
        let q: [f64; 7] = HOLD[..7].try_into().unwrap();
        let pose = bench.model.arm.unwrap().forward(&q).to_slots();
        let joints = bench.set_reals("pose", &pose).step().reals("joints", 7);
        for (got, want) in joints.iter().zip(q) {
            assert!((got - want).abs() < 1e-12, "{joints:?}");
        }
    }

    #[test]
    fn an_unreachable_or_null_pose_gives_null() {
        let mut bench = Bench::new("InverseKinematics");
        bench.hold = Some(HOLD);
        bench.prepare().unwrap();
        for pose in [[9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], [f64::NAN; 7]] {
            assert!(
                bench
                    .set_reals("pose", &pose)
                    .step()
                    .reals("joints", 7)
                    .iter()
                    .all(|q| q.is_nan())
            );
        }
    }

    #[test]
    fn without_a_known_hold_position_it_cannot_become_ready() {
        let mut bench = Bench::new("InverseKinematics");
        bench.hold = None;
        assert_eq!(
            bench.prepare(),
            Err(PrepareFault::HoldUnknown { device: 0 })
        );
    }
}
