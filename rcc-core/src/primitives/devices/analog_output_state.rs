//! `AnalogOutputState`: the value that the driver currently sends to an analog output, whichever net commands it.

use crate::primitive::{
    CatalogueEntry, ChannelKind, Kernel, Parameter, ParameterKind, Port, Spec, UnitRule,
    each_real_channel,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "AnalogOutputState",
        summary: "The value that the driver currently sends to an analog output: a net's command, or the value of `on_release`.",
        null: "null while the device is lost, and before the first command to a channel with `on_release: hold`",
        undefined: "the device is lost; nothing has been sent to the channel yet",
        outputs: &[Port::real(
            "out",
            UnitRule::Channel,
            "last value sent to the channel, in the unit of the configuration",
        )],
        parameters: &[
            Parameter::device(),
            Parameter::new(
                "channel",
                ParameterKind::Channel(ChannelKind::AnalogOutput),
                "name of an analog output; it may belong to another net",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_real_channel(frame, operands, |m| &m.analog_out);
    })],
);

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn gives_the_value_that_the_driver_sends_to_the_channel() {
        let mut bench = PrimitiveHarness::new("AnalogOutputState");
        bench.set_index("channel", 1);
        bench.device.measurement.analog_out[1] = 0.25;
        assert_eq!(bench.step().real("out"), 0.25);
        bench.device.measurement.analog_out[1] = f64::NAN;
        assert!(bench.step().real("out").is_nan());
        bench.device.measurement.analog_out[1] = 0.25;
        bench.device.present = false;
        assert!(bench.step().real("out").is_nan());
    }
}
