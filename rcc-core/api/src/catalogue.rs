//! The catalogue of primitives, as shown to people and programs. Computed on request by the server's threads.

use rcc_config::device::kind_name;
use rcc_core::linear::SIDE_MAX;
use rcc_core::primitive::{
    DefaultValue, Dim, ElementType, Example, Parameter, ParameterKind, Port, PortType, StateSpec,
    UnitRule,
};
use rcc_core::primitives::{CATALOGUE, Subject};
use rcc_core::unit::Unit;

use crate::bodies::{ExampleView, ParameterView, PortView, PrimitiveView};

/// Returns every primitive, sorted by name.
#[must_use]
pub fn primitives() -> Vec<PrimitiveView> {
    CATALOGUE
        .iter()
        .map(|entry| {
            let spec = &entry.spec;
            PrimitiveView {
                name: spec.name.to_owned(),
                summary: spec.summary.to_owned(),
                group: Subject::of(spec.name)
                    .map_or("", |subject| subject.title)
                    .to_owned(),
                null: spec.null.to_owned(),
                undefined: spec.undefined.to_owned(),
                formula: spec.formula.to_owned(),
                inputs: spec.inputs.iter().map(port).collect(),
                outputs: spec.outputs.iter().map(port).collect(),
                parameters: spec.parameters.iter().map(parameter).collect(),
                unique: spec.commands_device(),
                remembers: spec.state != StateSpec::NONE,
                examples: spec.examples.iter().map(example).collect(),
            }
        })
        .collect()
}

fn port(port: &Port) -> PortView {
    PortView {
        name: port.name.to_owned(),
        ty: type_words(port.ty),
        unit: unit_words(port.unit),
        doc: port.doc.to_owned(),
        default: port.default.map(literal),
        diagnostic: port.diagnostic,
        least: port.least,
        greatest: port.greatest,
    }
}

/// Parses a table of worked values.
fn example(example: &Example) -> ExampleView {
    let mut lines = example
        .table
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty());
    let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect();
    ExampleView {
        shows: example.shows.to_owned(),
        parameters: example.parameters.to_owned(),
        period_ms: example.period_ms,
        names: lines.next().map(cells).unwrap_or_default(),
        rows: lines.map(cells).collect(),
    }
}

fn parameter(parameter: &Parameter) -> ParameterView {
    let (ty, unit) = match parameter.kind {
        ParameterKind::Value(ty, unit) => (type_words(ty), unit_words(unit)),
        ParameterKind::Start(ty, unit) => (ty.to_string(), unit_words(unit)),
        ParameterKind::First(unit) => ("any".to_owned(), unit_words(unit)),
        ParameterKind::Length(_) => ("Int".to_owned(), String::new()),
        ParameterKind::Window => ("time".to_owned(), "s".to_owned()),
        ParameterKind::Arm => ("device with an arm".to_owned(), String::new()),
        ParameterKind::Device => ("device".to_owned(), String::new()),
        ParameterKind::Channel(kind) => (kind_name(kind).to_owned(), String::new()),
        ParameterKind::Word(words) => (words.join(", "), String::new()),
        ParameterKind::Topic => ("name".to_owned(), String::new()),
        ParameterKind::Type => ("type".to_owned(), String::new()),
        ParameterKind::Unit(_) => ("unit".to_owned(), String::new()),
        ParameterKind::Poses(_) => ("poses".to_owned(), String::new()),
        ParameterKind::Path(_) => ("path".to_owned(), String::new()),
        ParameterKind::Rate => ("Rate".to_owned(), "Hz".to_owned()),
    };
    ParameterView {
        name: parameter.name.to_owned(),
        ty,
        unit,
        doc: parameter.doc.to_owned(),
        default: parameter.default.map(literal),
        above: parameter.above,
        at_least: parameter.at_least,
        at_most: parameter.at_most,
    }
}

fn type_words(ty: PortType) -> String {
    match ty {
        PortType::Is(ty) => ty.to_string(),
        PortType::Any => "any".to_owned(),
        PortType::Scalar => "Bool, Int or Real".to_owned(),
        PortType::Number => "Int or Real".to_owned(),
        PortType::Linear => "Int, Real, Vector3, Twist, Wrench, array or matrix".to_owned(),
        PortType::Of(family) => family.members().to_owned(),
        PortType::Part => "Int or Real".to_owned(),
        PortType::Array(elements, length) => {
            let elements = match elements {
                ElementType::Are(ty) => ty.to_string(),
                ElementType::Open => "any".to_owned(),
            };
            format!("{elements}[{}]", dim_words(length))
        }
        PortType::Matrix(rows, columns) => {
            format!("Real[{},{}]", dim_words(rows), dim_words(columns))
        }
        PortType::Many(length) => format!("list of {}", dim_words(length)),
        PortType::Joints => "Real[joints]".to_owned(),
        PortType::JointColumns(rows) => format!("Real[{rows},joints]"),
    }
}

/// Formats a length: a number, or a letter that stands for the same number wherever it occurs.
fn dim_words(dim: Dim) -> String {
    match dim {
        Dim::Is(length) => length.to_string(),
        Dim::Small(index) => format!("{} (≤ {SIDE_MAX})", dim_words(Dim::Var(index))),
        Dim::Var(index) => char::from(b'n'.saturating_add(index)).to_string(),
        Dim::Sum(a, b) => format!("{}+{}", dim_words(Dim::Var(a)), dim_words(Dim::Var(b))),
    }
}

fn unit_words(rule: UnitRule) -> String {
    let letter = |variable: u8| char::from(b'u'.saturating_add(variable));
    match rule {
        UnitRule::Is(unit) => unit.to_string(),
        UnitRule::Var(a) => letter(a).to_string(),
        UnitRule::Product(a, b) => format!("{}*{}", letter(a), letter(b)),
        UnitRule::Quotient(a, b) => format!("{}/{}", letter(a), letter(b)),
        UnitRule::PerSecond(a) => format!("{}/s", letter(a)),
        UnitRule::PerSecond2(a) => format!("{}/s^2", letter(a)),
        UnitRule::PerSecond3(a) => format!("{}/s^3", letter(a)),
        UnitRule::Root(a) => format!("root of {}", letter(a)),
        UnitRule::Channel => "the channel's".to_owned(),
        UnitRule::Joint(order) => {
            let [turning, linear] = [false, true].map(|linear| Unit::of_joints(linear, order));
            format!("{turning} or {linear}")
        }
        UnitRule::Typed => String::new(),
    }
}

fn literal(value: DefaultValue) -> String {
    match value {
        DefaultValue::Real(value) => value.to_string(),
        DefaultValue::Int(value) => value.to_string(),
        DefaultValue::Bool(value) => value.to_string(),
        DefaultValue::Word(word) => word.to_owned(),
        DefaultValue::Null => "null".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_primitive_is_there_with_all_its_ports() {
        let views = primitives();
        assert_eq!(views.len(), CATALOGUE.len());
        for view in &views {
            assert!(!view.group.is_empty(), "{}", view.name);
        }
        let motion = views.iter().find(|view| view.name == "LinearMotion");
        assert!(motion.is_some_and(|view| {
            view.inputs.len() == 3 && view.outputs.len() == 8 && view.parameters[3].unit == "m/s"
        }));
    }
}
