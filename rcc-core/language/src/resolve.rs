//! The resolve pass, [`ExpandedNet`] → [`NetGraph`]: types, devices, channels, parameters and links are looked up by
//! name in the catalogue, the cell and the net itself. Unresolved names are reported and left out, so that one error
//! does not cause others. Runs on the loader's threads.

mod cell;
mod evaluations;
mod graph;
mod links;
mod rate;
mod suggest;

use foldhash::{HashMap, HashMapExt};
use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::Key;
use rcc_core::primitive::{CatalogueEntry, Parameter, Port, Role, Spec};
use rcc_core::primitives::{self, CATALOGUE};

use crate::codes;
use crate::devices::DeviceTable;
use crate::expand::{self, ExpandedNet};
use crate::syntax::literal::Literal;
use crate::syntax::{Net, Primitive};
use suggest::Suggestions;

pub(crate) use evaluations::{RATE_TOLERANCE, every, window, window_s};
pub use graph::{
    DeclaredInput, InputSource, ListElement, NetGraph, OutputId, ResolvedLink, ResolvedList,
    ResolvedOutcomes, ResolvedPrimitive, ResolvedRegion,
};

/// Remedy for `start: continue` of a motion along a path.
const PATH_BEGINS_AT_REST: &str = "a motion along a path begins at rest, at the place from which it was planned: take a moving arm over \
     with `start: continue` of `PoseGoal` or `JointGoal`, and start the path when it rests at their goal, with that \
     place as `from`";

/// Resolves all names of a net.
pub fn resolve<'a>(
    flat: &'a ExpandedNet,
    cell: &'a DeviceTable,
    diagnostics: &mut Vec<Diagnostic>,
) -> NetGraph<'a> {
    let net = &flat.net;
    let rate = rate::rate_of(&net.timing, cell, diagnostics);
    let mut resolver = Resolver {
        net,
        instances: &flat.instances,
        cell,
        diagnostics,
        ids: HashMap::with_capacity(net.primitives.len()),
        rows: Vec::with_capacity(net.primitives.len()),
        counted_as_read: Vec::new(),
        suggestions: Suggestions::default(),
    };
    resolver.find_types();
    let mut items = Vec::with_capacity(net.primitives.len());
    for (number, primitive) in net.primitives.iter().enumerate() {
        let region = flat.region_of.get(number).copied().flatten();
        match resolver.rows.get(number).copied().flatten() {
            Some((row, entry)) => items.push(ResolvedPrimitive {
                region,
                ..resolver.item(primitive, row, entry)
            }),
            None => resolver.count_inputs_as_read(&primitive.inputs),
        }
    }
    let regions = flat.regions.iter().map(|region| ResolvedRegion {
        id: &region.id,
        condition: resolver.resolve_source(&region.condition, &CONDITION),
        parent: region.parent,
    });
    let regions = regions.collect();
    for reference in &flat.read {
        let output = resolver.output(reference);
        resolver.counted_as_read.extend(output);
    }
    let discarded = resolver.discarded();
    let has_unknown_types = resolver.rows.iter().any(Option::is_none) || flat.is_incomplete;
    let declarations = flat
        .declarations
        .iter()
        .filter_map(|declaration| resolver.declared_input(declaration));
    NetGraph {
        net,
        cell,
        rate,
        types: types_of(&items),
        items,
        discarded,
        declarations: declarations.collect(),
        regions,
        counted_as_read: resolver.counted_as_read,
        has_unknown_types,
    }
}

/// Returns the value with this name. Most are given in the order of the spec, so that its place there is looked at first.
fn given<'a, T>(given: &'a [(Key, T)], place: usize, name: &str) -> Option<&'a T> {
    let first = given.get(place).into_iter();
    let mut rows = first.chain(given);
    rows.find(|(key, _)| key.name == name)
        .map(|(_, value)| value)
}

/// Returns true if a key is one of the names of the spec; that at its place is looked at first.
fn is_known(place: usize, key: &Key, names: impl Iterator<Item = &'static str> + Clone) -> bool {
    let first = names.clone().skip(place).take(1);
    first.chain(names).any(|name| key.name == name)
}

/// Returns the indices of the items' types in the catalogue, each once, in order.
fn types_of(items: &[ResolvedPrimitive<'_>]) -> Vec<usize> {
    let mut is_used = vec![false; CATALOGUE.len()];
    for item in items {
        if let Some(is_used) = is_used.get_mut(item.row) {
            *is_used = true;
        }
    }
    let rows = is_used.iter().enumerate();
    rows.filter_map(|(row, is_used)| is_used.then_some(row))
        .collect()
}

/// `active`, treated as an input.
const CONDITION: Port = Port::bool("active", "the condition");

/// The target of an id.
#[derive(Clone, Copy)]
enum IdTarget {
    /// A primitive of unknown type.
    Unknown,
    Item(usize, &'static Spec),
}

struct Resolver<'a, 'f> {
    net: &'a Net,
    instances: &'a [String],
    cell: &'a DeviceTable,
    diagnostics: &'f mut Vec<Diagnostic>,
    ids: HashMap<&'a str, IdTarget>,
    rows: Vec<Option<(usize, &'static CatalogueEntry)>>,
    counted_as_read: Vec<OutputId>,
    suggestions: Suggestions,
}

impl<'a> Resolver<'a, '_> {
    fn error(&mut self, code: &'static str, span: Span, message: String, help: Option<String>) {
        self.diagnostics
            .push(Diagnostic::error(code, span, message).help_if(help));
    }

    fn find_types(&mut self) {
        let mut count = 0;
        for primitive in &self.net.primitives {
            let name = &primitive.type_name;
            let row = primitives::find(&name.name);
            if row.is_none() && !name.name.is_empty() {
                let message = format!("unknown primitive type `{}`", name.name);
                let help = self.suggestions.primitive_type(&name.name);
                self.error(codes::UNKNOWN_TYPE, name.span, message, Some(help));
            }
            let target = row.map_or(IdTarget::Unknown, |(_, entry)| {
                IdTarget::Item(count, &entry.spec)
            });
            count += usize::from(row.is_some());
            self.ids.insert(&primitive.id.name, target);
            self.rows.push(row);
        }
    }

    fn declared_input(
        &self,
        declaration: &'a expand::InputDeclaration,
    ) -> Option<DeclaredInput<'a>> {
        let primitive = self.net.primitives.get(declaration.primitive)?;
        let IdTarget::Item(item, spec) = self.ids.get(primitive.id.name.as_str())? else {
            return None;
        };
        let (input, _) = spec.input(&declaration.input)?;
        Some(DeclaredInput {
            item: *item,
            input,
            declaration,
        })
    }

    fn item(
        &mut self,
        primitive: &'a Primitive,
        row: usize,
        entry: &'static CatalogueEntry,
    ) -> ResolvedPrimitive<'a> {
        let parameters = self.parameters(primitive, &entry.spec);
        let (device, channel) = self.device_and_channel(&entry.spec, &parameters);
        ResolvedPrimitive {
            primitive,
            row,
            entry,
            device,
            channel,
            region: None,
            inputs: self.inputs(primitive, &entry.spec),
            parameters,
        }
    }

    fn parameters(&mut self, primitive: &'a Primitive, spec: &Spec) -> Vec<Option<&'a Literal>> {
        let mut has_unknown = false;
        for (place, (key, _)) in primitive.parameters.iter().enumerate() {
            let names = spec.parameters.iter().map(|parameter| parameter.name);
            if !is_known(place, key, names) {
                has_unknown = true;
                let names = spec.parameters.iter().map(|parameter| parameter.name);
                let is_input = spec.input(&key.name).is_some();
                let help = match (spec.role, key.name.as_str()) {
                    (Role::Motion, "start") => PATH_BEGINS_AT_REST.to_owned(),
                    _ => self.suggestions.word(
                        &key.name,
                        "parameters",
                        names,
                        is_input.then_some("an input"),
                    ),
                };
                self.unknown(codes::UNKNOWN_PARAMETER, key, spec, "parameter", help);
            }
        }
        let mut found = Vec::with_capacity(spec.parameters.len());
        for (place, parameter) in spec.parameters.iter().enumerate() {
            let given = given(&primitive.parameters, place, parameter.name);
            // The missing parameter may be the one with the unknown name.
            if given.is_none() && parameter.default.is_none() && !has_unknown {
                self.missing_parameter(primitive, parameter);
            }
            found.push(given.filter(|literal| !literal.is_refused()));
        }
        found
    }

    fn unknown(&mut self, code: &'static str, key: &Key, spec: &Spec, what: &str, help: String) {
        let message = format!("{} has no {what} `{}`", spec.name, key.name);
        self.error(code, key.span, message, Some(help));
    }

    fn missing_parameter(&mut self, primitive: &Primitive, parameter: &Parameter) {
        let (id, name) = (&primitive.id.name, parameter.name);
        let message = format!("`{id}` needs the parameter `{name}`");
        let help = format!("add `{name}` to its parameters: {}", parameter.doc);
        let span = primitive.type_name.span;
        self.error(codes::MISSING_PARAMETER, span, message, Some(help));
    }
}
