//! The motions of a net: a path and its clock each. Built by whoever makes a net ready (it allocates there), stepped by
//! the real-time thread (it does not).

use rcc_core::axis::{AxisState, Phases};
use rcc_core::frame::{DeviceModel, PrepareFault, arm_at_rest};
use rcc_core::message::{JOINTS_MAX, Joints};
use rcc_core::path::{
    Drive, Limits, MotionBuilder, MotionFault, MotionState, Motions, PathRequest, Segment,
};
use rcc_core::types::NULL_REAL;

use crate::goal;
use crate::line::Line;
use crate::path_clock::{CLOCK_WORDS, PathBounds, PathClock};

/// A motion along a path.
#[derive(Debug, Clone)]
pub struct Motion {
    line: Line,
    bounds: PathBounds,
    clock: PathClock,
}

impl Motion {
    fn step(&mut self, drive: Drive) -> MotionState {
        let path = self.clock.step(&self.bounds, drive);
        let metres_per_s = self.line.metres_per_s();
        MotionState {
            path,
            leg: 0,
            pose: self.line.at(path.s),
            joints: [NULL_REAL; JOINTS_MAX],
            distance: path.s * metres_per_s,
            speed: path.velocity * metres_per_s,
            acceleration: path.acceleration * metres_per_s,
        }
    }
}

/// The motions of one net, in the order of its plan.
#[derive(Debug, Clone, Default)]
pub struct MotionSet(Vec<Motion>);

impl MotionSet {
    /// All of them back to their start; allocates nothing.
    pub fn reset(&mut self) {
        self.0.iter_mut().for_each(|motion| motion.clock.reset());
    }

    /// Number of words of [`MotionSet::save`].
    #[must_use]
    pub fn words(&self) -> usize {
        self.0.len() * CLOCK_WORDS
    }

    /// Gives what changes while they run, piece by piece, for the flight recorder; allocates nothing.
    pub fn save(&self, mut each: impl FnMut(&[u64])) {
        for motion in &self.0 {
            each(&motion.clock.words());
        }
    }

    /// Goes on from what [`MotionSet::save`] gave; `None`, and nothing changes, if the words are of other motions.
    pub fn restore(&mut self, words: &[u64]) -> Option<()> {
        let (clocks, rest) = words.as_chunks::<CLOCK_WORDS>();
        if clocks.len() != self.0.len() || !rest.is_empty() {
            return None;
        }
        for (motion, words) in self.0.iter_mut().zip(clocks) {
            motion.clock = PathClock::from_words(words);
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

impl MotionBuilder for Builder<'_> {
    fn path(&mut self, index: u32, request: &PathRequest<'_>) -> Result<(), PrepareFault> {
        let fault = |fault| PrepareFault::Motion {
            motion: index,
            leg: 0,
            fault,
        };
        let no_motion = fault(MotionFault::NoMotion);
        let place = self.motions.get_mut(index as usize).ok_or(no_motion)?;
        let start = match request.from {
            Some(pose) => pose,
            None => {
                let (arm, hold) = arm_at_rest(self.models, self.holds, request.device)?;
                arm.forward(&hold)
            }
        };
        let leg = request.legs.first().ok_or(no_motion)?;
        let Segment::Line { to } = leg.segment;
        let (line, limits) = Line::new(start, to, leg).map_err(fault)?;
        let bounds = PathBounds::of_limits(&limits, self.dt_s);
        let bounds = bounds.map_err(|_| fault(MotionFault::Limits { limits }))?;
        *place = Some(Motion {
            line,
            bounds,
            clock: PathClock::new(),
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests;
