//! `PoseInvert`: the pose of a in b from the pose of b in a.

use crate::frame::Frame;
use crate::primitive::{Entry, Kernel, Port, Spec, each};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "PoseInvert",
        summary: "The inverse of a pose.",
        inputs: &[Port::typed("in", Type::Pose, "pose of frame B in frame A")],
        outputs: &[Port::typed("out", Type::Pose, "pose of frame A in frame B")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [input, out]: [u32; 2]) {
    let pose = frame.pose(input).inverse();
    frame.set_pose(out, pose);
}

#[cfg(test)]
mod tests {
    use crate::pose::Pose;
    use crate::testing::Bench;

    #[test]
    fn a_pose_and_its_inverse_cancel() {
        let pose = Pose::from_xyz_rpy([0.4, -0.1, 0.7], [0.3, -1.1, 2.2]);
        let mut bench = Bench::new("PoseInvert");
        let out = bench
            .set_reals("in", &pose.to_slots())
            .step()
            .reals("out", 7);
        let inverse = Pose::from_slots(out.try_into().unwrap());
        let both = pose.compose(&inverse).to_slots();
        for (got, want) in both.iter().zip([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]) {
            assert!((got.abs() - want).abs() < 1e-15, "{both:?}");
        }
    }

    #[test]
    fn null_makes_every_element_null() {
        let mut bench = Bench::new("PoseInvert");
        assert!(
            bench
                .step()
                .reals("out", 7)
                .iter()
                .all(|value| value.is_nan())
        );
    }
}
