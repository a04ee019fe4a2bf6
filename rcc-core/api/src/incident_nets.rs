//! Names the nets, ports and slots of an incident, from the command files stored in it. Pure; used by programs that replay.

use crate::command_file::CommandFile;
use rcc_core::types::{NULL_BOOL, NULL_INT, Store};
use rcc_engine::net::Net;
use rcc_engine::replay::SlotDifference;
use rcc_language::names::{Names, PortNames};
use rcc_protocol::pattern::Pattern;
use serde_json::{Number, Value};

/// A net of an incident and the names of its ports.
#[derive(Clone, Debug, Default)]
pub struct IncidentNet {
    /// Id of the command.
    pub id: u64,
    /// Name of the net; empty if unknown.
    pub net: String,
    /// Slots of its ports.
    pub names: Names,
}

/// Consecutive slots of an arena that are shown under one name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShownSlots {
    /// Full name: `line/move.pose`, `line/ik.joints[2]`.
    pub name: String,
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of slots.
    pub width: u32,
}

impl IncidentNet {
    /// Reads the names from a net's command file, if it exists and is readable.
    #[must_use]
    pub fn of(id: u64, command: Option<&[u8]>) -> IncidentNet {
        let file = command.and_then(|bytes| serde_json::from_slice::<CommandFile>(bytes).ok());
        let file = file.unwrap_or_default();
        IncidentNet {
            id,
            net: file.net,
            names: file.names.unwrap_or_default(),
        }
    }

    /// Formats the net as `line#3`, or `#3` if its name is unknown.
    #[must_use]
    pub fn title(&self) -> String {
        format!("{}#{}", self.net, self.id)
    }

    /// Returns the part of a full name before the slash.
    fn prefix(&self) -> String {
        match self.net.as_str() {
            "" => format!("#{}", self.id),
            name => name.to_owned(),
        }
    }

    /// Returns the outputs that match a pattern, by their port or by the monitor that watches them.
    #[must_use]
    pub fn shown(&self, patterns: &[Pattern]) -> Vec<ShownSlots> {
        let net = self.prefix();
        let ports = self.names.primitives.iter().flat_map(|primitive| {
            let outputs = primitive.outputs.iter();
            outputs.map(|port| {
                let name = format!("{net}/{}.{}", primitive.id, port.name);
                (name.clone(), name, port.store, port.slot, port.width)
            })
        });
        let monitors = self.names.monitors.iter().map(|monitor| {
            let name = format!("{net}/{}", monitor.primitive);
            let shown = format!("{net}/{}", monitor.source);
            (name, shown, monitor.store, monitor.slot, monitor.width)
        });
        let mut all = Vec::new();
        for (name, shown, store, slot, width) in ports.chain(monitors) {
            let Some(pattern) = patterns.iter().find(|pattern| pattern.matches(&name)) else {
                continue;
            };
            let one = match pattern
                .element
                .and_then(|element| u32::try_from(element).ok())
            {
                None => ShownSlots {
                    name: shown,
                    store,
                    slot,
                    width,
                },
                Some(element) if element < width => ShownSlots {
                    name: format!("{shown}[{element}]"),
                    store,
                    slot: slot + element,
                    width: 1,
                },
                Some(_) => continue,
            };
            if !all.contains(&one) {
                all.push(one);
            }
        }
        all
    }

    /// Returns the name of a slot that differs.
    #[must_use]
    pub fn slot(&self, difference: &SlotDifference) -> String {
        let net = self.prefix();
        let at = |port: &&PortNames| {
            let from = port.slot;
            port.store == difference.store && (from..from + port.width).contains(&difference.slot)
        };
        let element = |port: &PortNames| match port.width {
            1 => String::new(),
            _ => format!("[{}]", difference.slot - port.slot),
        };
        for primitive in &self.names.primitives {
            if let Some(port) = primitive.outputs.iter().find(at) {
                return format!("{net}/{}.{}{}", primitive.id, port.name, element(port));
            }
        }
        for primitive in &self.names.primitives {
            if let Some(port) = primitive.inputs.iter().find(at) {
                let name = format!("{net}/{}.{}{}", primitive.id, port.name, element(port));
                return format!("{name} (input)");
            }
        }
        let slot = format!("{:?} slot {}", difference.store, difference.slot);
        match difference.writer {
            Some(writer) => format!("{net}: state of {writer} ({slot})"),
            None => format!("{net}: {slot}"),
        }
    }
}

impl ShownSlots {
    /// Names of its elements.
    #[must_use]
    pub fn columns(&self) -> Vec<String> {
        match self.width {
            1 => vec![self.name.clone()],
            width => (0..width).map(|i| format!("{}[{i}]", self.name)).collect(),
        }
    }

    /// Returns the current values of its elements; null is `null`.
    #[must_use]
    pub fn values(&self, net: &Net) -> Vec<Value> {
        let (reals, bools, ints) = net.arenas();
        let range = self.slot as usize..(self.slot + self.width) as usize;
        let all = match self.store {
            Store::Real => reals
                .get(range)
                .map(|all| all.iter().map(|x| real(*x)).collect()),
            Store::Bool => bools
                .get(range)
                .map(|all| all.iter().map(|x| bool(*x)).collect()),
            Store::Int => ints
                .get(range)
                .map(|all| all.iter().map(|x| int(*x)).collect()),
        };
        all.unwrap_or_else(|| vec![Value::Null; self.width as usize])
    }
}

fn real(value: f64) -> Value {
    match Number::from_f64(value) {
        Some(number) => Value::Number(number),
        // JSON cannot represent infinite numbers, and they are not null either.
        None if value.is_infinite() => Value::String(value.to_string()),
        None => Value::Null,
    }
}

fn bool(value: u8) -> Value {
    match value {
        value if value & NULL_BOOL != 0 => Value::Null,
        value => Value::Bool(value != 0),
    }
}

fn int(value: i64) -> Value {
    match value {
        NULL_INT => Value::Null,
        value => Value::from(value),
    }
}

/// Converts the bits of a slot to a value, by the type of its store.
#[must_use]
pub fn value_of(store: Store, bits: u64) -> Value {
    match store {
        Store::Real => real(f64::from_bits(bits)),
        Store::Bool => bool(bits as u8),
        Store::Int => int(bits.cast_signed()),
    }
}

/// Formats a value for people and tables; null becomes the text `null`.
#[must_use]
pub fn text(value: &Value, null: &str) -> String {
    match value {
        Value::Null => null.to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_language::names::PrimitiveNames;

    fn port(name: &str, store: Store, slot: u32, width: u32) -> PortNames {
        PortNames {
            name: name.to_owned().into(),
            store,
            slot,
            width,
            type_name: "".into(),
            unit: None,
            source: None,
        }
    }

    fn named() -> IncidentNet {
        let primitives = vec![PrimitiveNames {
            id: "move".into(),
            type_name: "LinearMotion".into(),
            inputs: vec![port("stop", Store::Bool, 3, 1)],
            outputs: vec![
                port("pose", Store::Real, 4, 7),
                port("done", Store::Bool, 0, 1),
            ],
            never_null: false,
        }];
        let names = Names {
            net: "line".into(),
            primitives,
            ..Names::default()
        };
        IncidentNet {
            id: 3,
            net: "line".into(),
            names,
        }
    }

    fn patterns(text: &str) -> Vec<Pattern> {
        vec![text.parse().expect("a pattern")]
    }

    #[test]
    fn a_pattern_means_outputs_and_their_elements() {
        let all = named().shown(&patterns("line/move.*"));
        assert_eq!(all.len(), 2);
        assert_eq!(all[0].columns()[6], "line/move.pose[6]");
        let one = named().shown(&patterns("move.pose[2]"));
        assert_eq!((one[0].slot, one[0].width), (6, 1));
        assert!(named().shown(&patterns("move.pose[7]")).is_empty());
        assert!(named().shown(&patterns("other/*")).is_empty());
    }

    #[test]
    fn a_slot_has_the_name_of_its_port_or_of_its_writer() {
        let at = |store, slot| SlotDifference {
            cycle: 1,
            store,
            slot,
            writer: Some("LinearMotion"),
            recorded: 0,
            replayed: 1,
        };
        assert_eq!(named().slot(&at(Store::Real, 5)), "line/move.pose[1]");
        assert_eq!(named().slot(&at(Store::Bool, 3)), "line/move.stop (input)");
        let state = named().slot(&at(Store::Real, 30));
        assert_eq!(state, "line: state of LinearMotion (Real slot 30)");
    }

    #[test]
    fn a_net_without_a_command_file_is_named_by_its_id() {
        assert_eq!(IncidentNet::of(7, None).title(), "#7");
        assert_eq!(IncidentNet::of(7, Some(b"{")).title(), "#7");
    }
}
