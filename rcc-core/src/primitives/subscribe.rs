//! `Subscribe`: a value that another net publishes.
//!
//! It has no kernel: the executor copies what was published up to the cycle before into the net before it evaluates any, so
//! that the order in which nets are evaluated never shows.

use super::input::{TYPE, UNIT};
use crate::primitive::{
    CatalogueEntry, DefaultValue, NullRule, Parameter, ParameterKind, Port, PortType, Role, Spec,
    UnitRule,
};
use crate::types::Type;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Subscribe",
        summary: "A value that another net publishes, as of the cycle before.",
        null: "null while no running net publishes it, unless an initial value is given and nothing was published yet; a \
               null that is published is null, and what is too old expires to null",
        null_rule: NullRule::Known,
        undefined: "no running net publishes it, null is published, or what was published has expired",
        outputs: &[
            Port::new(
                "value",
                PortType::Any,
                UnitRule::Var(0),
                "what was published last",
            ),
            Port::real(
                "age",
                UnitRule::SECOND,
                "time since this net could see it first, 0 in that evaluation (the null when its net ends comes too); null if \
                 nothing ever came",
            )
            .diagnostic(),
        ],
        parameters: &[
            Parameter::new(
                "topic",
                ParameterKind::Topic,
                "the name under which another net publishes it",
            ),
            TYPE,
            UNIT,
            Parameter::new(
                "initial",
                ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
                "the value before the first one comes; it does not expire, and does not come again when the other net ends",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "expires",
                ParameterKind::Value(PortType::Is(Type::Real), UnitRule::SECOND),
                "what could be seen longer ago than this is null: for a net that publishes more seldom than this one reads",
            )
            .default(DefaultValue::Null)
            .above(0.0),
        ],
        role: Role::Input,
        ..Spec::PLAIN
    },
    &[],
);
