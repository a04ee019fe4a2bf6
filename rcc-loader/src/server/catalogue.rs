//! The catalogue of primitives as people and programs read it.
//! Computed on request by the server's threads.

use rcc_config::device::kind_name;
use rcc_core::primitive::{Literal, Parameter, ParameterKind, Port, PortType, Role, UnitRule};
use rcc_core::primitives::CATALOGUE;

use super::api::{ParameterView, PortView, PrimitiveView};

/// Every primitive, sorted by name.
#[must_use]
pub fn primitives() -> Vec<PrimitiveView> {
    CATALOGUE
        .iter()
        .map(|entry| {
            let spec = &entry.spec;
            PrimitiveView {
                name: spec.name.to_owned(),
                summary: spec.summary.to_owned(),
                null: spec.null.to_owned(),
                inputs: spec.inputs.iter().map(port).collect(),
                outputs: spec.outputs.iter().map(port).collect(),
                parameters: spec.parameters.iter().map(parameter).collect(),
                unique: matches!(spec.role, Role::CommandsArm | Role::CommandsChannel),
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
    }
}

fn parameter(parameter: &Parameter) -> ParameterView {
    let (ty, unit) = match parameter.kind {
        ParameterKind::Value(ty, unit) => (type_words(ty), unit_words(unit)),
        ParameterKind::Start(ty, unit) => (ty.to_string(), unit_words(unit)),
        ParameterKind::Arm => ("device with an arm".to_owned(), String::new()),
        ParameterKind::Device => ("device".to_owned(), String::new()),
        ParameterKind::Channel(kind) => (kind_name(kind).to_owned(), String::new()),
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
        PortType::Joints => "Real[joints]".to_owned(),
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
        UnitRule::Root(a) => format!("root of {}", letter(a)),
        UnitRule::Channel => "the channel's".to_owned(),
        UnitRule::Typed => String::new(),
    }
}

fn literal(value: Literal) -> String {
    match value {
        Literal::Real(value) => value.to_string(),
        Literal::Int(value) => value.to_string(),
        Literal::Bool(value) => value.to_string(),
        Literal::Null => "null".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_primitive_is_there_with_all_its_ports() {
        let views = primitives();
        assert_eq!(views.len(), CATALOGUE.len());
        let motion = views.iter().find(|view| view.name == "LinearMotion");
        assert!(motion.is_some_and(|view| {
            view.inputs.len() == 1 && view.outputs.len() == 5 && view.parameters[3].unit == "m/s"
        }));
    }
}
