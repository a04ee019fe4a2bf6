//! `DigitalOutput`: commands a named digital output of a device; a unique resource.
//!
//! A null input sends no command, and the driver applies the channel's `on_release`.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Channel, ChannelKind, Device, Kernel, Parameter, ParameterKind, Port,
    Role, Slot, Spec, Step, operands,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "DigitalOutput",
        summary: "Commands a digital output; the output is a unique resource of this net.",
        null: "a null input sends no command: the channel is released as configured in its `on_release`",
        inputs: &[Port::bool("in", "value to write")],
        parameters: &[
            Parameter::device(),
            Parameter::new(
                "channel",
                ParameterKind::Channel(ChannelKind::DigitalOutput),
                "name of a digital output",
            ),
        ],
        role: Role::CommandsChannel,
        ..Spec::PLAIN
    },
    &[Kernel::each::<DigitalOutput>()],
);

operands! {
    struct DigitalOutput { input: Slot<Bool>, device: Device, channel: Channel }
}

impl Step for DigitalOutput {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        let bit = 1 << (self.channel.0 & 63);
        if let (Some(output), true) = (frame.output(self.device), value & NULL_BOOL == 0) {
            output.digital_commanded |= bit;
            output.digital = if value == 1 {
                output.digital | bit
            } else {
                output.digital & !bit
            };
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn commands_its_bit_and_sends_no_command_on_null() {
        let mut bench = PrimitiveHarness::new("DigitalOutput");
        bench.set_index("channel", 2);
        for (input, commanded, value) in [
            (Some(true), 0b100, 0b100),
            (Some(false), 0b100, 0),
            (None, 0, 0),
        ] {
            bench.set_bool("in", input).step();
            assert_eq!(
                (bench.output.digital_commanded, bench.output.digital),
                (commanded, value)
            );
        }
    }
}
