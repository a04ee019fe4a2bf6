//! `AnalogOutputState`: what an analog output of a device is told now, whoever commands it.

use crate::primitive::{
    CatalogueEntry, ChannelKind, Kernel, Parameter, ParameterKind, Port, Spec, UnitRule,
    each_real_channel,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "AnalogOutputState",
        summary: "What the driver tells an analog output now: what a net commands, or what `on_release` says.",
        null: "null while the device is lost, and before the first command of a channel that holds",
        undefined: "the device is lost; the channel has not been told anything yet",
        outputs: &[Port::real(
            "out",
            UnitRule::Channel,
            "value that the channel was told last, in the unit of the configuration",
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
    fn gives_what_the_driver_tells_the_channel() {
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
