//! `DeviceBase`: the pose of an arm's base in the world frame of its cell.

use crate::frame::Frame;
use crate::pose::Pose;
use crate::primitive::{
    CatalogueEntry, Device, Example, Kernel, Parameter, Port, Slot, Spec, Step, operands,
};
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
    &[Kernel::each::<DeviceBase>()],
);

operands! {
    struct DeviceBase { pose: Slot<Pose>, device: Device }
}

impl Step for DeviceBase {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let model = frame.models.get(self.device.0 as usize);
        let base = model.map_or(Pose::NULL, |model| model.base);
        frame.put(self.pose, base)
    }
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
