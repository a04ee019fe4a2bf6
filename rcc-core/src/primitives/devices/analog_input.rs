//! `AnalogInput`: a named analog input of a device, latched at the beginning of the cycle.

use crate::primitive::{
    CatalogueEntry, ChannelKind, Kernel, Parameter, ParameterKind, Port, Spec, UnitRule,
    each_real_channel,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "AnalogInput",
        summary: "The value of an analog input.",
        null: "null while the device is lost or does not report the channel",
        undefined: "the device is lost; it does not report the channel",
        outputs: &[Port::real(
            "out",
            UnitRule::Channel,
            "value of the channel in the unit of the configuration",
        )],
        parameters: &[
            Parameter::device(),
            Parameter::new(
                "channel",
                ParameterKind::Channel(ChannelKind::AnalogInput),
                "name of an analog input",
            ),
        ],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| {
        each_real_channel(frame, operands, |m| &m.analog);
    })],
);

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn gives_the_value_of_its_channel() {
        let mut bench = PrimitiveHarness::new("AnalogInput");
        bench.device.measurement.analog[1] = 4.5;
        assert_eq!(bench.set_index("channel", 1).step().real("out"), 4.5);
        bench.device.measurement.analog[1] = f64::NAN;
        assert!(bench.step().real("out").is_nan());
        bench.device.measurement.analog[1] = 4.5;
        bench.device.present = false;
        assert!(bench.step().real("out").is_nan());
    }
}
