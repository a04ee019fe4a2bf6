//! `Input`: a value that people and programs set from outside while the net runs.

use crate::primitive::{
    Entry, Literal, NullRule, Parameter, ParameterKind, Port, PortType, Role, Spec, UnitRule,
};

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "Input",
        summary: "A value that is set from outside while the net runs.",
        null: "null until it is set, unless an initial value is given; it can be set to null",
        null_rule: NullRule::Known,
        outputs: &[Port::new(
            "value",
            PortType::Any,
            UnitRule::Var(0),
            "what was set last",
        )],
        parameters: &[Parameter::new(
            "initial",
            ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
            "the value before it is set",
        )
        .default(Literal::Null)],
        role: Role::Input,
        ..Spec::PLAIN
    },
    &[],
);
