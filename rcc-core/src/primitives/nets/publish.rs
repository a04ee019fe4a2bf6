//! `Publish`: publishes a value for other nets.
//!
//! Its kernels are those of `Copy`; after the cycle, the executor copies the output into the nets that subscribe to it.
//! An output is published instead of the input, so that it becomes null when its region is deactivated.

use crate::primitive::{
    CatalogueEntry, Example, Parameter, ParameterKind, Port, PortType, Role, Spec, UnitRule,
};
use crate::primitives::selection::copy;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Publish",
        summary: "Publishes a value for other nets: they read it with `Subscribe` in the next cycle.",
        null: "null is passed through, element by element",
        inputs: copy::ENTRY.spec.inputs,
        outputs: &[Port::new("out", PortType::Any, UnitRule::Var(0), "the same").diagnostic()],
        parameters: &[Parameter::new(
            "topic",
            ParameterKind::Topic,
            "name of the topic, `tool/force`; only one running net at a time publishes a topic",
        )],
        examples: &[Example::new(
            "any type",
            "{topic: both}",
            "in | out\n [true, null] | [true, null]",
        )],
        role: Role::Publish,
        ..Spec::PLAIN
    },
    copy::ENTRY.kernels,
);
