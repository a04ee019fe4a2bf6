//! `convert --smooth`: joint set-points pass a low-pass filter, so that steps in their acceleration, which the predecessor's
//! profiles have, keep the arm's limits of jerk. A pure function of the net.

use std::collections::HashSet;
use std::f64::consts::TAU;

use rcc_api::codes;
use rcc_config::diagnostic::Span;
use rcc_config::yaml::Key;
use rcc_core::unit::Unit;
use rcc_language::syntax::literal::{Literal, LiteralShape};
use rcc_language::syntax::reference::Reference;
use rcc_language::syntax::{Link, Net, Primitive, PrimitiveKind, Source};

use crate::failure::Failure;

/// Cutoff without a value, Hz: low enough for the point-to-point motions of the predecessor's library with the robot
/// files of RCC.
pub(super) const CUTOFF_HZ: &str = "2 Hz";
/// The net ends this many time constants of the filter later: the rest of a step is 5e-5 of it then.
const SETTLING: f64 = 4.0 * std::f64::consts::PI;
/// Synthesised parts have no place in the text.
const NOWHERE: Span = Span::new(0, 0);

/// Parses `2 Hz`, `2Hz` or `2`.
///
/// # Errors
/// Returns a message for any other text.
pub(super) fn cutoff(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches("Hz").trim_end();
    let cutoff = number.parse().ok().filter(|hz| (0.1..=100.0).contains(hz));
    cutoff
        .ok_or_else(|| format!("invalid cutoff `{text}`: write a frequency from 0.1 Hz to 100 Hz"))
}

/// Filters and delays that were inserted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Smoothed {
    /// Number of filters.
    pub filters: usize,
    /// Time by which the net ends later, s.
    pub settling_s: f64,
}

/// Inserts a filter before each joint of each `JointPositionCommand`, and a delay before each condition of `Termination`.
///
/// # Errors
/// Fails if no joint is commanded by a link, or if the joints are one array.
pub(super) fn smooth(net: &mut Net, cutoff_hz: f64) -> Result<Smoothed, Failure> {
    let mut ids = Ids(net
        .primitives
        .iter()
        .map(|one| one.id.name.to_string())
        .collect());
    let settling_s = SETTLING / (TAU * cutoff_hz);
    let settling_s = (settling_s * 1e3).ceil() / 1e3;
    let (mut filters, mut primitives) = (0, Vec::new());
    for mut primitive in std::mem::take(&mut net.primitives) {
        let id = primitive.id.name.to_string();
        match primitive.type_name.name.as_str() {
            "JointPositionCommand" => {
                for (_, source) in &mut primitive.inputs {
                    let Source::List(joints) = source else {
                        return Err(whole_array(&id));
                    };
                    for (joint, element) in joints.elements.iter_mut().enumerate() {
                        let Source::Link(_) = element else { continue };
                        let filter = ids.unique(&format!("{id}_smooth{}", joint + 1));
                        let input = std::mem::replace(element, link(&filter));
                        primitives.push(low_pass(&filter, input, cutoff_hz));
                        filters += 1;
                    }
                }
            }
            "Termination" => {
                for (_, source) in &mut primitive.inputs {
                    for (name, condition) in conditions(source) {
                        let delay = ids.unique(&format!("{id}_settled{name}"));
                        let input = std::mem::replace(condition, link(&delay));
                        primitives.push(on_delay(&delay, input, settling_s));
                    }
                }
            }
            _ => {}
        }
        primitives.push(primitive);
    }
    net.primitives = primitives;
    match filters {
        0 => Err(Failure::new(
            codes::BAD_REQUEST,
            "--smooth: the net commands no joint of an arm by a link",
            "omit --smooth",
        )),
        filters => Ok(Smoothed {
            filters,
            settling_s,
        }),
    }
}

/// Returns the conditions of `Termination` that are links, each with a suffix for its id.
fn conditions(source: &mut Source) -> Vec<(String, &mut Source)> {
    match source {
        Source::Link(_) => vec![(String::new(), source)],
        Source::Outcomes(outcomes) => {
            let rows = outcomes.rows.iter_mut();
            let links = rows.filter(|(_, source)| matches!(source, Source::Link(_)));
            links
                .map(|(name, source)| (format!("_{}", name.name), source))
                .collect()
        }
        _ => Vec::new(),
    }
}

fn whole_array(id: &str) -> Failure {
    Failure::new(
        codes::BAD_REQUEST,
        format!("--smooth: the joints of `{id}` are one array, not a list of seven or six links"),
        "smooth the motion itself: `JointMotion` and `LinearMotion` are limited in jerk",
    )
}

/// The ids of a net.
struct Ids(HashSet<String>);

impl Ids {
    /// Returns a new id that begins like this.
    fn unique(&mut self, wanted: &str) -> String {
        let numbered = (2..).map(|number| format!("{wanted}_{number}"));
        let mut candidates = std::iter::once(wanted.to_owned()).chain(numbered);
        let free = candidates.find(|id| !self.0.contains(id));
        // The candidates never end.
        let free = free.unwrap_or_default();
        self.0.insert(free.clone());
        free
    }
}

fn key(name: &str) -> Key {
    Key {
        name: name.into(),
        span: NOWHERE,
    }
}

fn link(primitive: &str) -> Source {
    Source::Link(Link {
        from: Reference {
            primitive: primitive.into(),
            port: "out".into(),
            part: None,
            span: NOWHERE,
            primitive_span: NOWHERE,
            port_span: NOWHERE,
        },
        delayed: false,
        initial: None,
        span: NOWHERE,
    })
}

fn real(value: f64, unit: Option<Unit>) -> Literal {
    Literal::new(LiteralShape::Real(value, unit), NOWHERE)
}

fn primitive(id: &str, type_name: &str, input: Source) -> Primitive {
    Primitive {
        id: key(id),
        kind: PrimitiveKind::Type,
        type_name: key(type_name),
        parameters: Vec::new(),
        inputs: vec![(key("in"), input)],
        active: None,
    }
}

fn low_pass(id: &str, input: Source, cutoff_hz: f64) -> Primitive {
    let mut filter = primitive(id, "SecondOrderLowPass", input);
    filter.parameters = vec![
        (key("cutoff"), real(cutoff_hz, Some(Unit::HERTZ))),
        (key("damping"), real(1.0, None)),
    ];
    filter
}

fn on_delay(id: &str, input: Source, time_s: f64) -> Primitive {
    let mut delay = primitive(id, "OnDelay", input);
    let time = Source::Literal(real(time_s, Some(Unit::SECOND)));
    delay.inputs.push((key("time"), time));
    delay
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cutoff_is_a_frequency() {
        for (text, hz) in [("2 Hz", 2.0), ("0.5Hz", 0.5), ("3", 3.0)] {
            assert_eq!(cutoff(text), Ok(hz));
        }
        for text in ["", "Hz", "0 Hz", "-1", "1 kHz", "NaN"] {
            assert!(cutoff(text).is_err(), "{text}");
        }
    }

    #[test]
    fn new_ids_differ_from_those_that_are_there() {
        let mut ids = Ids(HashSet::from(["a".to_owned(), "a_2".to_owned()]));
        assert_eq!(ids.unique("a"), "a_3");
        assert_eq!(ids.unique("b"), "b");
        assert_eq!(ids.unique("b"), "b_2");
    }
}
