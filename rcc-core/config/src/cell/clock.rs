//! Reads `clock: {device: lwr, offset: 200 us}`: the device that the executor's clock follows. Run at start-up by
//! programs that read the cell's file.

use super::ClockConfig;
use crate::codes;
use crate::reader::{ConfigReader, Fields, error};
use crate::yaml::{Node, Value};

const KEYS: [&str; 2] = ["device", "offset"];
/// Default time for a packet to pass through the driver to the executor.
const OFFSET_NS: u64 = 200_000;

/// Reads the clock of a cell; `Some(None)`: the executor has its own.
pub(super) fn read(
    reader: &mut ConfigReader,
    cell: &Fields<'_>,
    period_ns: u64,
) -> Option<Option<ClockConfig>> {
    let Some(entry) = cell.entry("clock") else {
        return Some(None);
    };
    let fields = reader.fields(&entry.value, entry.key.span, "the clock", &KEYS)?;
    let node = reader.require(&fields, "device");
    let device = node.and_then(|node| device(reader, cell, node));
    let offset_ns = match fields.get("offset") {
        Some(node) => reader.nanoseconds(node, "offset (at most half a period)", 0, period_ns / 2),
        None => Some(OFFSET_NS.min(period_ns / 2)),
    };
    Some(Some(ClockConfig {
        device: device?,
        offset_ns: offset_ns?,
    }))
}

/// Returns the index of the device. It must not have a delay, because its set-points never wait.
fn device(reader: &mut ConfigReader, cell: &Fields<'_>, node: &Node) -> Option<usize> {
    let name = reader.text(node, "the device of the clock")?;
    let devices = match cell.get("devices").map(|node| &node.value) {
        Some(Value::Map(devices)) => devices.as_slice(),
        _ => &[],
    };
    let Some(index) = devices.iter().position(|device| device.key.name == name) else {
        let names: Vec<&str> = devices.iter().map(|device| &*device.key.name).collect();
        let message = format!("this cell has no device `{name}`");
        let fault = error(codes::UNKNOWN_DEVICE, node.span, message);
        reader.report(fault.help(format!("the devices are: {}", names.join(", "))));
        return None;
    };
    if let Some(delay) = devices
        .get(index)
        .and_then(|device| device.value.get("delay"))
    {
        let message =
            format!("`delay` has no meaning for `{name}`: the executor's clock follows it");
        let fault = error(codes::KEY_OF_OTHER_KIND, delay.span, message);
        reader.report(fault.help(
            "remove `delay`, because every set-point is played in its own cycle, or remove `clock`",
        ));
        return None;
    }
    Some(index)
}
