//! Fragments taken apart: every primitive with its path, every link followed through the borders of fragments to the
//! primitive that feeds it. Names only, no types. The loader's threads.

use std::collections::{HashMap, HashSet};

use rcc_config::diagnostic::{Diagnostic, Span, closest};
use rcc_config::yaml::Key;

use super::text::{self, Argument, Fragment, Item, Value};
use crate::fault;

/// Most borders of fragments that one link may cross; more is a circle or a trick.
const BORDERS_MAX: usize = 4 * text::DEPTH_MAX;

/// Most names that are compared for a suggestion, over all faults.
const SUGGESTIONS_MAX: usize = 100;

/// A net without fragments.
#[derive(Debug, Default)]
pub struct Flat<'t> {
    /// Its primitives in the order of the text.
    pub primitives: Vec<Primitive<'t>>,
    /// Outputs of the net as a whole: `outTerminate` and others.
    pub outputs: Vec<(&'t Key, Source<'t>)>,
    /// Where a history for debugging is asked for.
    pub debug: Vec<Span>,
}

/// A primitive of the text.
#[derive(Debug)]
pub struct Primitive<'t> {
    /// Names of the fragments around it and its own.
    pub path: Vec<String>,
    /// Place of its name.
    pub span: Span,
    /// Its type.
    pub ty: &'t Key,
    /// Parameters: name, text and the text's place.
    pub parameters: Vec<(&'t Key, &'t str, Span)>,
    /// Links by input; those that lead to an input of a fragment that nobody feeds are left out.
    pub inputs: Vec<(&'t Key, Source<'t>)>,
    /// The conditions of the fragments around it, outermost first.
    pub active: Vec<Source<'t>>,
}

impl Flat<'_> {
    /// Every output that an input, a condition or the net as a whole reads.
    #[must_use]
    pub fn reads(&self) -> HashSet<(usize, String)> {
        let inputs = self.primitives.iter().flat_map(|primitive| {
            let links = primitive.inputs.iter().map(|(_, source)| source);
            links.chain(&primitive.active)
        });
        let outputs = self.outputs.iter().map(|(_, source)| source);
        inputs
            .chain(outputs)
            .filter_map(|source| match source {
                Source::Output { primitive, port } => Some((*primitive, port.name.clone())),
                Source::Refused => None,
            })
            .collect()
    }
}

/// What feeds an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Source<'t> {
    /// An output of a primitive.
    Output {
        /// Index of the primitive.
        primitive: usize,
        /// The output, where its name stands.
        port: &'t Key,
    },
    /// Its fault is reported.
    Refused,
}

/// A fragment in its place.
struct Scope<'t> {
    parent: Option<usize>,
    path: Vec<String>,
    names: HashMap<&'t str, (Target, Span)>,
    outputs: HashMap<&'t str, (&'t text::Primitive, &'t Key)>,
    arguments: &'t [Argument],
    active: Option<&'t Argument>,
}

#[derive(Clone, Copy)]
enum Target {
    Primitive(usize),
    Scope(usize),
}

struct Flattener<'t, 'f> {
    faults: &'f mut Vec<Diagnostic>,
    scopes: Vec<Scope<'t>>,
    flat: Flat<'t>,
    /// Arguments of each primitive with the scope that they stand in.
    arguments: Vec<(usize, &'t [Argument])>,
    /// How many faults were given a suggestion.
    suggestions: usize,
    /// Primitives and fragments without a name, by the place of their node in the tree.
    nameless: HashMap<*const text::Primitive, Target>,
}

/// Takes a net apart. Everything is reported that names something which is not there.
pub fn flatten<'t>(root: &'t Fragment, faults: &mut Vec<Diagnostic>) -> Flat<'t> {
    let mut flattener = Flattener {
        faults,
        scopes: Vec::new(),
        flat: Flat::default(),
        arguments: Vec::new(),
        suggestions: 0,
        nameless: HashMap::new(),
    };
    flattener.scope(None, Vec::new(), root, &[]);
    for number in 0..flattener.arguments.len() {
        flattener.links(number);
    }
    for item in &root.items {
        if let Some(port) = &item.port {
            let source = flattener.follow(0, &item.primitive, port);
            if let Some(source) = source {
                flattener.flat.outputs.push((&item.name, source));
            }
        }
    }
    flattener.flat
}

impl<'t> Flattener<'t, '_> {
    fn scope(
        &mut self,
        parent: Option<usize>,
        path: Vec<String>,
        fragment: &'t Fragment,
        arguments: &'t [Argument],
    ) -> usize {
        let number = self.scopes.len();
        self.scopes.push(Scope {
            parent,
            path,
            names: HashMap::new(),
            outputs: HashMap::new(),
            arguments,
            active: arguments.iter().find(|it| it.name.name == "inActive"),
        });
        self.values(parent, number, arguments);
        for item in &fragment.items {
            self.item(number, item);
        }
        number
    }

    /// What the arguments of a fragment say besides the links.
    fn values(&mut self, parent: Option<usize>, scope: usize, arguments: &'t [Argument]) {
        for argument in arguments {
            self.flat.debug.extend(argument.debug);
            match &argument.value {
                Value::Text(_, span) => {
                    let message = format!("a fragment has no parameter `{}`", argument.name.name);
                    let fault = Diagnostic::error(fault::UNKNOWN_PARAMETER, *span, message);
                    self.faults
                        .push(fault.help("fragments have inputs and outputs only"));
                }
                Value::Link(primitive, _) => {
                    let around = parent.unwrap_or(scope);
                    self.nameless(around, primitive, &argument.name);
                }
            }
        }
    }

    fn item(&mut self, scope: usize, item: &'t Item) {
        if let Some(port) = &item.port {
            self.nameless(scope, &item.primitive, &item.name);
            let known = self
                .scope_of(scope)
                .outputs
                .contains_key(item.name.name.as_str());
            if known {
                self.twice(&item.name, "output");
            }
            if let Some(scope) = self.scopes.get_mut(scope) {
                scope
                    .outputs
                    .insert(&item.name.name, (&item.primitive, port));
            }
            return;
        }
        let target = match &item.primitive {
            text::Primitive::Named(other) => {
                let message = format!("`{}` is another name for `{}`", item.name.name, other.name);
                let fault = Diagnostic::error(fault::WRONG_SHAPE, other.span, message);
                self.faults.push(fault.help(format!(
                    "name an output, `{}={}.outPort`, or take it out",
                    item.name.name, other.name
                )));
                return;
            }
            primitive => self.target(scope, primitive, &item.name),
        };
        let name = item.name.name.as_str();
        if let Some((_, first)) = self.scope_of(scope).names.get(name).copied() {
            self.twice(&item.name, "primitive");
            let message = format!("the first `{name}` stands here");
            let first = Diagnostic::error(fault::DUPLICATE_KEY, first, message);
            self.faults.push(first.help("rename one of the two"));
        } else if let Some(scope) = self.scopes.get_mut(scope) {
            scope.names.insert(name, (target, item.name.span));
        }
    }

    fn twice(&mut self, name: &Key, what: &str) {
        let message = format!("a second {what} `{}` in the same fragment", name.name);
        let fault = Diagnostic::error(fault::DUPLICATE_KEY, name.span, message);
        self.faults
            .push(fault.help("rename one: the predecessor silently took the last one"));
    }

    fn scope_of(&self, number: usize) -> &Scope<'t> {
        // Scopes are numbered as they are made and never taken away.
        &self.scopes[number]
    }

    /// Makes what is defined where a link begins: the predecessor calls it `<consumer>.<port>.source`.
    fn nameless(&mut self, scope: usize, primitive: &'t text::Primitive, port: &Key) {
        if !matches!(primitive, text::Primitive::Named(_)) {
            let target = self.target(scope, primitive, port);
            self.nameless.insert(std::ptr::from_ref(primitive), target);
        }
    }

    /// Makes the primitive or fragment that is defined in `scope` under `name`.
    fn target(&mut self, scope: usize, primitive: &'t text::Primitive, name: &Key) -> Target {
        let mut path = self.scope_of(scope).path.clone();
        path.push(name.name.clone());
        match primitive {
            text::Primitive::Fragment(fragment, arguments, _) => {
                Target::Scope(self.scope(Some(scope), path, fragment, arguments))
            }
            text::Primitive::Typed(ty, arguments) => {
                let number = self.flat.primitives.len();
                self.flat.primitives.push(Primitive {
                    path: path.clone(),
                    span: name.span,
                    ty,
                    parameters: Vec::new(),
                    inputs: Vec::new(),
                    active: Vec::new(),
                });
                self.arguments.push((scope, arguments));
                for argument in arguments {
                    if let Value::Link(inner, _) = &argument.value
                        && !matches!(**inner, text::Primitive::Named(_))
                    {
                        let name = Key {
                            name: format!("{}_{}", name.name, argument.name.name),
                            span: argument.name.span,
                        };
                        self.nameless(scope, inner, &name);
                    }
                }
                Target::Primitive(number)
            }
            // Only definitions come here.
            text::Primitive::Named(_) => Target::Primitive(usize::MAX),
        }
    }

    /// Follows the links of a primitive.
    fn links(&mut self, number: usize) {
        let Some((scope, arguments)) = self.arguments.get(number).copied() else {
            return;
        };
        let mut parameters = Vec::new();
        let mut inputs: Vec<(&'t Key, Source<'t>)> = Vec::new();
        for argument in arguments {
            self.flat.debug.extend(argument.debug);
            let mut earlier = parameters.iter().map(|(key, ..): &(&Key, _, _)| *key);
            let earlier = earlier
                .find(|key| key.name == argument.name.name)
                .or_else(|| {
                    let mut inputs = inputs.iter().map(|(key, _)| *key);
                    inputs.find(|key| key.name == argument.name.name)
                });
            if earlier.is_some() {
                let message = format!("`{}` is given twice", argument.name.name);
                let span = argument.name.span;
                self.faults
                    .push(Diagnostic::error(fault::DUPLICATE_KEY, span, message));
            }
            match &argument.value {
                Value::Text(text, span) => parameters.push((&argument.name, text.as_str(), *span)),
                Value::Link(primitive, port) => {
                    if let Some(source) = self.follow(scope, primitive, port) {
                        inputs.push((&argument.name, source));
                    }
                }
            }
        }
        let active = self.conditions(scope);
        if let Some(primitive) = self.flat.primitives.get_mut(number) {
            primitive.parameters = parameters;
            primitive.inputs = inputs;
            primitive.active = active;
        }
    }

    /// The conditions under which a scope is evaluated.
    fn conditions(&mut self, scope: usize) -> Vec<Source<'t>> {
        let mut conditions = Vec::new();
        let mut next = Some(scope);
        while let Some(number) = next {
            let scope = self.scope_of(number);
            next = scope.parent;
            if let (Some(active), Some(parent)) = (scope.active, scope.parent)
                && let Value::Link(primitive, port) = &active.value
            {
                conditions.extend(self.follow(parent, primitive, port));
            }
        }
        conditions.reverse();
        conditions
    }

    /// The primitive that feeds a link which stands in `scope`; `None`: an input that nobody feeds.
    fn follow(
        &mut self,
        scope: usize,
        primitive: &'t text::Primitive,
        port: &'t Key,
    ) -> Option<Source<'t>> {
        let (mut scope, mut primitive, mut port) = (scope, primitive, port);
        for _ in 0..BORDERS_MAX {
            let target = match primitive {
                text::Primitive::Named(name) if name.name == "parent" => {
                    let here = self.scope_of(scope);
                    let Some(parent) = here.parent else {
                        return self.not_there(&name.span, "the net as a whole has no inputs");
                    };
                    let mut arguments = here.arguments.iter();
                    match arguments.find(|argument| argument.name.name == port.name) {
                        Some(Argument {
                            value: Value::Link(outer, outer_port),
                            ..
                        }) => {
                            (scope, primitive, port) = (parent, outer, outer_port);
                            continue;
                        }
                        Some(_) => return Some(Source::Refused),
                        None => return None,
                    }
                }
                text::Primitive::Named(name) => {
                    match self.scope_of(scope).names.get(name.name.as_str()) {
                        Some((target, _)) => *target,
                        None => return self.unknown(scope, name),
                    }
                }
                definition => match self.nameless.get(&std::ptr::from_ref(definition)) {
                    Some(target) => *target,
                    // What stands in the argument of something refused is not made.
                    None => return Some(Source::Refused),
                },
            };
            match target {
                Target::Primitive(primitive) => {
                    return Some(Source::Output { primitive, port });
                }
                Target::Scope(inner) => {
                    let found = self.scope_of(inner).outputs.get(port.name.as_str());
                    let Some((inside, inside_port)) = found.copied() else {
                        return self.no_output(inner, port);
                    };
                    (scope, primitive, port) = (inner, inside, inside_port);
                }
            }
        }
        let message = "this link leads through fragments in a circle";
        let fault = Diagnostic::error(fault::LOOP_WITHOUT_DELAY, port.span, message);
        self.faults
            .push(fault.help("let one of the fragments' outputs come from a primitive"));
        Some(Source::Refused)
    }

    fn not_there(&mut self, span: &Span, message: &str) -> Option<Source<'t>> {
        self.faults.push(Diagnostic::error(
            fault::UNKNOWN_PRIMITIVE,
            *span,
            message.to_string(),
        ));
        Some(Source::Refused)
    }

    fn near(&mut self, name: &str, mut known: Vec<&str>) -> Option<String> {
        self.suggestions += 1;
        if self.suggestions > SUGGESTIONS_MAX {
            return None;
        }
        known.sort_unstable();
        Some(format!("did you mean `{}`?", closest(name, known)?))
    }

    fn unknown(&mut self, scope: usize, name: &Key) -> Option<Source<'t>> {
        let names = self.scope_of(scope).names.keys().copied().collect();
        let help = self.near(&name.name, names);
        let message = format!("this fragment has no primitive `{}`", name.name);
        self.faults
            .push(Diagnostic::error(fault::UNKNOWN_PRIMITIVE, name.span, message).help_if(help));
        Some(Source::Refused)
    }

    fn no_output(&mut self, scope: usize, port: &Key) -> Option<Source<'t>> {
        let names = self.scope_of(scope).outputs.keys().copied().collect();
        let help = self.near(&port.name, names);
        let message = format!("the fragment has no output `{}`", port.name);
        self.faults
            .push(Diagnostic::error(fault::UNKNOWN_OUTPUT, port.span, message).help_if(help));
        Some(Source::Refused)
    }
}
