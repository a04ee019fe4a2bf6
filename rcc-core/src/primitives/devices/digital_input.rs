//! `DigitalInput`: a named digital input of a device, latched at the beginning of the cycle.

use crate::primitive::{
    CatalogueEntry, ChannelKind, Kernel, Parameter, ParameterKind, Port, Spec, each_bit_channel,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "DigitalInput",
        summary: "The value of a digital input.",
        null: "null while the device is lost or does not report the channel",
        undefined: "the device is lost; it does not report the channel",
        outputs: &[Port::bool("out", "value of the channel")],
        parameters: &[
            Parameter::device(),
            Parameter::new(
                "channel",
                ParameterKind::Channel(ChannelKind::DigitalInput),
                "name of a digital input",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_bit_channel(frame, operands, |m| (m.digital_known, m.digital));
    })],
);

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn gives_the_bit_of_its_channel() {
        let mut bench = PrimitiveHarness::new("DigitalInput");
        bench.set_index("channel", 3);
        assert_eq!(bench.step().bool("out"), None, "not known");
        bench.device.measurement.digital_known = 0b1000;
        assert_eq!(bench.step().bool("out"), Some(false));
        bench.device.measurement.digital = 0b1000;
        assert_eq!(bench.step().bool("out"), Some(true));
        bench.device.present = false;
        assert_eq!(bench.step().bool("out"), None);
    }
}
