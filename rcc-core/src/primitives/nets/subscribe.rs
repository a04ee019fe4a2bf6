//! `Subscribe`: a value that another net publishes.
//!
//! It has no kernel: before the executor evaluates any net, it copies the values published up to the previous cycle
//! into the net, so that the order in which nets are evaluated has no effect.

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
        summary: "A value that another net publishes, as of the previous cycle.",
        null: "null while no running net publishes it, unless an initial value is given and nothing has been published yet; a published null is null, and an old value expires to null",
        null_rule: NullRule::Known,
        undefined: "no running net publishes it, null is published, or the value has expired",
        outputs: &[
            Port::new(
                "value",
                PortType::Any,
                UnitRule::Var(0),
                "last published value",
            ),
            Port::real(
                "age",
                UnitRule::SECOND,
                "time since this net could first see the value, 0 in that evaluation (also for the null when the publishing net ends); null if no value ever arrived",
            )
            .diagnostic(),
        ],
        parameters: &[
            Parameter::new(
                "topic",
                ParameterKind::Topic,
                "name of the topic that another net publishes",
            ),
            TYPE,
            UNIT,
            Parameter::new(
                "initial",
                ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
                "value before the first one arrives; does not expire, and does not return when the publishing net ends",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "expires",
                ParameterKind::Value(PortType::Is(Type::Real), UnitRule::SECOND),
                "a value that is older than this becomes null: for a net that publishes less often than this one reads",
            )
            .default(DefaultValue::Null)
            .above(0.0),
        ],
        role: Role::Input,
        ..Spec::PLAIN
    },
    &[],
);
