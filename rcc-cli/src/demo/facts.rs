//! Parameters of a demo net: goal and limits of its motion, and switching positions of the torch. Read from the text
//! that is loaded, so that the checks use the loaded values.

use rcc_api::codes;
use rcc_config::quantity;
use rcc_config::yaml::{self, Node};
use rcc_core::path::PathLimits;

use crate::failure::Failure;

/// Parameters of one net.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionFacts {
    /// Goal of the motion, base frame, m.
    pub goal: [f64; 3],
    /// Limits of the motion; the length is unknown before it starts (0).
    pub limits: PathLimits,
    /// Distance from which the torch burns, m.
    pub torch_on: Option<f64>,
    /// Distance from which the torch is off again, m.
    pub torch_off: Option<f64>,
}

/// Id of the motion in the demo's nets.
const MOTION: &str = "move";
/// Output of the motion that switches the torch.
const DISTANCE: &str = "move.distance";

/// Reads the parameters of a net.
///
/// # Errors
/// Fails if the text is not one of the demo's nets.
pub fn read(name: &str, text: &str) -> Result<MotionFacts, Failure> {
    let strange = |what: &str| {
        Failure::new(
            codes::BAD_REQUEST,
            format!("{name}: the demo needs {what} in the primitive `{MOTION}`"),
            "use the nets that come with RCC (RCC_CONFIGS)",
        )
    };
    let root = yaml::parse(text).map_err(|_| strange("a readable text"))?;
    let primitives = root
        .get("primitives")
        .ok_or_else(|| strange("the parameters"))?;
    let parameters = primitives
        .get(MOTION)
        .and_then(|motion| motion.get("parameters"))
        .ok_or_else(|| strange("the parameters"))?;
    let real = |key: &str| number(parameters.get(key)).ok_or_else(|| strange(key));
    let xyz = parameters.get("to").and_then(|to| to.get("xyz"));
    let goal: Option<Vec<f64>> = xyz
        .and_then(Node::list)
        .and_then(|list| list.iter().map(|node| number(Some(node))).collect());
    let goal = goal
        .and_then(|goal| <[f64; 3]>::try_from(goal).ok())
        .ok_or_else(|| strange("to"))?;
    Ok(MotionFacts {
        goal,
        limits: PathLimits {
            length: 0.0,
            velocity: real("velocity")?,
            acceleration: real("acceleration")?,
            jerk: real("jerk")?,
        },
        torch_on: compared(primitives, "Greater"),
        torch_off: compared(primitives, "Less"),
    })
}

/// Returns the literal that a primitive of type `ty` compares the distance with.
fn compared(primitives: &Node, ty: &str) -> Option<f64> {
    let entries = primitives.map()?.iter().map(|entry| &entry.value);
    let mut compared = entries.filter_map(|primitive| {
        let inputs = primitive.get("inputs")?;
        let here = primitive.get("type")?.text()? == ty && inputs.get("a")?.text()? == DISTANCE;
        number(inputs.get("b").filter(|_| here))
    });
    compared.next()
}

fn number(node: Option<&Node>) -> Option<f64> {
    Some(quantity::of(node?).ok()?.value)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "net: x
primitives:
  move:
    type: LinearMotion
    parameters: {device: lwr, to: {xyz: [0.5, 100 mm, 0.4], rpy: [0, 0, 0]}, velocity: 0.1 m/s, acceleration: 1, jerk: 5}
  begun:  {type: Greater, inputs: {a: move.distance, b: 50 mm}}
  touch:  {type: Greater, inputs: {a: ft.fz, b: 12 N}}
";

    #[test]
    fn facts_are_in_si_units() {
        let facts = read("x", TEXT);
        assert_eq!(
            facts,
            Ok(MotionFacts {
                goal: [0.5, 0.1, 0.4],
                limits: PathLimits {
                    length: 0.0,
                    velocity: 0.1,
                    acceleration: 1.0,
                    jerk: 5.0
                },
                torch_on: Some(0.05),
                torch_off: None,
            })
        );
    }

    #[test]
    fn a_net_without_the_motion_is_refused() {
        assert!(read("x", "net: x\nprimitives: {}\n").is_err());
    }
}
