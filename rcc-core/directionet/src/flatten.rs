//! Flattens fragments: every primitive gets its path, and every link is followed through fragment boundaries to its
//! source. Handles names only, no types. Runs on the loader's threads.

use std::cell::OnceCell;

use foldhash::{HashMap, HashMapExt, HashSet, HashSetExt};
use rcc_config::diagnostic::{Diagnostic, NameSearch, Span};
use rcc_config::yaml::Key;
use rcc_language::codes;
use rcc_language::syntax::NAME_MAX;

use super::text::{self, AstArgument, AstFragment, AstItem, AstValue};

/// Most fragment boundaries that one link may cross; beyond that it is a cycle.
const BORDERS_MAX: usize = 4 * text::DEPTH_MAX;

/// Up to this number of arguments a name is looked for in the arguments themselves.
const FEW_ARGUMENTS: usize = 16;

/// A net without fragments.
#[derive(Debug, Default)]
pub struct FlatNet<'t> {
    /// Its primitives in the order of the text.
    pub primitives: Vec<FlatPrimitive<'t>>,
    /// Outputs of the net as a whole: `outTerminate` and others.
    pub outputs: Vec<(&'t Key, FlatSource<'t>)>,
    /// Spans of requests for a debug history.
    pub debug: Vec<Span>,
}

/// A primitive of the text.
#[derive(Debug)]
pub struct FlatPrimitive<'t> {
    /// Names of the enclosing fragments and its own name, joined by `.`; at most [`NAME_MAX`] bytes, because an id has no
    /// more, and a long name may have many primitives in it.
    pub path: String,
    /// Span of its name.
    pub span: Span,
    /// Its type.
    pub ty: &'t Key,
    /// Parameters: name, text and span of the text.
    pub parameters: Vec<(&'t Key, &'t str, Span)>,
    /// Links by input. Links to a fragment's input that is not connected are left out.
    pub inputs: Vec<(&'t Key, FlatSource<'t>)>,
    /// The conditions of the enclosing fragments, outermost first.
    pub active: Vec<FlatSource<'t>>,
}

impl<'t> FlatNet<'t> {
    /// Returns every output that an input, a condition or the net as a whole reads.
    #[must_use]
    pub fn reads(&self) -> HashSet<(usize, &'t str)> {
        let inputs = self.primitives.iter().flat_map(|primitive| {
            let links = primitive.inputs.iter().map(|(_, source)| source);
            links.chain(&primitive.active)
        });
        let outputs = self.outputs.iter().map(|(_, source)| source);
        inputs
            .chain(outputs)
            .filter_map(|source| match source {
                FlatSource::Output { primitive, port } => Some((*primitive, port.name.as_str())),
                FlatSource::Refused => None,
            })
            .collect()
    }
}

/// The source of an input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FlatSource<'t> {
    /// An output of a primitive.
    Output {
        /// Index of the primitive.
        primitive: usize,
        /// The output, with the span of its name.
        port: &'t Key,
    },
    /// Refused; the error is reported.
    Refused,
}

/// A fragment at its place in the net.
struct FragmentScope<'t> {
    parent: Option<usize>,
    path: String,
    names: HashMap<&'t str, (NameTarget, Span)>,
    outputs: HashMap<&'t str, (&'t text::AstPrimitive, &'t Key)>,
    /// For messages about unknown names.
    sorted_names: OnceCell<Vec<&'t str>>,
    /// For messages about unknown outputs.
    sorted_outputs: OnceCell<Vec<&'t str>>,
    /// The first argument of each name.
    arguments: HashMap<&'t str, &'t AstArgument>,
}

#[derive(Clone, Copy)]
enum NameTarget {
    Primitive(usize),
    Scope(usize),
}

struct Flattener<'t, 'f> {
    diagnostics: &'f mut Vec<Diagnostic>,
    scopes: Vec<FragmentScope<'t>>,
    flat: FlatNet<'t>,
    /// Arguments of each primitive with the scope that contains them.
    arguments: Vec<(usize, &'t [AstArgument])>,
    search: NameSearch,
    /// Primitives and fragments without a name, by the address of their node in the tree.
    inline: HashMap<*const text::AstPrimitive, NameTarget>,
}

/// Flattens a net. Reports every name that does not resolve.
pub fn flatten<'t>(root: &'t AstFragment, diagnostics: &mut Vec<Diagnostic>) -> FlatNet<'t> {
    let mut flattener = Flattener {
        diagnostics,
        scopes: Vec::new(),
        flat: FlatNet::default(),
        arguments: Vec::new(),
        search: NameSearch::default(),
        inline: HashMap::new(),
    };
    flattener.scope(None, String::new(), root, &[]);
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
        path: String,
        fragment: &'t AstFragment,
        arguments: &'t [AstArgument],
    ) -> usize {
        let number = self.scopes.len();
        let mut by_name = HashMap::new();
        for argument in arguments {
            by_name
                .entry(argument.name.name.as_str())
                .or_insert(argument);
        }
        self.scopes.push(FragmentScope {
            parent,
            path,
            names: HashMap::new(),
            outputs: HashMap::new(),
            sorted_names: OnceCell::new(),
            sorted_outputs: OnceCell::new(),
            arguments: by_name,
        });
        self.values(parent, number, arguments);
        for item in &fragment.items {
            self.item(number, item);
        }
        number
    }

    /// Handles the arguments of a fragment except for the links.
    fn values(&mut self, parent: Option<usize>, scope: usize, arguments: &'t [AstArgument]) {
        for argument in arguments {
            self.flat.debug.extend(argument.debug);
            match &argument.value {
                AstValue::Text(_, span) => {
                    let message = format!("a fragment has no parameter `{}`", argument.name.name);
                    let diagnostic = Diagnostic::error(codes::UNKNOWN_PARAMETER, *span, message);
                    self.diagnostics
                        .push(diagnostic.help("fragments have inputs and outputs only"));
                }
                AstValue::Link(primitive, _) => {
                    let around = parent.unwrap_or(scope);
                    self.define_inline(around, primitive, &argument.name);
                }
            }
        }
    }

    fn item(&mut self, scope: usize, item: &'t AstItem) {
        if let Some(port) = &item.port {
            self.define_inline(scope, &item.primitive, &item.name);
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
            text::AstPrimitive::Named(other) => {
                let message = format!("`{}` is another name for `{}`", item.name.name, other.name);
                let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, other.span, message);
                self.diagnostics.push(diagnostic.help(format!(
                    "name an output, `{}={}.outPort`, or remove it",
                    item.name.name, other.name
                )));
                return;
            }
            primitive => self.target(scope, primitive, &item.name),
        };
        let name = item.name.name.as_str();
        if let Some((_, first)) = self.scope_of(scope).names.get(name).copied() {
            self.twice(&item.name, "primitive");
            let message = format!("the first definition of `{name}`");
            let first = Diagnostic::error(codes::DUPLICATE_KEY, first, message);
            self.diagnostics.push(first.help("rename one of the two"));
        } else if let Some(scope) = self.scopes.get_mut(scope) {
            scope.names.insert(name, (target, item.name.span));
        }
    }

    fn twice(&mut self, name: &Key, what: &str) {
        let message = format!("a second {what} `{}` in the same fragment", name.name);
        let diagnostic = Diagnostic::error(codes::DUPLICATE_KEY, name.span, message);
        self.diagnostics
            .push(diagnostic.help("rename one: the predecessor silently took the last one"));
    }

    fn scope_of(&self, number: usize) -> &FragmentScope<'t> {
        // Scopes are numbered in the order of creation and never removed.
        &self.scopes[number]
    }

    /// Creates a primitive that is defined inline as the source of a link. The predecessor names it
    /// `<consumer>.<port>.source`.
    fn define_inline(&mut self, scope: usize, primitive: &'t text::AstPrimitive, port: &Key) {
        if !matches!(primitive, text::AstPrimitive::Named(_)) {
            let target = self.target(scope, primitive, port);
            self.inline.insert(std::ptr::from_ref(primitive), target);
        }
    }

    /// Creates the primitive or fragment that is defined in `scope` under `name`.
    fn target(
        &mut self,
        scope: usize,
        primitive: &'t text::AstPrimitive,
        name: &Key,
    ) -> NameTarget {
        let path = path_of(&self.scope_of(scope).path, &name.name);
        match primitive {
            text::AstPrimitive::Fragment(fragment, arguments, _) => {
                NameTarget::Scope(self.scope(Some(scope), path, fragment, arguments))
            }
            text::AstPrimitive::Typed(ty, arguments) => {
                let number = self.flat.primitives.len();
                self.flat.primitives.push(FlatPrimitive {
                    path: path.clone(),
                    span: name.span,
                    ty,
                    parameters: Vec::new(),
                    inputs: Vec::new(),
                    active: Vec::new(),
                });
                self.arguments.push((scope, arguments));
                for argument in arguments {
                    if let AstValue::Link(inner, _) = &argument.value
                        && !matches!(**inner, text::AstPrimitive::Named(_))
                    {
                        let mut inner_name = shortened(&name.name).to_owned();
                        inner_name.push('_');
                        inner_name.push_str(shortened(&argument.name.name));
                        let name = Key {
                            name: inner_name.into(),
                            span: argument.name.span,
                        };
                        self.define_inline(scope, inner, &name);
                    }
                }
                NameTarget::Primitive(number)
            }
            // Called for definitions only.
            text::AstPrimitive::Named(_) => NameTarget::Primitive(usize::MAX),
        }
    }

    /// Resolves the links of a primitive.
    fn links(&mut self, number: usize) {
        let Some((scope, arguments)) = self.arguments.get(number).copied() else {
            return;
        };
        let mut parameters = Vec::new();
        let mut inputs: Vec<(&'t Key, FlatSource<'t>)> = Vec::new();
        let mut given = HashSet::new();
        for (index, argument) in arguments.iter().enumerate() {
            self.flat.debug.extend(argument.debug);
            let name = argument.name.name.as_str();
            let is_new = match arguments.len() <= FEW_ARGUMENTS {
                true => arguments.iter().take(index).all(|it| it.name.name != name),
                false => given.insert(name),
            };
            if !is_new {
                let message = format!("`{}` is given twice", argument.name.name);
                let span = argument.name.span;
                self.diagnostics
                    .push(Diagnostic::error(codes::DUPLICATE_KEY, span, message));
            }
            match &argument.value {
                AstValue::Text(text, span) => {
                    parameters.push((&argument.name, text.as_str(), *span))
                }
                AstValue::Link(primitive, port) => {
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

    /// Returns the conditions under which a scope is evaluated.
    fn conditions(&mut self, scope: usize) -> Vec<FlatSource<'t>> {
        let mut conditions = Vec::new();
        let mut next = Some(scope);
        while let Some(number) = next {
            let scope = self.scope_of(number);
            next = scope.parent;
            let active = scope.arguments.get("inActive");
            if let (Some(active), Some(parent)) = (active, scope.parent)
                && let AstValue::Link(primitive, port) = &active.value
            {
                conditions.extend(self.follow(parent, primitive, port));
            }
        }
        conditions.reverse();
        conditions
    }

    /// Returns the source of a link in `scope`; `None` if it leads to an input that is not connected.
    fn follow(
        &mut self,
        scope: usize,
        primitive: &'t text::AstPrimitive,
        port: &'t Key,
    ) -> Option<FlatSource<'t>> {
        let (mut scope, mut primitive, mut port) = (scope, primitive, port);
        for _ in 0..BORDERS_MAX {
            let target = match primitive {
                text::AstPrimitive::Named(name) if name.name == "parent" => {
                    let here = self.scope_of(scope);
                    let Some(parent) = here.parent else {
                        return self.not_there(&name.span, "the net as a whole has no inputs");
                    };
                    match here.arguments.get(port.name.as_str()).copied() {
                        Some(AstArgument {
                            value: AstValue::Link(outer, outer_port),
                            ..
                        }) => {
                            (scope, primitive, port) = (parent, outer, outer_port);
                            continue;
                        }
                        Some(_) => return Some(FlatSource::Refused),
                        None => return None,
                    }
                }
                text::AstPrimitive::Named(name) => {
                    match self.scope_of(scope).names.get(name.name.as_str()) {
                        Some((target, _)) => *target,
                        None => return self.unknown(scope, name),
                    }
                }
                definition => match self.inline.get(&std::ptr::from_ref(definition)) {
                    Some(target) => *target,
                    // Definitions in the argument of something refused are not created.
                    None => return Some(FlatSource::Refused),
                },
            };
            match target {
                NameTarget::Primitive(primitive) => {
                    return Some(FlatSource::Output { primitive, port });
                }
                NameTarget::Scope(inner) => {
                    let found = self.scope_of(inner).outputs.get(port.name.as_str());
                    let Some((inside, inside_port)) = found.copied() else {
                        return self.no_output(inner, port);
                    };
                    (scope, primitive, port) = (inner, inside, inside_port);
                }
            }
        }
        let message = "this link forms a cycle through fragments";
        let diagnostic = Diagnostic::error(codes::LOOP_WITHOUT_DELAY, port.span, message);
        self.diagnostics
            .push(diagnostic.help("connect one of the fragments' outputs to a primitive"));
        Some(FlatSource::Refused)
    }

    fn not_there(&mut self, span: &Span, message: &str) -> Option<FlatSource<'t>> {
        self.diagnostics.push(Diagnostic::error(
            codes::UNKNOWN_PRIMITIVE,
            *span,
            message.to_string(),
        ));
        Some(FlatSource::Refused)
    }

    fn unknown(&mut self, scope: usize, name: &Key) -> Option<FlatSource<'t>> {
        let known = self.scopes.get(scope).map(|scope| {
            let sorted = &scope.sorted_names;
            sorted.get_or_init(|| sorted_keys(&scope.names))
        });
        let known = known.into_iter().flatten().copied();
        let help = suggested(self.search.near(&name.name, known));
        let message = format!("this fragment has no primitive `{}`", name.name);
        self.diagnostics
            .push(Diagnostic::error(codes::UNKNOWN_PRIMITIVE, name.span, message).help_if(help));
        Some(FlatSource::Refused)
    }

    fn no_output(&mut self, scope: usize, port: &Key) -> Option<FlatSource<'t>> {
        let known = self.scopes.get(scope).map(|scope| {
            let sorted = &scope.sorted_outputs;
            sorted.get_or_init(|| sorted_keys(&scope.outputs))
        });
        let known = known.into_iter().flatten().copied();
        let help = suggested(self.search.near(&port.name, known));
        let message = format!("the fragment has no output `{}`", port.name);
        self.diagnostics
            .push(Diagnostic::error(codes::UNKNOWN_OUTPUT, port.span, message).help_if(help));
        Some(FlatSource::Refused)
    }
}

/// Returns the names in order, so that the first of several similar ones is always the same.
fn sorted_keys<'t, V>(map: &HashMap<&'t str, V>) -> Vec<&'t str> {
    let mut names: Vec<&str> = map.keys().copied().collect();
    names.sort_unstable();
    names
}

fn suggested(near: Option<&str>) -> Option<String> {
    near.map(|near| format!("did you mean `{near}`?"))
}

/// Returns the beginning of a name, which is ASCII: at most [`NAME_MAX`] bytes.
fn shortened(name: &str) -> &str {
    name.get(..NAME_MAX).unwrap_or(name)
}

fn path_of(scope: &str, name: &str) -> String {
    let name = shortened(name);
    match scope {
        "" => name.to_owned(),
        scope => {
            let mut path = format!("{scope}.{name}");
            path.truncate(NAME_MAX);
            path
        }
    }
}
