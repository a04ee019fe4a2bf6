//! The state of a net as it is recorded. Made by the real-time thread, read by replay.

/// The state of a net.
#[derive(Clone, Copy, Debug)]
pub struct NetSnapshot<'a> {
    /// Id of the net.
    pub id: u64,
    /// Number of its evaluations.
    pub cycles: u64,
    /// CANCEL was requested.
    pub cancel: bool,
    /// `Real` arena, as bits.
    pub reals: &'a [u64],
    /// `Int` arena.
    pub ints: &'a [u64],
    /// `Bool` arena, eight slots per word.
    pub bools: &'a [u64],
    /// State of the motions, see [`rcc_motion::MotionSet::save`].
    pub motions: &'a [u64],
}
