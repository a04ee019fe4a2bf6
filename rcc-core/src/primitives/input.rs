//! `Input`: a value that people and programs set from outside while the net runs.
//!
//! It has no kernel: what is set lies ready between two cycles, and the executor writes it before it evaluates the net.

use crate::primitive::{
    CatalogueEntry, DefaultValue, NullRule, Parameter, ParameterKind, Port, PortType, Role, Spec,
    UnitRule,
};
use crate::unit::Unit;

/// What it is, of a value whose readers may not tell.
pub(super) const TYPE: Parameter = Parameter::new(
    "type",
    ParameterKind::Type,
    "its type where links and values do not tell it, `Wrench`",
)
.default(DefaultValue::Null);

/// The same for its unit.
pub(super) const UNIT: Parameter = Parameter::new(
    "unit",
    ParameterKind::Unit(0),
    "its unit where they do not, `N`",
)
.default(DefaultValue::Null);

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Input",
        summary: "A value that is set from outside while the net is ready or runs.",
        null: "null until it is set, unless an initial value is given; it can be set to null, and expires to null",
        null_rule: NullRule::Known,
        undefined: "it is not set, it is set to null, or what was set has expired",
        outputs: &[
            Port::new("value", PortType::Any, UnitRule::Var(0), "what was set last"),
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
                "the value before it is set; it does not expire",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "at_least",
                ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
                "less is refused, element by element; of numbers and arrays of them",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "at_most",
                ParameterKind::Value(PortType::Any, UnitRule::Var(0)),
                "more is refused, element by element; of numbers and arrays of them",
            )
            .default(DefaultValue::Null),
            Parameter::new(
                "expires",
                ParameterKind::Value(PortType::Is(crate::types::Type::Real), UnitRule::Is(Unit::SECOND)),
                "what was set longer ago than this is null; a dead client is not obeyed any more",
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
