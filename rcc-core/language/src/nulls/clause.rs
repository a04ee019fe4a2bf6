//! The clauses of `Spec::undefined`: which of them can come true at one primitive of a net, as far as its constants and
//! the ranges of the ports that it reads tell. The loader's threads and the command line.

use rcc_core::primitive::{Literal as Default, Role};

use crate::resolve::{Feed, Graph, Item, Output};

/// What begins so is never counted.
const OVERFLOW: &str = "overflow";

/// The clauses of an item's spec that nothing rules out.
pub fn clauses(graph: &Graph<'_>, item: &Item<'_>) -> impl Iterator<Item = &'static str> {
    let clauses = item.spec().undefined.split("; ").map(str::trim);
    clauses.filter(|clause| {
        !clause.is_empty()
            && !clause.starts_with(OVERFLOW)
            && comparison(graph, item, clause).unwrap_or(true)
    })
}

/// Numbers from the first to the second one.
type Range = [f64; 2];

const ANY: Range = [f64::NEG_INFINITY, f64::INFINITY];

/// False if a comparison of ports and numbers cannot come true; `None`: the clause is none.
fn comparison(graph: &Graph<'_>, item: &Item<'_>, clause: &str) -> Option<bool> {
    let mut words = clause.split_whitespace();
    let (left, operator, right) = (words.next()?, words.next()?, words.next()?);
    if words.next().is_some() {
        return None;
    }
    let [least, greatest] = range(graph, item, left)?;
    let [low, high] = match right.parse::<f64>() {
        Ok(number) => [number, number],
        Err(_) => range(graph, item, right)?,
    };
    match operator {
        "=" => Some(least <= high && low <= greatest),
        "<" => Some(least < high),
        "<=" => Some(least <= high),
        ">" => Some(greatest > low),
        ">=" => Some(greatest >= low),
        _ => None,
    }
}

/// What a port of an item can be: an input, or a parameter that is a number.
fn range(graph: &Graph<'_>, item: &Item<'_>, name: &str) -> Option<Range> {
    let spec = item.spec();
    if let Some((place, _)) = spec.input(name) {
        return Some(
            item.inputs
                .get(place)
                .map_or(ANY, |feed| of_feed(graph, feed)),
        );
    }
    let place = spec
        .parameters
        .iter()
        .position(|parameter| parameter.name == name)?;
    let given = item.parameters.get(place).copied().flatten();
    Some(match (given, spec.parameters.get(place)?.default) {
        (Some(literal), _) => literal.number().map_or(ANY, |number| [number, number]),
        (None, default) => default
            .and_then(number)
            .map_or(ANY, |number| [number, number]),
    })
}

fn of_feed(graph: &Graph<'_>, feed: &Feed<'_>) -> Range {
    let constant = |number: Option<f64>| number.map_or(ANY, |number| [number, number]);
    match feed {
        Feed::Literal(literal) => constant(literal.number()),
        Feed::Default(value) => constant(number(*value)),
        Feed::Wire(wire) => {
            let [least, greatest] = of_output(graph, wire.from);
            match wire
                .initial
                .filter(|_| wire.delayed)
                .map(|initial| initial.number())
            {
                Some(Some(first)) => [least.min(first), greatest.max(first)],
                _ => [least, greatest],
            }
        }
        _ => ANY,
    }
}

fn of_output(graph: &Graph<'_>, output: Output) -> Range {
    let Some(item) = graph.items.get(output.item) else {
        return ANY;
    };
    if item.spec().role == Role::Constant {
        let value = item.parameters.first().copied().flatten();
        let value = value.and_then(|value| value.number());
        return value.map_or(ANY, |value| [value, value]);
    }
    let port = item.spec().outputs.get(output.port);
    port.map_or(ANY, |port| {
        [
            port.least.unwrap_or(ANY[0]),
            port.greatest.unwrap_or(ANY[1]),
        ]
    })
}

fn number(value: Default) -> Option<f64> {
    match value {
        Default::Real(value) => Some(value),
        // Near enough for a comparison with what a spec says.
        Default::Int(value) => Some(value as f64),
        _ => None,
    }
}
