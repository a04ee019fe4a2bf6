//! The objects of a model of a terminal after power-on: identity, sync managers, process data objects, and settings.
//! Called by the thread of the socket.

use super::drive_objects;
use super::model::{Channels, Model};
use super::objects::ObjectDictionary;

/// Returns the objects of a model after power-on; empty if it has no mailbox.
#[must_use]
pub fn of(model: &Model, serial: u32) -> ObjectDictionary {
    let mut objects = ObjectDictionary::default();
    if !model.has_mailbox() {
        return objects;
    }
    objects.constant(0x1000, 0, &5001_u32.to_le_bytes());
    objects.constant(0x1008, 0, model.name.as_bytes());
    objects.constant(0x1009, 0, b"00");
    objects.constant(0x100a, 0, b"01");
    let identity = [model.vendor, model.product, model.revision, serial];
    objects.array(0x1018, identity.map(u32::to_le_bytes));
    objects.array(0x1c00, [[1], [2], [3], [4]]);
    let assigned = |outputs| {
        let pdos = model.pdos().into_iter();
        let of = pdos.filter(move |pdo| pdo.is_output() == outputs);
        of.map(|pdo| pdo.index.to_le_bytes())
    };
    objects.array(0x1c12, assigned(true));
    objects.array(0x1c13, assigned(false));
    for pdo in model.pdos() {
        let mapped = pdo.entries.iter().map(|entry| {
            let object = u32::from(entry.index) << 16 | u32::from(entry.sub_index) << 8;
            (object | u32::from(entry.bits)).to_le_bytes()
        });
        objects.array(pdo.index, mapped);
    }
    if model.channels == Channels::Drive {
        drive_objects::add(&mut objects);
    }
    for channel in 0..u16::from(model.count) {
        let settings = 0x8000 + channel * 0x10;
        match model.channels {
            // Filter on; filter settings: 0 = 50 Hz.
            Channels::AnalogInput => {
                objects.setting(settings, 0x06, &[0]);
                objects.setting(settings, 0x15, &[0, 0]);
            }
            // Value without communication.
            _ => objects.setting(settings, 0x13, &[0, 0]),
        }
    }
    objects
}
