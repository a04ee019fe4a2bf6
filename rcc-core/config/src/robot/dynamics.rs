//! Masses and friction of an arm, for the torques that simulators report: `dynamics:` of a robot's file. Read at start-up
//! by programs that read the cell's file.

use rcc_core::unit::Unit;

use super::JointConfig;
use crate::base::three;
use crate::codes;
use crate::diagnostic::Span;
use crate::reader::{ConfigReader, QuantityRange, error};
use crate::yaml::{Entry, Node};

pub(super) const KEYS: [&str; 4] = ["mass", "centre", "friction", "damping"];

/// Mass and friction of a link, the body that moves with one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkDynamics {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass while all joints are 0, base frame, m.
    pub centre_m: [f64; 3],
    /// Dry friction of the joint, N·m.
    pub friction_nm: f64,
    /// Viscous friction of the joint, N·m·s/rad.
    pub damping_nm_s_rad: f64,
}

/// Reads a link for each joint, under the joint's name.
pub(super) fn read(
    reader: &mut ConfigReader,
    node: &Node,
    place: Span,
    joints: &[JointConfig],
) -> Option<Vec<LinkDynamics>> {
    let entries = reader.entries(node, "the dynamics")?;
    let names = || joints.iter().map(|joint| joint.name.as_str());
    for Entry { key, .. } in entries {
        if !names().any(|name| name == key.name) {
            let message = format!("the dynamics have no joint `{}`", key.name);
            let help = format!("its joints are: {}", names().collect::<Vec<_>>().join(", "));
            reader.report(error(codes::UNKNOWN_KEY, key.span, message).help(help));
        }
    }
    let links: Vec<_> = names()
        .map(|name| {
            let found = entries.iter().find(|entry| entry.key.name == name);
            let Some(Entry { key, value }) = found else {
                let message = format!("the dynamics need a key `{name}`");
                let help = format!(
                    "add `{name}: {{mass: …, centre: […], friction: …, damping: …}}`; see configs/robots/lwr4plus.yaml"
                );
                reader.report(error(codes::MISSING_KEY, place, message).help(help));
                return None;
            };
            link(reader, value, key.span)
        })
        .collect();
    links.into_iter().collect()
}

fn link(reader: &mut ConfigReader, node: &Node, place: Span) -> Option<LinkDynamics> {
    let fields = reader.fields(node, place, "a link", &KEYS)?;
    let mut at_least_0 = |key, unit| {
        let wanted = QuantityRange {
            unit,
            least: 0.0,
            most: f64::MAX,
        };
        let node = reader.require(&fields, key)?;
        reader.quantity(node, key, wanted)
    };
    let mass = at_least_0("mass", Unit::KILOGRAM);
    let friction = at_least_0("friction", Unit::NEWTON_METRE);
    let viscous = Unit::NEWTON_METRE.per(Unit::RADIAN_PER_SECOND);
    let damping = at_least_0("damping", viscous);
    let centre = reader.require(&fields, "centre");
    let centre = centre.and_then(|node| three(reader, node, "centre", Unit::METRE));
    Some(LinkDynamics {
        mass_kg: mass?,
        centre_m: centre?,
        friction_nm: friction?,
        damping_nm_s_rad: damping?,
    })
}
