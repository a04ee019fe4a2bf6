//! The terminals that can be simulated: identity, sync managers and process data objects, as the real ones have them.
//! Plain tables.

/// Vendor number of Beckhoff Automation.
pub const VENDOR: u32 = 2;
/// Size of each of the two mailboxes, bytes.
pub const MAILBOX_SIZE: u16 = 128;
/// First address of the mailbox that the MainDevice writes.
pub const MAILBOX_OUT: u16 = 0x1000;
/// First address of the mailbox that the MainDevice reads.
pub const MAILBOX_IN: u16 = 0x1080;

/// What the channels of a terminal are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// Inputs of 1 bit.
    DigitalInput,
    /// Outputs of 1 bit.
    DigitalOutput,
    /// Inputs of 16 bits status and a signed value of 16 bits.
    AnalogInput,
    /// Outputs of a signed value of 16 bits.
    AnalogOutput,
}

/// A terminal type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Model {
    /// Order number, such as `EL1008`.
    pub name: &'static str,
    /// Description, as in the EEPROM.
    pub description: &'static str,
    /// Product code.
    pub product: u32,
    /// Revision.
    pub revision: u32,
    /// Kind of its channels.
    pub channels: Channels,
    /// Number of its channels.
    pub count: u8,
}

/// All types.
pub const MODELS: &[Model] = &[
    Model {
        name: "EL1008",
        description: "EL1008 8K. Dig. Eingang 24V, 3ms",
        product: 0x03f0_3052,
        revision: 0x0011_0000,
        channels: Channels::DigitalInput,
        count: 8,
    },
    Model {
        name: "EL2008",
        description: "EL2008 8K. Dig. Ausgang 24V, 0.5A",
        product: 0x07d8_3052,
        revision: 0x0011_0000,
        channels: Channels::DigitalOutput,
        count: 8,
    },
    Model {
        name: "EL3064",
        description: "EL3064 4K. Ana. Eingang 0-10V",
        product: 0x0bf8_3052,
        revision: 0x0014_0000,
        channels: Channels::AnalogInput,
        count: 4,
    },
    Model {
        name: "EL4004",
        description: "EL4004 4K. Ana. Ausgang 0-10V, 12bit",
        product: 0x0fa4_3052,
        revision: 0x0013_0000,
        channels: Channels::AnalogOutput,
        count: 4,
    },
];

/// A sync manager as the EEPROM describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SyncManagerDefault {
    /// First address.
    pub start: u16,
    /// Length, bytes.
    pub length: u16,
    /// Control byte.
    pub control: u8,
    /// 1 mailbox out, 2 mailbox in, 3 outputs, 4 inputs; seen from the MainDevice.
    pub kind: u8,
}

/// An entry of a process data object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PdoEntry {
    /// Index of the mapped object; 0 = padding.
    pub index: u16,
    /// Its sub-index.
    pub sub_index: u8,
    /// Length, bits.
    pub bits: u8,
    /// Data type of CANopen: 1 Boolean, 3 INTEGER16, 0x31 BIT2, 0 none.
    pub data_type: u8,
}

/// A process data object: one for each channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pdo {
    /// Index: 0x16nn outputs, 0x1Ann inputs.
    pub index: u16,
    /// Its entries, in order.
    pub entries: Vec<PdoEntry>,
}

impl SyncManagerDefault {
    fn new(start: u16, length: u16, control: u8, kind: u8) -> SyncManagerDefault {
        SyncManagerDefault {
            start,
            length,
            control,
            kind,
        }
    }
}

impl Model {
    /// Returns the type with this name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Model> {
        MODELS.iter().find(|model| model.name == name)
    }

    /// Returns true if the MainDevice writes its process data.
    #[must_use]
    pub fn is_output(&self) -> bool {
        matches!(
            self.channels,
            Channels::DigitalOutput | Channels::AnalogOutput
        )
    }

    /// Returns true if it has mailboxes and an object dictionary.
    #[must_use]
    pub fn has_mailbox(&self) -> bool {
        matches!(
            self.channels,
            Channels::AnalogInput | Channels::AnalogOutput
        )
    }

    /// Returns the size of one channel in the process image, bits.
    #[must_use]
    pub fn channel_bits(&self) -> u16 {
        match self.channels {
            Channels::DigitalInput | Channels::DigitalOutput => 1,
            Channels::AnalogInput => 32,
            Channels::AnalogOutput => 16,
        }
    }

    /// Returns the size of its process data, bytes.
    #[must_use]
    pub fn process_bytes(&self) -> u16 {
        (self.channel_bits() * u16::from(self.count)).div_ceil(8)
    }

    /// Returns its sync managers.
    #[must_use]
    pub fn sync_managers(&self) -> Vec<SyncManagerDefault> {
        let mailbox = [
            SyncManagerDefault::new(MAILBOX_OUT, MAILBOX_SIZE, 0x26, 1),
            SyncManagerDefault::new(MAILBOX_IN, MAILBOX_SIZE, 0x22, 2),
        ];
        let (_, process) = self.process_manager();
        let data = match self.channels {
            Channels::DigitalInput | Channels::DigitalOutput => return vec![process],
            Channels::AnalogInput => [SyncManagerDefault::new(0x1100, 0, 0x24, 3), process],
            Channels::AnalogOutput => [process, SyncManagerDefault::new(0x1180, 0, 0x20, 4)],
        };
        mailbox.into_iter().chain(data).collect()
    }

    /// Returns the uses of its FMMUs: 1 outputs, 2 inputs, 3 state of the mailbox.
    #[must_use]
    pub fn fmmu_uses(&self) -> &'static [u8] {
        match self.channels {
            Channels::DigitalInput => &[2],
            Channels::DigitalOutput => &[1],
            Channels::AnalogInput | Channels::AnalogOutput => &[1, 2, 3],
        }
    }

    /// Returns number and registers of the sync manager with its process data.
    #[must_use]
    pub fn process_manager(&self) -> (u16, SyncManagerDefault) {
        let (number, start, control, kind) = match self.channels {
            Channels::DigitalInput => (0, 0x1000, 0x00, 4),
            Channels::DigitalOutput => (0, 0x0f00, 0x44, 3),
            Channels::AnalogInput => (3, 0x1180, 0x20, 4),
            Channels::AnalogOutput => (2, 0x1100, 0x64, 3),
        };
        let length = self.process_bytes();
        (
            number,
            SyncManagerDefault::new(start, length, control, kind),
        )
    }

    /// Returns its process data objects in the order of the process image.
    #[must_use]
    pub fn pdos(&self) -> Vec<Pdo> {
        (0..self.count).map(|channel| self.pdo(channel)).collect()
    }

    fn pdo(&self, channel: u8) -> Pdo {
        let number = u16::from(channel);
        let object = if self.is_output() { 0x7000 } else { 0x6000 } + number * 0x10;
        let entry = |sub_index, bits, data_type| PdoEntry {
            index: object,
            sub_index,
            bits,
            data_type,
        };
        let gap = |bits| PdoEntry {
            index: 0,
            sub_index: 0,
            bits,
            data_type: 0,
        };
        let (index, entries) = match self.channels {
            Channels::DigitalInput => (0x1a00 + number, vec![entry(1, 1, 1)]),
            Channels::DigitalOutput => (0x1600 + number, vec![entry(1, 1, 1)]),
            Channels::AnalogOutput => (0x1600 + number, vec![entry(1, 16, 3)]),
            // Underrange, overrange, limit 1, limit 2, error, padding, sync error, state, toggle, value.
            Channels::AnalogInput => (
                // The objects with odd numbers are the compact ones, without status.
                0x1a00 + number * 2,
                vec![
                    entry(1, 1, 1),
                    entry(2, 1, 1),
                    entry(3, 2, 0x31),
                    entry(5, 2, 0x31),
                    entry(7, 1, 1),
                    gap(6),
                    entry(14, 1, 1),
                    entry(15, 1, 1),
                    entry(16, 1, 1),
                    entry(17, 16, 3),
                ],
            ),
        };
        Pdo { index, entries }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_objects_of_every_model_fill_its_process_data() {
        for model in MODELS {
            let pdos = model.pdos();
            let bits: u16 = pdos
                .iter()
                .flat_map(|pdo| &pdo.entries)
                .map(|entry| u16::from(entry.bits))
                .sum();
            assert_eq!(bits, model.channel_bits() * u16::from(model.count));
            let (number, manager) = model.process_manager();
            assert_eq!(manager.length, bits / 8, "{}", model.name);
            assert_eq!(model.sync_managers()[usize::from(number)], manager);
        }
    }

    #[test]
    fn every_output_triggers_the_watchdog() {
        for model in MODELS.iter().filter(|model| model.is_output()) {
            let (_, manager) = model.process_manager();
            assert_eq!(manager.control & 0x44, 0x44, "{}", model.name);
        }
    }
}
