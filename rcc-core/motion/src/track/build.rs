//! From legs to a track: shapes, the joints along them, roundings, and the limits of every piece.
//! Run when a command is made ready; allocates.

use core::ops::Range;

use rcc_core::frame::DeviceModel;
use rcc_core::kinematics::Arm;
use rcc_core::message::Joints;
use rcc_core::path::{Leg, MotionFault, Pace};
use rcc_core::pose::Pose;

use super::bounds::{self, Bounds, EVEN, Refused, Stop, TooFast, allowed};
use super::draft::{Draft, Zone, drafts};
use super::fastest::fastest;
use super::look::{Look, look};
use super::{Guide, Part, Section, Shortened, Stretch, Track};
use crate::geometry::NOTHING;
use crate::geometry::chain::{Chain, Link, Piece, Where};
use crate::path_clock::{PathBounds, PathPiece, duration_s};

/// Parts of a piece that may have velocity limits of their own.
const SPLIT: usize = 4;

/// What goes along a path.
#[derive(Clone, Copy)]
pub(crate) struct Traveller<'a> {
    /// Kinematics and limits of the arm.
    pub(crate) model: &'a DeviceModel,
    /// The same, as the model has it.
    pub(crate) arm: Arm,
    /// Joints at the start.
    pub(crate) joints: Joints,
    /// Flange at the start.
    pub(crate) pose: Pose,
}

/// A fault and the leg that has it.
pub(crate) type Fault = (u32, MotionFault);

/// Builds a track and its parts from rest to rest (one at least), for a cycle of `dt_s` (s).
///
/// # Errors
/// Legs that are no path, that the arm cannot follow, or not as fast as given.
pub(crate) fn build(
    traveller: Traveller<'_>,
    (legs, pace): (&[Leg<'_>], Pace),
    dt_s: f64,
) -> Result<(Track, Box<[Section]>), Fault> {
    let drafts = drafts(traveller, legs)?;
    let followed = drafts
        .iter()
        .zip(drafts.iter().skip(1).map(Some).chain([None]));
    let zones: Vec<_> = followed
        .map(|(draft, next)| draft.zones(next, traveller.arm))
        .collect();
    let links = drafts.iter().zip(&zones).map(|(draft, zones)| Link {
        shape: draft.shape.clone(),
        zone: zones.map(|zone| zone.way),
    });
    let chain = Chain::new(links.collect(), |link, shape, s| {
        let draft = drafts.get(link).ok_or((0, MotionFault::NoMotion))?;
        let jets = draft.jets(traveller, shape, s);
        jets.map_err(|fault| (draft.leg, fault))
    })?;
    let mut road = Road {
        traveller,
        chain: &chain,
        drafts: &drafts,
        seen: Vec::new(),
        dt_s,
    };
    road.look(pace)?;
    let (sections, stretches) = road.sections(pace)?;
    let mut begin_m = 0.0;
    let parts = road.seen.into_iter().map(|seen| {
        let part = Part {
            guide: seen.guide,
            begin_m,
            way_m: seen.look.way_m,
        };
        begin_m += seen.look.way_m;
        part
    });
    let track = Track {
        shortened: shortened(&drafts, &zones, &chain),
        arm: traveller.arm,
        parts: parts.collect(),
        legs: drafts.iter().map(|draft| draft.leg).collect(),
        stretches,
        chain,
    };
    Ok((track, sections))
}

/// The roundings that are smaller than asked for: a leg is too short, or the flange turns so far that there is none.
fn shortened(drafts: &[Draft], zones: &[[Zone; 2]], chain: &Chain) -> Box<[Shortened]> {
    let rounded = |link| {
        let mut pieces = chain.pieces().iter();
        pieces.any(|piece| piece.blend && piece.link == link)
    };
    // Nothing follows on the last one.
    let corners = drafts.len().saturating_sub(1);
    let corners = drafts.iter().zip(zones).enumerate().take(corners);
    let cut = corners.filter_map(|(link, (draft, [before, behind]))| {
        let made_m = before.metres.min(behind.metres);
        draft.shortened(if rounded(link) { made_m } else { 0.0 })
    });
    cut.collect()
}

/// What was seen along a piece.
pub(super) struct Seen {
    pub(super) look: Look,
    pub(super) bounds: Bounds,
    guide: Option<Guide>,
    given: bool,
}

/// A chain with all that was seen along it.
pub(super) struct Road<'a> {
    traveller: Traveller<'a>,
    pub(super) chain: &'a Chain,
    drafts: &'a [Draft],
    /// Of each piece.
    pub(super) seen: Vec<Seen>,
    pub(super) dt_s: f64,
}

/// Sections, and the same by what their clocks count.
type Sections = (Box<[Section]>, Box<[Stretch]>);

impl<'a> Road<'a> {
    /// Looks at all pieces.
    fn look(&mut self, pace: Pace) -> Result<(), Fault> {
        let mut joints = self.traveller.joints;
        for piece in self.chain.pieces() {
            let none = (0, MotionFault::NoMotion);
            let draft = self.drafts.get(piece.link).ok_or(none)?;
            let next = self.drafts.get(piece.link + 1).filter(|_| piece.blend);
            let mut look = look(self.traveller, piece, draft, &joints)?;
            joints = look.joints.last().copied().unwrap_or(joints);
            let on_flange = matches!(piece.at(piece.begin), Where::Flange(_));
            let elbow = draft.elbow_on(piece).filter(|_| on_flange);
            self.seen.push(Seen {
                guide: elbow.map(|elbow| Guide {
                    elbow,
                    joints: core::mem::take(&mut look.joints).into(),
                }),
                bounds: next.map_or(draft.bounds, |next| tighter(&draft.bounds, &next.bounds)),
                // Who wants to be there soonest gives a limit, no speed.
                given: draft.given && !piece.blend && matches!(pace, Pace::Even),
                look,
            });
        }
        Ok(())
    }

    /// The pieces from rest to rest that are any way at all.
    fn stretches(&self) -> Vec<Range<usize>> {
        let (mut all, mut first) = (Vec::new(), 0);
        let pieces = self.chain.pieces();
        for (number, piece) in pieces.iter().enumerate() {
            if piece.rest || number + 1 == pieces.len() {
                let range = first..number + 1;
                if range.clone().any(|number| self.is_way(number)) {
                    all.push(range);
                }
                first = number + 1;
            }
        }
        all
    }

    /// There is a way along this piece.
    pub(super) fn is_way(&self, number: usize) -> bool {
        let piece = self.chain.pieces().get(number);
        let seen = self.seen.get(number);
        piece.is_some_and(|piece| piece.length() > NOTHING)
            && seen.is_some_and(|seen| !seen.look.wide.is_empty())
    }

    /// Limits for each part of the path from rest to rest.
    fn sections(&self, pace: Pace) -> Result<Sections, Fault> {
        let (mut sections, mut stretches) = (Vec::new(), Vec::new());
        let mut begin = 0.0;
        for range in self.stretches() {
            let begin_s = self.chain.pieces().get(range.start);
            let begin_s = begin_s.map_or(0.0, |piece| piece.begin);
            let mut gather = Gather::default();
            for number in range.clone() {
                gather.add(self, number, begin_s);
            }
            let bounds = gather.even(self.dt_s)?;
            let by_law = match pace {
                Pace::Even => None,
                Pace::Fastest => fastest(self, range.clone(), duration_s(&bounds)),
            };
            let (bounds, stops, law) = match by_law {
                Some((law, by_law)) => (by_law, Some(gather.stops(bounds)), Some(law)),
                None => (bounds, None, None),
            };
            let length = law.as_ref().map_or(bounds.length(), |law| law.duration());
            sections.push(Section {
                begin,
                length,
                bounds,
                stops,
            });
            stretches.push(Stretch {
                begin,
                begin_s,
                law,
            });
            begin += length;
        }
        if sections.is_empty() {
            sections.push(self.nowhere()?);
        }
        if stretches.iter().all(|stretch| stretch.law.is_none()) {
            stretches.clear();
        }
        Ok((sections.into(), stretches.into()))
    }

    /// The section of a path that goes nowhere.
    fn nowhere(&self) -> Result<Section, Fault> {
        let piece = PathPiece {
            end_s: 0.0,
            velocity: 1.0,
        };
        let bounds = PathBounds::new(&[piece], 1.0, 1.0, self.dt_s);
        Ok(Section {
            begin: 0.0,
            length: 0.0,
            stops: None,
            bounds: bounds.map_err(|_| (0, MotionFault::NotFinite))?,
        })
    }
}

/// What is gathered for the limits of a part from rest to rest.
#[derive(Default)]
struct Gather<'a> {
    parts: Vec<bounds::Part>,
    ends: Vec<f64>,
    /// Where each part is: on what piece, of which leg, from where to where of it.
    owners: Vec<(&'a Piece, u32, [f64; 2])>,
}

impl<'a> Gather<'a> {
    /// Adds a piece; `begin` is where the part from rest to rest begins.
    fn add(&mut self, road: &Road<'a>, number: usize, begin: f64) {
        let (Some(piece), Some(seen)) = (road.chain.pieces().get(number), road.seen.get(number))
        else {
            return;
        };
        if !road.is_way(number) {
            return;
        }
        let leg = road.drafts.get(piece.link).map_or(0, |draft| draft.leg);
        let split = if seen.given { 1 } else { SPLIT };
        let steps = seen.look.wide.len() - 1;
        for part in 0..split {
            let (from, to) = (steps * part / split, steps * (part + 1) / split);
            self.parts.push(bounds::Part {
                samples: seen.look.wide.get(from..=to).unwrap_or(&[]).to_vec(),
                bounds: seen.bounds,
                given: seen.given,
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

    fn even(&self, dt_s: f64) -> Result<PathBounds, Fault> {
        let leg = self.owners.last().map_or(0, |(_, leg, _)| *leg);
        allowed(&self.parts, &self.ends, dt_s, &EVEN).map_err(|refused| match refused {
            Refused::TooFast(fast) => self.too_fast(fast),
            Refused::Clock => (leg, MotionFault::Limits),
        })
    }

    fn stops(&self, even: PathBounds) -> Box<[Stop]> {
        bounds::stops(&self.parts, &self.ends, even)
    }

    fn too_fast(&self, fast: TooFast) -> Fault {
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

fn tighter(a: &Bounds, b: &Bounds) -> Bounds {
    core::array::from_fn(|quantity| {
        core::array::from_fn(|order| a[quantity][order].min(b[quantity][order]))
    })
}
