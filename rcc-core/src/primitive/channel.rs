//! Steps of primitives that read a channel of a device: a bit of two words, or an element of an array. Run by the
//! real-time thread.

use super::each;
use crate::frame::Frame;
use crate::message::Measurement;
use crate::types::{NULL_BOOL, NULL_REAL};

/// `[out, device, channel]`: reads the channel's bit of the words (known, value); null if it is not known or the device
/// is lost.
#[inline(always)]
pub fn each_bit_channel(
    frame: &mut Frame<'_>,
    operands: &[u32],
    words: impl Fn(&Measurement) -> (u64, u64),
) {
    each(frame, operands, |frame, [out, device, channel]| {
        let bit = |word: u64| word >> (channel & 63) & 1;
        let known = frame.measured(device).map(&words);
        let known = known.filter(|(known, _)| bit(*known) == 1);
        frame.set_bool(out, known.map_or(NULL_BOOL, |(_, value)| bit(value) as u8));
    });
}

/// `[out, device, channel]`: reads the channel's element of an array; null if the device is lost.
#[inline(always)]
pub fn each_real_channel(
    frame: &mut Frame<'_>,
    operands: &[u32],
    values: impl Fn(&Measurement) -> &[f64],
) {
    each(frame, operands, |frame, [out, device, channel]| {
        let measured = frame.measured(device);
        let value = measured.and_then(|measured| values(measured).get(channel as usize).copied());
        frame.set_real(out, value.unwrap_or(NULL_REAL));
    });
}
