//! Which values of a net can be null, and why: an upper bound, found without running it. Null begins where a spec says so
//! (`Spec::undefined`), where nothing was set or written, and in the first cycle of a delayed link; it goes on by the null
//! rules of the primitives until nothing changes any more. The loader's threads and the command line.
//!
//! *Can* means: for some values of what it reads. A primitive that asks `IsNull` and selects accordingly is not understood,
//! and numbers that overflow are not counted: else every sum could be null.

mod clause;

use std::collections::VecDeque;

use rcc_core::primitive::{Literal as Default, NullRule, Role};

use crate::resolve::{Feed, Graph, Item, Leaf, Output, Wire};
use crate::syntax::literal::{Literal, Shape};

pub use clause::clauses;

/// Why the outputs of a primitive can be null.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// They can although its inputs are known: the device is lost, a divisor is 0; see [`clauses`].
    Undefined,
    /// It is set from outside: null until then, or set to null.
    NotSet,
    /// It comes from another net, which may not run.
    NotPublished,
    /// Its value is the constant null.
    Constant,
    /// It is evaluated only while a condition is true.
    NotActive,
    /// This input can be null, for this reason, and null passes.
    Input(usize, InputCause),
}

/// Why an input can be null.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputCause {
    /// It is the constant null, or not connected and null by default.
    Constant,
    /// The output that it reads can be.
    Output(Output),
    /// A delayed link carries null in the first cycle, and only then.
    FirstCycle,
}

/// Which values of a net can be null. All outputs of a primitive together.
#[derive(Clone, Debug)]
pub struct Nulls {
    /// By item.
    causes: Vec<Option<Cause>>,
}

/// Finds everything that can be null; linear in the number of links.
#[must_use]
pub fn nulls(graph: &Graph<'_>) -> Nulls {
    let mut nulls = Nulls {
        causes: vec![None; graph.items.len()],
    };
    let mut readers = vec![Vec::new(); graph.items.len()];
    for (number, item) in graph.items.iter().enumerate() {
        for (_, wire) in item.wires() {
            if let Some(readers) = readers.get_mut(wire.from.item) {
                readers.push(number);
            }
        }
    }
    // In waves from the origins, so that the way that is kept is a shortest one.
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
            queue.extend(readers.get(number).into_iter().flatten());
        }
    }
    nulls
}

fn is_output(cause: InputCause) -> bool {
    matches!(cause, InputCause::Output(_))
}

/// Null that begins at an item.
fn origin(graph: &Graph<'_>, item: &Item<'_>) -> Option<Cause> {
    match item.spec().role {
        Role::Input if item.topic().is_some() => Some(Cause::NotPublished),
        Role::Input => Some(Cause::NotSet),
        Role::Constant => {
            let value = item.parameters.first().copied().flatten();
            let is_null = value.is_some_and(|value| value.shape == Shape::Null);
            is_null.then_some(Cause::Constant)
        }
        _ if item.region.is_some() => Some(Cause::NotActive),
        _ => clauses(graph, item)
            .next()
            .is_some()
            .then_some(Cause::Undefined),
    }
}

/// True if a delayed link begins with null.
fn begins_null(wire: &Wire<'_>) -> bool {
    let is_null = |initial: &Literal| initial.shape == Shape::Null;
    wire.delayed && wire.initial.is_none_or(is_null)
}

impl Nulls {
    /// Why an output can be null; `None`: it never is.
    #[must_use]
    pub fn output(&self, output: Output) -> Option<Cause> {
        self.item(output.item)
    }

    /// Why the outputs of item `number` can be null; `None`: they never are.
    #[must_use]
    pub fn item(&self, number: usize) -> Option<Cause> {
        self.causes.get(number).copied().flatten()
    }

    /// Why an input can be null; `None`: it never is. An input that is not connected and may not be is passed over.
    #[must_use]
    pub fn input(&self, item: &Item<'_>, input: usize) -> Option<InputCause> {
        self.feed(item.inputs.get(input)?)
    }

    fn feed(&self, feed: &Feed<'_>) -> Option<InputCause> {
        match feed {
            Feed::Literal(literal) if literal.shape == Shape::Null => Some(InputCause::Constant),
            Feed::Default(Default::Null) => Some(InputCause::Constant),
            Feed::Wire(wire) => self.wire(wire),
            Feed::List(list) => list.leaves.iter().find_map(|leaf| match leaf {
                Leaf::Wire(wire) => self.wire(wire),
                Leaf::Literal(literal, _) => {
                    (literal.shape == Shape::Null).then_some(InputCause::Constant)
                }
            }),
            _ => None,
        }
    }

    fn wire(&self, wire: &Wire<'_>) -> Option<InputCause> {
        if self.output(wire.from).is_some() {
            return Some(InputCause::Output(wire.from));
        }
        begins_null(wire).then_some(InputCause::FirstCycle)
    }

    /// The input through which null passes an item, as far as it is known to be null for a reason that counts.
    fn passed(&self, item: &Item<'_>, counts: impl Fn(InputCause) -> bool) -> Option<Cause> {
        let mut inputs = item.inputs.iter().enumerate().map(|(place, feed)| {
            let cause = self.feed(feed).filter(|cause| counts(*cause));
            cause.map(|cause| Cause::Input(place, cause))
        });
        match item.spec().null_rule {
            NullRule::Known => None,
            NullRule::Remembers if item.begins_known() => None,
            NullRule::Propagates | NullRule::FirstAndAnyKnown | NullRule::Remembers => {
                inputs.flatten().next()
            }
            // The last one is what the others fall back on.
            NullRule::AnyKnown => inputs.try_fold(None, |_, cause| cause.map(Some)).flatten(),
        }
    }

    /// The way of null to item `number`: where null begins first, the item itself last. Empty: it is never null.
    #[must_use]
    pub fn way(&self, number: usize) -> Vec<usize> {
        let mut way = Vec::new();
        let mut at = self.item(number).map(|_| number);
        // An item became null after what it is null for, so the way has an end.
        while let Some(number) = at.take() {
            way.push(number);
            if let Some(Cause::Input(_, InputCause::Output(from))) = self.item(number) {
                at = Some(from.item);
            }
        }
        way.reverse();
        way
    }

    /// Why the outputs of item `number` can be null, and the way to it, as a phrase: "`lwr` is lost: ft → force". `None`:
    /// they never are.
    #[must_use]
    pub fn why(&self, graph: &Graph<'_>, number: usize) -> Option<String> {
        let way = self.way(number);
        let (_, before) = way.split_last()?;
        let words = self.words(graph, *way.first()?, self.begins_at(&way, None))?;
        Some(phrase(graph, words, before))
    }

    /// Why an input can be null, as a phrase; `None`: it never is.
    #[must_use]
    pub fn why_input(&self, graph: &Graph<'_>, number: usize, input: usize) -> Option<String> {
        match self.input(graph.items.get(number)?, input)? {
            InputCause::Constant => Some("it is the constant null".to_owned()),
            InputCause::FirstCycle => Some("null in the first cycle".to_owned()),
            InputCause::Output(from) => {
                let way = self.way(from.item);
                let output = self.begins_at(&way, Some(from.port));
                Some(phrase(
                    graph,
                    self.words(graph, *way.first()?, output)?,
                    &way,
                ))
            }
        }
    }

    /// Which output of the first item of a way it goes through; `last` is that of a way of one item.
    fn begins_at(&self, way: &[usize], last: Option<usize>) -> Option<usize> {
        let Some(next) = way.get(1) else {
            return last;
        };
        match self.item(*next) {
            Some(Cause::Input(_, InputCause::Output(from))) => Some(from.port),
            _ => None,
        }
    }

    /// What makes null at the item where it begins, at this output of it.
    fn words(&self, graph: &Graph<'_>, number: usize, output: Option<usize>) -> Option<String> {
        let item = graph.items.get(number)?;
        let words = match self.item(number)? {
            Cause::NotSet if is_age(item, output) => "it was never set".to_owned(),
            Cause::NotSet if has_first_value(item) => "it was set to null".to_owned(),
            Cause::NotSet => "it is not set".to_owned(),
            Cause::NotPublished => {
                let topic = item.topic().unwrap_or_default();
                format!("no running net publishes `{topic}`")
            }
            Cause::Constant => "its value is null".to_owned(),
            Cause::NotActive => {
                let region = graph.conditions(item).next();
                let id = region.map_or("", |region| &region.id.name);
                format!("`{id}` is not active")
            }
            Cause::Undefined => {
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
            Cause::Input(input, cause) => {
                let port = item.spec().inputs.get(input).map_or("", |port| port.name);
                match cause {
                    InputCause::FirstCycle => format!("`{port}` is null in the first cycle"),
                    _ => format!("`{port}` is the constant null"),
                }
            }
        };
        Some(words)
    }
}

/// The age of an input is null until it is set, with an initial value too.
fn is_age(item: &Item<'_>, output: Option<usize>) -> bool {
    let port = output.and_then(|output| item.spec().outputs.get(output));
    port.is_some_and(|port| port.name == "age")
}

fn has_first_value(item: &Item<'_>) -> bool {
    let mut given = item.parameters.iter().zip(item.spec().parameters);
    given.any(|(value, parameter)| {
        parameter.name == "initial" && value.is_some_and(|value| value.shape != Shape::Null)
    })
}

/// Most primitives of a way that are named at each of its ends.
const NAMED_MAX: usize = 3;

fn phrase(graph: &Graph<'_>, origin: String, way: &[usize]) -> String {
    let mut ids: Vec<&str> = way
        .iter()
        .filter_map(|number| graph.items.get(*number).map(Item::id))
        .collect();
    if ids.len() > 2 * NAMED_MAX {
        ids.splice(NAMED_MAX..ids.len() - NAMED_MAX, ["…"]);
    }
    match ids.as_slice() {
        [] => origin,
        ids => format!("{origin}: {}", ids.join(" → ")),
    }
}
