//! Outputs that are null in every cycle, whatever the inputs and devices of the net do, and the chain that makes them so.
//! The complement of what can become known, which is a static upper bound: an output that is not proved may be null in
//! every cycle all the same. Runs on the loader's threads and in the command line.

use std::collections::HashSet;

use rcc_core::primitive::{NullRule, Role};

use super::clause::{ClauseTruth, truths};
use super::{is_initially_null, phrase};
use crate::adjacency::Adjacency;
use crate::resolve::{
    InputSource, ListElement, NetGraph, OutputId, ResolvedLink, ResolvedPrimitive, ResolvedRegion,
};
use crate::syntax::literal::{Literal, LiteralShape};

/// Result of the analysis.
#[derive(Clone, Debug)]
pub struct AlwaysNull {
    /// False for items all of whose outputs are always null.
    can_be_known: Vec<bool>,
    /// Outputs that are always null by a clause of their spec, by item: the port and the clause.
    undefined: Vec<Option<(usize, &'static str)>>,
}

/// Analyses a net; linear in the number of links.
#[must_use]
pub fn find_always_null(graph: &NetGraph<'_>) -> AlwaysNull {
    let mut nulls = AlwaysNull {
        can_be_known: vec![false; graph.items.len()],
        undefined: graph.items.iter().map(|it| undefined(graph, it)).collect(),
    };
    let sources = graph.items.iter().map(|item| {
        let links = graph.dependencies(item);
        links.map(|(_, link)| link.from.item)
    });
    let readers = sources.collect::<Adjacency>().reversed(graph.items.len());
    let mut queue: Vec<usize> = (0..graph.items.len()).collect();
    while let Some(number) = queue.pop() {
        let Some(item) = graph.items.get(number) else {
            continue;
        };
        if nulls.can_be_known.get(number) == Some(&false) && nulls.becomes_known(graph, item) {
            if let Some(known) = nulls.can_be_known.get_mut(number) {
                *known = true;
            }
            queue.extend(readers.of(number));
        }
    }
    nulls
}

/// Returns the output that a clause of the spec makes null in every cycle. Clauses concern the outputs that must be read:
/// with several of them it is not known which one.
fn undefined(graph: &NetGraph<'_>, item: &ResolvedPrimitive<'_>) -> Option<(usize, &'static str)> {
    let mut ports = item.spec().outputs.iter().enumerate();
    let (port, _) = ports.find(|(_, port)| !port.diagnostic)?;
    if ports.any(|(_, port)| !port.diagnostic) {
        return None;
    }
    let mut clauses = truths(graph, item);
    let clause = clauses.find(|(_, truth)| *truth == ClauseTruth::Always)?.0;
    Some((port, clause))
}

/// Returns true if a constant keeps a region from ever being active.
fn is_switched_off(region: &ResolvedRegion<'_>) -> bool {
    match &region.condition {
        InputSource::Literal(literal) => {
            matches!(
                literal.shape,
                LiteralShape::Bool(false) | LiteralShape::Null
            )
        }
        _ => false,
    }
}

/// Returns true if a constant has an element that is not null.
fn has_value(literal: &Literal) -> bool {
    match &literal.shape {
        LiteralShape::Null => false,
        LiteralShape::List(elements) => elements.iter().any(has_value),
        _ => true,
    }
}

impl AlwaysNull {
    /// Returns true if an output is null in every cycle.
    #[must_use]
    pub fn output(&self, output: OutputId) -> bool {
        let undefined = self.undefined.get(output.item).copied().flatten();
        self.can_be_known.get(output.item) == Some(&false)
            || undefined.is_some_and(|(port, _)| port == output.port)
    }

    fn link(&self, link: &ResolvedLink<'_>) -> bool {
        let has_initial = link.delayed && !is_initially_null(link);
        !has_initial && self.output(link.from)
    }

    /// Returns true if an input is null in every cycle. A list is, if all its elements are.
    fn input(&self, input_source: &InputSource<'_>) -> bool {
        match input_source {
            InputSource::Link(link) => self.link(link),
            InputSource::Literal(literal) => !has_value(literal),
            InputSource::List(list) => list.elements.iter().all(|element| match element {
                ListElement::Link(link) => self.link(link),
                ListElement::Literal(literal, _) => !has_value(literal),
            }),
            // The default null of an input means that it is absent; outcomes end a net and command nothing.
            InputSource::Default(_)
            | InputSource::Missing
            | InputSource::Refused
            | InputSource::Outcomes(_) => false,
        }
    }

    fn becomes_known(&self, graph: &NetGraph<'_>, item: &ResolvedPrimitive<'_>) -> bool {
        let is_active = graph
            .regions_of(item)
            .all(|region| !is_switched_off(region) && !self.input(&region.condition));
        if !is_active {
            return false;
        }
        let mut known = item.inputs.iter().map(|source| !self.input(source));
        match (item.spec().role, item.spec().null_rule) {
            (Role::Input, _) => true,
            (Role::Constant, _) => {
                let value = item.parameters.first().copied().flatten();
                value.is_none_or(has_value)
            }
            (_, NullRule::Known) => true,
            (_, NullRule::Remembers) => {
                item.has_known_initial_value() || item.inputs.is_empty() || known.any(|it| it)
            }
            (_, NullRule::Propagates) => known.all(|it| it),
            (_, NullRule::AnyKnown) => item.inputs.is_empty() || known.any(|it| it),
            (_, NullRule::FirstAndAnyKnown) => known.next() == Some(true) && known.any(|it| it),
        }
    }

    /// Returns why a command is never given, as a phrase: "b = 0: ratio → speed"; `None` if that is not proved, or if it
    /// is switched off by a constant. `input` is the input of the command; all its elements must be known.
    #[must_use]
    pub fn why_input(
        &self,
        graph: &NetGraph<'_>,
        item: &ResolvedPrimitive<'_>,
        input: usize,
    ) -> Option<String> {
        if graph.regions_of(item).any(is_switched_off) {
            return None;
        }
        let link = match item.inputs.get(input)? {
            InputSource::Link(link) => Some(link).filter(|link| self.link(link)),
            InputSource::List(list) => list.elements.iter().find_map(|element| match element {
                ListElement::Link(link) => Some(link).filter(|link| self.link(link)),
                ListElement::Literal(..) => None,
            }),
            _ => None,
        };
        self.chain(graph, link?.from)
    }

    /// Follows null from an output to its origin; `None` in a loop, which another rule reports.
    fn chain(&self, graph: &NetGraph<'_>, output: OutputId) -> Option<String> {
        let (mut at, mut path, mut seen) = (output, Vec::new(), HashSet::new());
        let reason = loop {
            if !seen.insert(at.item) {
                return None;
            }
            path.push(at.item);
            let item = graph.items.get(at.item)?;
            match self.origin(graph, item, at) {
                Ok(reason) => break reason,
                Err(from) => at = from?,
            }
        };
        path.reverse();
        Some(phrase(graph, reason, &path))
    }

    /// Returns the reason if null originates at an output, otherwise the output that it comes from.
    fn origin(
        &self,
        graph: &NetGraph<'_>,
        item: &ResolvedPrimitive<'_>,
        output: OutputId,
    ) -> Result<String, Option<OutputId>> {
        let undefined = self.undefined.get(output.item).copied().flatten();
        if let Some((_, clause)) = undefined.filter(|(port, _)| *port == output.port) {
            return Ok(clause.to_owned());
        }
        if item.spec().role == Role::Constant {
            return Ok("its value is null".to_owned());
        }
        for region in graph.regions_of(item) {
            match &region.condition {
                _ if is_switched_off(region) => {
                    return Ok(format!("`{}` is never active", region.id.name));
                }
                InputSource::Link(link) if self.link(link) => return Err(Some(link.from)),
                _ => {}
            }
        }
        for (port, source) in item.spec().inputs.iter().zip(&item.inputs) {
            match source {
                _ if !self.input(source) => {}
                InputSource::Link(link) => return Err(Some(link.from)),
                InputSource::List(list) => {
                    let mut links = list.elements.iter().filter_map(|element| match element {
                        ListElement::Link(link) => Some(link.from),
                        ListElement::Literal(..) => None,
                    });
                    if let Some(from) = links.next() {
                        return Err(Some(from));
                    }
                    return Ok(format!("`{}` is the constant null", port.name));
                }
                _ => return Ok(format!("`{}` is the constant null", port.name)),
            }
        }
        Err(None)
    }
}
