//! The derivatives of flange and joints by the path parameter along a section, from its samples, for any position. Used
//! when a motion is built.

use core::ops::Range;

use super::super::sampled_path::{SampledPath, SampledPiece};
use super::super::speed_limits::QUANTITIES;

/// The first four derivatives of a quantity by s: magnitudes for translation and rotation, signed values for joints. The
/// fourth is the slope of the third between two samples.
pub(super) type Slopes = [f64; 4];

/// A quantity with finite limits.
#[derive(Debug, Clone, Copy)]
pub(super) struct LimitedQuantity {
    /// Index of the quantity.
    pub(super) index: usize,
    /// Reciprocal limits of velocity, acceleration and jerk; 0 if there is no limit.
    pub(super) over: [f64; 3],
}

impl LimitedQuantity {
    /// Only magnitudes of its derivatives are known.
    pub(super) fn is_magnitude(&self) -> bool {
        self.index < 2
    }
}

/// A piece of a section.
pub(super) struct TablePiece<'a> {
    begin: f64,
    end: f64,
    sampled: &'a SampledPiece,
    /// Its quantities with finite limits.
    pub(super) limited: Vec<LimitedQuantity>,
    /// Third derivatives of every quantity in the piece before, at its end, and in the piece behind, at its beginning.
    beside: [Option<[f64; QUANTITIES]>; 2],
}

/// The pieces of a section that have a length.
pub(super) struct SectionTable<'a> {
    pieces: Vec<TablePiece<'a>>,
}

impl<'a> SectionTable<'a> {
    /// The table of a range of pieces; `None` if none of them has a length.
    pub(super) fn new(path: &'a SampledPath<'_>, range: Range<usize>) -> Option<Self> {
        let pieces = path.with_length(range).map(|(piece, sampled)| {
            let over = |limits: &[f64; 3]| limits.map(|limit| 1.0 / limit);
            let limited = sampled.bounds.iter().map(over).enumerate();
            let limited = limited.map(|(index, over)| LimitedQuantity { index, over });
            TablePiece {
                begin: piece.begin,
                end: piece.end,
                sampled,
                beside: [None; 2],
                limited: limited
                    .filter(|limited| limited.over.iter().any(|over| *over > 0.0))
                    .collect(),
            }
        });
        let mut pieces: Vec<TablePiece<'_>> = pieces.collect();
        for number in 1..pieces.len() {
            let before = pieces[number - 1].third_at(false);
            let behind = pieces[number].third_at(true);
            pieces[number].beside[0] = Some(before);
            pieces[number - 1].beside[1] = Some(behind);
        }
        (!pieces.is_empty()).then_some(Self { pieces })
    }

    /// Path parameters at the beginning and the end.
    pub(super) fn ends(&self) -> [f64; 2] {
        let begin = self.pieces.first().map_or(0.0, |piece| piece.begin);
        [begin, self.pieces.last().map_or(begin, |piece| piece.end)]
    }

    /// The piece at path parameter s, the later one at a boundary.
    pub(super) fn piece(&self, s: f64) -> &TablePiece<'a> {
        let next = self.pieces.partition_point(|piece| piece.begin <= s);
        &self.pieces[next.saturating_sub(1)]
    }

    /// The shortest time in which a limited quantity builds up its greatest acceleration, s; infinite if none has both
    /// limits.
    pub(super) fn ramp_s(&self) -> f64 {
        let limited = self.pieces.iter().flat_map(|piece| &piece.limited);
        let times = limited.map(|limited| limited.over[2] / limited.over[1]);
        times
            .filter(|time| *time > 0.0)
            .fold(f64::INFINITY, f64::min)
    }
}

impl TablePiece<'_> {
    /// Third derivatives of every quantity at its beginning or its end.
    fn third_at(&self, begin: bool) -> [f64; QUANTITIES] {
        let samples = &self.sampled.samples;
        let step = if begin {
            0
        } else {
            samples.points.len().saturating_sub(1)
        };
        core::array::from_fn(|index| match index {
            0..2 => samples.points[step][index][2],
            joint => samples.jets[step][joint - 2].derivative(3),
        })
    }

    /// The third derivative jumps from piece to piece. If a boundary is nearer to `s` than the second `reach`: third
    /// derivatives of every quantity beyond it, the weight with which they apply at `s` as well, which is 1 within the first
    /// `reach`, and the derivative of the weight by s.
    pub(super) fn beside(
        &self,
        s: f64,
        [near, far]: [f64; 2],
    ) -> Option<(&[f64; QUANTITIES], [f64; 2])> {
        let gaps = [(s - self.begin, -1.0), (self.end - s, 1.0)];
        let mut beside = self.beside.iter().zip(gaps);
        let (third, (gap, sign)) =
            beside.find(|(beside, (gap, _))| beside.is_some() && *gap < far)?;
        let weight = match gap > near {
            true => [(far - gap) / (far - near), sign / (far - near)],
            false => [1.0, 0.0],
        };
        third.as_ref().map(|third| (third, weight))
    }

    /// The derivatives of its limited quantities at s, in order.
    pub(super) fn slopes(&self, s: f64, slopes: &mut [Slopes; QUANTITIES]) {
        let samples = &self.sampled.samples;
        let last = samples.points.len().saturating_sub(1).max(1);
        let per_step = last as f64 / (self.end - self.begin);
        let place = ((s - self.begin) * per_step).clamp(0.0, last as f64);
        let step = (place as usize).min(last - 1);
        let part = place - step as f64;
        for (slopes, limited) in slopes.iter_mut().zip(&self.limited) {
            let at = |step: usize| -> [f64; 3] {
                match limited.index {
                    index @ 0..2 => samples.points[step][index],
                    joint => {
                        let jet = &samples.jets[step][joint - 2];
                        [1, 2, 3].map(|order| jet.derivative(order))
                    }
                }
            };
            let (here, behind) = (at(step), at(step + 1));
            for order in 0..3 {
                slopes[order] = here[order] + (behind[order] - here[order]) * part;
            }
            slopes[3] = (behind[2] - here[2]) * per_step;
        }
    }
}
