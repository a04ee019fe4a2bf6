//! Builds a planned path from legs: shapes, joints along them, blends, and the limits of every piece. Run when a
//! command is made ready; allocates.

use core::ops::Range;

use rcc_core::path::{Leg, MotionFault, SpeedProfile};

use super::leg_shape::{BlendZone, LegShape, leg_shapes};
use super::sampled_path::SampledPath;
use super::slow_section::{REPORTED, SlowSection, limiting_place};
use super::speed_limits::{self, BrakingLimits, LimitsFault, TooFast, fastest_bounds};
use super::time_optimal::{adapted_law, possible_duration_s, time_optimal_law};
use super::{
    ArmStart, LawStops, LegFault, MotionSection, PieceKinematics, PlannedPath, ReducedBlend,
    TimeScaling, TimedSection,
};
use crate::geometry::chain::{Chain, ChainLink, ChainPiece};
use crate::path_clock::{PathBounds, PathPiece, duration_s};

/// Parts of a piece that may have separate velocity limits.
const SPLIT: usize = 4;

/// Builds a path and its sections from rest to rest (at least one), for a cycle of `dt_s` (s).
///
/// # Errors
/// Returns the fault and its leg if legs do not define a path, or the arm cannot follow them, or not at the given
/// speed.
pub(crate) fn build(
    arm_start: ArmStart<'_>,
    (legs, pace): (&[Leg<'_>], SpeedProfile),
    dt_s: f64,
) -> Result<(PlannedPath, Box<[MotionSection]>), LegFault> {
    let leg_shapes = leg_shapes(arm_start, legs)?;
    let followed = leg_shapes
        .iter()
        .zip(leg_shapes.iter().skip(1).map(Some).chain([None]));
    let zones: Vec<_> = followed
        .map(|(leg_shape, next)| leg_shape.zones(next, arm_start.arm))
        .collect();
    let links = leg_shapes
        .iter()
        .zip(&zones)
        .map(|(leg_shape, zones)| ChainLink {
            shape: leg_shape.shape.clone(),
            zone: zones.map(|zone| zone.way),
        });
    let chain = Chain::new(links.collect(), |link, shape, s| {
        let leg_shape = leg_shapes.get(link).ok_or((0, MotionFault::NoMotion))?;
        let jets = leg_shape.jets(arm_start, shape, s);
        jets.map_err(|fault| (leg_shape.leg, fault))
    })?;
    let path = SampledPath::new((arm_start, dt_s), (&chain, &leg_shapes), pace)?;
    // Conditions apply to legs without a length, too.
    let with_empty = legs
        .iter()
        .any(|leg| leg.wait.is_some() || leg.until.is_some());
    let (sections, timed_sections, slow) = path.sections(pace, with_empty)?;
    let mut distance_before_m = 0.0;
    let parts = path.pieces.into_iter().map(|sampled| {
        let part = PieceKinematics {
            inverse_hints: sampled.inverse_hints,
            distance_before_m,
            length_m: sampled.samples.length_m,
        };
        distance_before_m += sampled.samples.length_m;
        part
    });
    let planned_path = PlannedPath {
        shortened: shortened(&leg_shapes, &zones, &chain),
        arm: arm_start.arm,
        parts: parts.collect(),
        legs: leg_shapes.iter().map(|leg_shape| leg_shape.leg).collect(),
        timed_sections,
        chain,
        slow,
    };
    Ok((planned_path, sections))
}

/// The blends that are smaller than requested, because a leg is too short or the flange turns too far for a blend.
fn shortened(
    leg_shapes: &[LegShape],
    zones: &[[BlendZone; 2]],
    chain: &Chain,
) -> Box<[ReducedBlend]> {
    let rounded = |link| {
        let mut pieces = chain.pieces().iter();
        pieces.any(|piece| piece.blend && piece.link == link)
    };
    // No leg follows the last one.
    let corners = leg_shapes.len().saturating_sub(1);
    let corners = leg_shapes.iter().zip(zones).enumerate().take(corners);
    let cut = corners.filter_map(|(link, (leg_shape, [before, behind]))| {
        let made_m = before.metres.min(behind.metres);
        leg_shape.shortened(if rounded(link) { made_m } else { 0.0 })
    });
    cut.collect()
}

/// The sections, their mappings from clock values to s, and those that are slow.
type BuiltSections = (
    Box<[MotionSection]>,
    Box<[TimedSection]>,
    Box<[SlowSection]>,
);

impl SampledPath<'_> {
    /// Computes the clock limits of each section from rest to rest; `with_empty` keeps those of length 0.
    fn sections(&self, pace: SpeedProfile, with_empty: bool) -> Result<BuiltSections, LegFault> {
        let (mut sections, mut timed_sections, mut slow) = (Vec::new(), Vec::new(), Vec::new());
        let mut begin = 0.0;
        for range in self.section_ranges(with_empty) {
            let legs = self.legs_of(&range);
            if !range.clone().any(|number| self.has_length(number)) {
                sections.push(self.nowhere(begin, legs)?);
                continue;
            }
            let begin_s = self.chain.pieces().get(range.start);
            let begin_s = begin_s.map_or(0.0, |piece| piece.begin);
            let mut section_parts = SectionParts::default();
            for number in range.clone() {
                section_parts.add(self, number, begin_s);
            }
            let bounds = section_parts.uniform_bounds(self.dt_s)?;
            let timed = match pace {
                SpeedProfile::Uniform => None,
                SpeedProfile::Adaptive if section_parts.given() => {
                    slow.extend(section_parts.slow(self, range.clone(), &bounds));
                    None
                }
                SpeedProfile::Adaptive => adapted_law(self, range.clone(), &bounds),
                SpeedProfile::TimeOptimal(reserve) => {
                    time_optimal_law(self, range.clone(), &bounds, reserve)
                }
            };
            let time_scaling =
                (timed.as_ref()).map_or(TimeScaling::Even, |timed| timed.time_scaling);
            let (bounds, stops, time_law) = match timed {
                Some(timed) => {
                    let stops = LawStops {
                        anywhere: section_parts.stops(bounds),
                        on_law: timed.on_law,
                        wait_cycles: timed.wait_cycles,
                    };
                    (timed.bounds, Some(stops), Some(timed.time_law))
                }
                None => (bounds, None, None),
            };
            let length = time_law
                .as_ref()
                .map_or(bounds.length(), |time_law| time_law.duration());
            sections.push(MotionSection {
                begin,
                length,
                bounds,
                stops,
                time_scaling,
                legs,
                wait: None,
                until: None,
                after_until: None,
            });
            timed_sections.push(TimedSection {
                begin,
                begin_s,
                time_law,
            });
            begin += length;
        }
        if sections.is_empty() {
            let pieces = self.chain.pieces().len();
            sections.push(self.nowhere(0.0, self.legs_of(&(0..pieces)))?);
        }
        if timed_sections
            .iter()
            .all(|timed_section| timed_section.time_law.is_none())
        {
            timed_sections.clear();
        }
        Ok((sections.into(), timed_sections.into(), slow.into()))
    }

    /// Indices of the first and the last leg of a range of pieces.
    fn legs_of(&self, range: &Range<usize>) -> [u32; 2] {
        let leg = |number: usize| {
            let piece = self.chain.pieces().get(number)?;
            self.leg_shapes.get(piece.link).map(|shape| shape.leg)
        };
        [range.start, range.end.saturating_sub(1)].map(|number| leg(number).unwrap_or(0))
    }

    /// A section of length 0.
    fn nowhere(&self, begin: f64, legs: [u32; 2]) -> Result<MotionSection, LegFault> {
        let piece = PathPiece {
            end_s: 0.0,
            velocity: 1.0,
        };
        let bounds = PathBounds::new(&[piece], 1.0, 1.0, self.dt_s);
        Ok(MotionSection {
            begin,
            length: 0.0,
            stops: None,
            time_scaling: TimeScaling::Even,
            legs,
            wait: None,
            until: None,
            after_until: None,
            bounds: bounds.map_err(|_| (0, MotionFault::NotFinite))?,
        })
    }
}

/// Collects the parts of a section from rest to rest, from which its limits are computed.
#[derive(Default)]
struct SectionParts<'a> {
    parts: Vec<speed_limits::SampledPart>,
    ends: Vec<f64>,
    /// For each part: its piece, the leg, and the fractions of the piece at which it begins and ends.
    owners: Vec<(&'a ChainPiece, u32, [f64; 2])>,
}

impl<'a> SectionParts<'a> {
    /// Adds a piece; `begin` is the path parameter at which the section begins.
    fn add(&mut self, path: &SampledPath<'a>, number: usize, begin: f64) {
        let (Some(piece), Some(sampled)) =
            (path.chain.pieces().get(number), path.pieces.get(number))
        else {
            return;
        };
        if !path.has_length(number) {
            return;
        }
        let leg = path
            .leg_shapes
            .get(piece.link)
            .map_or(0, |leg_shape| leg_shape.leg);
        let split = if sampled.given { 1 } else { SPLIT };
        let steps = sampled.samples.widened.len() - 1;
        for part in 0..split {
            let (from, to) = (steps * part / split, steps * (part + 1) / split);
            self.parts.push(speed_limits::SampledPart {
                samples: sampled
                    .samples
                    .widened
                    .get(from..=to)
                    .unwrap_or(&[])
                    .to_vec(),
                bounds: sampled.bounds,
                given: sampled.given,
            });
            let end = if part + 1 == split {
                piece.end
            } else {
                piece.begin + piece.length() * to as f64 / steps as f64
            };
            self.ends.push(end - begin);
            let place = [from, to].map(|step| step as f64 / steps as f64);
            self.owners.push((piece, leg, place));
        }
    }

    /// Returns true if the speed of a part is given.
    fn given(&self) -> bool {
        self.parts.iter().any(|part| part.given)
    }

    fn uniform_bounds(&self, dt_s: f64) -> Result<PathBounds, LegFault> {
        let leg = self.owners.last().map_or(0, |(_, leg, _)| *leg);
        fastest_bounds(&self.parts, &self.ends, dt_s).map_err(|refused| match refused {
            LimitsFault::TooFast(fast) => self.too_fast(fast),
            LimitsFault::Clock => (leg, MotionFault::Limits),
        })
    }

    fn stops(&self, uniform: PathBounds) -> Box<[BrakingLimits]> {
        speed_limits::braking_limits(&self.parts, &self.ends, uniform)
    }

    /// Why the section takes much longer than its limits require, if it does.
    fn slow(
        &self,
        path: &SampledPath<'_>,
        range: Range<usize>,
        bounds: &PathBounds,
    ) -> Option<SlowSection> {
        let takes_s = duration_s(bounds);
        // A law does not exceed the given speed either.
        if speed_limits::at_given_speed_s(&self.parts, &self.ends) >= REPORTED * takes_s {
            return None;
        }
        let possible_s = possible_duration_s(path, range, REPORTED * takes_s)?;
        let place = limiting_place(&self.parts, &self.ends, bounds)?;
        let (piece, leg, [from, to]) = self.owners.get(place.part)?;
        Some(SlowSection {
            leg: *leg,
            fraction: piece.of_shape(from + (to - from) * place.fraction),
            quantity: place.quantity,
            order: place.order,
            takes_s,
            possible_s,
        })
    }

    fn too_fast(&self, fast: TooFast) -> LegFault {
        let Some((piece, leg, [from, to])) = self.owners.get(fast.part) else {
            return (0, MotionFault::NoMotion);
        };
        let fault = MotionFault::TooFast {
            fraction: piece.of_shape(from + (to - from) * fast.fraction),
            quantity: fast.quantity,
            order: fast.order,
            value: fast.value,
            limit: fast.limit,
            possible: fast.possible,
        };
        (*leg, fault)
    }
}
