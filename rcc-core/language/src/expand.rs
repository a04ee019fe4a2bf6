//! The expand pass, [`Net`] → [`ExpandedNet`]: each instance of a fragment is replaced by a copy of the fragment's
//! primitives, named `instance/id`, with the parameters and sources of the instance. Types, loops and all other rules
//! are checked on the expanded net, so a fragment is notation only. Runs on the loader's threads.

mod body;
mod net;
mod parameters;
mod sources;

use std::collections::{HashMap, HashSet};

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::Key;

use crate::codes;
use crate::formula::choose_products;
use crate::source_map::{SourceMap, SpanShift};
use crate::syntax::fragment::{Fragment, FragmentInput};
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::reference::Reference;
use crate::syntax::{Net, Primitive, PrimitiveKind, Source};
use body::{Bodies, Body, ReferenceTarget};
use parameters::Parameters;

pub use net::{ExpandedNet, ExpandedRegion, InputDeclaration};

/// Deepest nesting of instances.
pub const DEPTH_MAX: usize = 32;
/// Largest size of the expanded net: primitives, their inputs and parameters, and elements of constants together.
/// Without a limit, ten lines of nested fragments could expand beyond any memory.
pub const EXPANDED_MAX: usize = 1 << 20;

/// The source of an instance's input, and the declarations of the enclosing fragments that apply to it.
#[derive(Clone)]
struct BoundInput<'a> {
    source: Source,
    declarations: Vec<(&'a FragmentInput, SpanShift)>,
}

/// The target of an expansion: prefix, bindings and region of the primitives of a body.
struct Scope<'a> {
    /// Prefix of ids, `a/b/`; empty for the net itself.
    path: String,
    shift: SpanShift,
    parameters: Parameters<'a>,
    inputs: HashMap<&'a str, BoundInput<'a>>,
    region: Option<usize>,
    depth: usize,
}

struct Expander<'a, 's> {
    bodies: &'a Bodies<'a>,
    sources: &'s mut SourceMap,
    diagnostics: &'s mut Vec<Diagnostic>,
    flat: ExpandedNet,
    expanded: usize,
    /// Ids of the generated `Constant` primitives that stand for constants read through delayed links.
    constants: HashSet<String>,
}

/// Expands all instances of a net; `library` holds the fragments of its libraries. Returns `None` if the expanded net
/// would be too large. This is reported, and further checks are pointless.
pub fn expand(
    mut net: Net,
    library: &[Fragment],
    sources: &mut SourceMap,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<ExpandedNet> {
    parameters::refuse_in_timing(&mut net.timing, diagnostics);
    let is_plain = |primitive: &Primitive| {
        primitive.kind != PrimitiveKind::Fragment
            && primitive.active.is_none()
            && !parameters::any_in(primitive)
    };
    if net.fragments.is_empty() && library.is_empty() && net.primitives.iter().all(is_plain) {
        choose_products(&mut net.primitives);
        return Some(ExpandedNet::plain(net));
    }
    let bodies = Bodies::of(&net, library, diagnostics);
    bodies.check(diagnostics);
    let empty = Net {
        name: net.name.clone(),
        description: net.description.clone(),
        timing: net.timing.clone(),
        survives_device_loss: net.survives_device_loss,
        uses: Vec::new(),
        fragments: Vec::new(),
        primitives: Vec::new(),
        discard: Vec::new(),
    };
    let mut expander = Expander {
        bodies: &bodies,
        sources,
        diagnostics,
        flat: ExpandedNet::plain(empty),
        expanded: 0,
        constants: HashSet::new(),
    };
    let scope = Scope {
        path: String::new(),
        shift: SpanShift::default(),
        parameters: Parameters::default(),
        inputs: HashMap::new(),
        region: None,
        depth: 0,
    };
    expander.body(&bodies.net, &scope);
    if expander.expanded > EXPANDED_MAX {
        return None;
    }
    let mut flat = expander.flat;
    choose_products(&mut flat.net.primitives);
    if flat.regions.is_empty() {
        flat.region_of.clear();
    }
    Some(flat)
}

impl<'a> Expander<'a, '_> {
    fn body(&mut self, body: &'a Body<'a>, scope: &Scope<'a>) {
        for primitive in body.primitives {
            if scope.depth > 0 && !self.has_room_for(primitive, scope) {
                return;
            }
            let region = self.region(primitive, body, scope);
            match primitive.kind {
                PrimitiveKind::Type | PrimitiveKind::Product => {
                    self.primitive(primitive, body, scope, region);
                }
                PrimitiveKind::Fragment => self.instance(primitive, body, scope, region),
            }
        }
        for reference in body.discard {
            if matches!(
                self.bodies.target(body, reference),
                ReferenceTarget::Primitive
            ) {
                let discarded = scope.named(reference);
                self.flat.net.discard.push(discarded);
            }
        }
        let shown = body.fragment.map_or(&[][..], |fragment| &fragment.outputs);
        for output in shown {
            if let Some(reference) = self.output(body, scope, &output.from) {
                self.flat.read.push(reference);
            }
        }
    }

    fn has_room_for(&mut self, primitive: &Primitive, scope: &Scope<'_>) -> bool {
        let span = scope.shift.span(primitive.id.span);
        self.add(weight(primitive), span)
    }

    /// Adds to the size of the expanded net. Returns false if it is above [`EXPANDED_MAX`], which is reported once.
    fn add(&mut self, size: usize, span: Span) -> bool {
        let had_room = self.expanded <= EXPANDED_MAX;
        self.expanded = self.expanded.saturating_add(size);
        if self.expanded <= EXPANDED_MAX {
            return true;
        }
        if had_room {
            let message = "the net is too large after its fragments are expanded";
            let diagnostic = Diagnostic::error(codes::NET_TOO_LARGE, span, message);
            let diagnostic = diagnostic.label("the first one too many");
            self.diagnostics
                .push(diagnostic.help("use fewer or smaller instances"));
        }
        false
    }

    /// Returns the region of a primitive: a new one if it has a condition.
    fn region(
        &mut self,
        primitive: &'a Primitive,
        body: &'a Body<'a>,
        scope: &Scope<'a>,
    ) -> Option<usize> {
        let Some(condition) = &primitive.active else {
            return scope.region;
        };
        let (condition, _) = self.source(condition, body, scope);
        if let Source::Literal(literal) = &condition
            && literal.shape == LiteralShape::Bool(true)
        {
            return scope.region;
        }
        self.flat.regions.push(ExpandedRegion {
            id: scope.key(&primitive.id),
            condition,
            parent: scope.region,
        });
        Some(self.flat.regions.len() - 1)
    }

    fn primitive(
        &mut self,
        primitive: &'a Primitive,
        body: &'a Body<'a>,
        scope: &Scope<'a>,
        region: Option<usize>,
    ) {
        let parameters = primitive.parameters.iter().map(|(key, literal)| {
            let literal = scope
                .parameters
                .fill(literal, scope.shift, self.diagnostics);
            (scope.shift.key(key), literal)
        });
        let parameters = parameters.collect();
        let (mut inputs, mut declarations) =
            (Vec::with_capacity(primitive.inputs.len()), Vec::new());
        for (key, source) in &primitive.inputs {
            let (source, declared) = self.source(source, body, scope);
            inputs.push((scope.shift.key(key), source));
            declarations.extend(declared.into_iter().map(|declared| (key, declared)));
        }
        let number = self.flat.net.primitives.len();
        let declarations = declarations
            .into_iter()
            .map(|(key, (input, shift))| InputDeclaration {
                primitive: number,
                input: key.name.to_string(),
                name: input.name.name.to_string(),
                ty: input.ty.map(|(ty, span)| (ty, shift.span(span))),
                unit: input.unit.map(|(unit, span)| (unit, shift.span(span))),
            });
        self.flat.declarations.extend(declarations);
        let made = Primitive {
            id: scope.key(&primitive.id),
            kind: primitive.kind,
            type_name: scope.shift.key(&primitive.type_name),
            parameters,
            inputs,
            active: None,
        };
        self.push(made, region);
    }

    fn push(&mut self, primitive: Primitive, region: Option<usize>) {
        self.flat.net.primitives.push(primitive);
        self.flat.region_of.push(region);
    }

    fn instance(
        &mut self,
        instance: &'a Primitive,
        body: &'a Body<'a>,
        scope: &Scope<'a>,
        region: Option<usize>,
    ) {
        let Key { name: id, span } = scope.key(&instance.id);
        self.flat.instances.push(id.to_string());
        if scope.depth >= DEPTH_MAX {
            let message = format!("instances are nested more than {DEPTH_MAX} deep");
            let diagnostic = Diagnostic::error(codes::NET_TOO_LARGE, span, message);
            self.diagnostics
                .push(diagnostic.help("nest them less deeply"));
        }
        let inner = self.bodies.body_of(instance);
        let Some((inner, fragment)) = inner.filter(|_| scope.depth < DEPTH_MAX) else {
            self.flat.is_incomplete = true;
            for (_, source) in &instance.inputs {
                self.read(source, body, scope);
            }
            return;
        };
        let shift = self.sources.copy(fragment, &id, span);
        let given = instance.parameters.iter();
        let given = given.map(|(key, literal)| {
            let literal = scope
                .parameters
                .fill(literal, scope.shift, self.diagnostics);
            (key.name.as_str(), literal)
        });
        let given = given.collect();
        let inner_scope = Scope {
            path: format!("{id}/"),
            shift,
            parameters: Parameters::bind(fragment, given, shift, self.diagnostics),
            inputs: self.bind(instance, fragment, shift, body, scope),
            region,
            depth: scope.depth + 1,
        };
        self.body(inner, &inner_scope);
    }

    /// Returns the sources of the inputs of an instance.
    fn bind(
        &mut self,
        instance: &'a Primitive,
        fragment: &'a Fragment,
        shift: SpanShift,
        body: &'a Body<'a>,
        scope: &Scope<'a>,
    ) -> HashMap<&'a str, BoundInput<'a>> {
        let known: HashSet<&str> = fragment
            .inputs
            .iter()
            .map(|input| input.name.name.as_str())
            .collect();
        let mut given = HashMap::new();
        for (key, source) in &instance.inputs {
            if known.contains(key.name.as_str()) {
                let (source, declarations) = self.source(source, body, scope);
                for link in source.links() {
                    // Counts as read even if the fragment ignores the input, which is reported for the fragment.
                    self.flat.read.push(link.from.clone());
                }
                given.insert(
                    key.name.as_str(),
                    BoundInput {
                        source,
                        declarations,
                    },
                );
            } else {
                self.read(source, body, scope);
            }
        }
        for input in &fragment.inputs {
            if let Some(LiteralShape::List(default)) = input.default.as_ref().map(|it| &it.shape)
                && !given.contains_key(input.name.name.as_str())
            {
                let size = default.iter().map(elements).sum();
                if !self.add(size, scope.shift.span(instance.id.span)) {
                    break;
                }
            }
            let bound = given.entry(&input.name.name).or_insert_with(|| BoundInput {
                source: match &input.default {
                    Some(default) => Source::Literal(shift.literal(default)),
                    None => Source::Refused,
                },
                declarations: Vec::new(),
            });
            if input.ty.is_some() || input.unit.is_some() {
                bound.declarations.push((input, shift));
            }
        }
        given
    }

    /// Counts the outputs that a refused source reads as read.
    fn read(&mut self, source: &'a Source, body: &'a Body<'a>, scope: &Scope<'a>) {
        let (source, _) = self.source(source, body, scope);
        let links = source.links().into_iter();
        self.flat.read.extend(links.map(|link| link.from.clone()));
    }
}

impl Scope<'_> {
    /// Returns an id with the prefix of the scope.
    fn key(&self, id: &Key) -> Key {
        let mut key = self.shift.key(id);
        key.name.insert_str(0, &self.path);
        key
    }

    /// Returns a reference to a primitive with the prefix of the scope.
    fn named(&self, reference: &Reference) -> Reference {
        let mut named = self.shift.reference(reference);
        named.primitive.insert_str(0, &self.path);
        named
    }
}

/// Returns the cost of a copy of a primitive, counted against [`EXPANDED_MAX`].
fn weight(primitive: &Primitive) -> usize {
    let parameters = primitive.parameters.iter();
    let parameters = parameters.map(|(_, literal)| elements(literal));
    let inputs = primitive.inputs.iter();
    let inputs = inputs.map(|(_, source)| 1 + source_weight(source));
    // An instance costs more: its path and its span are stored as well.
    let itself = if primitive.kind == PrimitiveKind::Fragment {
        16
    } else {
        4
    };
    itself + parameters.sum::<usize>() + inputs.sum::<usize>()
}

/// Returns the number of links in a source and of elements of its constants.
fn source_weight(source: &Source) -> usize {
    let constants = source.constants().into_iter().map(elements);
    source.links().len() + constants.sum::<usize>()
}

/// Returns the number of elements of a constant, lists themselves included.
fn elements(literal: &Literal) -> usize {
    match &literal.shape {
        LiteralShape::List(elements) => 1 + elements.iter().map(self::elements).sum::<usize>(),
        // The parameters are not substituted yet; assume the longest list.
        LiteralShape::Parameterised(_) => usize::from(rcc_core::types::ELEMENTS_MAX),
        _ => 1,
    }
}
