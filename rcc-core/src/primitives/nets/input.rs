//! `Input`: a value that is set from outside, through the control interface, while the net runs.
//!
//! It has no kernel: a new value is held until the next cycle, and the executor writes it before it evaluates the net.

use crate::primitive::{
    CatalogueEntry, DefaultValue, NullRule, Parameter, ParameterKind, Port, PortType, Role, Spec,
    UnitRule,
};
use crate::unit::Unit;

/// Type of the value, if its readers do not determine it.
pub(super) const TYPE: Parameter = Parameter::new(
    "type",
    ParameterKind::Type,
    "type, if links and values do not determine it, `Wrench`",
)
.default(DefaultValue::Null);

/// Unit of the value, if its readers do not determine it.
pub(super) const UNIT: Parameter = Parameter::new(
    "unit",
    ParameterKind::Unit(0),
    "unit, if links and values do not determine it, `N`",
)
.default(DefaultValue::Null);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Input",
        summary: "A value that is set from outside while the net is ready or runs.",
        null: "null until it is set, unless an initial value is given; it can be set to null, and expires to null",
        null_rule: NullRule::Known,
        undefined: "it was never set, it is set to null, or the value has expired",
        outputs: &[
            Port::new("value", PortType::Any, UnitRule::Var(0), "last value set"),
            Port::real(
                "age",
                UnitRule::Is(Unit::SECOND),
                "time since it was set, 0 in the first cycle that sees it; null if it was never set",
            )
            .diagnostic(),
        ],
        parameters: &[
            Parameter::new(
                "initial",
                ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
                "value before it is first set; does not expire",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "at_least",
                ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
                "smaller values are refused, element by element; for numbers and arrays of numbers",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "at_most",
                ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
                "larger values are refused, element by element; for numbers and arrays of numbers",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "expires",
                ParameterKind::Value(PortType::Is(crate::types::Type::Real), UnitRule::Is(Unit::SECOND)),
                "a value set longer ago than this becomes null, so that a dead client is no longer obeyed",
            )
            .default(DefaultValue::Null)
            .above(0.0),
            TYPE,
            UNIT,
        ],
        role: Role::Input,
        ..Spec::PLAIN
    },
    &[],
);
