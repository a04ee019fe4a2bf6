//! Workspace of an arm: `workspace: {box: {x: [0.2 m, 0.8 m], z: [50 mm, 1 m]}, point: [0 m, 0 m, 0.15 m], singularity:
//! 0.05}`. Read at start-up with the cell's file.

use rcc_core::unit::Unit;
use rcc_core::workspace::Workspace;

use crate::codes;
use crate::reader::{ConfigReader, Fields, QuantityRange, error};
use crate::yaml::Entry;

const KEYS: [&str; 3] = ["box", "point", "singularity"];
const AXES: [&str; 3] = ["x", "y", "z"];

/// Reads the key `workspace` of a device. An omitted axis is unbounded; without `point` the flange must stay inside;
/// without a box only the distance to singular positions is bounded.
pub(crate) fn read(reader: &mut ConfigReader, device: &Fields<'_>) -> Option<Option<Workspace>> {
    let Some(Entry { key, value }) = device.entry("workspace") else {
        return Some(None);
    };
    let fields = reader.fields(value, key.span, "the workspace", &KEYS)?;
    let mut space = Workspace::ANYWHERE;
    let mut valid = true;
    if let Some(node) = fields.get("point") {
        let point = point(reader, node);
        valid = point.is_some();
        space.point = point.unwrap_or_default();
    }
    if let Some(node) = fields.get("singularity") {
        let wanted = QuantityRange {
            most: 1.0,
            ..QuantityRange::positive(Unit::ONE)
        };
        space.singularity_min = reader.quantity(node, "singularity", wanted)?;
        if fields.get("box").is_none() {
            return valid.then_some(Some(space));
        }
    }
    let node = reader.require(&fields, "box")?;
    let place = fields.place_of("box");
    let axes = reader.fields(node, place, "the box", &AXES)?;
    let bounds = space.lower.iter_mut().zip(&mut space.upper);
    let mut bounded = false;
    for (axis, (lower, upper)) in AXES.into_iter().zip(bounds) {
        let Some(node) = axes.get(axis) else { continue };
        bounded = true;
        let read = reader.bounds(node, axis, Unit::METRE);
        valid &= read.is_some();
        [*lower, *upper] = read.unwrap_or_default();
    }
    if !bounded {
        let fault = error(codes::MISSING_KEY, place, "a box without bounds");
        reader.report(fault.help("give the bounds of at least one axis: `box: {z: [50 mm, 1 m]}`"));
        return None;
    }
    valid.then_some(Some(space))
}

fn point(reader: &mut ConfigReader, node: &crate::yaml::Node) -> Option<[f64; 3]> {
    let [x, y, z] = reader.array(node, "point")?;
    let mut read = |node| reader.quantity(node, "point", QuantityRange::any(Unit::METRE));
    let (x, y, z) = (read(x), read(y), read(z));
    Some([x?, y?, z?])
}
