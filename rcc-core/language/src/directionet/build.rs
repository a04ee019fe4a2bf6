//! From the predecessor's primitives to ours: in the order of their links each becomes what its row says.
//! Everything that has no counterpart is told with its place, all at once. The loader's threads.

mod finish;
mod order;
mod special;
mod template;
mod units;

use std::collections::{BTreeMap, HashMap, HashSet};

use rcc_config::diagnostic::{Diagnostic, Span, closest};
use rcc_config::yaml::Key;
use rcc_core::unit::Unit;

use super::Options;
use super::flatten::{Flat, Primitive, Source};
use super::table::{self, Entry, Port, Reads, To};
use super::values;
use crate::devices::DeviceTable;
use crate::fault;
use crate::syntax::literal::{Literal, Shape};

/// Most names that are compared for a suggestion, over all faults: a broken text of a megabyte must not cost minutes.
const SUGGESTIONS_MAX: usize = 200;

/// What an output of the predecessor is here.
#[derive(Clone, Debug)]
enum Value {
    /// An output of a primitive of ours, or an element of one.
    Wire(Wire),
    /// A constant.
    Constant(Literal),
    /// An array whose elements are known one by one.
    List(Vec<Value>),
    /// What an earlier-breaking `Pre` gives: the value of the cycle before.
    Delayed(usize),
    /// What an output gave in the cycle before, and what it is in the first.
    Before(Wire, Literal),
    /// Its fault is reported.
    Refused,
}

/// An output of a primitive of ours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Wire {
    primitive: usize,
    port: &'static str,
    index: Option<u32>,
    /// The unit in which it travels; ONE also where types say it.
    unit: Unit,
    /// It is an array of so many elements.
    length: Option<u32>,
    /// It is a Vector3, Twist or Wrench: a unit is changed by Scale.
    is_vector: bool,
}

/// A primitive of ours.
#[derive(Debug)]
struct Ours {
    id: String,
    span: Span,
    ty: &'static str,
    parameters: Vec<(&'static str, Literal)>,
    inputs: Vec<(&'static str, Value, Span)>,
    active: Option<Value>,
    /// The primitive of the text that it was made for; orders the result.
    made_for: usize,
}

/// A robot's axes as they are commanded.
#[derive(Debug, Default)]
struct Arm {
    axes: BTreeMap<u32, (Value, Span)>,
    active: Option<Value>,
    span: Span,
    made_for: usize,
}

/// Everything about the net in the making.
struct Build<'t, 'f> {
    options: &'f Options,
    cell: &'f DeviceTable,
    faults: &'f mut Vec<Diagnostic>,
    flat: &'f Flat<'t>,
    entries: Vec<Option<&'static Entry>>,
    /// By primitive of the text: what its outputs are.
    values: Vec<HashMap<&'static str, Value>>,
    ours: Vec<Ours>,
    /// What was made once and serves many: casts, JointState, values that outlive null.
    shared: HashMap<String, usize>,
    arms: BTreeMap<String, Arm>,
    /// Values to the application by key.
    keys: Vec<(String, Value)>,
    /// Each `Pre` of the text, and its condition.
    delayed: Vec<(usize, Option<Value>)>,
    /// Outputs of the text that something reads.
    read: HashSet<(usize, String)>,
    suggestions: usize,
    /// Devices whose absence is reported.
    absent: Vec<String>,
    /// The primitive of the text that is being made.
    current: usize,
}

/// Makes a net of ours. Faults are reported; the net is whole only if there is none.
pub fn build(
    flat: &Flat<'_>,
    options: &Options,
    cell: &DeviceTable,
    faults: &mut Vec<Diagnostic>,
) -> crate::syntax::Net {
    let mut build = Build {
        options,
        cell,
        faults,
        flat,
        entries: Vec::new(),
        values: vec![HashMap::new(); flat.primitives.len()],
        ours: Vec::new(),
        shared: HashMap::new(),
        arms: BTreeMap::new(),
        keys: Vec::new(),
        delayed: Vec::new(),
        read: flat.reads(),
        suggestions: 0,
        absent: Vec::new(),
        current: 0,
    };
    for primitive in &flat.primitives {
        let entry = build.known(primitive);
        build.entries.push(entry);
    }
    for number in (0..flat.primitives.len())
        .filter(|number| build.is_pre(*number))
        .collect::<Vec<_>>()
    {
        let value = Value::Delayed(build.delayed.len());
        build.delayed.push((number, None));
        build.put(number, "outValue", value);
    }
    let order = build.order();
    for number in order {
        build.current = number;
        build.primitive(number);
    }
    build.finish()
}

impl<'t> Build<'t, '_> {
    fn error(&mut self, code: &'static str, span: Span, message: String, help: Option<String>) {
        self.faults
            .push(Diagnostic::error(code, span, message).help_if(help));
    }

    fn near<'k>(&mut self, name: &str, known: impl IntoIterator<Item = &'k str>) -> Option<String> {
        self.suggestions += 1;
        if self.suggestions > SUGGESTIONS_MAX {
            return None;
        }
        Some(format!("did you mean `{}`?", closest(name, known)?))
    }

    /// Looks a type up, and the names of what a primitive gives to it.
    fn known(&mut self, primitive: &Primitive<'t>) -> Option<&'static Entry> {
        let Some(entry) = table::all().get(&primitive.ty.name) else {
            let message = format!("the predecessor has no type `{}`", primitive.ty.name);
            let mut names: Vec<&str> = table::all().keys().map(String::as_str).collect();
            names.sort_unstable();
            let help = self.near(&primitive.ty.name, names);
            self.error(fault::UNKNOWN_TYPE, primitive.ty.span, message, help);
            return None;
        };
        for (key, ..) in &primitive.parameters {
            if entry.parameter(&key.name).is_none() {
                let known = entry.parameters.iter().map(|port| port.name);
                self.no_such(fault::UNKNOWN_PARAMETER, "parameter", key, entry, known);
            }
        }
        for (key, _) in &primitive.inputs {
            if entry.input(&key.name).is_none() {
                let known = entry.inputs.iter().map(|port| port.name);
                self.no_such(fault::UNKNOWN_INPUT, "input", key, entry, known);
            }
        }
        if let To::None(_) = entry.row.to {
            let message = format!("`{}` has no counterpart: {}", entry.name, entry.row.note);
            let help = Some("docs/from-the-predecessor.md says what becomes of each type".into());
            self.error(fault::NO_COUNTERPART, primitive.ty.span, message, help);
            return None;
        }
        Some(entry)
    }

    fn no_such(
        &mut self,
        code: &'static str,
        what: &str,
        key: &Key,
        entry: &Entry,
        known: impl Iterator<Item = &'static str>,
    ) {
        let known: Vec<&str> = known.collect();
        let help = match known.as_slice() {
            [] => Some(format!("it has no {what}s")),
            known => self
                .near(&key.name, known.iter().copied())
                .or_else(|| Some(format!("{what}s: {}", known.join(", ")))),
        };
        let message = format!("{} has no {what} `{}`", entry.name, key.name);
        self.error(code, key.span, message, help);
    }

    /// Makes ours from one primitive of the text.
    fn primitive(&mut self, number: usize) {
        let Some(entry) = self.entries.get(number).copied().flatten() else {
            return;
        };
        for port in &entry.inputs {
            if port.required && self.given(number, port.name).is_none() {
                self.not_connected(number, port.name, entry);
            }
        }
        self.must_be_mentioned(number, entry, "inReset");
        let active = self.active(number);
        let first = self.ours.len();
        match entry.row.to {
            To::Net(_) => {
                if let Some(net) = entry.nets.first() {
                    self.expand(number, entry, net);
                }
            }
            To::By(parameter, ..) => {
                let chosen = self.parameter(number, entry, parameter);
                let no = matches!(chosen.map(|it| it.shape), Some(Shape::Bool(false)));
                if let Some(net) = entry.nets.get(usize::from(no)) {
                    self.expand(number, entry, net);
                }
            }
            To::Special(builtin) => self.special(number, entry, builtin, active.as_ref()),
            To::None(_) => {}
        }
        if let Some(active) = active {
            for ours in self.ours.iter_mut().skip(first) {
                // What is shared does not stop with one that uses it, nor does what makes the condition.
                if ours.made_for == number && ours.active.is_none() {
                    ours.active = Some(active.clone());
                }
            }
        }
    }

    /// What resets a primitive is never passed over in silence.
    fn must_be_mentioned(&mut self, number: usize, entry: &Entry, input: &str) {
        let mentioned = entry.nets.iter().any(|net| net.mentions(input));
        let Some((key, _)) = self.given(number, input) else {
            return;
        };
        if entry.input(input).is_some() && !mentioned && !self.is_pre(number) {
            let message = format!("the input `{input}` of {} has no counterpart", entry.name);
            self.error(fault::NO_COUNTERPART, key.span, message, None);
        }
    }

    fn not_connected(&mut self, number: usize, port: &str, entry: &Entry) {
        let message = format!("the input `{port}` of {} is not connected", entry.name);
        let span = self.flat.primitives[number].ty.span;
        self.error(fault::NOT_CONNECTED, span, message, None);
    }

    fn span(&self, number: usize) -> Span {
        let primitive = self.flat.primitives.get(number);
        primitive.map_or(Span::default(), |primitive| primitive.span)
    }

    /// The link to an input.
    fn given(&self, number: usize, input: &str) -> Option<(&'t Key, Source<'t>)> {
        let primitive = self.flat.primitives.get(number)?;
        let mut inputs = primitive.inputs.iter();
        inputs.find(|(key, _)| key.name == input).copied()
    }

    /// The value of an output of the text.
    fn value(&mut self, source: Source<'t>) -> Value {
        let Source::Output { primitive, port } = source else {
            return Value::Refused;
        };
        let Some(entry) = self.entries.get(primitive).copied().flatten() else {
            return Value::Refused;
        };
        let known = self.values.get(primitive);
        if let Some(value) = known.and_then(|values| values.get(port.name.as_str())) {
            return value.clone();
        }
        if entry.output(&port.name).is_none() {
            let names = entry.outputs.iter().map(|port| port.name);
            let message = format!(
                "output not found: {} has no output `{}`",
                entry.name, port.name
            );
            let near = self.near(&port.name, names);
            self.error(fault::UNKNOWN_OUTPUT, port.span, message, near);
        } else {
            let message = format!(
                "the output `{}` of {} has no counterpart",
                port.name, entry.name
            );
            let note = (!entry.row.note.is_empty()).then(|| entry.row.note.to_string());
            self.error(fault::NO_COUNTERPART, port.span, message, note);
        }
        Value::Refused
    }

    /// The conditions of a primitive: those of its fragments and its own, as one value.
    fn active(&mut self, number: usize) -> Option<Value> {
        let mut conditions = self.flat.primitives.get(number)?.active.clone();
        conditions.extend(self.given(number, "inActive").map(|(_, source)| source));
        let values: Vec<Value> = conditions
            .into_iter()
            .map(|source| self.value(source))
            .filter(|value| {
                !matches!(
                    value,
                    Value::Constant(Literal {
                        shape: Shape::Bool(true),
                        ..
                    })
                )
            })
            .collect();
        let span = self.span(number);
        let mut values = values.into_iter();
        let first = values.next()?;
        Some(values.fold(first, |a, b| {
            let key = format!("and {a:?} {b:?}");
            let inputs = vec![("a", a, span), ("b", b, span)];
            let made = self.shared(key, "And", "both", Vec::new(), inputs);
            self.wire(made, "out")
        }))
    }

    /// A parameter of the text or its default.
    fn parameter(&mut self, number: usize, entry: &Entry, name: &str) -> Option<Literal> {
        let port = *entry.parameter(name)?;
        let primitive = self.flat.primitives.get(number)?;
        let mut given = primitive.parameters.iter();
        let given = given.find(|(key, ..)| key.name == name);
        let read = match (given, port.default) {
            (Some((_, text, span)), _) => values::read(text, *span, port.ty, port.array),
            (None, Some(text)) => values::read(text, primitive.span, port.ty, port.array),
            (None, None) => Ok(port.ty.zero(primitive.span)),
        };
        match read {
            Ok(literal) => Some(literal),
            Err(fault) => {
                // The same parameter may be asked for more than once.
                if !self.faults.contains(&fault) {
                    self.faults.push(*fault);
                }
                None
            }
        }
    }

    /// A parameter that is a whole number, at least 0.
    fn count(&mut self, number: usize, entry: &Entry, name: &str) -> Option<u32> {
        let literal = self.parameter(number, entry, name)?;
        let Shape::Int(value) = literal.shape else {
            return None;
        };
        let count = u32::try_from(value).ok();
        if count.is_none() {
            let message = format!("`{name}` is {value}");
            self.error(fault::OUT_OF_RANGE, literal.span, message, None);
        }
        count
    }

    /// What an input or parameter of a primitive is: what the net of its row calls `parent.name`.
    fn argument(&mut self, number: usize, entry: &'static Entry, name: &str) -> (Value, Span) {
        let span = self.span(number);
        let Some(port) = entry.input(name).copied() else {
            let literal = self.parameter(number, entry, name);
            let span = literal.as_ref().map_or(span, |literal| literal.span);
            return (literal.map_or(Value::Refused, Value::Constant), span);
        };
        let otherwise = name
            .strip_prefix("in")
            .filter(|stem| entry.parameter(stem).is_some());
        let constant = |build: &mut Self| match otherwise {
            Some(stem) => build.parameter(number, entry, stem),
            None => Some(port.ty.zero(span)),
        };
        let Some((key, source)) = self.given(number, name) else {
            let constant = constant(self).map_or(Value::Refused, Value::Constant);
            return (constant, span);
        };
        let value = self.value(source);
        if !self.can_be_null(source) || entry.row.reads == Reads::Null {
            return (value, key.span);
        }
        let Some(constant) = constant(self) else {
            return (Value::Refused, key.span);
        };
        (
            self.without_null(value, constant, entry.row.reads, port),
            key.span,
        )
    }

    /// True if an output of the text can be null there: what is not evaluated in every cycle, and some types.
    fn can_be_null(&self, source: Source<'t>) -> bool {
        let Source::Output { primitive, .. } = source else {
            return false;
        };
        let entry = self.entries.get(primitive).copied().flatten();
        let conditional = self
            .flat
            .primitives
            .get(primitive)
            .is_some_and(|primitive| {
                !primitive.active.is_empty()
                    || primitive
                        .inputs
                        .iter()
                        .any(|(key, _)| key.name == "inActive")
            });
        conditional || entry.is_some_and(|entry| entry.row.may_be_null)
    }

    /// What the predecessor reads where a value is null: the last one, or a constant.
    fn without_null(&mut self, value: Value, constant: Literal, reads: Reads, port: Port) -> Value {
        match value {
            Value::Refused | Value::Constant(_) => value,
            Value::List(elements) => {
                let mut constants = match constant.shape {
                    Shape::List(constants) => constants.into_iter(),
                    _ => Vec::new().into_iter(),
                };
                let elements = elements.into_iter().map(|element| {
                    let constant = constants.next();
                    let constant = constant.unwrap_or_else(|| port.ty.zero(Span::default()));
                    self.without_null(element, constant, reads, port)
                });
                Value::List(elements.collect())
            }
            value => {
                let span = self.span(self.current);
                let key = format!("{reads:?} {value:?} {constant:?}");
                let inputs = vec![("in", value, span)];
                let name = if reads == Reads::Parameter {
                    "known"
                } else {
                    "last"
                };
                let made = self.shared(key, "OrElse", name, Vec::new(), inputs);
                let other = match (reads, self.wire(made, "out")) {
                    // The last known value: itself of the cycle before.
                    (Reads::Last, Value::Wire(wire)) => Value::Before(wire, constant),
                    _ => Value::Constant(constant),
                };
                if let Some(ours) = self
                    .ours
                    .get_mut(made)
                    .filter(|ours| ours.inputs.len() == 1)
                {
                    ours.inputs.push(("other", other, span));
                }
                self.wire(made, "out")
            }
        }
    }

    /// A primitive that is made once for all that need the same.
    fn shared(
        &mut self,
        key: String,
        ty: &'static str,
        name: &str,
        parameters: Vec<(&'static str, Literal)>,
        inputs: Vec<(&'static str, Value, Span)>,
    ) -> usize {
        if let Some(made) = self.shared.get(&key) {
            return *made;
        }
        let base = inputs.iter().find_map(|(_, value, _)| match value {
            Value::Wire(wire) => Some((wire.primitive, wire.index)),
            _ => None,
        });
        let id = match base {
            Some((primitive, Some(index))) => format!("{}_{index}_{name}", self.ours[primitive].id),
            Some((primitive, None)) => format!("{}_{name}", self.ours[primitive].id),
            None => name.to_string(),
        };
        let made = self.ours.len();
        self.ours.push(Ours {
            id,
            span: self.span(self.current),
            ty,
            parameters,
            inputs,
            // Never that of one of its users.
            active: None,
            made_for: usize::MAX,
        });
        self.shared.insert(key, made);
        made
    }
}
