//! Units: the predecessor's ports have none, so values are plain numbers, and get a unit where an RCC port has one. A
//! unit is added or removed by multiplication with 1 of it, which changes no bit. Runs on the loader's threads.

use rcc_config::diagnostic::Span;
use rcc_core::primitive::{Port, PortType, Spec, UnitRule};
use rcc_core::types::Type;
use rcc_core::unit::Unit;
use rcc_language::syntax::literal::{Literal, LiteralShape};

use super::{BuiltOutput, BuiltValue, Conversion};
use crate::values::ForeignType;

impl Conversion<'_, '_> {
    pub(super) fn spec(&self, made: usize) -> Option<&'static Spec> {
        self.built.get(made)?.spec
    }

    /// Returns an output of an RCC primitive.
    pub(super) fn built_output(&self, primitive: usize, port: &'static str) -> BuiltValue {
        let found = self.spec(primitive).and_then(|spec| spec.output(port));
        let Some((_, port)) = found else {
            return BuiltValue::Refused;
        };
        BuiltValue::Output(BuiltOutput {
            primitive,
            port: port.name,
            index: None,
            unit: self.unit_of(primitive, port),
            length: self.length_of(primitive, port),
            is_vector: self.is_vector(primitive, port),
        })
    }

    /// Returns the unit of a port; a unit that the spec leaves open is that of a plain number.
    fn unit_of(&self, primitive: usize, port: &Port) -> Unit {
        match port.unit {
            UnitRule::Is(unit) => unit,
            UnitRule::Channel => self.channel_unit(primitive).unwrap_or(Unit::ONE),
            // The predecessor has arms of rotary joints only.
            UnitRule::Joint(order) => Unit::of_joints(false, order),
            UnitRule::PerSecond(_) => Unit::HERTZ,
            UnitRule::PerSecond2(_) => Unit::HERTZ.per(Unit::SECOND),
            UnitRule::PerSecond3(_) => Unit::HERTZ.per(Unit::SECOND).per(Unit::SECOND),
            _ => Unit::ONE,
        }
    }

    /// Returns the number of elements of an array output.
    fn length_of(&self, primitive: usize, port: &Port) -> Option<u32> {
        match port.ty {
            PortType::Is(Type::Reals(length) | Type::Bools(length) | Type::Ints(length)) => {
                Some(u32::from(length))
            }
            PortType::Joints => self.joints_of(primitive),
            _ => None,
        }
    }

    fn is_vector(&self, primitive: usize, port: &Port) -> bool {
        match port.ty {
            PortType::Is(ty) => matches!(ty, Type::Vector3 | Type::Twist | Type::Wrench),
            PortType::Joints | PortType::JointColumns(_) => false,
            // It has the type of its sources, or of its initial value.
            _ => self.built.get(primitive).is_some_and(|built| {
                let inputs = built.inputs.iter().map(|(_, value, _)| value);
                let begins = built.parameters.iter().map(|(_, literal)| literal);
                inputs.into_iter().any(|value| self.is_vector_value(value))
                    || begins.into_iter().any(is_vector_literal)
            }),
        }
    }

    fn is_vector_value(&self, value: &BuiltValue) -> bool {
        match value {
            BuiltValue::Output(output) => output.is_whole_vector(),
            BuiltValue::Before(before) => before.0.is_whole_vector(),
            BuiltValue::Constant(literal) => is_vector_literal(literal),
            BuiltValue::Delayed(number) => {
                let pre = self.delayed.get(*number).map(|(primitive, _)| *primitive);
                let entry = pre.and_then(|pre| self.entries.get(pre).copied().flatten());
                let port = entry.and_then(|entry| entry.output("outValue"));
                port.is_some_and(|port| {
                    matches!(
                        port.ty,
                        ForeignType::Vector | ForeignType::Twist | ForeignType::Wrench
                    )
                })
            }
            BuiltValue::List(_) | BuiltValue::Refused => false,
        }
    }

    fn text_parameter(&self, primitive: usize, name: &str) -> Option<&str> {
        let mut parameters = self.built.get(primitive)?.parameters.iter();
        match &parameters.find(|(key, _)| *key == name)?.1.shape {
            LiteralShape::Text(text) => Some(text),
            _ => None,
        }
    }

    fn joints_of(&self, primitive: usize) -> Option<u32> {
        let device = self.text_parameter(primitive, "device")?;
        let (_, device) = self.cell.find(device)?;
        Some(device.model.joints)
    }

    fn channel_unit(&self, primitive: usize) -> Option<Unit> {
        let device = self.text_parameter(primitive, "device")?;
        let name = self.text_parameter(primitive, "channel")?;
        let (_, device) = self.cell.find(device)?;
        let mut channels = device.channels.iter().flatten();
        Some(channels.find(|channel| channel.name == name)?.unit)
    }

    /// Converts a value to the unit of an input.
    pub(super) fn fit(&mut self, value: BuiltValue, primitive: usize, port: &Port) -> BuiltValue {
        if port.unit == UnitRule::Typed {
            return value;
        }
        let unit = self.unit_of(primitive, port);
        self.in_unit(value, unit)
    }

    /// Converts a value to a unit.
    pub(super) fn in_unit(&mut self, value: BuiltValue, unit: Unit) -> BuiltValue {
        match value {
            BuiltValue::Output(output) if output.unit != unit => self.cast(output, unit),
            // A delayed value is a plain number.
            BuiltValue::Delayed(pre) if unit != Unit::ONE => {
                let pass = self.pass(BuiltValue::Delayed(pre));
                self.in_unit(pass, unit)
            }
            BuiltValue::List(elements) => {
                let elements = elements.into_iter();
                BuiltValue::List(
                    elements
                        .map(|element| self.in_unit(element, unit))
                        .collect(),
                )
            }
            value => value,
        }
    }

    fn cast(&mut self, output: BuiltOutput, unit: Unit) -> BuiltValue {
        if let (Some(length), None) = (output.length, output.index) {
            let element = |index| BuiltOutput {
                index: Some(index),
                length: None,
                ..output
            };
            let elements = (0..length).map(|index| self.cast(element(index), unit));
            return BuiltValue::List(elements.collect());
        }
        let span = self.span(self.current);
        let one = Literal::new(LiteralShape::Real(1.0, Some(unit.per(output.unit))), span);
        let name = if unit == Unit::ONE { "bare" } else { "unit" };
        let key = format!("cast {output:?} {unit:?}");
        let (ty, inputs): (_, [&'static str; 2]) = if output.is_whole_vector() {
            ("Scale", ["in", "factor"])
        } else {
            ("Multiply", ["a", "b"])
        };
        let [value, factor] = inputs;
        let inputs = vec![
            (value, BuiltValue::Output(output), span),
            (factor, BuiltValue::Constant(one), span),
        ];
        let made = self.shared(key, ty, name, Vec::new(), inputs);
        match self.built_output(made, "out") {
            BuiltValue::Output(out) => BuiltValue::Output(BuiltOutput {
                unit,
                is_vector: output.is_whole_vector(),
                ..out
            }),
            other => other,
        }
    }

    /// Returns the value as an output of a primitive of its own, which a value that is delayed twice needs.
    pub(super) fn pass(&mut self, value: BuiltValue) -> BuiltValue {
        let span = self.span(self.current);
        let key = format!("pass {value:?}");
        let never = Literal::new(LiteralShape::Bool(false), Span::default());
        let inputs = vec![
            ("in", value, span),
            ("condition", BuiltValue::Constant(never), span),
        ];
        let made = self.shared(key, "NullIf", "before", Vec::new(), inputs);
        self.built_output(made, "out")
    }
}

/// Returns true for a list, which is multiplied by a number as a whole.
fn is_vector_literal(literal: &Literal) -> bool {
    matches!(&literal.shape, LiteralShape::List(elements) if elements.iter().all(|it| it.number().is_some()))
}
