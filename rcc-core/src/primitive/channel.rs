//! Steps of primitives that read a channel of a device: a bit of two words, or an element of an array. Run by the
//! real-time thread.

use super::{Bool, Channel, Device, Real, Slot, each, operands};
use crate::frame::Frame;
use crate::message::Measurement;
use crate::types::{NULL_BOOL, NULL_REAL};

operands! {
    struct ChannelValue<E> { out: Slot<E>, device: Device, channel: Channel }
}

/// Reads the channel's bit of the words (known, value); null if it is not known or the device is lost.
#[inline(always)]
pub fn each_bit_channel(
    frame: &mut Frame<'_>,
    operands: &[u32],
    words: impl Fn(&Measurement) -> (u64, u64),
) {
    each(frame, operands, |frame, read: ChannelValue<Bool>| {
        let bit = |word: u64| word >> (read.channel.0 & 63) & 1;
        let known = frame.measured(read.device).map(&words);
        let known = known.filter(|(known, _)| bit(*known) == 1);
        frame.put(
            read.out,
            known.map_or(NULL_BOOL, |(_, value)| bit(value) as u8),
        )
    });
}

/// Reads the channel's element of an array; null if the device is lost.
#[inline(always)]
pub fn each_real_channel(
    frame: &mut Frame<'_>,
    operands: &[u32],
    values: impl Fn(&Measurement) -> &[f64],
) {
    each(frame, operands, |frame, read: ChannelValue<Real>| {
        let measured = frame.measured(read.device);
        let value =
            measured.and_then(|measured| values(measured).get(read.channel.0 as usize).copied());
        frame.put(read.out, value.unwrap_or(NULL_REAL))
    });
}
