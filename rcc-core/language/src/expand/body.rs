//! A net and its fragments as they are written: which primitive, instance or input a reference names, and whether a
//! fragment contains itself. Runs on the loader's threads.

mod rules;

use std::collections::{HashMap, HashSet};

use rcc_config::diagnostic::Diagnostic;
use rcc_core::primitives;

use crate::adjacency::Adjacency;
use crate::codes;
use crate::components::{Components, circle};
use crate::syntax::fragment::{Fragment, FragmentInput, FragmentOutput};
use crate::syntax::reference::Reference;
use crate::syntax::{Net, Primitive, PrimitiveKind};

/// The primitives of a net or fragment.
pub struct Body<'a> {
    /// The fragment; `None` for the net.
    pub fragment: Option<&'a Fragment>,
    /// Primitives and instances.
    pub primitives: &'a [Primitive],
    /// Discarded outputs.
    pub discard: &'a [Reference],
    members: HashMap<&'a str, &'a Primitive>,
    inputs: HashMap<&'a str, &'a FragmentInput>,
    /// The first output of each name.
    outputs: HashMap<&'a str, &'a FragmentOutput>,
}

/// The target of a reference.
pub enum ReferenceTarget<'a> {
    /// An input of the fragment.
    Input(&'a FragmentInput),
    /// An output of an instance.
    Instance(&'a Primitive, &'a FragmentOutput),
    /// A primitive. Whether it exists is checked by the resolver, on the expanded net.
    Primitive,
    /// Unresolved, which is reported here.
    Refused,
}

/// A net and all its fragments.
pub struct Bodies<'a> {
    /// The net.
    pub net: Body<'a>,
    fragments: Vec<(Body<'a>, &'a Fragment)>,
    /// Number of fragments that the net defines itself; they come first.
    own: usize,
    by_name: HashMap<&'a str, usize>,
    /// Whether a fragment contains itself, by fragment.
    recursive: Vec<bool>,
    /// Outputs that do not resolve: index of the fragment and name.
    unresolved_outputs: HashSet<(usize, &'a str)>,
}

impl<'a> Body<'a> {
    fn of(
        fragment: Option<&'a Fragment>,
        primitives: &'a [Primitive],
        discard: &'a [Reference],
    ) -> Body<'a> {
        let inputs = fragment.map_or(&[][..], |fragment| &fragment.inputs);
        let members = primitives.iter();
        let mut outputs = HashMap::new();
        for output in fragment.map_or(&[][..], |fragment| &fragment.outputs) {
            outputs.entry(output.name.name.as_str()).or_insert(output);
        }
        Body {
            outputs,
            fragment,
            primitives,
            discard,
            members: members
                .map(|primitive| (primitive.id.name.as_str(), primitive))
                .collect(),
            inputs: inputs
                .iter()
                .map(|input| (input.name.name.as_str(), input))
                .collect(),
        }
    }

    /// Returns all references except those of `discard`.
    fn references(&self) -> impl Iterator<Item = &'a Reference> {
        let inputs = self.primitives.iter().flat_map(|primitive| {
            let inputs = primitive.inputs.iter().map(|(_, source)| source);
            inputs.chain(&primitive.active)
        });
        let links = inputs.flat_map(|source| source.links().into_iter().map(|link| &link.from));
        let outputs = self.fragment.map_or(&[][..], |fragment| &fragment.outputs);
        links.chain(outputs.iter().map(|output| &output.from))
    }

    fn describe(&self) -> String {
        match self.fragment {
            Some(fragment) => format!("the fragment `{}`", fragment.name.name),
            None => "the net".to_owned(),
        }
    }
}

impl<'a> Bodies<'a> {
    /// Collects a net and the fragments of its libraries. Of several fragments with one name, the first is used.
    pub fn of(
        net: &'a Net,
        library: &'a [Fragment],
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Bodies<'a> {
        let mut by_name = HashMap::new();
        let mut fragments = Vec::new();
        for fragment in net.fragments.iter().chain(library) {
            let name = &fragment.name;
            if by_name.contains_key(name.name.as_str()) {
                let message = format!("fragment `{}` is defined more than once", name.name);
                let diagnostic = Diagnostic::error(codes::DUPLICATE_FRAGMENT, name.span, message);
                diagnostics.push(diagnostic);
                continue;
            }
            by_name.insert(name.name.as_str(), fragments.len());
            let body = Body::of(Some(fragment), &fragment.primitives, &fragment.discard);
            fragments.push((body, fragment));
        }
        let mut bodies = Bodies {
            net: Body::of(None, &net.primitives, &net.discard),
            recursive: vec![false; fragments.len()],
            fragments,
            own: net.fragments.len(),
            by_name,
            unresolved_outputs: HashSet::new(),
        };
        bodies.find_recursion(diagnostics);
        bodies.find_unresolved_outputs();
        bodies
    }

    /// Finds fragments that contain themselves.
    fn find_recursion(&mut self, diagnostics: &mut Vec<Diagnostic>) {
        let contained = self.fragments.iter().map(|(body, _)| {
            let instances = body.primitives.iter();
            let instances = instances.filter(|primitive| primitive.kind == PrimitiveKind::Fragment);
            let numbers = instances.filter_map(|it| self.by_name.get(it.type_name.name.as_str()));
            numbers.copied()
        });
        let contained: Adjacency = contained.collect();
        for component in Components::of(&contained).loops(&contained) {
            for number in &component {
                self.recursive[*number] = true;
            }
            let mut circle = circle(&contained, &component);
            // From the containing fragment to the contained one.
            circle.reverse();
            circle.extend(circle.first().copied());
            let names = circle.iter().map(|number| {
                let (_, fragment) = self.fragments[*number];
                format!("`{}`", fragment.name.name)
            });
            let names: Vec<String> = names.collect();
            let Some((_, first)) = circle.first().map(|number| &self.fragments[*number]) else {
                continue;
            };
            let message = format!("a fragment contains itself: {}", names.join(" → "));
            let diagnostic = Diagnostic::error(codes::RECURSIVE_FRAGMENT, first.name.span, message);
            diagnostics.push(diagnostic);
        }
    }

    /// Finds outputs that do not resolve. They are reported in the fragment and not again where they are read.
    fn find_unresolved_outputs(&mut self) {
        let mut bad = HashSet::new();
        for (number, (body, fragment)) in self.fragments.iter().enumerate() {
            for FragmentOutput { name, from, .. } in &fragment.outputs {
                let good = match self.target(body, from) {
                    ReferenceTarget::Primitive => body
                        .members
                        .get(from.primitive.as_str())
                        .is_some_and(|primitive| {
                            let entry = primitives::find(&primitive.type_name.name);
                            entry.is_none_or(|(_, entry)| entry.spec.output(&from.port).is_some())
                        }),
                    ReferenceTarget::Instance(..) => true,
                    ReferenceTarget::Input(_) | ReferenceTarget::Refused => false,
                };
                if !good {
                    bad.insert((number, name.name.as_str()));
                }
            }
        }
        self.unresolved_outputs = bad;
    }

    /// Returns the fragment of an instance and its body, or `None` if it does not exist or contains itself, which is
    /// reported.
    pub fn body_of(&self, instance: &Primitive) -> Option<(&Body<'a>, &'a Fragment)> {
        let number = *self.by_name.get(instance.type_name.name.as_str())?;
        let (body, fragment) = &self.fragments[number];
        (!self.recursive[number]).then_some((body, fragment))
    }

    fn fragment_of(&self, instance: &Primitive) -> Option<(usize, &'a Fragment)> {
        let number = *self.by_name.get(instance.type_name.name.as_str())?;
        Some((number, self.fragments[number].1))
    }

    /// Resolves a reference in a body.
    pub fn target<'b>(&'b self, body: &'b Body<'a>, reference: &Reference) -> ReferenceTarget<'a> {
        let Reference {
            primitive, port, ..
        } = reference;
        let is_input = body.inputs.get(primitive.as_str());
        match (body.members.get(primitive.as_str()), is_input) {
            (_, Some(input)) if port.is_empty() => ReferenceTarget::Input(input),
            (Some(primitive), _) if primitive.kind != PrimitiveKind::Fragment => {
                ReferenceTarget::Primitive
            }
            (Some(instance), _) => {
                let output = self.fragment_of(instance).and_then(|(number, _)| {
                    let (body, _) = self.fragments.get(number)?;
                    let output = *body.outputs.get(port.as_str())?;
                    let is_bad = self.unresolved_outputs.contains(&(number, port.as_str()));
                    (!is_bad).then_some(output)
                });
                output.map_or(ReferenceTarget::Refused, |output| {
                    ReferenceTarget::Instance(instance, output)
                })
            }
            (None, None) if !port.is_empty() || body.fragment.is_none() => {
                ReferenceTarget::Primitive
            }
            (None, _) => ReferenceTarget::Refused,
        }
    }
}
