//! Units: the predecessor's ports have none, so values travel as plain numbers and get one where a port of ours has one.
//! A unit is put on or taken off by multiplying with 1 of it, which changes no bit. The loader's threads.

use rcc_config::diagnostic::Span;
use rcc_core::primitive::{Port, PortType, Spec, UnitRule};
use rcc_core::primitives;
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::{Build, Value, Wire};
use crate::directionet::values::Type as Theirs;
use crate::syntax::literal::{Literal, Shape};

impl Build<'_, '_> {
    pub(super) fn spec(&self, made: usize) -> Option<&'static Spec> {
        let ours = self.ours.get(made)?;
        Some(&primitives::find(ours.ty)?.1.spec)
    }

    /// An output of a primitive of ours.
    pub(super) fn wire(&self, primitive: usize, port: &'static str) -> Value {
        let found = self.spec(primitive).and_then(|spec| spec.output(port));
        let Some((_, port)) = found else {
            return Value::Refused;
        };
        Value::Wire(Wire {
            primitive,
            port: port.name,
            index: None,
            unit: self.unit_of(primitive, port),
            length: self.length_of(primitive, port),
            is_vector: self.is_vector(primitive, port),
        })
    }

    /// The unit of a port, every unit that is open being that of a plain number.
    fn unit_of(&self, primitive: usize, port: &Port) -> Unit {
        match port.unit {
            UnitRule::Is(unit) => unit,
            UnitRule::Channel => self.channel_unit(primitive).unwrap_or(Unit::ONE),
            UnitRule::PerSecond(_) => Unit::HERTZ,
            UnitRule::PerSecond2(_) => Unit::HERTZ.per(Unit::SECOND),
            UnitRule::PerSecond3(_) => Unit::HERTZ.per(Unit::SECOND).per(Unit::SECOND),
            _ => Unit::ONE,
        }
    }

    /// The number of elements of an array output.
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
            // The same as what feeds it, or as what it begins with.
            _ => self.ours.get(primitive).is_some_and(|ours| {
                let inputs = ours.inputs.iter().map(|(_, value, _)| value);
                let begins = ours.parameters.iter().map(|(_, literal)| literal);
                inputs.into_iter().any(|value| self.is_vector_value(value))
                    || begins.into_iter().any(is_vector_literal)
            }),
        }
    }

    fn is_vector_value(&self, value: &Value) -> bool {
        match value {
            Value::Wire(wire) | Value::Before(wire, _) => wire.is_vector && wire.index.is_none(),
            Value::Constant(literal) => is_vector_literal(literal),
            Value::Delayed(number) => {
                let pre = self.delayed.get(*number).map(|(primitive, _)| *primitive);
                let entry = pre.and_then(|pre| self.entries.get(pre).copied().flatten());
                let port = entry.and_then(|entry| entry.output("outValue"));
                port.is_some_and(|port| {
                    matches!(port.ty, Theirs::Vector | Theirs::Twist | Theirs::Wrench)
                })
            }
            Value::List(_) | Value::Refused => false,
        }
    }

    fn text_parameter(&self, primitive: usize, name: &str) -> Option<&str> {
        let mut parameters = self.ours.get(primitive)?.parameters.iter();
        match &parameters.find(|(key, _)| *key == name)?.1.shape {
            Shape::Text(text) => Some(text),
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

    /// A value as an input of ours takes it.
    pub(super) fn fit(&mut self, value: Value, primitive: usize, port: &Port) -> Value {
        if port.unit == UnitRule::Typed {
            return value;
        }
        let unit = self.unit_of(primitive, port);
        self.in_unit(value, unit)
    }

    /// A value in a unit.
    pub(super) fn in_unit(&mut self, value: Value, unit: Unit) -> Value {
        match value {
            Value::Wire(wire) if wire.unit != unit => self.cast(wire, unit),
            // A delayed value is a plain number.
            Value::Delayed(pre) if unit != Unit::ONE => {
                let pass = self.pass(Value::Delayed(pre));
                self.in_unit(pass, unit)
            }
            Value::List(elements) => {
                let elements = elements.into_iter();
                Value::List(
                    elements
                        .map(|element| self.in_unit(element, unit))
                        .collect(),
                )
            }
            value => value,
        }
    }

    fn cast(&mut self, wire: Wire, unit: Unit) -> Value {
        if let (Some(length), None) = (wire.length, wire.index) {
            let element = |index| Wire {
                index: Some(index),
                length: None,
                ..wire
            };
            let elements = (0..length).map(|index| self.cast(element(index), unit));
            return Value::List(elements.collect());
        }
        let span = self.span(self.current);
        let one = Literal::new(Shape::Real(1.0, Some(unit.per(wire.unit))), span);
        let name = if unit == Unit::ONE { "bare" } else { "unit" };
        let key = format!("cast {wire:?} {unit:?}");
        let (ty, inputs): (_, [&'static str; 2]) = if wire.is_vector && wire.index.is_none() {
            ("Scale", ["in", "factor"])
        } else {
            ("Multiply", ["a", "b"])
        };
        let [value, factor] = inputs;
        let inputs = vec![
            (value, Value::Wire(wire), span),
            (factor, Value::Constant(one), span),
        ];
        let made = self.shared(key, ty, name, Vec::new(), inputs);
        match self.wire(made, "out") {
            Value::Wire(out) => Value::Wire(Wire {
                unit,
                is_vector: wire.is_vector && wire.index.is_none(),
                ..out
            }),
            other => other,
        }
    }

    /// The same value at an output of a primitive of its own: what is delayed twice needs one.
    pub(super) fn pass(&mut self, value: Value) -> Value {
        let span = self.span(self.current);
        let key = format!("pass {value:?}");
        let never = Literal::new(Shape::Bool(false), Span::default());
        let inputs = vec![
            ("in", value, span),
            ("condition", Value::Constant(never), span),
        ];
        let made = self.shared(key, "NullIf", "before", Vec::new(), inputs);
        self.wire(made, "out")
    }
}

/// True for a list, which multiplication by a number wants as a whole.
fn is_vector_literal(literal: &Literal) -> bool {
    matches!(&literal.shape, Shape::List(elements) if elements.iter().all(|it| it.number().is_some()))
}
