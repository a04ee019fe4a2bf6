//! Poses in files: `{xyz: [0 m, 0.9 m, 0 m], rpy: [0 deg, 0 deg, 180 deg]}`, for example that of an arm's base in the world
//! frame of the cell. Read at start-up with the cell's file.

use rcc_core::pose::Pose;
use rcc_core::unit::Unit;

use crate::reader::{ConfigReader, Fields, QuantityRange};
use crate::yaml::{Entry, Node};

const KEYS: [&str; 2] = ["xyz", "rpy"];

/// Reads the key `base` of a device. Without it the base is the world frame; without `rpy` it is not rotated.
pub(crate) fn read(reader: &mut ConfigReader, device: &Fields<'_>) -> Option<Pose> {
    match device.entry("base") {
        Some(entry) => pose(reader, entry, "the base"),
        None => Some(Pose::IDENTITY),
    }
}

/// Reads a pose. Without `rpy` it is not rotated.
pub(crate) fn pose(reader: &mut ConfigReader, entry: &Entry, what: &'static str) -> Option<Pose> {
    let Entry { key, value } = entry;
    let fields = reader.fields(value, key.span, what, &KEYS)?;
    let xyz = reader.require(&fields, "xyz");
    let xyz = xyz.and_then(|node| three(reader, node, "xyz", Unit::METRE));
    let rpy = match fields.get("rpy") {
        Some(node) => three(reader, node, "rpy", Unit::RADIAN),
        None => Some([0.0; 3]),
    };
    Some(Pose::from_xyz_rpy(xyz?, rpy?))
}

/// Reads three numbers of one unit.
pub(crate) fn three(
    reader: &mut ConfigReader,
    node: &Node,
    what: &str,
    unit: Unit,
) -> Option<[f64; 3]> {
    let [x, y, z] = reader.array(node, what)?;
    let mut read = |node| reader.quantity(node, what, QuantityRange::any(unit));
    let (x, y, z) = (read(x), read(y), read(z));
    Some([x?, y?, z?])
}
