//! Null analysis: which values of a net can be null, and why. A static upper bound: null originates where a spec says
//! so (`Spec::undefined`), where nothing was set or written, and in the first cycle of a delayed link. It propagates by
//! the null rules of the primitives until a fixpoint. Runs on the loader's threads and in the command line.
//!
//! *Can be null* means: for some input values. The analysis does not understand a net that tests with `IsNull` and
//! selects accordingly. It ignores overflow, because otherwise every sum could be null.

mod always_null;
mod clause;

use std::collections::VecDeque;

use rcc_core::primitive::{DefaultValue as Default, NullRule, Role};

use crate::adjacency::Adjacency;
use crate::resolve::{
    InputSource, ListElement, NetGraph, OutputId, ResolvedLink, ResolvedPrimitive,
};
use crate::syntax::literal::{Literal, LiteralShape};

pub use always_null::{AlwaysNull, find_always_null};
pub use clause::clauses;

/// Why the outputs of a primitive can be null.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NullCause {
    /// The result can be undefined although the inputs are known: the device is lost, a divisor is 0; see [`clauses`].
    Undefined,
    /// The value is set from outside; it is null before that, or if it is set to null.
    NotSet,
    /// The value comes from another net, which may not be running.
    NotPublished,
    /// The value is the constant null.
    Constant,
    /// The primitive is evaluated only while a condition is true.
    NotActive,
    /// The input with this index can be null for this reason, and null propagates.
    Input(usize, NullInputCause),
}

/// Why an input can be null.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NullInputCause {
    /// The input is the constant null, or not connected and null by default.
    Constant,
    /// The output that the input reads can be null.
    Output(OutputId),
    /// The input reads a delayed link that is null in the first cycle only.
    FirstCycle,
}

/// The result of the analysis, for all outputs of a primitive together.
#[derive(Clone, Debug)]
pub struct NullAnalysis {
    /// Cause of null, by item; `None` if the item is never null.
    causes: Vec<Option<NullCause>>,
}

/// Analyses a net; linear in the number of links.
#[must_use]
pub fn analyse_nulls(graph: &NetGraph<'_>) -> NullAnalysis {
    let mut nulls = NullAnalysis {
        causes: vec![None; graph.items.len()],
    };
    let sources = graph.items.iter().map(|item| {
        let links = item.links();
        links.map(|(_, link)| link.from.item)
    });
    let readers = sources.collect::<Adjacency>().reversed(graph.items.len());
    // Breadth first from the origins, so that the stored path is a shortest one.
    let mut queue: VecDeque<usize> = (0..graph.items.len()).collect();
    let mut first_wave = queue.len();
    while let Some(number) = queue.pop_front() {
        let only_origins = first_wave > 0;
        first_wave = first_wave.saturating_sub(1);
        let (Some(item), Some(None)) = (graph.items.get(number), nulls.causes.get(number)) else {
            continue;
        };
        let cause = match only_origins {
            true => origin(graph, item).or_else(|| nulls.passed(item, |cause| !is_output(cause))),
            false => nulls.passed(item, |_| true),
        };
        if let (Some(cause), Some(place)) = (cause, nulls.causes.get_mut(number)) {
            *place = Some(cause);
            queue.extend(readers.of(number));
        }
    }
    nulls
}

fn is_output(cause: NullInputCause) -> bool {
    matches!(cause, NullInputCause::Output(_))
}

/// Returns the cause if null originates at the item.
fn origin(graph: &NetGraph<'_>, item: &ResolvedPrimitive<'_>) -> Option<NullCause> {
    match item.spec().role {
        Role::Input if item.topic().is_some() => Some(NullCause::NotPublished),
        Role::Input => Some(NullCause::NotSet),
        Role::Constant => {
            let value = item.parameters.first().copied().flatten();
            let is_null = value.is_some_and(Literal::is_null);
            is_null.then_some(NullCause::Constant)
        }
        _ if item.region.is_some() => Some(NullCause::NotActive),
        _ => clauses(graph, item)
            .next()
            .is_some()
            .then_some(NullCause::Undefined),
    }
}

/// Returns true if a delayed link carries null in the first cycle.
fn is_initially_null(link: &ResolvedLink<'_>) -> bool {
    link.delayed && link.initial.is_none_or(Literal::is_null)
}

impl NullAnalysis {
    /// Returns why an output can be null; `None` if it never is.
    #[must_use]
    pub fn output(&self, output: OutputId) -> Option<NullCause> {
        self.item(output.item)
    }

    /// Returns why the outputs of item `number` can be null; `None` if they never are.
    #[must_use]
    pub fn item(&self, number: usize) -> Option<NullCause> {
        self.causes.get(number).copied().flatten()
    }

    /// Returns why an input can be null; `None` if it never is. A required input that is not connected counts as never
    /// null.
    #[must_use]
    pub fn input(&self, item: &ResolvedPrimitive<'_>, input: usize) -> Option<NullInputCause> {
        self.input_source(item.inputs.get(input)?)
    }

    fn input_source(&self, input_source: &InputSource<'_>) -> Option<NullInputCause> {
        match input_source {
            InputSource::Literal(literal) if literal.is_null() => Some(NullInputCause::Constant),
            InputSource::Default(Default::Null) => Some(NullInputCause::Constant),
            InputSource::Link(link) => self.link(link),
            InputSource::List(list) => list.elements.iter().find_map(|it| self.element(it)),
            InputSource::Outcomes(outcomes) => {
                outcomes.conditions.iter().find_map(|it| self.element(it))
            }
            _ => None,
        }
    }

    fn element(&self, element: &ListElement<'_>) -> Option<NullInputCause> {
        match element {
            ListElement::Link(link) => self.link(link),
            ListElement::Literal(literal, _) => {
                literal.is_null().then_some(NullInputCause::Constant)
            }
        }
    }

    fn link(&self, link: &ResolvedLink<'_>) -> Option<NullInputCause> {
        if self.output(link.from).is_some() {
            return Some(NullInputCause::Output(link.from));
        }
        is_initially_null(link).then_some(NullInputCause::FirstCycle)
    }

    /// Returns the input through which null propagates to the outputs of an item. Only causes for which `counts` is
    /// true are considered.
    fn passed(
        &self,
        item: &ResolvedPrimitive<'_>,
        counts: impl Fn(NullInputCause) -> bool,
    ) -> Option<NullCause> {
        let mut inputs = item.inputs.iter().enumerate().map(|(place, input_source)| {
            let cause = self
                .input_source(input_source)
                .filter(|cause| counts(*cause));
            cause.map(|cause| NullCause::Input(place, cause))
        });
        match item.spec().null_rule {
            NullRule::Known => None,
            NullRule::Remembers if item.has_known_initial_value() => None,
            NullRule::Propagates | NullRule::FirstAndAnyKnown | NullRule::Remembers => {
                inputs.flatten().next()
            }
            // All inputs must be null; the last one is the final alternative, so it is named as the cause.
            NullRule::AnyKnown => inputs.try_fold(None, |_, cause| cause.map(Some)).flatten(),
        }
    }

    /// Returns the path of null to item `number`, from the origin to the item itself. Empty if the item is never null.
    #[must_use]
    pub fn path(&self, number: usize) -> Vec<usize> {
        let mut path = Vec::new();
        let mut at = self.item(number).map(|_| number);
        // The cause of an item became null before the item did, so the path ends.
        while let Some(number) = at.take() {
            path.push(number);
            if let Some(NullCause::Input(_, NullInputCause::Output(from))) = self.item(number) {
                at = Some(from.item);
            }
        }
        path.reverse();
        path
    }

    /// Returns why the outputs of item `number` can be null, with the path, as a phrase: "`lwr` is lost: ft → force".
    /// Returns `None` if they never are.
    #[must_use]
    pub fn why(&self, graph: &NetGraph<'_>, number: usize) -> Option<String> {
        let path = self.path(number);
        let (_, before) = path.split_last()?;
        let words = self.describe_origin(graph, *path.first()?, self.origin_output(&path, None))?;
        Some(phrase(graph, words, before))
    }

    /// Returns why an input can be null, as a phrase; `None` if it never is.
    #[must_use]
    pub fn why_input(&self, graph: &NetGraph<'_>, number: usize, input: usize) -> Option<String> {
        self.describe(graph, self.input(graph.items.get(number)?, input)?)
    }

    /// Returns why an element of a list, or a named condition, can be null, as a phrase; `None` if it never is.
    #[must_use]
    pub fn why_element(&self, graph: &NetGraph<'_>, element: &ListElement<'_>) -> Option<String> {
        self.describe(graph, self.element(element)?)
    }

    fn describe(&self, graph: &NetGraph<'_>, cause: NullInputCause) -> Option<String> {
        match cause {
            NullInputCause::Constant => Some("it is the constant null".to_owned()),
            NullInputCause::FirstCycle => Some("null in the first cycle".to_owned()),
            NullInputCause::Output(from) => {
                let path = self.path(from.item);
                let output = self.origin_output(&path, Some(from.port));
                Some(phrase(
                    graph,
                    self.describe_origin(graph, *path.first()?, output)?,
                    &path,
                ))
            }
        }
    }

    /// Returns the output of the first item through which a path begins. `last` is the output if the path has one item
    /// only.
    fn origin_output(&self, path: &[usize], last: Option<usize>) -> Option<usize> {
        let Some(next) = path.get(1) else {
            return last;
        };
        match self.item(*next) {
            Some(NullCause::Input(_, NullInputCause::Output(from))) => Some(from.port),
            _ => None,
        }
    }

    /// Describes the origin of null at an item and one of its outputs.
    fn describe_origin(
        &self,
        graph: &NetGraph<'_>,
        number: usize,
        output: Option<usize>,
    ) -> Option<String> {
        let item = graph.items.get(number)?;
        let words = match self.item(number)? {
            NullCause::NotSet if is_age(item, output) => "it has never been set".to_owned(),
            NullCause::NotSet if has_initial_value(item) => "it was set to null".to_owned(),
            NullCause::NotSet => "it is not set".to_owned(),
            NullCause::NotPublished => {
                let topic = item.topic().unwrap_or_default();
                format!("no running net publishes `{topic}`")
            }
            NullCause::Constant => "its value is null".to_owned(),
            NullCause::NotActive => {
                let region = graph.regions_of(item).next();
                let id = region.map_or("", |region| &region.id.name);
                format!("`{id}` is not active")
            }
            NullCause::Undefined => {
                let clauses: Vec<&str> = clauses(graph, item).collect();
                let device = item
                    .device
                    .and_then(|device| graph.cell.devices.get(device));
                let words = clauses.join(", or ");
                match device {
                    Some(device) => words.replace("the device", &format!("`{}`", device.name)),
                    None => words,
                }
            }
            NullCause::Input(input, cause) => {
                let port = item.spec().inputs.get(input).map_or("", |port| port.name);
                match cause {
                    NullInputCause::FirstCycle => format!("`{port}` is null in the first cycle"),
                    _ => format!("`{port}` is the constant null"),
                }
            }
        };
        Some(words)
    }
}

/// The age of an input is null until the input is set, even if it has an initial value.
fn is_age(item: &ResolvedPrimitive<'_>, output: Option<usize>) -> bool {
    let port = output.and_then(|output| item.spec().outputs.get(output));
    port.is_some_and(|port| port.name == "age")
}

fn has_initial_value(item: &ResolvedPrimitive<'_>) -> bool {
    let mut given = item.parameters.iter().zip(item.spec().parameters);
    given.any(|(value, parameter)| {
        parameter.name == "initial" && value.is_some_and(|value| value.shape != LiteralShape::Null)
    })
}

/// Most primitives that a phrase names at each end of a path.
const NAMED_MAX: usize = 3;

fn phrase(graph: &NetGraph<'_>, origin: String, path: &[usize]) -> String {
    let mut ids: Vec<&str> = path
        .iter()
        .filter_map(|number| graph.items.get(*number).map(ResolvedPrimitive::id))
        .collect();
    if ids.len() > 2 * NAMED_MAX {
        ids.splice(NAMED_MAX..ids.len() - NAMED_MAX, ["…"]);
    }
    match ids.as_slice() {
        [] => origin,
        ids => format!("{origin}: {}", ids.join(" → ")),
    }
}
