//! Reads a device and its channels. Run at start-up by programs that read the cell's file.

use rcc_core::message::{ANALOG_MAX, DIGITAL_MAX};
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;

use super::{CHANNEL_KINDS, ChannelConfig, OnRelease, is_digital, is_output, kind_name};
use crate::article::with_article;
use crate::codes;
use crate::diagnostic::Span;
use crate::reader::{ConfigReader, Fields, ID, QuantityRange, display_value, error};
use crate::yaml::{Entry, Node, Value};

pub(crate) const KEYS: [&str; 7] = [
    "kind",
    "address",
    "unit",
    "scale",
    "offset",
    "range",
    "on_release",
];

/// Reads the channels of a device.
pub(crate) fn channels(reader: &mut ConfigReader, node: &Node) -> Option<Vec<ChannelConfig>> {
    let entries = reader.entries(node, "channels")?;
    let mut places: [Vec<Span>; 4] = Default::default();
    let mut outputs: Vec<(ChannelKind, &Node, &str)> = Vec::new();
    let mut channels = Vec::new();
    for entry in entries {
        let Some(mut channel) = channel(reader, entry) else {
            continue;
        };
        let kind = CHANNEL_KINDS.iter().position(|kind| *kind == channel.kind);
        if let Some(places) = kind.and_then(|kind| places.get_mut(kind)) {
            // A device with more than 2^32 channels does not fit into a text of 4 MiB.
            channel.index = places.len() as u32;
            places.push(entry.key.span);
        }
        let address = entry.value.get("address");
        if let Some(address) = address.filter(|_| is_output(channel.kind)) {
            refuse_taken_address(reader, &outputs, channel.kind, address);
            outputs.push((channel.kind, address, &entry.key.name));
        }
        channels.push(channel);
    }
    for (kind, places) in CHANNEL_KINDS.into_iter().zip(&places) {
        let most = if is_digital(kind) {
            DIGITAL_MAX
        } else {
            ANALOG_MAX
        };
        reader.at_most(most, &format!("{}s of one device", kind_name(kind)), places);
    }
    Some(channels)
}

/// Refuses an address that another output already has: both would overwrite each other.
fn refuse_taken_address(
    reader: &mut ConfigReader,
    outputs: &[(ChannelKind, &Node, &str)],
    kind: ChannelKind,
    address: &Node,
) {
    let same = |(other, node, _): &&(ChannelKind, &Node, &str)| {
        *other == kind && node.value == address.value
    };
    if let Some((_, _, other)) = outputs.iter().find(same) {
        let message = format!("the output `{other}` already has this address");
        let fault = error(codes::ADDRESS_TAKEN, address.span, message);
        reader.report(
            fault.help("two outputs at one address would overwrite each other; keep only one"),
        );
    }
}

fn channel(reader: &mut ConfigReader, Entry { key, value }: &Entry) -> Option<ChannelConfig> {
    let name = reader.key_name(key, "a channel", ID);
    let fields = reader.fields(value, key.span, "a channel", &KEYS)?;
    let kinds = CHANNEL_KINDS.map(|kind| (kind_name(kind), kind));
    let kind = reader
        .require(&fields, "kind")
        .and_then(|node| reader.keyword(node, "kind of channel", &kinds));
    let address = reader
        .require(&fields, "address")
        .and_then(|node| address(reader, node));
    let kind = kind?;
    refuse_keys_of_other_kinds(reader, &fields, kind);
    let form = if is_digital(kind) {
        Some(DIGITAL)
    } else {
        analog(reader, &fields)
    };
    // Without a valid conversion the safe value cannot be checked, but a missing `on_release` can.
    let on_release = match (is_output(kind), fields.get("on_release"), form) {
        (true, Some(node), Some(form)) => on_release(reader, node, &form).map(Some),
        (true, Some(_), None) => None,
        (true, None, _) => {
            no_on_release(reader, &fields, &key.name);
            None
        }
        (false, ..) => Some(None),
    };
    let form = form?;
    Some(ChannelConfig {
        name: name?,
        kind,
        index: 0,
        address: address?,
        unit: form.unit,
        scale: form.scale,
        offset: form.offset,
        range: form.range,
        on_release: on_release?,
    })
}

fn address(reader: &mut ConfigReader, node: &Node) -> Option<serde_json::Value> {
    match &node.value {
        Value::Int(_) => Some(node.to_json()),
        Value::Text(text) if !text.trim().is_empty() => Some(node.to_json()),
        _ => {
            reader.wrong_type(
                node,
                "an address",
                "a whole number or text such as `coil 3`",
            );
            None
        }
    }
}

fn refuse_keys_of_other_kinds(reader: &mut ConfigReader, fields: &Fields<'_>, kind: ChannelKind) {
    let mut refuse = |key: &str, reason: &str| {
        if let Some(entry) = fields.entry(key) {
            let message = format!(
                "`{key}` has no meaning for {}",
                with_article(kind_name(kind))
            );
            let fault = error(codes::KEY_OF_OTHER_KIND, entry.key.span, message);
            reader.report(fault.help(format!("remove it: {reason}")));
        }
    };
    if is_digital(kind) {
        for key in ["unit", "scale", "offset", "range"] {
            refuse(key, "a digital channel is true or false");
        }
    }
    if !is_output(kind) {
        refuse("on_release", "an input is never commanded");
    }
}

/// Reads a unit without a factor, because a multiple would be ambiguous.
fn unit(reader: &mut ConfigReader, node: &Node) -> Option<Unit> {
    if node.value == Value::Int(1) {
        return Some(Unit::ONE);
    }
    let text = reader.text(node, "a unit")?;
    match Unit::parse(text) {
        Some((unit, 1.0)) => Some(unit),
        Some((unit, _)) => {
            let message =
                format!("the unit of a channel is an SI unit, `{text}` is a multiple of {unit}");
            let help = format!(
                "write `unit: {unit}` and, if one raw step is one {text}, `scale: 1 {text}`"
            );
            reader.report(error(codes::WRONG_UNIT, node.span, message).help(help));
            None
        }
        None => {
            let message = format!("unknown unit `{text}`");
            let fault = error(codes::NOT_A_QUANTITY, node.span, message);
            reader.report(
                fault.help(
                    "units are written like `m/s`, `N`, `rad/s^2`, `V`; 1 for a plain number",
                ),
            );
            None
        }
    }
}

/// Range of a channel's value and its conversion from the raw value.
#[derive(Clone, Copy)]
struct SignalForm {
    digital: bool,
    unit: Unit,
    scale: f64,
    offset: f64,
    range: Option<[f64; 2]>,
}

const DIGITAL: SignalForm = SignalForm {
    digital: true,
    unit: Unit::ONE,
    scale: 1.0,
    offset: 0.0,
    range: None,
};

fn analog(reader: &mut ConfigReader, fields: &Fields<'_>) -> Option<SignalForm> {
    let unit = match fields.get("unit") {
        Some(node) => unit(reader, node)?,
        None => Unit::ONE,
    };
    let range = match fields.get("range") {
        Some(node) => reader.bounds(node, "range", unit).map(Some),
        None => Some(None),
    };
    let (scale, offset) = scale_and_offset(reader, fields, unit)?;
    Some(SignalForm {
        digital: false,
        unit,
        scale,
        offset,
        range: range?,
    })
}

fn scale_and_offset(
    reader: &mut ConfigReader,
    fields: &Fields<'_>,
    unit: Unit,
) -> Option<(f64, f64)> {
    let mut number = |key, default| match fields.get(key) {
        Some(node) => Some((
            reader.quantity(node, key, QuantityRange::any(unit))?,
            node.span,
        )),
        None => Some((default, fields.place)),
    };
    let (scale, offset) = (number("scale", 1.0), number("offset", 0.0));
    let ((scale, span), (offset, _)) = (scale?, offset?);
    if scale == 0.0 {
        let message = "scale is 0: every raw value would mean the same";
        reader.report(error(codes::OUT_OF_RANGE, span, message));
        return None;
    }
    Some((scale, offset))
}

fn no_on_release(reader: &mut ConfigReader, fields: &Fields<'_>, name: &str) {
    let message =
        format!("the output `{name}` does not define what it does when it is no longer commanded");
    let fault = error(codes::NO_ON_RELEASE, fields.place, message).label("`on_release` is missing");
    reader.report(fault.help(
        "add `on_release: {safe: VALUE}` or `on_release: hold`. It takes effect when a net ends, sends null or dies. \
         There is no default because both can do harm: a torch must not burn on, a gripper must not let go",
    ));
}

fn on_release(reader: &mut ConfigReader, node: &Node, form: &SignalForm) -> Option<OnRelease> {
    const FORMS: &str = "`hold` or `{safe: VALUE}`";
    match node.text() {
        Some("hold") => return Some(OnRelease::Hold),
        Some(text) => {
            let message = format!("`{text}` is not a valid action on release");
            let fault = error(codes::UNKNOWN_KIND, node.span, message);
            reader.report(fault.help(format!("write {FORMS}")));
            return None;
        }
        None if node.map().is_none() => {
            reader.wrong_type(node, "on_release", FORMS);
            return None;
        }
        None => {}
    }
    let fields = reader.fields(node, node.span, "on_release", &["safe"])?;
    let safe = reader.require(&fields, "safe")?;
    if form.digital {
        return reader
            .bool(safe, "the safe value of a digital output")
            .map(|value| OnRelease::Safe(f64::from(u8::from(value))));
    }
    let value = reader.quantity(safe, "the safe value", QuantityRange::any(form.unit))?;
    if let Some([lower, upper]) = form.range
        && !(lower..=upper).contains(&value)
    {
        let [value, lower, upper] =
            [value, lower, upper].map(|value| display_value(value, form.unit));
        let message =
            format!("the safe value {value} is outside of the channel's range, {lower} to {upper}");
        let fault = error(codes::UNSAFE_VALUE, safe.span, message);
        reader.report(fault.help(
            "values outside of the range are refused, including the safe value: choose one inside",
        ));
        return None;
    }
    Some(OnRelease::Safe(value))
}
