//! `PoseCompose`: the pose of c in a, from b in a and c in b: out = a · b.

use crate::frame::Frame;
use crate::primitive::{Entry, Example, Kernel, Port, Spec, each};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "PoseCompose",
        summary: "Chains two poses: the second is given in the frame of the first.",
        examples: &[Example::new("a step ahead after a turn to the left", "", "
            a                                       | b                | out
            {xyz: [1, 2, 0], rpy: [0, 0, deg(90)]} | {xyz: [3, 0, 0], rpy: [0, 0, 0]} | {xyz: [1, 5, 0], rpy: [0, 0, deg(90)]}
        ")],
        inputs: &[
            Port::typed("a", Type::Pose, "pose of frame B in frame A"),
            Port::typed("b", Type::Pose, "pose of frame C in frame B"),
        ],
        outputs: &[Port::typed("out", Type::Pose, "pose of frame C in frame A")],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [a, b, out]: [u32; 3]) {
    let pose = frame.pose(a).compose(&frame.pose(b));
    frame.set_pose(out, pose);
}

#[cfg(test)]
mod tests {
    use core::f64::consts::FRAC_1_SQRT_2;

    use crate::testing::Bench;

    #[test]
    fn the_second_pose_is_turned_by_the_first() {
        let mut bench = Bench::new("PoseCompose");
        // 90° about z, then 1 m along its x, which is the outer y.
        bench.set_reals(
            "a",
            &[1.0, 2.0, 3.0, 0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2],
        );
        bench.set_reals("b", &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let out = bench.step().reals("out", 7);
        for (got, want) in out
            .iter()
            .zip([1.0, 3.0, 3.0, 0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2])
        {
            assert!((got - want).abs() < 1e-15, "{out:?}");
        }
    }

    #[test]
    fn null_makes_every_element_null() {
        let mut bench = Bench::new("PoseCompose");
        bench.set_reals("a", &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        bench.set_reals("b", &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, f64::NAN]);
        assert!(
            bench
                .step()
                .reals("out", 7)
                .iter()
                .all(|value| value.is_nan())
        );
    }
}
