//! The object dictionary of a terminal with a mailbox (ETG.1000.6, section 5.6.7): objects that can be read, and settings
//! that can be written.
//! Called by the thread of the socket.

use std::collections::BTreeMap;

use super::model::{Channels, Model};

/// Abort codes of SDO (ETG.1000.6, table 40).
pub mod abort {
    /// The object cannot be accessed in this way: no complete access.
    pub const ACCESS: u32 = 0x0601_0000;
    /// The object can only be read.
    pub const READ_ONLY: u32 = 0x0601_0002;
    /// There is no such object.
    pub const NO_OBJECT: u32 = 0x0602_0000;
    /// The value is not supported.
    pub const VALUE: u32 = 0x0609_0030;
    /// Data type and length do not fit.
    pub const LENGTH: u32 = 0x0607_0010;
    /// There is no such sub-index.
    pub const NO_SUB_INDEX: u32 = 0x0609_0011;
    /// The command is not known.
    pub const COMMAND: u32 = 0x0504_0001;
}

/// A setting: index, sub-index, default, and the only value that is supported, if there is only one.
pub type Setting = (u16, u8, &'static [u8], Option<&'static [u8]>);

/// One object or one entry of it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Entry {
    data: Vec<u8>,
    writable: bool,
    /// The only value that can be written.
    only: Option<&'static [u8]>,
}

/// All objects, by index and sub-index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ObjectDictionary(BTreeMap<(u16, u8), Entry>);

impl ObjectDictionary {
    /// Adds or changes an object that can only be read.
    pub fn constant(&mut self, index: u16, sub_index: u8, data: &[u8]) {
        self.put(index, sub_index, data, false);
    }

    /// Adds a setting; sub-index 0 holds the largest sub-index.
    pub fn setting(&mut self, index: u16, sub_index: u8, data: &[u8]) {
        self.put(index, sub_index, data, true);
        self.constant(index, 0, &[sub_index]);
    }

    /// Adds settings; sub-index 0 of a list holds its largest sub-index.
    pub fn settings(&mut self, settings: &[Setting]) {
        for (index, sub_index, default, only) in settings {
            match sub_index {
                0 => self.put(*index, 0, default, true),
                _ => self.setting(*index, *sub_index, default),
            }
            if let Some(entry) = self.0.get_mut(&(*index, *sub_index)) {
                entry.only = *only;
            }
        }
    }

    fn put(&mut self, index: u16, sub_index: u8, data: &[u8], writable: bool) {
        let entry = Entry {
            data: data.to_vec(),
            writable,
            only: None,
        };
        self.0.insert((index, sub_index), entry);
    }

    /// Adds a list: sub-index 0 holds its length.
    pub fn array<const N: usize>(&mut self, index: u16, items: impl IntoIterator<Item = [u8; N]>) {
        let mut count = 0;
        for item in items {
            count += 1;
            self.constant(index, count, &item);
        }
        self.constant(index, 0, &[count]);
    }

    /// Stores the value of a process data channel as an object that can be read.
    pub fn put_value(&mut self, model: &Model, channel: u8, value: i16) {
        let (object, sub_index) = match model.channels {
            Channels::AnalogInput => (0x6000, 0x11),
            _ => (0x7000, 0x01),
        };
        let index = object + u16::from(channel) * 0x10;
        self.constant(index, sub_index, &value.to_le_bytes());
        self.constant(index, 0, &[sub_index]);
    }

    /// Returns the output value of a channel without communication.
    #[must_use]
    pub fn default_output(&self, channel: u8) -> i16 {
        match self.read(0x8000 + u16::from(channel) * 0x10, 0x13) {
            Ok(&[low, high]) => i16::from_le_bytes([low, high]),
            _ => 0,
        }
    }

    /// Returns the data of an entry.
    ///
    /// # Errors
    /// Returns the abort code.
    pub fn read(&self, index: u16, sub_index: u8) -> Result<&[u8], u32> {
        match self.0.get(&(index, sub_index)) {
            Some(entry) => Ok(&entry.data),
            None => Err(self.missing(index)),
        }
    }

    /// Stores the data of a setting.
    ///
    /// # Errors
    /// Returns the abort code; nothing has changed then.
    pub fn write(&mut self, index: u16, sub_index: u8, data: &[u8]) -> Result<(), u32> {
        let missing = self.missing(index);
        let entry = self.0.get_mut(&(index, sub_index)).ok_or(missing)?;
        match entry {
            Entry {
                writable: false, ..
            } => Err(abort::READ_ONLY),
            entry if entry.data.len() != data.len() => Err(abort::LENGTH),
            entry if entry.only.is_some_and(|only| only != data) => Err(abort::VALUE),
            entry => {
                entry.data = data.to_vec();
                Ok(())
            }
        }
    }

    fn missing(&self, index: u16) -> u32 {
        match self.0.range((index, 0)..=(index, u8::MAX)).next() {
            Some(_) => abort::NO_SUB_INDEX,
            None => abort::NO_OBJECT,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::model_objects;
    use super::*;

    fn analog_input() -> ObjectDictionary {
        model_objects::of(Model::named("EL3064").unwrap(), 9)
    }

    #[test]
    fn the_assigned_objects_add_up_to_the_process_data() {
        let objects = analog_input();
        let mut bits = 0;
        for sub_index in 1..=objects.read(0x1c13, 0).unwrap()[0] {
            let pdo = objects.read(0x1c13, sub_index).unwrap();
            let pdo = u16::from_le_bytes([pdo[0], pdo[1]]);
            for entry in 1..=objects.read(pdo, 0).unwrap()[0] {
                bits += usize::from(objects.read(pdo, entry).unwrap()[0]);
            }
        }
        assert_eq!(bits, 128);
        assert_eq!(objects.read(0x1c12, 0), Ok(&[0][..]));
    }

    #[test]
    fn only_settings_are_written_and_only_in_their_length() {
        let mut objects = analog_input();
        assert_eq!(objects.write(0x8010, 0x06, &[1]), Ok(()));
        assert_eq!(objects.read(0x8010, 0x06), Ok(&[1][..]));
        assert_eq!(objects.write(0x8010, 0x06, &[1, 0]), Err(abort::LENGTH));
        assert_eq!(objects.write(0x1018, 1, &[0; 4]), Err(abort::READ_ONLY));
        assert_eq!(objects.write(0x8010, 0x07, &[1]), Err(abort::NO_SUB_INDEX));
        assert_eq!(objects.read(0x2000, 0), Err(abort::NO_OBJECT));
    }
}
