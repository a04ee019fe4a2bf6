//! The clauses of `Spec::undefined`: which of them can become true for one primitive of a net, given its constants and
//! the ranges of the ports that it reads. Runs on the loader's threads and in the command line.

use rcc_core::kinematics::Arm;
use rcc_core::primitive::{DefaultValue as Default, Role};

use crate::resolve::{InputSource, NetGraph, OutputId, ResolvedPrimitive};

/// Clauses that begin with this word are ignored.
const OVERFLOW: &str = "overflow";

/// Returns the clauses of an item's spec that cannot be ruled out.
pub fn clauses(
    graph: &NetGraph<'_>,
    item: &ResolvedPrimitive<'_>,
) -> impl Iterator<Item = &'static str> {
    truths(graph, item)
        .filter(|(_, truth)| *truth != ClauseTruth::Never)
        .map(|(clause, _)| clause)
}

/// Whether a clause is true for one primitive of a net.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClauseTruth {
    /// It cannot become true.
    Never,
    /// It is true for some values, or not understood.
    Sometimes,
    /// It is true in every cycle in which the inputs are known.
    Always,
}

/// Returns the clauses of an item's spec, except overflow, with what constants and ranges tell of them.
pub fn truths(
    graph: &NetGraph<'_>,
    item: &ResolvedPrimitive<'_>,
) -> impl Iterator<Item = (&'static str, ClauseTruth)> {
    let clauses = item.spec().undefined.split(';').map(str::trim);
    let clauses = clauses.filter(|clause| !clause.is_empty() && !clause.starts_with(OVERFLOW));
    clauses.map(|clause| {
        let truth = match clause {
            NO_ARM_ANGLE => of_arm(graph, item, |arm| !arm.has_arm_angle()),
            NOT_SRS => of_arm(graph, item, |arm| !matches!(arm, Arm::Srs(_))),
            clause => comparison(graph, item, clause),
        };
        (clause, truth.unwrap_or(ClauseTruth::Sometimes))
    })
}

/// The clause about arms without an arm angle.
const NO_ARM_ANGLE: &str = "the arm has no arm angle";
/// The clause about arms whose arm angle has no known range.
const NOT_SRS: &str = "the arm is not of type `srs`";

fn of_arm(
    graph: &NetGraph<'_>,
    item: &ResolvedPrimitive<'_>,
    applies: impl Fn(&Arm) -> bool,
) -> Option<ClauseTruth> {
    let device = graph.cell.devices.get(item.device?)?;
    Some(match applies(device.model.arm.as_ref()?) {
        true => ClauseTruth::Always,
        false => ClauseTruth::Never,
    })
}

/// A closed interval: least and greatest value.
type Range = [f64; 2];

const ANY: Range = [f64::NEG_INFINITY, f64::INFINITY];

/// Returns the truth of a comparison between ports and numbers; `None` if the clause is not a comparison.
fn comparison(
    graph: &NetGraph<'_>,
    item: &ResolvedPrimitive<'_>,
    clause: &str,
) -> Option<ClauseTruth> {
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
    let (can_be, is_always) = match operator {
        "=" => (
            least <= high && low <= greatest,
            least == greatest && greatest == low && low == high,
        ),
        "<" => (least < high, greatest < low),
        "<=" => (least <= high, greatest <= low),
        ">" => (greatest > low, least > high),
        ">=" => (greatest >= low, least >= high),
        _ => return None,
    };
    Some(match (can_be, is_always) {
        (_, true) => ClauseTruth::Always,
        (true, false) => ClauseTruth::Sometimes,
        (false, false) => ClauseTruth::Never,
    })
}

/// Returns the range of an input or of a numeric parameter.
fn range(graph: &NetGraph<'_>, item: &ResolvedPrimitive<'_>, name: &str) -> Option<Range> {
    let spec = item.spec();
    if let Some((place, _)) = spec.input(name) {
        return Some(
            item.inputs
                .get(place)
                .map_or(ANY, |input_source| of_feed(graph, input_source)),
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

fn of_feed(graph: &NetGraph<'_>, input_source: &InputSource<'_>) -> Range {
    let constant = |number: Option<f64>| number.map_or(ANY, |number| [number, number]);
    match input_source {
        InputSource::Literal(literal) => constant(literal.number()),
        InputSource::Default(value) => constant(number(*value)),
        InputSource::Link(link) => {
            let [least, greatest] = of_output(graph, link.from);
            match link
                .initial
                .filter(|_| link.delayed)
                .map(|initial| initial.number())
            {
                Some(Some(first)) => [least.min(first), greatest.max(first)],
                _ => [least, greatest],
            }
        }
        _ => ANY,
    }
}

fn of_output(graph: &NetGraph<'_>, output: OutputId) -> Range {
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
        // Exact enough for a comparison with a bound of a spec.
        Default::Int(value) => Some(value as f64),
        _ => None,
    }
}
