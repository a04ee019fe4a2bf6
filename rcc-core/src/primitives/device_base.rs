//! `DeviceBase`: the pose of an arm's base in the world frame of its cell.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{CatalogueEntry, Example, Kernel, Parameter, Port, Spec, each};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "DeviceBase",
        summary: "The pose of an arm's base in the world frame, from the cell's configuration (`base`).",
        outputs: &[Port::typed(
            "pose",
            Type::Pose,
            "the arm's base in the world frame of the cell",
        )],
        parameters: &[Parameter::arm()],
        examples: &[Example::new(
            "an arm whose base is the world frame",
            "{device: lwr}",
            "pose\n {xyz: [0, 0, 0], rpy: [0, 0, 0]}",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [pose, device]: [u32; 2]) {
    let model = frame.models.get(device as usize);
    let base = model.map_or(Pose::NULL, |model| model.base);
    frame.set_pose(pose, base);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::PrimitiveHarness;

    #[test]
    fn gives_the_configured_base() {
        let mut bench = PrimitiveHarness::new("DeviceBase");
        bench.model.base = Pose::from_xyz_rpy([0.5, -1.0, 0.0], [0.0, 0.0, 2.0]);
        let want = bench.model.base.to_slots();
        assert_eq!(bench.step().reals("pose", 7), want);
    }
}
