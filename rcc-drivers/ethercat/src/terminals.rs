//! The terminals that can be simulated: identity, sync managers and process data objects, as the real ones have them.
//! Plain tables.

/// Vendor number of Beckhoff Automation.
pub const VENDOR: u32 = 2;
/// Vendor number of the simulated drive, which no manufacturer has.
pub const DRIVE_VENDOR: u32 = 0xffff_fffe;
/// Size of each of the two mailboxes, bytes.
pub const MAILBOX_SIZE: u16 = 128;
/// First address of the mailbox that the MainDevice writes.
pub const MAILBOX_OUT: u16 = 0x1000;
/// First address of the mailbox that the MainDevice reads.
pub const MAILBOX_IN: u16 = 0x1080;

/// The kind of a terminal's channels.
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
    /// No channels: the axis of a servo drive (CiA 402; IEC 61800-7-201).
    Drive,
}

/// A terminal type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Model {
    /// Order number, such as `EL1008`.
    pub name: &'static str,
    /// Description, as in the EEPROM.
    pub description: &'static str,
    /// Vendor number.
    pub vendor: u32,
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
        vendor: VENDOR,
        product: 0x03f0_3052,
        revision: 0x0011_0000,
        channels: Channels::DigitalInput,
        count: 8,
    },
    Model {
        name: "EL2008",
        description: "EL2008 8K. Dig. Ausgang 24V, 0.5A",
        vendor: VENDOR,
        product: 0x07d8_3052,
        revision: 0x0011_0000,
        channels: Channels::DigitalOutput,
        count: 8,
    },
    Model {
        name: "EL3064",
        description: "EL3064 4K. Ana. Eingang 0-10V",
        vendor: VENDOR,
        product: 0x0bf8_3052,
        revision: 0x0014_0000,
        channels: Channels::AnalogInput,
        count: 4,
    },
    Model {
        name: "EL4004",
        description: "EL4004 4K. Ana. Ausgang 0-10V, 12bit",
        vendor: VENDOR,
        product: 0x0fa4_3052,
        revision: 0x0013_0000,
        channels: Channels::AnalogOutput,
        count: 4,
    },
    Model {
        name: "CiA402",
        description: "Simulated servo drive, CiA 402, cyclic synchronous position",
        vendor: DRIVE_VENDOR,
        product: 0x0000_0402,
        revision: 0x0001_0000,
        channels: Channels::Drive,
        count: 0,
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
    /// Data type of CANopen: 1 Boolean, 3 INTEGER16, 4 INTEGER32, 6 UNSIGNED16, 0x31 BIT2, 0 none.
    pub data_type: u8,
}

/// A process data object: one for each channel, and for each direction of a drive.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pdo {
    /// Index: 0x16nn outputs, 0x1Ann inputs.
    pub index: u16,
    /// Its entries, in order.
    pub entries: Vec<PdoEntry>,
}

impl Pdo {
    /// Returns true if the MainDevice writes it.
    #[must_use]
    pub fn is_output(&self) -> bool {
        self.index < 0x1a00
    }
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

    /// Returns true if the MainDevice writes process data of it.
    #[must_use]
    pub fn has_outputs(&self) -> bool {
        use Channels::{AnalogOutput, DigitalOutput, Drive};
        matches!(self.channels, DigitalOutput | AnalogOutput | Drive)
    }

    /// Returns true if the MainDevice reads process data of it.
    #[must_use]
    pub fn has_inputs(&self) -> bool {
        use Channels::{AnalogInput, DigitalInput, Drive};
        matches!(self.channels, DigitalInput | AnalogInput | Drive)
    }

    /// Returns true if it has mailboxes and an object dictionary.
    #[must_use]
    pub fn has_mailbox(&self) -> bool {
        !matches!(
            self.channels,
            Channels::DigitalInput | Channels::DigitalOutput
        )
    }

    /// Returns true if it has a distributed clock.
    #[must_use]
    pub fn has_clock(&self) -> bool {
        self.channels == Channels::Drive
    }

    /// Returns the size of one channel in the process image, bits; 0 for a drive.
    #[must_use]
    pub fn channel_bits(&self) -> u16 {
        match self.channels {
            Channels::DigitalInput | Channels::DigitalOutput => 1,
            Channels::AnalogInput => 32,
            Channels::AnalogOutput => 16,
            Channels::Drive => 0,
        }
    }

    /// Returns the size of its outputs or of its inputs, bytes; 0 if it has none.
    #[must_use]
    pub fn process_bytes(&self, outputs: bool) -> u16 {
        let pdos = self.pdos().into_iter();
        let entries = pdos.filter(|pdo| pdo.is_output() == outputs);
        let bits = entries.flat_map(|pdo| pdo.entries);
        let bits: u16 = bits.map(|entry| u16::from(entry.bits)).sum();
        bits.div_ceil(8)
    }

    /// Returns its sync managers.
    #[must_use]
    pub fn sync_managers(&self) -> Vec<SyncManagerDefault> {
        let mailbox = [
            SyncManagerDefault::new(MAILBOX_OUT, MAILBOX_SIZE, 0x26, 1),
            SyncManagerDefault::new(MAILBOX_IN, MAILBOX_SIZE, 0x22, 2),
        ];
        let none = |start, control, kind| SyncManagerDefault::new(start, 0, control, kind);
        let of = |manager: Option<(u16, SyncManagerDefault)>| manager.map(|(_, manager)| manager);
        let (outputs, inputs) = (of(self.outputs_manager()), of(self.inputs_manager()));
        match self.has_mailbox() {
            false => outputs.into_iter().chain(inputs).collect(),
            true => mailbox
                .into_iter()
                .chain([outputs.unwrap_or(none(0x1100, 0x24, 3))])
                .chain([inputs.unwrap_or(none(0x1180, 0x20, 4))])
                .collect(),
        }
    }

    /// Returns the uses of its FMMUs: 1 outputs, 2 inputs, 3 state of the mailbox.
    #[must_use]
    pub fn fmmu_uses(&self) -> &'static [u8] {
        match self.channels {
            Channels::DigitalInput => &[2],
            Channels::DigitalOutput => &[1],
            _ => &[1, 2, 3],
        }
    }

    /// Returns number and registers of the sync manager with the outputs; `None` if it has none.
    #[must_use]
    pub fn outputs_manager(&self) -> Option<(u16, SyncManagerDefault)> {
        let (number, start, control) = match self.has_mailbox() {
            false => (0, 0x0f00, 0x44),
            true => (2, 0x1100, 0x64),
        };
        let length = self.process_bytes(true);
        let manager = SyncManagerDefault::new(start, length, control, 3);
        self.has_outputs().then_some((number, manager))
    }

    /// Returns number and registers of the sync manager with the inputs; `None` if it has none.
    #[must_use]
    pub fn inputs_manager(&self) -> Option<(u16, SyncManagerDefault)> {
        let (number, start, control) = match self.has_mailbox() {
            false => (0, 0x1000, 0x00),
            true => (3, 0x1180, 0x20),
        };
        let length = self.process_bytes(false);
        let manager = SyncManagerDefault::new(start, length, control, 4);
        self.has_inputs().then_some((number, manager))
    }

    /// Returns its process data objects in the order of the process image, outputs first.
    #[must_use]
    pub fn pdos(&self) -> Vec<Pdo> {
        match self.channels {
            Channels::Drive => drive_pdos(),
            _ => (0..self.count).map(|channel| self.pdo(channel)).collect(),
        }
    }

    fn pdo(&self, channel: u8) -> Pdo {
        let number = u16::from(channel);
        let object = if self.has_outputs() { 0x7000 } else { 0x6000 } + number * 0x10;
        let entry = |sub_index, bits, data_type| PdoEntry::new(object, sub_index, bits, data_type);
        let (index, entries) = match self.channels {
            Channels::DigitalInput => (0x1a00 + number, vec![entry(1, 1, 1)]),
            Channels::DigitalOutput => (0x1600 + number, vec![entry(1, 1, 1)]),
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
                    PdoEntry::new(0, 0, 6, 0),
                    entry(14, 1, 1),
                    entry(15, 1, 1),
                    entry(16, 1, 1),
                    entry(17, 16, 3),
                ],
            ),
            _ => (0x1600 + number, vec![entry(1, 16, 3)]),
        };
        Pdo { index, entries }
    }
}

impl PdoEntry {
    fn new(index: u16, sub_index: u8, bits: u8, data_type: u8) -> PdoEntry {
        PdoEntry {
            index,
            sub_index,
            bits,
            data_type,
        }
    }
}

/// Returns what a drive exchanges: controlword and target position; statusword, actual position and error code.
fn drive_pdos() -> Vec<Pdo> {
    let word = |index| PdoEntry::new(index, 0, 16, 6);
    let position = |index| PdoEntry::new(index, 0, 32, 4);
    vec![
        Pdo {
            index: 0x1600,
            entries: vec![word(0x6040), position(0x607a)],
        },
        Pdo {
            index: 0x1a00,
            entries: vec![word(0x6041), position(0x6064), word(0x603f)],
        },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_objects_of_every_model_fill_its_sync_managers() {
        for model in MODELS {
            let managers = model.sync_managers();
            let mut bytes = 0;
            for (number, manager) in [model.outputs_manager(), model.inputs_manager()]
                .into_iter()
                .flatten()
            {
                assert_eq!(managers[usize::from(number)], manager, "{}", model.name);
                bytes += manager.length;
            }
            let channels = (model.channel_bits() * u16::from(model.count)).div_ceil(8);
            let drive = if model.channels == Channels::Drive {
                14
            } else {
                0
            };
            assert_eq!(bytes, channels + drive, "{}", model.name);
        }
    }

    #[test]
    fn every_output_triggers_the_watchdog() {
        for model in MODELS {
            if let Some((_, manager)) = model.outputs_manager() {
                assert_eq!(manager.control & 0x44, 0x44, "{}", model.name);
            }
        }
    }
}
