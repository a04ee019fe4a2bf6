//! Replaces the expressions of one net or fragment by primitives. Runs on the loader's threads.

use std::collections::{HashMap, HashSet};

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::Key;

use super::error::Problem;
use super::lexer::{KEYWORDS, Lexer, Token};
use super::parser::parse;
use super::places::{Place, PortWords};
use super::terms::{NamedInputs, Scope, Terms, link_to};
use super::values::{OperationOutput, Operations, Value, marked};
use super::{EXPRESSION, FORMULA, ListCount, emit, is_formula};
use crate::codes;
use crate::parse::reference;
use crate::source_map::SourceMap;
use crate::syntax::literal::LiteralShape;
use crate::syntax::reference::Reference;
use crate::syntax::{Formula, Link, Primitive, PrimitiveKind, Source};

/// The lowering of one net or fragment.
pub struct BodyLowering<'a> {
    terms: Terms,
    sources: &'a SourceMap,
    diagnostics: &'a mut Vec<Diagnostic>,
    /// Operations that are a whole `Formula`, by the number of the primitive.
    whole: HashMap<usize, usize>,
    refused: Vec<Primitive>,
    /// Primitives with discarded outputs: no other formula reads them.
    discarded: HashSet<String>,
}

impl<'a> BodyLowering<'a> {
    /// Begins with the inputs of the fragment, which a net does not have, and the discarded outputs.
    pub fn new(
        fragment_inputs: Vec<String>,
        discard: &[Reference],
        sources: &'a SourceMap,
        diagnostics: &'a mut Vec<Diagnostic>,
    ) -> BodyLowering<'a> {
        BodyLowering {
            terms: Terms {
                fragment_inputs: fragment_inputs.into_iter().collect(),
                ..Terms::default()
            },
            sources,
            diagnostics,
            whole: HashMap::new(),
            refused: Vec::new(),
            discarded: discard
                .iter()
                .map(|output| output.primitive.to_string())
                .collect(),
        }
    }

    /// Replaces all expressions. `lists` counts the list elements of all nets and fragments of a text.
    pub fn run(
        mut self,
        primitives: &mut Vec<Primitive>,
        words: &mut PortWords,
        lists: &mut ListCount,
    ) {
        self.terms.lists = *lists;
        let ids = primitives
            .iter()
            .map(|primitive| primitive.id.name.to_string());
        self.terms.ids = ids.collect();
        for (owner, primitive) in primitives.iter_mut().enumerate() {
            let mut read = Vec::new();
            if is_formula(primitive) {
                self.formula(primitive, owner, &mut read);
            } else {
                for (_, source) in &mut primitive.inputs {
                    self.replace(source, owner, &mut read);
                }
            }
            if let Some(active) = &mut primitive.active {
                self.replace(active, owner, &mut read);
            }
            self.add_refused(&primitive.id, read);
        }
        *lists = self.terms.lists;
        let operations = self.terms.operations.all;
        emit::insert(operations, &self.whole, self.refused, primitives, words);
    }

    /// Replaces a source by one without expressions. `read` gets the outputs that refused expressions name.
    fn replace(&mut self, source: &mut Source, owner: usize, read: &mut Vec<Link>) {
        match source {
            Source::Formula(formula) => {
                let (value, span) = self.expression(formula, owner, read);
                *source = Operations::source(&value, span);
            }
            Source::List(list) => {
                for element in &mut list.elements {
                    self.replace(element, owner, read);
                }
            }
            Source::Outcomes(outcomes) => {
                for (_, condition) in &mut outcomes.rows {
                    self.replace(condition, owner, read);
                }
            }
            Source::Link(_) | Source::Literal(_) | Source::Refused => {}
        }
    }

    /// Returns the value of `= …`.
    fn expression(
        &mut self,
        formula: &Formula,
        owner: usize,
        read: &mut Vec<Link>,
    ) -> (Value, Span) {
        let from = formula.text.find('=').map_or(0, |at| at + 1);
        let mut inputs = NamedInputs::default();
        let text = (formula.text.as_str(), from);
        self.evaluate(text, formula.span, owner, &mut inputs, read)
    }

    /// Evaluates a text, and reports what is wrong with it.
    fn evaluate(
        &mut self,
        (text, from): (&str, usize),
        span: Span,
        owner: usize,
        inputs: &mut NamedInputs,
        read: &mut Vec<Link>,
    ) -> (Value, Span) {
        let place = Place::of(text, self.sources.text(span), span);
        let mut scope = Scope {
            inputs,
            place,
            owner,
            values: Vec::new(),
        };
        let parsed = parse(text, from);
        let evaluated = parsed.and_then(|expression| self.terms.evaluate(&expression, &mut scope));
        if let Err(error) = evaluated {
            let code = error.problem.code();
            let at = scope.place.at(&error.place);
            let is_limit = error.problem == Problem::ListElements;
            // The limit is that of the whole net: one error for all expressions.
            if !(is_limit && std::mem::replace(&mut self.terms.lists.is_reported, is_limit)) {
                let diagnostic = Diagnostic::error(code, at, error.problem.to_string());
                self.diagnostics.push(diagnostic.help_if(error.help));
            }
            read.extend(self.named_outputs(text, from, scope.inputs, span));
            return (Value::Refused, span);
        }
        scope.values.pop().unwrap_or((Value::Refused, span))
    }

    /// Returns the outputs that a refused expression names: they count as read, and its inputs as used.
    fn named_outputs(
        &self,
        text: &str,
        from: usize,
        inputs: &mut NamedInputs,
        span: Span,
    ) -> Vec<Link> {
        let mut lexer = Lexer::new(text, from);
        let mut links = Vec::new();
        inputs.used.extend(inputs.values.keys().cloned());
        loop {
            match lexer.next() {
                Ok((Token::End, _)) => return links,
                Ok((Token::Word(word), _)) => {
                    let reference = reference::parse(word, span);
                    let known = reference.filter(|from| {
                        !from.port.is_empty() && self.terms.ids.contains(from.primitive.as_str())
                    });
                    links.extend(known.map(|from| link_to(from, span)));
                }
                Ok(_) => {}
                // The lexer is behind a character that it refuses, but not behind an angle that never ends.
                Err(error) if matches!(error.problem, Problem::Character { .. }) => {}
                Err(_) => return links,
            }
        }
    }

    /// Replaces a `Formula` by the primitive that computes its last term.
    fn formula(&mut self, primitive: &mut Primitive, owner: usize, read: &mut Vec<Link>) {
        let mut inputs = NamedInputs::default();
        for (key, source) in &mut primitive.inputs {
            self.replace(source, owner, read);
            let value = self.input_value(key, source);
            inputs.values.insert(key.name.to_string(), value);
        }
        let text = self.text_of(primitive);
        let (value, span) = match &text {
            Some((text, span)) => self.evaluate((text, 0), *span, owner, &mut inputs, read),
            None => {
                inputs.used.extend(inputs.values.keys().cloned());
                (Value::Refused, primitive.id.span)
            }
        };
        self.report_unused(primitive, &inputs);
        let given = std::mem::take(&mut primitive.inputs);
        primitive.parameters.clear();
        if let Value::Refused = value {
            // A primitive of unknown type, which is reported already.
            primitive.type_name.name.clear();
            primitive.inputs = given;
            return;
        }
        self.put(primitive, owner, &value, span);
    }

    fn input_value(&mut self, key: &Key, source: &Source) -> Value {
        let problem = match source {
            _ if KEYWORDS.contains(&key.name.as_str()) => {
                let message = format!("`{}` is a word of formulas", key.name);
                Some((
                    codes::BAD_NAME,
                    message,
                    "choose another name for the input",
                ))
            }
            Source::Outcomes(_) => {
                let name = key.name.to_string();
                let message = Problem::Outcomes { name }.to_string();
                Some((
                    codes::WRONG_SHAPE,
                    message,
                    "connect an output or a constant",
                ))
            }
            _ => None,
        };
        if let Some((code, message, help)) = problem {
            let diagnostic = Diagnostic::error(code, key.span, message);
            self.diagnostics.push(diagnostic.help(help));
            return Value::Refused;
        }
        self.value_of(source)
    }

    /// Returns the value of a source without expressions; the marks of operations in it are read back.
    fn value_of(&self, source: &Source) -> Value {
        match source {
            Source::Literal(literal) => Value::Constant(literal.clone()),
            Source::List(list) => {
                let elements = list.elements.iter();
                let elements = elements.map(|element| (self.value_of(element), list.span));
                Value::List(elements.collect())
            }
            Source::Link(link) => match marked(&link.from) {
                Some(number) => self.output_of(number, link),
                None => Value::Link(link.clone()),
            },
            Source::Outcomes(_) | Source::Formula(_) | Source::Refused => Value::Refused,
        }
    }

    fn output_of(&self, number: usize, link: &Link) -> Value {
        let operation = self.terms.operations.all.get(number);
        let port = match operation.and_then(|operation| operation.spec) {
            Some(spec) => spec.output(&link.from.port).map(|(_, port)| port.name),
            None => Some("out"),
        };
        Value::Operation(OperationOutput {
            number,
            port,
            part: link.from.part,
            delayed: link.delayed,
            initial: link.initial.clone(),
        })
    }

    /// Returns the text of a `Formula` with its span, and reports wrong parameters.
    fn text_of(&mut self, primitive: &Primitive) -> Option<(String, Span)> {
        let mut text = None;
        for (key, literal) in &primitive.parameters {
            match &literal.shape {
                LiteralShape::Text(expression) if key.name == EXPRESSION => {
                    text = Some((expression.clone(), literal.span));
                }
                _ if key.name == EXPRESSION => return None,
                _ => {
                    let message = format!("{FORMULA} has no parameter `{}`", key.name);
                    let diagnostic = Diagnostic::error(codes::UNKNOWN_PARAMETER, key.span, message);
                    self.diagnostics
                        .push(diagnostic.help("its parameter is `expr`"));
                }
            }
        }
        if text.is_none() {
            let message = format!("`{}` has no expression", primitive.id.name);
            let diagnostic =
                Diagnostic::error(codes::MISSING_PARAMETER, primitive.id.span, message);
            let help = "add `parameters: {expr: \"…\"}`";
            self.diagnostics.push(diagnostic.help(help));
        }
        text
    }

    fn report_unused(&mut self, primitive: &Primitive, inputs: &NamedInputs) {
        for (key, _) in &primitive.inputs {
            if !inputs.used.contains(key.name.as_str()) {
                let message = format!("the formula does not use its input `{}`", key.name);
                let diagnostic = Diagnostic::error(codes::NOT_USED, key.span, message);
                self.diagnostics.push(diagnostic);
            }
        }
    }

    /// Makes a `Formula` the operation that computes it, a constant, or a copy of another output.
    fn put(&mut self, primitive: &mut Primitive, owner: usize, value: &Value, span: Span) {
        let always_active = primitive.active.is_none();
        let is_shared = !self.discarded.contains(primitive.id.name.as_str());
        if let Value::Operation(output) = value
            && let Some(operation) = self.terms.operations.all.get_mut(output.number)
            && let (None, false, Some("out")) = (output.part, output.delayed, output.port)
            && let (None, true, true) = (&operation.id, always_active, is_shared)
            && operation.spec.is_none_or(|spec| spec.outputs.len() == 1)
        {
            operation.id = Some(primitive.id.name.to_string());
            self.whole.insert(owner, output.number);
            return;
        }
        let key = |name: &str| Key {
            name: name.into(),
            span,
        };
        if let (Value::Constant(literal), true) = (value, always_active) {
            primitive.type_name = key("Constant");
            primitive.parameters = vec![(key("value"), literal.clone())];
            return;
        }
        primitive.type_name = key("Copy");
        primitive.inputs = vec![(key("in"), Operations::source(value, span))];
    }

    /// Adds what stands in the place of a refused expression: a primitive of unknown type that reads the outputs that the
    /// expression names, so that they are not reported as unread.
    fn add_refused(&mut self, owner: &Key, read: Vec<Link>) {
        if read.is_empty() {
            return;
        }
        let key = |name: String| Key {
            name: name.into(),
            span: owner.span,
        };
        let links = read.into_iter();
        self.refused.push(Primitive {
            id: key(format!("{}/refused{}", owner.name, self.refused.len())),
            kind: PrimitiveKind::Type,
            type_name: key(String::new()),
            parameters: Vec::new(),
            inputs: links
                .map(|link| (key(String::new()), Source::Link(link)))
                .collect(),
            active: None,
        });
    }
}
