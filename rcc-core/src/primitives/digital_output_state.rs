//! `DigitalOutputState`: what a digital output of a device is told now, whoever commands it.

use crate::primitive::{
    CatalogueEntry, ChannelKind, Kernel, Parameter, ParameterKind, Port, Spec, each_bit_channel,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "DigitalOutputState",
        summary: "What the driver tells a digital output now: what a net commands, or what `on_release` says.",
        null: "null while the device is lost, and before the first command of a channel that holds",
        undefined: "the device is lost; the channel has not been told anything yet",
        outputs: &[Port::bool("out", "value that the channel was told last")],
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
    fn gives_what_the_driver_tells_the_channel() {
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
