//! `AnalogOutput`: commands a named analog output of a device; a unique resource.
//!
//! A null input sends no command, and the driver applies the channel's `on_release`. The driver refuses values outside
//! the channel's range and reports them; it does not clamp.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, Channel, ChannelKind, Device, Kernel, Parameter, ParameterKind, Port, Real,
    Role, Slot, Spec, Step, UnitRule, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "AnalogOutput",
        summary: "Commands an analog output; the output is a unique resource of this net.",
        null: "a null input sends no command: the channel is released as configured in its `on_release`",
        inputs: &[Port::real(
            "in",
            UnitRule::Channel,
            "value to write, in the unit of the configuration",
        )],
        parameters: &[
            Parameter::device(),
            Parameter::new(
                "channel",
                ParameterKind::Channel(ChannelKind::AnalogOutput),
                "name of an analog output",
            ),
        ],
        role: Role::CommandsChannel,
        ..Spec::PLAIN
    },
    &[Kernel::each::<AnalogOutput>()],
);

operands! {
    struct AnalogOutput { input: Slot<Real>, device: Device, channel: Channel }
}

impl Step for AnalogOutput {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let value = frame.get(self.input)?;
        if let Some(place) = frame
            .output(self.device)
            .and_then(|output| output.analog.get_mut(self.channel.0 as usize))
        {
            *place = value;
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn commands_its_channel_and_sends_no_command_on_null() {
        let mut bench = PrimitiveHarness::new("AnalogOutput");
        bench.set_index("channel", 1).set_real("in", 3.5).step();
        assert_eq!(bench.output.analog[1], 3.5);
        assert!(bench.output.analog[0].is_nan());
        bench.set_real("in", f64::NAN).step();
        assert!(bench.output.analog[1].is_nan());
    }
}
