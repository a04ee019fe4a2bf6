//! `ForceTorque`: the external force and torque at the flange that an arm measures or estimates.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Device, Kernel, Parameter, Port, Real, Slot, Spatial, Spec, Step, UnitRule,
    operands,
};
use crate::types::{NULL_REAL, Type};
use crate::unit::Unit;

const FORCE: UnitRule = UnitRule::Is(Unit::NEWTON);
const TORQUE: UnitRule = UnitRule::Is(Unit::NEWTON_METRE);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "ForceTorque",
        summary: "External force and torque at the flange of an arm.",
        null: "null while the device is lost",
        undefined: "the device is lost",
        outputs: &[
            Port::real("fx", FORCE, "force along x of the device's task frame"),
            Port::real("fy", FORCE, "force along y"),
            Port::real("fz", FORCE, "force along z"),
            Port::real("tx", TORQUE, "torque about x"),
            Port::real("ty", TORQUE, "torque about y"),
            Port::real("tz", TORQUE, "torque about z"),
            Port::typed(
                "wrench",
                Type::Wrench,
                "all six elements, `[fx fy fz tx ty tz]`",
            )
            .diagnostic(),
        ],
        parameters: &[Parameter::arm()],
        ..Spec::PLAIN
    },
    &[Kernel::each::<ForceTorque>()],
);

operands! {
    struct ForceTorque {
        fx: Slot<Real>, fy: Slot<Real>, fz: Slot<Real>, tx: Slot<Real>, ty: Slot<Real>, tz: Slot<Real>,
        wrench: Slot<Spatial>, device: Device,
    }
}

impl Step for ForceTorque {
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let ForceTorque {
            fx,
            fy,
            fz,
            tx,
            ty,
            tz,
            ..
        } = self;
        let measured = frame
            .measured(self.device)
            .map_or([NULL_REAL; 6], |m| m.wrench);
        let known = measured.iter().all(|value| !value.is_nan());
        let values = if known { measured } else { [NULL_REAL; 6] };
        for (slot, value) in [fx, fy, fz, tx, ty, tz].into_iter().zip(values) {
            frame.put(slot, value)?;
        }
        frame.put(self.wrench, values)
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn gives_the_elements_in_order_and_null_when_the_device_is_lost() {
        let mut bench = PrimitiveHarness::new("ForceTorque");
        bench.device.measurement.wrench = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        bench.step();
        let got = ["fx", "fy", "fz", "tx", "ty", "tz"].map(|name| bench.real(name));
        assert_eq!(got, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(bench.reals("wrench", 6), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        bench.device.present = false;
        assert!(bench.step().real("fx").is_nan() && bench.real("tz").is_nan());
    }
}
