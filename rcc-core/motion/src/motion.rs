//! The motions of a net: a path and its clock each. Built by whoever makes a net ready (it allocates there), stepped by
//! the real-time thread (it does not).

use rcc_core::axis::{AxisState, Phases};
use rcc_core::frame::{DeviceModel, PrepareFault, arm_at_rest};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::{
    Drive, LEGS_MAX, Limits, MotionBuilder, MotionFault, MotionState, Motions, PathRequest, Segment,
};
use rcc_core::types::NULL_REAL;

use crate::goal;
use crate::line::Line;
use crate::path_clock::{CLOCK_WORDS, PathBounds, PathClock};
use crate::track::{Place, Section, Track, Traveller, build};

/// What a motion follows.
#[derive(Debug, Clone)]
enum Path {
    /// One line, of which poses are given.
    Line(Line),
    /// Anything else, with joints.
    Track(Box<Track>),
}

/// A motion along a path.
#[derive(Debug, Clone)]
pub struct Motion {
    path: Path,
    /// Parts from rest to rest, in order; at least one.
    sections: Box<[Section]>,
    section: usize,
    clock: PathClock,
    /// s at the end.
    length: f64,
}

/// Words of one motion: the section and its clock.
const WORDS: usize = CLOCK_WORDS + 1;

impl Motion {
    fn reset(&mut self) {
        (self.section, self.clock) = (0, PathClock::new());
    }

    fn step(&mut self, drive: Drive) -> MotionState {
        let Some(Section { begin, bounds }) = self.sections.get(self.section) else {
            return self.state(Default::default());
        };
        let mut path = self.clock.step(bounds, drive);
        path.s += begin;
        if path.done && !path.stopping && self.section + 1 < self.sections.len() {
            // At rest between two sections: the next one begins with the next cycle.
            (self.section, self.clock) = (self.section + 1, PathClock::new());
            path.done = false;
        }
        self.state(path)
    }

    fn state(&self, path: rcc_core::path::PathState) -> MotionState {
        let place = match &self.path {
            Path::Line(line) => Place {
                pose: line.at(path.s),
                joints: [NULL_REAL; JOINTS_MAX],
                leg: 0,
                distance: path.s * line.metres_per_s(),
                metres_per_s: line.metres_per_s(),
            },
            Path::Track(track) => track.at(path.s),
        };
        let progress = if self.length > 0.0 {
            path.s / self.length
        } else {
            1.0
        };
        MotionState {
            path,
            leg: place.leg,
            pose: place.pose,
            joints: place.joints,
            progress: progress.min(1.0),
            distance: place.distance,
            speed: path.velocity * place.metres_per_s,
            acceleration: path.acceleration * place.metres_per_s,
        }
    }
}

/// The motions of one net, in the order of its plan.
#[derive(Debug, Clone, Default)]
pub struct MotionSet(Vec<Motion>);

impl MotionSet {
    /// All of them back to their start; allocates nothing.
    pub fn reset(&mut self) {
        self.0.iter_mut().for_each(Motion::reset);
    }

    /// Number of words of [`MotionSet::save`].
    #[must_use]
    pub fn words(&self) -> usize {
        self.0.len() * WORDS
    }

    /// Gives what changes while they run, piece by piece, for the flight recorder; allocates nothing.
    pub fn save(&self, mut each: impl FnMut(&[u64])) {
        for motion in &self.0 {
            each(&[motion.section as u64]);
            each(&motion.clock.words());
        }
    }

    /// Goes on from what [`MotionSet::save`] gave; `None`, and nothing changes, if the words are of other motions.
    pub fn restore(&mut self, words: &[u64]) -> Option<()> {
        let (motions, rest) = words.as_chunks::<WORDS>();
        if motions.len() != self.0.len() || !rest.is_empty() {
            return None;
        }
        for (motion, [section, clock @ ..]) in self.0.iter_mut().zip(motions) {
            // A section that there is not leaves the motion where it begins.
            motion.section = usize::try_from(*section).unwrap_or(usize::MAX);
            motion.clock = PathClock::from_words(clock);
        }
        Some(())
    }
}

impl Motions for MotionSet {
    fn step(&mut self, index: usize, drive: Drive) -> Option<MotionState> {
        self.0.get_mut(index).map(|motion| motion.step(drive))
    }

    fn way(&mut self, from: &AxisState, goal: f64, limits: &Limits) -> Phases {
        goal::plan(from, goal, limits)
    }
}

/// Builds the motions of one net.
#[derive(Debug)]
pub struct Builder<'a> {
    models: &'a [DeviceModel],
    holds: &'a [Option<Joints>],
    dt_s: f64,
    motions: Vec<Option<Motion>>,
}

impl<'a> Builder<'a> {
    /// For a net of `count` motions that is evaluated every `dt_s` (s), with arms that rest at `holds`.
    #[must_use]
    pub fn new(
        models: &'a [DeviceModel],
        holds: &'a [Option<Joints>],
        dt_s: f64,
        count: u32,
    ) -> Builder<'a> {
        Builder {
            models,
            holds,
            dt_s,
            motions: vec![None; count as usize],
        }
    }

    /// All motions.
    ///
    /// # Errors
    /// A motion that no primitive asked for.
    pub fn finish(self) -> Result<MotionSet, PrepareFault> {
        let motions = self.motions.into_iter().zip(0..);
        let motions = motions.map(|(built, motion)| {
            built.ok_or(PrepareFault::Motion {
                motion,
                leg: 0,
                fault: MotionFault::NoMotion,
            })
        });
        Ok(MotionSet(motions.collect::<Result<_, _>>()?))
    }
}

impl Builder<'_> {
    /// Flange line of which only poses are asked for.
    fn line(&self, request: &PathRequest<'_>) -> Result<Motion, Fault> {
        let leg = request.legs.first().ok_or((0, MotionFault::NoMotion))?;
        let Segment::Line { to } = leg.segment else {
            return Err((0, MotionFault::NoMotion).into());
        };
        let start = match request.from {
            Some(pose) => pose,
            None => {
                let (arm, hold) = arm_at_rest(self.models, self.holds, request.device)?;
                arm.forward(&hold)
            }
        };
        let (line, limits) = Line::new(start, to, leg).map_err(|fault| (0, fault))?;
        let bounds = PathBounds::of_limits(&limits, self.dt_s);
        let bounds = bounds.map_err(|_| (0, MotionFault::Limits { limits }))?;
        let section = Section { begin: 0.0, bounds };
        Ok(Motion {
            path: Path::Line(line),
            sections: [section].into(),
            section: 0,
            clock: PathClock::new(),
            length: limits.length,
        })
    }

    /// Any path, with joints.
    fn track(&self, request: &PathRequest<'_>) -> Result<Motion, Fault> {
        let count = request.legs.len();
        if count == 0 || count > LEGS_MAX {
            let count = u32::try_from(count).unwrap_or(u32::MAX);
            return Err((0, MotionFault::Legs { count }).into());
        }
        let (arm, joints) = arm_at_rest(self.models, self.holds, request.device)?;
        let model = self.models.get(request.device as usize);
        let traveller = Traveller {
            model: model.ok_or((0, MotionFault::NoMotion))?,
            arm,
            joints,
            pose: arm.forward(&joints),
        };
        let (track, sections) = build(traveller, request.legs, self.dt_s)?;
        Ok(Motion {
            length: track.length(),
            path: Path::Track(Box::new(track)),
            sections,
            section: 0,
            clock: PathClock::new(),
        })
    }
}

/// Why a motion cannot be made.
enum Fault {
    /// The arm.
    Arm(PrepareFault),
    /// A leg.
    Leg(u32, MotionFault),
}

impl From<PrepareFault> for Fault {
    fn from(fault: PrepareFault) -> Self {
        Self::Arm(fault)
    }
}

impl From<(u32, MotionFault)> for Fault {
    fn from((leg, fault): (u32, MotionFault)) -> Self {
        Self::Leg(leg, fault)
    }
}

impl MotionBuilder for Builder<'_> {
    fn path(&mut self, index: u32, request: &PathRequest<'_>) -> Result<(), PrepareFault> {
        let fault = |leg, fault| PrepareFault::Motion {
            motion: index,
            leg,
            fault,
        };
        let built = if request.joints {
            self.track(request)
        } else {
            self.line(request)
        };
        let motion = built.map_err(|error| match error {
            Fault::Arm(error) => error,
            Fault::Leg(leg, error) => fault(leg, error),
        })?;
        let place = self.motions.get_mut(index as usize);
        *place.ok_or(fault(0, MotionFault::NoMotion))? = Some(motion);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
