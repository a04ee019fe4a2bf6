//! `WrenchShift`: moves the reference point of a wrench.

use crate::frame::Frame;
use crate::primitive::{CatalogueEntry, Example, Kernel, Port, PortType, Spec, UnitRule, each};
use crate::spatial;
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "WrenchShift",
        summary: "The same load, as a wrench with another reference point, in the same axes.",
        undefined: "overflow: an infinite input, a result out of range",
        formula: "f' = f, t' = t - by × f (Lynch and Park, Modern Robotics, 2017, section 3.4)",
        examples: &[Example::new(
            "10 N down at the origin has a torque about a point half a metre along x",
            "",
            "in | by | out\n\
             [0, 0, -10, 0, 0, 0] | [0.5, 0, 0] | [0, 0, -10, 0, -5, 0]\n\
             [10, -5, 2, 0.3, 0.1, -0.2] | [0, 0, 0] | [10, -5, 2, 0.3, 0.1, -0.2]\n\
             null | [0, 0, 0] | null",
        )],
        inputs: &[
            Port::typed("in", Type::Wrench, "a wrench"),
            Port::new(
                "by",
                PortType::Is(Type::Vector3),
                UnitRule::Is(Unit::METRE),
                "vector from the old reference point to the new one, same axes",
            ),
        ],
        outputs: &[Port::typed(
            "out",
            Type::Wrench,
            "the wrench at the new reference point, same axes",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

fn step(frame: &mut Frame<'_>, [input, by, out]: [u32; 3]) {
    let both = frame.composite(input).zip(frame.composite(by));
    frame.set_composite(
        out,
        both.map(|(wrench, by)| spatial::shift_wrench(wrench, by)),
    );
}
