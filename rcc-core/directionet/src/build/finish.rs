//! Completes a conversion: commands of whole arms, termination, ids, links and discarded outputs. Runs on the loader's
//! threads.

use foldhash::{HashMap, HashMapExt, HashSet, HashSetExt};
use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::{Key, ShortText};
use rcc_core::counted::Counted;
use rcc_language::codes;
use rcc_language::syntax::literal::{Literal, LiteralShape};
use rcc_language::syntax::part::ValuePart;
use rcc_language::syntax::reference::Reference;
use rcc_language::syntax::{
    Link, List, NAME_MAX, Net, Primitive, PrimitiveKind, Source as InputSource, Timing,
};

use super::{BuiltOutput, BuiltPrimitive, BuiltValue, Conversion};
use crate::flatten::FlatSource;

/// Converts a name of the predecessor to an id: lowercase letters, digits and `_`, beginning with a letter.
#[must_use]
pub fn id(name: &str) -> ShortText {
    let is_of_id = |byte: u8| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'_');
    if name.starts_with(|c: char| c.is_ascii_lowercase()) && name.bytes().all(is_of_id) {
        return ShortText::new(name);
    }
    let mut id = ShortText::with_capacity(name.len() + 1);
    for c in name.chars() {
        match c {
            'a'..='z' | '0'..='9' | '_' => id.push(c),
            'A'..='Z' => id.push(c.to_ascii_lowercase()),
            _ => id.push('_'),
        }
    }
    if !id.starts_with(|c: char| c.is_ascii_lowercase()) {
        id.insert_str(0, "p");
    }
    id
}

impl Conversion<'_, '_> {
    /// Returns the id for a primitive of the text, derived from its path.
    pub(super) fn id_of(&self, number: usize) -> ShortText {
        let primitive = self.flat.primitives.get(number);
        id(primitive.map_or("", |it| &it.path))
    }

    pub(super) fn finish(mut self) -> Net {
        self.command_arms();
        self.terminate();
        self.warn_of_debug();
        let delayed = self.delayed_values();
        let order = self.order_of_the_text();
        let ids = self.ids(&order);
        let mut read = HashSet::with_capacity(order.len());
        let mut primitives = Vec::with_capacity(order.len());
        for made in &order {
            let Some(built) = self.built.get(*made) else {
                continue;
            };
            let writer = NetWriter {
                ids: &ids,
                delayed: &delayed,
            };
            primitives.push(writer.primitive(*made, built, &mut read));
        }
        let discard = self.discard(&order, &ids, &read);
        Net {
            name: Key {
                name: self.options.name.as_str().into(),
                span: Span::default(),
            },
            description: "made from DirectIONet".to_string(),
            survives_device_loss: false,
            timing: Timing::default(),
            uses: Vec::new(),
            fragments: Vec::new(),
            primitives,
            discard,
        }
    }

    fn add(&mut self, built: BuiltPrimitive) -> usize {
        self.built.push(built);
        self.built.len() - 1
    }

    /// Adds one command for all axes of each robot.
    fn command_arms(&mut self) {
        for (device, arm) in std::mem::take(&mut self.arms) {
            let joints = self
                .cell
                .find(&device)
                .map_or(0, |(_, device)| device.model.joints);
            let missing: Vec<String> = (0..joints)
                .filter(|axis| !arm.axes.contains_key(axis))
                .map(|axis| axis.to_string())
                .collect();
            if !missing.is_empty() {
                let message = format!(
                    "the net commands only {} of the {joints} axes of `{device}`; missing: {}",
                    arm.axes.len(),
                    missing.join(", ")
                );
                let diagnostic = Diagnostic::error(codes::WRONG_ARM, arm.span, message);
                self.diagnostics.push(diagnostic.help(
                    "command all axes, or name the arm that the net was made for in `# devices:`",
                ));
                continue;
            }
            self.current = arm.made_for;
            let (name, span) = (id(&format!("{device}_command")), self.span(arm.made_for));
            let made = self.add(BuiltPrimitive {
                parameters: vec![("device", text(&device, arm.span))],
                active: arm.active,
                ..BuiltPrimitive::new("JointPositionCommand", name, span, arm.made_for)
            });
            let span = arm.axes.values().next().map_or(arm.span, |(_, span)| *span);
            let list = BuiltValue::List(arm.axes.into_values().map(|(value, _)| value).collect());
            let port = self.spec(made).and_then(|spec| spec.input("position"));
            let value = match port {
                Some((_, port)) => self.fit(list, made, port),
                None => BuiltValue::Refused,
            };
            if let Some(built) = self.built.get_mut(made) {
                built.inputs = vec![("position", value, span)];
            }
        }
    }

    /// Adds the termination: `outTerminate`, and the keys given as ends.
    fn terminate(&mut self) {
        self.current = usize::MAX;
        let outputs = &self.flat.outputs;
        let terminate = outputs.iter().find(|(key, _)| key.name == "outTerminate");
        let Some((key, source)) = terminate.copied() else {
            let message = "the net has no output `outTerminate`".to_string();
            let help = Some("add `outTerminate=PRIMITIVE.PORT`".to_string());
            self.diagnostics.push(
                Diagnostic::error(codes::NO_TERMINATION, Span::default(), message)
                    .anywhere()
                    .help_if(help),
            );
            return;
        };
        let mut done = self.value(source);
        let mut never = matches!(&done, BuiltValue::Constant(literal) if literal.shape == LiteralShape::Bool(false));
        let span = match source {
            FlatSource::Output { port, .. } => port.span,
            FlatSource::Refused => key.span,
        };
        let mut sent = HashMap::new();
        for (key, value) in &self.keys {
            sent.entry(key.clone()).or_insert_with(|| value.clone());
        }
        for (end, place) in &self.options.end {
            let Some(value) = sent.get(end).cloned() else {
                self.unknown_key(end, *place);
                continue;
            };
            if never {
                (done, never) = (value, false);
                continue;
            }
            let name = id(&format!("end_{end}"));
            let made = self.add(BuiltPrimitive {
                inputs: vec![("a", done, span), ("b", value, span)],
                ..BuiltPrimitive::new("Or", name, span, usize::MAX)
            });
            done = self.built_output(made, "out");
        }
        if never {
            let message = "the net never terminates: `outTerminate` is always false";
            let diagnostic = Diagnostic::warning(codes::NEVER_ENDS, span, message);
            self.diagnostics.push(diagnostic.help(
                "the predecessor's application ended it on a result: name these results, `# end: _1, _2`, or abort it",
            ));
        }
        self.add(BuiltPrimitive {
            inputs: vec![("done", done, span)],
            ..BuiltPrimitive::new("Termination", "end".into(), span, usize::MAX)
        });
    }

    fn unknown_key(&mut self, end: &str, place: Span) {
        let message = format!("the net sends no value with the key `{end}` to the application");
        let keys = self.keys.iter().map(|(key, _)| key.as_str());
        let help = match self.search.near(end, keys.clone()) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("keys: {}", keys.take(10).collect::<Vec<_>>().join(", ")),
        };
        self.diagnostics
            .push(Diagnostic::error(codes::WRONG_SHAPE, place, message).help(help));
    }

    fn warn_of_debug(&mut self) {
        let Some(first) = self.flat.debug.first() else {
            return;
        };
        let count = self.flat.debug.len();
        let message = format!(
            "a debug history is requested here and at {}, but is not kept",
            Counted::of(count - 1, "other input")
        );
        let diagnostic = Diagnostic::warning(codes::NO_HISTORY, *first, message);
        self.diagnostics.push(diagnostic.help(
            "the flight recorder keeps all device inputs and set-points, and `rcc-cli watch` shows any port",
        ));
    }

    /// Returns the source of each `Pre` as a plain number.
    fn delayed_values(&mut self) -> Vec<BuiltValue> {
        let mut values = Vec::new();
        for (number, active) in self.delayed.clone() {
            self.current = number;
            let Some(entry) = self.entries.get(number).copied().flatten() else {
                continue;
            };
            let (value, span) = self.argument(number, entry, "inValue");
            let value = self.in_unit(value, rcc_core::unit::Unit::ONE);
            let reset = self.given(number, "inReset");
            let is_place = matches!(value, BuiltValue::Output(_) | BuiltValue::Refused);
            if is_place && active.is_none() && reset.is_none() {
                values.push(value);
                continue;
            }
            // A constant, a value that is delayed already, and a value that is not always stored each need a primitive
            // of their own.
            let never = BuiltValue::Constant(Literal::new(LiteralShape::Bool(false), span));
            let reset = reset.map_or(never, |(_, source)| self.value(source));
            let inputs = vec![("in", value, span), ("condition", reset, span)];
            let made = self.one(number, "NullIf", inputs);
            self.built[made].active = active;
            values.push(self.built_output(made, "out"));
        }
        values
    }

    /// Returns the primitives in the order of the text; a shared primitive comes before its first user.
    fn order_of_the_text(&self) -> Vec<usize> {
        let mut place: Vec<usize> = self.built.iter().map(|built| built.made_for).collect();
        for (made, built) in self.built.iter().enumerate().rev() {
            let Some(at) = place.get(made).copied() else {
                continue;
            };
            for (_, value, _) in &built.inputs {
                for_outputs_in(value, &mut |output| {
                    let built = self.built.get(output.primitive);
                    let is_shared = built.is_some_and(|it| it.made_for == usize::MAX);
                    if let Some(place) = place.get_mut(output.primitive).filter(|_| is_shared) {
                        *place = at.min(*place);
                    }
                });
            }
        }
        let mut order: Vec<usize> = (0..self.built.len()).collect();
        order.sort_by_key(|made| place.get(*made).copied());
        order
    }

    /// Returns unique ids of limited length.
    fn ids(&self, order: &[usize]) -> Vec<ShortText> {
        let mut ids = vec![ShortText::default(); self.built.len()];
        let mut taken: HashMap<ShortText, usize> = HashMap::with_capacity(ids.len());
        for made in order {
            let Some(built) = self.built.get(*made) else {
                continue;
            };
            // Ids are ASCII.
            let part = |length: usize| ShortText::new(&built.id[..length.min(built.id.len())]);
            let mut name = part(NAME_MAX);
            while let Some(count) = taken.get_mut(&name) {
                *count += 1;
                let tail = format!("_{count}");
                name = part(NAME_MAX - tail.len());
                name.push_str(&tail);
            }
            taken.insert(name.clone(), 1);
            if let Some(place) = ids.get_mut(*made) {
                *place = name;
            }
        }
        ids
    }

    /// Returns all outputs that nothing reads and that must be discarded.
    fn discard(
        &self,
        order: &[usize],
        ids: &[ShortText],
        read: &HashSet<(usize, &'static str)>,
    ) -> Vec<Reference> {
        let mut discard = Vec::new();
        for made in order {
            let (Some(spec), Some(built)) = (self.spec(*made), self.built.get(*made)) else {
                continue;
            };
            for port in spec.outputs {
                if !port.diagnostic && !read.contains(&(*made, port.name)) {
                    let output = (*made, port.name, None);
                    discard.push(reference(ids, output, built.span));
                }
            }
        }
        discard
    }
}

fn text(text: &str, span: Span) -> Literal {
    Literal::new(LiteralShape::Text(text.to_string()), span)
}

fn for_outputs_in(value: &BuiltValue, visit: &mut impl FnMut(&BuiltOutput)) {
    match value {
        BuiltValue::Output(output) => visit(output),
        BuiltValue::List(values) => values.iter().for_each(|it| for_outputs_in(it, visit)),
        _ => {}
    }
}

fn reference(
    ids: &[ShortText],
    (primitive, port, index): (usize, &str, Option<u32>),
    span: Span,
) -> Reference {
    Reference {
        primitive: ids.get(primitive).cloned().unwrap_or_default(),
        port: port.into(),
        part: index.map(ValuePart::Element),
        span,
        primitive_span: span,
        port_span: span,
    }
}

/// Converts the built primitives to the syntax model.
struct NetWriter<'b> {
    ids: &'b [ShortText],
    delayed: &'b [BuiltValue],
}

impl NetWriter<'_> {
    fn primitive(
        &self,
        made: usize,
        built: &BuiltPrimitive,
        read: &mut HashSet<(usize, &'static str)>,
    ) -> Primitive {
        let key = |name: &str, span: Span| Key {
            name: name.into(),
            span,
        };
        let mut inputs = Vec::with_capacity(built.inputs.len());
        for (name, value, span) in &built.inputs {
            inputs.push((
                key(name, *span),
                self.link_source(value, *span, false, read),
            ));
        }
        let active = built.active.as_ref();
        Primitive {
            id: key(self.ids.get(made).map_or("", ShortText::as_str), built.span),
            kind: PrimitiveKind::Type,
            type_name: key(built.ty, built.span),
            parameters: built
                .parameters
                .iter()
                .map(|(name, literal)| (key(name, literal.span), literal.clone()))
                .collect(),
            inputs,
            active: active.map(|value| self.link_source(value, built.span, false, read)),
        }
    }

    fn link(
        &self,
        output: &BuiltOutput,
        initial: Option<Literal>,
        span: Span,
        read: &mut HashSet<(usize, &'static str)>,
    ) -> InputSource {
        read.insert((output.primitive, output.port));
        let output = (output.primitive, output.port, output.index);
        InputSource::Link(Link {
            from: reference(self.ids, output, span),
            delayed: initial.is_some(),
            initial: initial.map(Box::new),
            span,
        })
    }

    fn link_source(
        &self,
        value: &BuiltValue,
        span: Span,
        delayed: bool,
        read: &mut HashSet<(usize, &'static str)>,
    ) -> InputSource {
        match value {
            BuiltValue::Output(output) => {
                let null = || Literal::new(LiteralShape::Null, span);
                self.link(output, delayed.then(null), span, read)
            }
            BuiltValue::Before(before) => {
                let (output, initial) = before.as_ref();
                self.link(output, Some(initial.clone()), span, read)
            }
            BuiltValue::Constant(literal) => InputSource::Literal(literal.clone()),
            BuiltValue::Delayed(number) => match self.delayed.get(*number) {
                Some(value) => self.link_source(value, span, true, read),
                None => InputSource::Refused,
            },
            BuiltValue::List(elements) => InputSource::List(List {
                elements: elements
                    .iter()
                    .map(|element| self.link_source(element, span, delayed, read))
                    .collect(),
                span,
            }),
            BuiltValue::Refused => InputSource::Refused,
        }
    }
}
