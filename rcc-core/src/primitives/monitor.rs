//! `Monitor`: makes a value of any type visible outside, as often as asked (paper, section IV-C).
//!
//! It computes nothing in the cycle: after it, the executor copies the slots that it watches.

use crate::primitive::{
    CatalogueEntry, DefaultValue, Parameter, ParameterKind, Port, PortType, Role, Spec, UnitRule,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Monitor",
        summary: "Makes a value visible to monitors.",
        null: "null is shown as null",
        inputs: &[Port::new(
            "value",
            PortType::Any,
            UnitRule::Var(0),
            "value to show, at most 16 elements",
        )],
        parameters: &[Parameter::new(
            "rate",
            ParameterKind::Rate,
            "how often; the nearest rate that divides the cycle's is taken, at most that",
        )
        .default(DefaultValue::Real(100.0))
        .above(0.0)],
        role: Role::Monitor,
        ..Spec::PLAIN
    },
    &[],
);
