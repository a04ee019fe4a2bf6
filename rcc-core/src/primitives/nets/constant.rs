//! `Constant`: a named value. A literal at an input has the same effect without a name.

use crate::primitive::{
    CatalogueEntry, Example, Parameter, ParameterKind, Port, PortType, Role, Spec, UnitRule,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Constant",
        summary: "A value that never changes.",
        null: "never null, unless its value is null",
        examples: &[Example::new(
            "with its unit",
            "{value: 20 mm}",
            "out
                 0.02 m
                 0.02 m",
        )],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "the value",
        )],
        parameters: &[Parameter::new(
            "value",
            ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
            "a number, Bool, list or pose",
        )],
        role: Role::Constant,
        ..Spec::PLAIN
    },
    &[],
);
