//! `Publish`: a value for other nets.
//!
//! Its kernels are those of `Copy`; after the cycle, the executor copies the output into the nets that subscribe to it. It
//! is an output, and not the input itself, so that it becomes null with the fragment that it stands in.

use super::copy;
use crate::primitive::{
    CatalogueEntry, Example, Parameter, ParameterKind, Port, PortType, Role, Spec, UnitRule,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Publish",
        summary: "Gives a value to other nets: they read it with `Subscribe` in the cycle after this one.",
        null: "null is passed through, element by element",
        inputs: copy::ENTRY.spec.inputs,
        outputs: &[Port::new("out", PortType::Any, UnitRule::Var(0), "the same").diagnostic()],
        parameters: &[Parameter::new(
            "topic",
            ParameterKind::Topic,
            "the name under which it is published, `tool/force`; one running net at a time publishes a topic",
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
