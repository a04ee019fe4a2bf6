//! Converts the predecessor's primitives to RCC primitives: in the order of their links, each is replaced as its row of
//! the table says. Everything without a counterpart is reported with its span, all at once. Runs on the loader's
//! threads.

mod arrays;
mod finish;
mod names;
mod nulls;
mod order;
mod special;
mod template;
mod units;

use std::cell::OnceCell;
use std::collections::BTreeMap;

use foldhash::{HashMap, HashMapExt, HashSet, HashSetExt};
use rcc_config::diagnostic::{Diagnostic, NameSearch, Span};
use rcc_config::yaml::{Key, ShortText};
use rcc_core::primitive::Spec;
use rcc_core::primitives;
use rcc_core::unit::Unit;
use rcc_language::codes;
use rcc_language::devices::DeviceTable;
use rcc_language::syntax::Net;
use rcc_language::syntax::literal::{Literal, LiteralShape};

use super::Options;
use super::flatten::{FlatNet, FlatSource};
use super::table::{Counterpart, TypeEntry};
use super::values;

/// Most elements that all arrays of a net may have together: each has its own list of up to 1024.
const ARRAY_ELEMENTS_MAX: usize = 1 << 20;

/// The conversion of an output of the predecessor.
#[derive(Clone, Debug)]
enum BuiltValue {
    /// An output of an RCC primitive, or an element of one.
    Output(BuiltOutput),
    /// A constant.
    Constant(Literal),
    /// An array whose elements are known one by one.
    List(Vec<BuiltValue>),
    /// The output of a `Pre`, with its index in `delayed`: the value of the previous cycle.
    Delayed(usize),
    /// The value of an output in the previous cycle, with the initial value.
    Before(Box<(BuiltOutput, Literal)>),
    /// Refused; the error is reported.
    Refused,
}

/// An output of an RCC primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct BuiltOutput {
    primitive: usize,
    port: &'static str,
    index: Option<u32>,
    /// The unit of the value; 1 also where the type implies the unit.
    unit: Unit,
    /// Number of elements, for an array.
    length: Option<u32>,
    /// True for a Vector3, Twist or Wrench, whose unit is changed by `Scale`.
    is_vector: bool,
}

impl BuiltOutput {
    /// Returns true for a Vector3, Twist or Wrench, but not for an element of one.
    fn is_whole_vector(&self) -> bool {
        self.is_vector && self.index.is_none()
    }
}

/// An RCC primitive.
#[derive(Debug)]
struct BuiltPrimitive {
    id: ShortText,
    span: Span,
    ty: &'static str,
    /// Spec of its type; `None` if the catalogue does not have it.
    spec: Option<&'static Spec>,
    parameters: Vec<(&'static str, Literal)>,
    inputs: Vec<(&'static str, BuiltValue, Span)>,
    active: Option<BuiltValue>,
    /// Index of the primitive of the text that it was made for; determines its place in the result.
    made_for: usize,
}

impl BuiltPrimitive {
    /// Returns a primitive without parameters, inputs and condition.
    fn new(ty: &'static str, id: ShortText, span: Span, made_for: usize) -> BuiltPrimitive {
        BuiltPrimitive {
            id,
            span,
            ty,
            spec: primitives::find(ty).map(|(_, entry)| &entry.spec),
            parameters: Vec::new(),
            inputs: Vec::new(),
            active: None,
            made_for,
        }
    }
}

/// The commanded axes of a robot.
#[derive(Debug, Default)]
struct ArmAxes {
    axes: BTreeMap<u32, (BuiltValue, Span)>,
    active: Option<BuiltValue>,
    span: Span,
    made_for: usize,
}

/// The state of the conversion.
struct Conversion<'t, 'f> {
    options: &'f Options,
    cell: &'f DeviceTable,
    diagnostics: &'f mut Vec<Diagnostic>,
    flat: &'f FlatNet<'t>,
    entries: Vec<Option<&'static TypeEntry>>,
    /// Values of the outputs, by primitive of the text.
    values: Vec<Vec<(&'static str, BuiltValue)>>,
    built: Vec<BuiltPrimitive>,
    /// Primitives that serve several others, by key: unit casts, `JointState`, last known values.
    shared: HashMap<String, usize>,
    arms: BTreeMap<String, ArmAxes>,
    /// Values sent to the application, by key.
    keys: Vec<(String, BuiltValue)>,
    /// The `Pre` primitives of the text, with their conditions.
    delayed: Vec<(usize, Option<BuiltValue>)>,
    /// Outputs of the text that something reads, for the types that ask for them.
    read: OnceCell<HashSet<(usize, &'t str)>>,
    search: NameSearch,
    /// Devices that are reported as unknown.
    absent: HashSet<String>,
    /// Values of parameters that are reported as malformed; one may be read more than once.
    misread: HashSet<Option<Span>>,
    /// Number of elements in lists made of arrays.
    array_elements: usize,
    /// Index of the primitive of the text that is being converted.
    current: usize,
}

/// Converts a net. Errors are reported; the net is complete only if there are none.
pub fn build(
    flat: &FlatNet<'_>,
    options: &Options,
    cell: &DeviceTable,
    diagnostics: &mut Vec<Diagnostic>,
) -> Net {
    let mut build = Conversion {
        options,
        cell,
        diagnostics,
        flat,
        entries: Vec::new(),
        values: vec![Vec::new(); flat.primitives.len()],
        built: Vec::new(),
        shared: HashMap::new(),
        arms: BTreeMap::new(),
        keys: Vec::new(),
        delayed: Vec::new(),
        read: OnceCell::new(),
        search: NameSearch::default(),
        absent: HashSet::new(),
        misread: HashSet::new(),
        array_elements: 0,
        current: 0,
    };
    for primitive in &flat.primitives {
        let entry = build.check_names(primitive);
        build.entries.push(entry);
    }
    for number in (0..flat.primitives.len())
        .filter(|number| build.is_pre(*number))
        .collect::<Vec<_>>()
    {
        let value = BuiltValue::Delayed(build.delayed.len());
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

impl<'t> Conversion<'t, '_> {
    fn error(&mut self, code: &'static str, span: Span, message: String, help: Option<String>) {
        self.diagnostics
            .push(Diagnostic::error(code, span, message).help_if(help));
    }

    fn suggest<'k>(
        &mut self,
        name: &str,
        known: impl IntoIterator<Item = &'k str>,
    ) -> Option<String> {
        let near = self.search.near(name, known)?;
        Some(format!("did you mean `{near}`?"))
    }

    /// Converts a primitive of the text.
    fn primitive(&mut self, number: usize) {
        let Some(entry) = self.entries.get(number).copied().flatten() else {
            return;
        };
        for port in &entry.inputs {
            if port.required && self.given(number, port.name).is_none() {
                self.not_connected(number, port.name, entry);
            }
        }
        self.report_ignored_input(number, entry, "inReset");
        let active = self.active(number);
        let first = self.built.len();
        match entry.row.to {
            Counterpart::Net(_) => {
                if let Some(net) = entry.nets.first() {
                    self.expand(number, entry, net);
                }
            }
            Counterpart::By(parameter, ..) => {
                let chosen = self.parameter(number, entry, parameter);
                let no = matches!(chosen.map(|it| it.shape), Some(LiteralShape::Bool(false)));
                if let Some(net) = entry.nets.get(usize::from(no)) {
                    self.expand(number, entry, net);
                }
            }
            Counterpart::Special(builtin) => self.special(number, entry, builtin, active.as_ref()),
            Counterpart::None(_) => {}
        }
        if let Some(active) = active {
            for built in self.built.iter_mut().skip(first) {
                // A shared primitive is not subject to the condition of one of its users, nor is the primitive that
                // computes the condition.
                if built.made_for == number && built.active.is_none() {
                    built.active = Some(active.clone());
                }
            }
        }
    }

    /// Reports a connected `inReset` that the conversion would ignore.
    fn report_ignored_input(&mut self, number: usize, entry: &TypeEntry, input: &str) {
        let mentioned = entry.nets.iter().any(|net| net.mentions(input));
        let Some((key, _)) = self.given(number, input) else {
            return;
        };
        if entry.input(input).is_some() && !mentioned && !self.is_pre(number) {
            let message = format!("the input `{input}` of {} has no counterpart", entry.name);
            self.error(codes::NO_COUNTERPART, key.span, message, None);
        }
    }

    fn not_connected(&mut self, number: usize, port: &str, entry: &TypeEntry) {
        let message = format!("the input `{port}` of {} is not connected", entry.name);
        let span = self.flat.primitives[number].ty.span;
        self.error(codes::NOT_CONNECTED, span, message, None);
    }

    fn span(&self, number: usize) -> Span {
        let primitive = self.flat.primitives.get(number);
        primitive.map_or(Span::default(), |primitive| primitive.span)
    }

    /// Returns the link to an input.
    fn given(&self, number: usize, input: &str) -> Option<(&'t Key, FlatSource<'t>)> {
        let primitive = self.flat.primitives.get(number)?;
        let mut inputs = primitive.inputs.iter();
        inputs.find(|(key, _)| key.name == input).copied()
    }

    /// Returns the value of an output of the text.
    fn value(&mut self, source: FlatSource<'t>) -> BuiltValue {
        let FlatSource::Output { primitive, port } = source else {
            return BuiltValue::Refused;
        };
        let Some(entry) = self.entries.get(primitive).copied().flatten() else {
            return BuiltValue::Refused;
        };
        let mut known = self.values.get(primitive).into_iter().flatten();
        if let Some((_, value)) = known.find(|(known, _)| port.name == *known) {
            return value.clone();
        }
        if entry.output(&port.name).is_none() {
            let names = entry.outputs.iter().map(|port| port.name);
            let message = format!(
                "output not found: {} has no output `{}`",
                entry.name, port.name
            );
            let near = self.suggest(&port.name, names);
            self.error(codes::UNKNOWN_OUTPUT, port.span, message, near);
        } else {
            let message = format!(
                "the output `{}` of {} has no counterpart",
                port.name, entry.name
            );
            let note = (!entry.row.note.is_empty()).then(|| entry.row.note.to_string());
            self.error(codes::NO_COUNTERPART, port.span, message, note);
        }
        BuiltValue::Refused
    }

    /// Returns the conditions of a primitive, those of its fragments and its own, joined with And.
    fn active(&mut self, number: usize) -> Option<BuiltValue> {
        let mut conditions = self.flat.primitives.get(number)?.active.clone();
        conditions.extend(self.given(number, "inActive").map(|(_, source)| source));
        let values: Vec<BuiltValue> = conditions
            .into_iter()
            .map(|source| self.value(source))
            .filter(|value| {
                !matches!(
                    value,
                    BuiltValue::Constant(Literal {
                        shape: LiteralShape::Bool(true),
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
            self.built_output(made, "out")
        }))
    }

    /// Returns a parameter of the text, or its default.
    fn parameter(&mut self, number: usize, entry: &TypeEntry, name: &str) -> Option<Literal> {
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
            Err(diagnostic) => {
                if self.misread.insert(diagnostic.place) {
                    self.diagnostics.push(*diagnostic);
                }
                None
            }
        }
    }

    /// Returns a parameter that is a whole number, at least 0.
    fn count(&mut self, number: usize, entry: &TypeEntry, name: &str) -> Option<u32> {
        let literal = self.parameter(number, entry, name)?;
        let LiteralShape::Int(value) = literal.shape else {
            return None;
        };
        let count = u32::try_from(value).ok();
        if count.is_none() {
            let message = format!("`{name}` is {value}");
            self.error(codes::OUT_OF_RANGE, literal.span, message, None);
        }
        count
    }

    /// Returns the primitive with this key, and creates it on first use.
    fn shared(
        &mut self,
        key: String,
        ty: &'static str,
        name: &str,
        parameters: Vec<(&'static str, Literal)>,
        inputs: Vec<(&'static str, BuiltValue, Span)>,
    ) -> usize {
        if let Some(made) = self.shared.get(&key) {
            return *made;
        }
        let base = inputs.iter().find_map(|(_, value, _)| match value {
            BuiltValue::Output(output) => Some((output.primitive, output.index)),
            _ => None,
        });
        let id = match base {
            Some((primitive, Some(index))) => {
                format!("{}_{index}_{name}", self.built[primitive].id)
            }
            Some((primitive, None)) => format!("{}_{name}", self.built[primitive].id),
            None => name.to_string(),
        };
        let made = self.built.len();
        // Never with the condition of one of its users.
        let span = self.span(self.current);
        self.built.push(BuiltPrimitive {
            parameters,
            inputs,
            ..BuiltPrimitive::new(ty, id.into(), span, usize::MAX)
        });
        self.shared.insert(key, made);
        made
    }
}
