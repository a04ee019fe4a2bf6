//! From legs to a track: shapes, the joints along them, roundings, and the limits of every piece.
//! Run when a command is made ready; allocates.

use rcc_core::frame::DeviceModel;
use rcc_core::kinematics::Arm;
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::{Leg, MotionFault};
use rcc_core::pose::Pose;
use rcc_core::vector;

use super::bounds::{self, Bounds, Refused, Sample, TooFast, allowed, widen};
use super::draft::{Draft, drafts};
use super::sampling::derivatives;
use super::walk::Follower;
use super::{Guide, Part, STEPS, Section, Track};
use crate::geometry::NOTHING;
use crate::geometry::chain::{Chain, Link, Piece, Shape, Where};
use crate::geometry::jet::{Jet, Scalar};
use crate::path_clock::{PathBounds, PathPiece};

/// Most steps in which one piece is looked at.
const STEPS_MAX: usize = 2048;

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
    legs: &[Leg<'_>],
    dt_s: f64,
) -> Result<(Track, Box<[Section]>), Fault> {
    let drafts = drafts(traveller, legs)?;
    let links = drafts
        .iter()
        .zip(drafts.iter().skip(1).map(Some).chain([None]));
    let links = links.map(|(draft, next)| Link {
        shape: draft.shape.clone(),
        zone: draft.zones(next, traveller.arm),
    });
    let chain = Chain::new(links.collect(), |link, shape, s| {
        let draft = drafts.get(link).ok_or((0, MotionFault::NoMotion))?;
        let jets = draft.jets(traveller, shape, s);
        jets.map_err(|fault| (draft.leg, fault))
    })?;
    let mut seen = Vec::new();
    let mut joints = traveller.joints;
    for piece in chain.pieces() {
        let piece = look(traveller, piece, &drafts, &mut joints)?;
        seen.push(piece);
    }
    let sections = sections(&chain, &seen, &drafts, dt_s)?;
    let mut begin_m = 0.0;
    let parts = seen.into_iter().map(|seen| {
        let part = Part {
            guide: seen.guide,
            begin_m,
            way_m: seen.way_m,
        };
        begin_m += seen.way_m;
        part
    });
    let track = Track {
        arm: traveller.arm,
        parts: parts.collect(),
        legs: drafts.iter().map(|draft| draft.leg).collect(),
        chain,
    };
    Ok((track, sections))
}

/// What was seen along a piece.
struct Seen {
    guide: Option<Guide>,
    samples: Vec<Sample>,
    bounds: Bounds,
    given: bool,
    way_m: f64,
}

/// Steps for a piece.
fn steps(piece: &Piece) -> usize {
    match &piece.shape {
        Shape::Spline(spline) => (spline.points().len() * STEPS / 4).clamp(STEPS, STEPS_MAX),
        _ => STEPS,
    }
}

/// Looks at a piece; `joints` are those before it, and become those behind it.
fn look(
    traveller: Traveller<'_>,
    piece: &Piece,
    drafts: &[Draft],
    joints: &mut Joints,
) -> Result<Seen, Fault> {
    let draft = drafts.get(piece.link).ok_or((0, MotionFault::NoMotion))?;
    let next = drafts.get(piece.link + 1).filter(|_| piece.blend);
    let mut seen = Seen {
        guide: None,
        samples: Vec::new(),
        bounds: next.map_or(draft.bounds, |next| tighter(&draft.bounds, &next.bounds)),
        given: draft.given && !piece.blend,
        way_m: 0.0,
    };
    let steps = steps(piece);
    let step = piece.length() / steps as f64;
    let places = (0..=steps).map(|number| piece.begin + step * number as f64);
    let mut samples: Vec<Sample> = Vec::with_capacity(steps + 1);
    if let Where::Joints(_) = piece.at(piece.begin) {
        let mut last: Option<Pose> = None;
        for s in places {
            let Where::Joints(jets) = piece.at(Jet::variable(s)) else {
                continue;
            };
            *joints = jets.map(Scalar::value);
            let pose = traveller.arm.forward(joints);
            seen.way_m += last.map_or(0.0, |last| last.distance_to(&pose));
            last = Some(pose);
            samples.push(sample([[0.0; 3]; 2], &jets));
        }
        seen.samples = widen(&samples);
        return Ok(seen);
    }
    let configuration = draft
        .configuration
        .ok_or((draft.leg, MotionFault::NoMotion))?;
    let follower = Follower {
        arm: traveller.arm,
        model: traveller.model,
        configuration,
    };
    let fault = |fault: MotionFault| (draft.leg, fault.at(|fraction| piece.of_shape(fraction)));
    let span = (piece.begin, piece.end);
    let walked = follower
        .walk(|s| piece.at(s), span, joints, steps)
        .map_err(fault)?;
    if piece.length() > NOTHING {
        for (s, jets) in places.zip(derivatives(&walked, step)) {
            let Where::Flange(place) = piece.at(Jet::variable(s)) else {
                continue;
            };
            let rates = place.rates();
            let lengths = [rates.linear, rates.angular].map(|rates| rates.map(vector::norm));
            samples.push(sample(lengths, &jets));
        }
    }
    let mut speeds = samples.iter().map(|[[speed, ..], ..]| speed);
    let sum: f64 = speeds.clone().sum();
    let ends: f64 = speeds.clone().take(1).chain(speeds.next_back()).sum();
    // Exact where the speed is the same everywhere.
    let way_m = (sum - ends / 2.0) * step;
    seen.way_m = piece
        .shape
        .constant_speed()
        .map_or(way_m, |speed| speed * piece.length());
    *joints = walked.last().copied().unwrap_or(*joints);
    seen.samples = widen(&samples);
    seen.guide = Some(Guide {
        configuration,
        joints: walked.into(),
    });
    Ok(seen)
}

fn sample([line, turn]: [[f64; 3]; 2], jets: &[Jet; JOINTS_MAX]) -> Sample {
    let mut sample = [[0.0; 3]; bounds::QUANTITIES];
    (sample[0], sample[1]) = (line, turn);
    for (place, jet) in sample.iter_mut().skip(2).zip(jets) {
        *place = [1, 2, 3].map(|order| jet.derivative(order).abs());
    }
    sample
}

fn tighter(a: &Bounds, b: &Bounds) -> Bounds {
    core::array::from_fn(|quantity| {
        core::array::from_fn(|order| a[quantity][order].min(b[quantity][order]))
    })
}

/// Limits for each part of the path from rest to rest.
fn sections(
    chain: &Chain,
    seen: &[Seen],
    drafts: &[Draft],
    dt_s: f64,
) -> Result<Box<[Section]>, Fault> {
    let mut sections = Vec::new();
    let mut begin = 0.0;
    let (mut parts, mut ends, mut owners) = (Vec::new(), Vec::new(), Vec::new());
    for (number, (piece, seen)) in chain.pieces().iter().zip(seen).enumerate() {
        let leg = drafts.get(piece.link).map_or(0, |draft| draft.leg);
        if piece.length() > NOTHING && !seen.samples.is_empty() {
            let split = if seen.given { 1 } else { SPLIT };
            let steps = seen.samples.len() - 1;
            for part in 0..split {
                let (from, to) = (steps * part / split, steps * (part + 1) / split);
                parts.push(bounds::Part {
                    samples: seen.samples.get(from..=to).unwrap_or(&[]).to_vec(),
                    bounds: seen.bounds,
                    given: seen.given,
                });
                let end = if part + 1 == split {
                    piece.end
                } else {
                    piece.begin + piece.length() * to as f64 / steps as f64
                };
                ends.push(end - begin);
                owners.push((
                    piece,
                    leg,
                    [from, to].map(|step| step as f64 / steps as f64),
                ));
            }
        }
        if !piece.rest && number + 1 < seen_len(chain) {
            continue;
        }
        if !parts.is_empty() {
            let bounds = allowed(&parts, &ends, dt_s).map_err(|refused| match refused {
                Refused::TooFast(fast) => too_fast(fast, &owners),
                Refused::Clock => (leg, MotionFault::NotFinite),
            })?;
            sections.push(Section { begin, bounds });
        }
        begin = piece.end;
        (parts, ends, owners) = (Vec::new(), Vec::new(), Vec::new());
    }
    if sections.is_empty() {
        let nowhere = PathPiece {
            end_s: 0.0,
            velocity: 1.0,
        };
        let bounds = PathBounds::new(&[nowhere], 1.0, 1.0, dt_s);
        let bounds = bounds.map_err(|_| (0, MotionFault::NotFinite))?;
        sections.push(Section { begin: 0.0, bounds });
    }
    Ok(sections.into())
}

fn seen_len(chain: &Chain) -> usize {
    chain.pieces().len()
}

fn too_fast(fast: TooFast, owners: &[(&Piece, u32, [f64; 2])]) -> Fault {
    let Some((piece, leg, [from, to])) = owners.get(fast.part) else {
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
