//! `DigitalInput`: a named digital input of a device, latched at the beginning of the cycle.

use crate::frame::Frame;
use crate::primitive::{ChannelKind, Entry, Kernel, Parameter, ParameterKind, Port, Spec, each};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: Entry = Entry::new(
    Spec {
        name: "DigitalInput",
        summary: "The value of a digital input.",
        null: "null while the device is lost or does not know the channel",
        undefined: "the device is lost; it does not know the channel",
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
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline(always)]
fn step(frame: &mut Frame<'_>, [out, device, channel]: [u32; 3]) {
    let known = frame
        .measured(device)
        .filter(|m| m.digital_known >> (channel & 63) & 1 == 1);
    let value = known.map_or(NULL_BOOL, |m| (m.digital >> (channel & 63) & 1) as u8);
    frame.set_bool(out, value);
}

#[cfg(test)]
mod tests {
    use crate::testing::Bench;

    #[test]
    fn gives_the_bit_of_its_channel() {
        let mut bench = Bench::new("DigitalInput");
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
