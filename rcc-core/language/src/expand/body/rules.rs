//! Rules about a net or fragment as it is written, independent of its instances: references resolve, and ports and
//! parameters are used. Each error is reported once, in the fragment. Runs on the loader's threads.

use std::collections::{BTreeSet, HashSet};

use rcc_config::diagnostic::{Diagnostic, Span, closest};
use rcc_config::yaml::Key;
use rcc_core::types::Type;

use super::super::parameters::{constants, named_in, unknown};
use super::{Bodies, Body, ReferenceTarget};
use crate::codes;
use crate::syntax::PrimitiveKind;
use crate::syntax::fragment::{Fragment, FragmentOutput};
use crate::syntax::reference::Reference;

/// Most names that a name is compared with for a suggestion.
const COMPARED_MAX: usize = 100;

impl<'a> Bodies<'a> {
    /// Reports everything that is wrong in the net and its fragments as they are written.
    pub fn check(&self, diagnostics: &mut Vec<Diagnostic>) {
        let fragments = self.fragments.iter().map(|(body, _)| body);
        for body in std::iter::once(&self.net).chain(fragments) {
            self.references_lead_somewhere(body, diagnostics);
            self.instances_fit_their_fragments(body, diagnostics);
            self.outputs_of_instances_are_read(body, diagnostics);
            parameters_are_known_and_used(body, diagnostics);
            if let Some(fragment) = body.fragment {
                inputs_are_used(body, fragment, diagnostics);
            }
        }
        self.own_fragments_are_used(diagnostics);
    }

    fn references_lead_somewhere(&self, body: &Body<'a>, diagnostics: &mut Vec<Diagnostic>) {
        let outputs = body.fragment.map_or(&[][..], |fragment| &fragment.outputs);
        for FragmentOutput { name, from, .. } in outputs {
            if let ReferenceTarget::Input(input) = self.target(body, from) {
                let message = format!(
                    "the output `{}` is the input `{}`: an output must come from a primitive of the fragment",
                    name.name, input.name.name
                );
                let diagnostic = Diagnostic::error(codes::WRONG_SHAPE, from.span, message);
                diagnostics.push(
                    diagnostic.help("connect the reader to the source of the instance's input"),
                );
            }
        }
        for reference in body.references().chain(body.discard) {
            if !matches!(self.target(body, reference), ReferenceTarget::Refused) {
                continue;
            }
            let id = reference.primitive.as_str();
            let Some(instance) = body.members.get(id) else {
                diagnostics.push(unknown_input(body, reference));
                continue;
            };
            // An unknown fragment is reported at the instance, an unresolved output in its fragment.
            let Some((number, fragment)) = self.fragment_of(instance) else {
                continue;
            };
            if self
                .unresolved_outputs
                .contains(&(number, reference.port.as_str()))
            {
                continue;
            }
            let name = &fragment.name.name;
            let (message, span) = if reference.port.is_empty() {
                let message =
                    format!("`{reference}` is an instance of `{name}`: name one of its outputs");
                (message, reference.span)
            } else {
                let message = format!(
                    "output not found: the fragment `{name}` has no output `{}`",
                    reference.port
                );
                (message, reference.port_span)
            };
            let names = fragment.outputs.iter().map(|output| &output.name);
            let help = nearest(&reference.port, "outputs", names);
            diagnostics.push(Diagnostic::error(codes::UNKNOWN_OUTPUT, span, message).help(help));
        }
    }

    fn instances_fit_their_fragments(&self, body: &Body<'a>, diagnostics: &mut Vec<Diagnostic>) {
        let instances = body.primitives.iter();
        for instance in instances.filter(|primitive| primitive.kind == PrimitiveKind::Fragment) {
            let (id, of) = (&instance.id.name, &instance.type_name);
            let Some((_, fragment)) = self.fragment_of(instance) else {
                let names = self.fragments.iter().map(|(_, fragment)| &fragment.name);
                let help = nearest(&of.name, "fragments", names);
                let message = format!("unknown fragment `{}`", of.name);
                let diagnostic = Diagnostic::error(codes::UNKNOWN_FRAGMENT, of.span, message);
                diagnostics.push(diagnostic.help(help));
                continue;
            };
            let parameters = fragment.parameters.iter();
            let parameters = parameters.map(|it| (&it.name, &it.description, it.default.is_some()));
            let inputs = fragment.inputs.iter();
            let inputs = inputs.map(|it| (&it.name, &it.description, it.default.is_some()));
            let given = instance.parameters.iter().map(|(key, _)| key);
            let fed = instance.inputs.iter().map(|(key, _)| key);
            check_members(
                InstanceMembers {
                    id,
                    of,
                    what: "parameter",
                    unknown: codes::UNKNOWN_PARAMETER,
                },
                (given.collect(), parameters.collect()),
                diagnostics,
            );
            check_members(
                InstanceMembers {
                    id,
                    of,
                    what: "input",
                    unknown: codes::UNKNOWN_INPUT,
                },
                (fed.collect(), inputs.collect()),
                diagnostics,
            );
        }
    }

    fn outputs_of_instances_are_read(&self, body: &Body<'a>, diagnostics: &mut Vec<Diagnostic>) {
        let names =
            |reference: &'a Reference| (reference.primitive.as_str(), reference.port.as_str());
        let read: HashSet<(&str, &str)> = body.references().map(names).collect();
        let mut discarded = HashSet::new();
        for reference in body.discard {
            let ReferenceTarget::Instance(..) = self.target(body, reference) else {
                continue;
            };
            let twice = !discarded.insert(names(reference));
            let (code, message) = if twice {
                (
                    codes::BAD_DISCARD,
                    format!("`{reference}` is discarded twice"),
                )
            } else if reference.part.is_some() {
                let message = "an output can only be discarded as a whole";
                (codes::BAD_DISCARD, message.to_owned())
            } else if read.contains(&names(reference)) {
                let message = format!("`{reference}` is discarded and read");
                (codes::DISCARDED_BUT_READ, message)
            } else {
                continue;
            };
            diagnostics.push(Diagnostic::error(code, reference.span, message));
        }
        for instance in body
            .primitives
            .iter()
            .filter(|it| it.kind == PrimitiveKind::Fragment)
        {
            let Some((number, fragment)) = self.fragment_of(instance) else {
                continue;
            };
            let id = instance.id.name.as_str();
            let outputs = fragment
                .outputs
                .iter()
                .map(|output| output.name.name.as_str());
            if outputs.clone().any(|output| read.contains(&(id, output))) {
                continue;
            }
            let unread = outputs
                .filter(|output| !self.unresolved_outputs.contains(&(number, *output)))
                .filter(|output| !self.unresolved_outputs.contains(&(number, *output)))
                .filter(|output| {
                    !read.contains(&(id, *output)) && !discarded.contains(&(id, *output))
                })
                .map(|output| format!("{id}.{output}"));
            let unread: Vec<String> = unread.collect();
            let list = unread.join(", ");
            let message = match unread.len() {
                0 => continue,
                1 => format!("the output `{list}` is neither read nor discarded"),
                _ => format!("the outputs {list} are neither read nor discarded"),
            };
            let diagnostic = Diagnostic::error(codes::NOT_READ, instance.id.span, message);
            diagnostics.push(diagnostic.help(format!(
                "connect them, or discard them: `discard: [{list}]`"
            )));
        }
    }

    fn own_fragments_are_used(&self, diagnostics: &mut Vec<Diagnostic>) {
        let fragments = self.fragments.iter().map(|(body, _)| body);
        let all = std::iter::once(&self.net).chain(fragments);
        let instances = all.flat_map(|body| body.primitives);
        let instances = instances.filter(|primitive| primitive.kind == PrimitiveKind::Fragment);
        let used: HashSet<&str> = instances.map(|it| it.type_name.name.as_str()).collect();
        for (_, fragment) in self.fragments.iter().take(self.own) {
            let name = &fragment.name;
            if !used.contains(name.name.as_str()) {
                let message = format!("the fragment `{}` is not used", name.name);
                diagnostics.push(Diagnostic::warning(
                    codes::FRAGMENT_NOT_USED,
                    name.span,
                    message,
                ));
            }
        }
    }
}

/// The kind of member that `check_members` compares: parameters or inputs of an instance.
struct InstanceMembers<'a> {
    id: &'a str,
    of: &'a Key,
    what: &'static str,
    unknown: &'static str,
}

/// A port or parameter of a fragment: its name, its description, and whether it has a default.
type DeclaredMember<'a> = (&'a Key, &'a String, bool);

fn check_members(
    ports: InstanceMembers<'_>,
    (given, known): (Vec<&Key>, Vec<DeclaredMember<'_>>),
    diagnostics: &mut Vec<Diagnostic>,
) {
    let InstanceMembers {
        id,
        of,
        what,
        unknown,
    } = ports;
    let names: HashSet<&str> = known.iter().map(|(name, ..)| name.name.as_str()).collect();
    for key in given
        .iter()
        .filter(|key| !names.contains(key.name.as_str()))
    {
        let message = format!("the fragment `{}` has no {what} `{}`", of.name, key.name);
        let help = nearest(
            &key.name,
            &format!("{what}s"),
            known.iter().map(|(name, ..)| *name),
        );
        diagnostics.push(Diagnostic::error(unknown, key.span, message).help(help));
    }
    let given: HashSet<&str> = given.iter().map(|key| key.name.as_str()).collect();
    for (name, description, has_default) in known {
        if has_default || given.contains(name.name.as_str()) {
            continue;
        }
        let name = &name.name;
        let (code, message) = match what {
            "input" => (
                codes::NOT_CONNECTED,
                format!("the input `{id}.{name}` is not connected"),
            ),
            _ => (
                codes::MISSING_PARAMETER,
                format!("`{id}` needs the parameter `{name}`"),
            ),
        };
        let about = match description.as_str() {
            "" => String::new(),
            description => format!(": {description}"),
        };
        let help = format!("add `{name}` to its {what}s{about}");
        diagnostics.push(Diagnostic::error(code, of.span, message).help(help));
    }
}

/// Reports a reference without a port that is not an input of the fragment, or an input referred to with a port.
fn unknown_input(body: &Body<'_>, reference: &Reference) -> Diagnostic {
    let Reference {
        primitive, port, ..
    } = reference;
    if body.inputs.contains_key(primitive.as_str()) {
        let message = format!(
            "`{primitive}` is an input of {}: it has no `{port}`",
            body.describe()
        );
        let diagnostic = Diagnostic::error(codes::UNKNOWN_OUTPUT, reference.span, message);
        return diagnostic.help(format!(
            "write `{primitive}`, or `{primitive}[0]` for an element"
        ));
    }
    let message = format!("{} has no input `{primitive}`", body.describe());
    let names = body.inputs.values().map(|input| &input.name);
    let names: BTreeSet<&str> = names.map(|key| key.name.as_str()).collect();
    let help = match closest(primitive, names.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => {
            "write an input as one word, an output of a primitive as `primitive.port`".to_owned()
        }
    };
    Diagnostic::error(codes::UNKNOWN_PRIMITIVE, reference.span, message).help(help)
}

fn parameters_are_known_and_used(body: &Body<'_>, diagnostics: &mut Vec<Diagnostic>) {
    let parameters = body
        .fragment
        .map_or(&[][..], |fragment| &fragment.parameters);
    let inputs = body.fragment.map_or(&[][..], |fragment| &fragment.inputs);
    let mut used = HashSet::new();
    let known: HashSet<&str> = parameters.iter().map(|it| it.name.name.as_str()).collect();
    let mut names = Vec::new();
    for literal in body.primitives.iter().flat_map(constants) {
        named_in(literal, &mut names);
    }
    for (name, span) in names.drain(..) {
        used.insert(name);
        if !known.contains(name) {
            let help = match body.fragment {
                Some(_) => nearest(name, "parameters", parameters.iter().map(|it| &it.name)),
                None => "a net has no parameters: write the value".to_owned(),
            };
            diagnostics.push(unknown(name, span, help));
        }
    }
    let defaults = parameters.iter().map(|it| &it.default);
    for default in defaults
        .chain(inputs.iter().map(|it| &it.default))
        .flatten()
    {
        named_in(default, &mut names);
    }
    for (name, span) in names {
        diagnostics.push(unknown(name, span, "a default must be a value".to_owned()));
    }
    for parameter in parameters {
        let name = &parameter.name;
        if !used.contains(name.name.as_str()) {
            diagnostics.push(not_used(body, "parameter", name));
        }
    }
}

fn inputs_are_used(body: &Body<'_>, fragment: &Fragment, diagnostics: &mut Vec<Diagnostic>) {
    let references = body
        .references()
        .filter(|reference| reference.port.is_empty());
    let used: HashSet<&str> = references
        .map(|reference| reference.primitive.as_str())
        .collect();
    for input in &fragment.inputs {
        let name = &input.name;
        if let Some(primitive) = body.members.get(name.name.as_str()) {
            let message = format!("`{}` is the name of an input and of a primitive", name.name);
            let diagnostic = Diagnostic::error(codes::BAD_NAME, primitive.id.span, message);
            diagnostics.push(diagnostic.help("rename one of them"));
        }
        if !used.contains(name.name.as_str()) {
            diagnostics.push(not_used(body, "input", name));
        }
        if let Some((Type::Text, span)) = input.ty {
            diagnostics.push(no_text(span));
        }
    }
}

fn no_text(span: Span) -> Diagnostic {
    let message = "an input cannot be of type Text";
    Diagnostic::error(codes::WRONG_SHAPE, span, message).help("make it a parameter of the fragment")
}

fn not_used(body: &Body<'_>, what: &str, name: &Key) -> Diagnostic {
    let message = format!(
        "the {what} `{}` of {} is not used",
        name.name,
        body.describe()
    );
    Diagnostic::error(codes::NOT_USED, name.span, message)
}

/// Returns `did you mean …?`, or the known names.
fn nearest<'n>(name: &str, what: &str, known: impl Iterator<Item = &'n Key> + Clone) -> String {
    // Limited, because a text may have a hundred thousand names and as many typing errors.
    let known = known.map(|key| key.name.as_str()).take(COMPARED_MAX);
    match closest(name, known.clone()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => {
            let names: Vec<&str> = known.take(16).collect();
            match names.len() {
                0 => format!("{what}: none"),
                _ => format!("{what}: {}", names.join(", ")),
            }
        }
    }
}
