//! `Monitor`: publishes a value of any type to monitors at a given rate (Vistein et al. 2010, section IV-C).
//!
//! It computes nothing in the cycle: the executor copies the monitored slots after the cycle.

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
            "sampling rate; the nearest rate that divides the cycle rate is used, at most the cycle rate",
        )
        .default(DefaultValue::Real(100.0))
        .above(0.0)],
        role: Role::Monitor,
        ..Spec::PLAIN
    },
    &[],
);
