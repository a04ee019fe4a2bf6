//! The pieces of a path with the samples from which their limits and time laws are computed. Run when a command is made
//! ready; allocates.

use core::ops::Range;

use rcc_core::path::{MotionFault, SpeedProfile};

use super::leg_shape::LegShape;
use super::piece_samples::{PieceSamples, sample_piece};
use super::speed_limits::QuantityLimits;
use super::{ArmStart, InverseHints, LegFault};
use crate::geometry::LENGTH_MIN;
use crate::geometry::chain::{Chain, ChainPiece, ShapePoint};

/// The samples of a piece with its limits.
pub(super) struct SampledPiece {
    pub(super) samples: PieceSamples,
    pub(super) bounds: QuantityLimits,
    pub(super) inverse_hints: Option<InverseHints>,
    pub(super) given: bool,
}

/// A chain of shapes with the samples of its pieces.
pub(super) struct SampledPath<'a> {
    pub(super) chain: &'a Chain,
    pub(super) leg_shapes: &'a [LegShape],
    /// One element per piece.
    pub(super) pieces: Vec<SampledPiece>,
    pub(super) dt_s: f64,
}

impl<'a> SampledPath<'a> {
    /// Samples all pieces of a chain, which consists of these shapes, for a cycle of `dt_s` (s).
    ///
    /// # Errors
    /// Returns the fault and its leg if the arm cannot follow a piece.
    pub(super) fn new(
        (arm_start, dt_s): (ArmStart<'_>, f64),
        (chain, leg_shapes): (&'a Chain, &'a [LegShape]),
        pace: SpeedProfile,
    ) -> Result<Self, LegFault> {
        let mut pieces = Vec::new();
        let mut joints = arm_start.joints;
        for piece in chain.pieces() {
            let none = (0, MotionFault::NoMotion);
            let leg_shape = leg_shapes.get(piece.link).ok_or(none)?;
            let next = leg_shapes.get(piece.link + 1).filter(|_| piece.blend);
            let mut samples = sample_piece(arm_start, piece, leg_shape, &joints)?;
            joints = samples.joints.last().copied().unwrap_or(joints);
            let on_flange = matches!(piece.at(piece.begin), ShapePoint::Flange(_));
            let elbow = leg_shape.elbow_on(piece).filter(|_| on_flange);
            pieces.push(SampledPiece {
                inverse_hints: elbow.map(|elbow| InverseHints {
                    elbow,
                    joints: core::mem::take(&mut samples.joints).into(),
                }),
                bounds: next.map_or(leg_shape.bounds, |next| {
                    tighter(&leg_shape.bounds, &next.bounds)
                }),
                // With the time-optimal profile the speed of a leg is a limit; otherwise it is to be kept.
                given: leg_shape.given
                    && !piece.blend
                    && !matches!(pace, SpeedProfile::TimeOptimal(_)),
                samples,
            });
        }
        Ok(Self {
            chain,
            leg_shapes,
            pieces,
            dt_s,
        })
    }

    /// The ranges of pieces from rest to rest; those of length 0 only `with_empty`.
    pub(super) fn section_ranges(&self, with_empty: bool) -> Vec<Range<usize>> {
        let (mut all, mut first) = (Vec::new(), 0);
        let pieces = self.chain.pieces();
        for (number, piece) in pieces.iter().enumerate() {
            if piece.rest || number + 1 == pieces.len() {
                let range = first..number + 1;
                if with_empty || range.clone().any(|number| self.has_length(number)) {
                    all.push(range);
                }
                first = number + 1;
            }
        }
        all
    }

    /// The pieces of a range that have a length, with their samples.
    pub(super) fn with_length(
        &self,
        range: Range<usize>,
    ) -> impl Iterator<Item = (&'a ChainPiece, &SampledPiece)> {
        let numbers = range.filter(|number| self.has_length(*number));
        numbers
            .filter_map(|number| Some((self.chain.pieces().get(number)?, self.pieces.get(number)?)))
    }

    /// Returns true if the piece has a length.
    pub(super) fn has_length(&self, number: usize) -> bool {
        let piece = self.chain.pieces().get(number);
        let sampled = self.pieces.get(number);
        piece.is_some_and(|piece| piece.length() > LENGTH_MIN)
            && sampled.is_some_and(|sampled| !sampled.samples.widened.is_empty())
    }
}

fn tighter(a: &QuantityLimits, b: &QuantityLimits) -> QuantityLimits {
    core::array::from_fn(|quantity| {
        core::array::from_fn(|order| a[quantity][order].min(b[quantity][order]))
    })
}
