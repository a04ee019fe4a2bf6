//! `DigitalOutputState`: the value that the driver currently sends to a digital output, whichever net commands it.

use crate::primitive::{
    CatalogueEntry, ChannelKind, Kernel, Parameter, ParameterKind, Port, Spec, each_bit_channel,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "DigitalOutputState",
        summary: "The value that the driver currently sends to a digital output: a net's command, or the value of `on_release`.",
        null: "null while the device is lost, and before the first command to a channel with `on_release: hold`",
        undefined: "the device is lost; nothing has been sent to the channel yet",
        outputs: &[Port::bool("out", "last value sent to the channel")],
        parameters: &[
            Parameter::device(),
            Parameter::new(
                "channel",
                ParameterKind::Channel(ChannelKind::DigitalOutput),
                "name of a digital output; it may belong to another net",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_bit_channel(frame, operands, |m| (m.digital_out_known, m.digital_out));
    })],
);

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn gives_the_value_that_the_driver_sends_to_the_channel() {
        let mut bench = PrimitiveHarness::new("DigitalOutputState");
        bench.set_index("channel", 2);
        assert_eq!(bench.step().bool("out"), None, "not told yet");
        bench.device.measurement.digital_out_known = 0b100;
        assert_eq!(bench.step().bool("out"), Some(false));
        bench.device.measurement.digital_out = 0b100;
        assert_eq!(bench.step().bool("out"), Some(true));
        bench.device.present = false;
        assert_eq!(bench.step().bool("out"), None);
    }
}
