//! The motions of a net: each is a planned path with its path clock. Built when a net is made ready (this allocates),
//! stepped by the real-time thread (this does not).

use rcc_core::axis::{AxisState, Phases};
use rcc_core::frame::{DeviceModel, PrepareFault, arm_at_rest};
use rcc_core::message::Joints;
use rcc_core::path::{
    LEGS_MAX, MotionBuilder, MotionFault, MotionLimits, MotionState, Motions, PathRequest,
    PathState, SpeedOverride,
};

use crate::goal;
use crate::path_clock::{CLOCK_WORDS, PathClock};
use crate::planned_path::speed_limits::BrakingLimits;
use crate::planned_path::{ArmStart, MotionSection, PathPoint, PlannedPath, ReducedBlend, build};

/// A motion along a path.
#[derive(Debug, Clone)]
pub struct Motion {
    planned_path: Box<PlannedPath>,
    /// Sections from rest to rest, in order; at least one.
    sections: Box<[MotionSection]>,
    section: usize,
    clock: PathClock,
    /// Set while a section with a time law is being stopped: the clock then counts the path parameter s directly
    /// instead of the time of the law.
    braking: Option<Braking>,
    /// Sum of the lengths of all sections, in units of the clock.
    length: f64,
}

/// State of a stop on a section with a time law.
#[derive(Debug, Clone, Copy)]
struct Braking {
    /// Value of the clock at which braking began.
    clock_value: f64,
    /// Index of the [`BrakingLimits`] in use.
    stop: usize,
}

/// Words saved per motion: section, value of the clock at which braking began, index of the braking limits, and the
/// clock.
const WORDS: usize = CLOCK_WORDS + 3;

impl Motion {
    fn reset(&mut self) {
        (self.section, self.clock, self.braking) = (0, PathClock::new(), None);
    }

    fn step(&mut self, speed_override: SpeedOverride) -> MotionState {
        let stopping = speed_override.stop || self.clock.last().stopping;
        if stopping && let Some(state) = self.brake() {
            return state;
        }
        let Some(section) = self.sections.get(self.section) else {
            return self.state(Default::default());
        };
        let MotionSection { begin, bounds, .. } = section;
        let timed = section.stops.is_some();
        if timed {
            self.clock.start_rolling(bounds, speed_override);
        }
        let mut path = self.clock.step(bounds, speed_override);
        let next = self.sections.get(self.section + 1);
        let end = next.map_or(self.length, |next| next.begin);
        if timed && path.s >= section.length {
            path = rest(path, section.length);
        }
        // The sum may exceed the beginning of the next section by one rounding error.
        path.s = (path.s + begin).min(end);
        if path.done && !path.stopping && self.section + 1 < self.sections.len() {
            // At rest between two sections: the next section begins in the next cycle.
            (self.section, self.clock) = (self.section + 1, PathClock::new());
            path.done = false;
        }
        self.state(path)
    }

    /// Stops on a section with a time law by counting the path parameter directly, as soon as the state satisfies a set
    /// of braking limits: the time law alone would keep accelerating while its time is slowed down.
    fn brake(&mut self) -> Option<MotionState> {
        let MotionSection { begin, stops, .. } = self.sections.get(self.section)?;
        let (begin, stops) = (*begin, stops.as_ref()?);
        let begin_s = self.planned_path.section_begin_s(begin);
        if self.braking.is_none() {
            let now = self.clock.last();
            let rates = [now.velocity, now.acceleration];
            let mut path_state = self.planned_path.path_state_at(begin + now.s, rates);
            path_state.position -= begin_s;
            let mut candidates = stops.iter();
            let allows = |stop: &BrakingLimits| {
                stop.begins_at(path_state.position) && stop.bounds.allows_stop(path_state)
            };
            let stop = candidates.position(allows).filter(|_| !now.done)?;
            let clock_value = begin + now.s;
            self.braking = Some(Braking { clock_value, stop });
            self.clock = PathClock::moving(path_state);
        }
        let Braking { clock_value, stop } = self.braking?;
        let path_state = self
            .clock
            .step(&stops.get(stop)?.bounds, SpeedOverride::STOP);
        let s = begin_s + path_state.s;
        let path = PathState {
            // Inverting the time law and evaluating it again is not exact.
            s: self.planned_path.clock_value_at(begin, s).max(clock_value),
            ..path_state
        };
        Some(self.at(path, self.planned_path.at_path_parameter(s)))
    }

    fn state(&self, path: PathState) -> MotionState {
        self.at(path, self.planned_path.at(path.s))
    }

    fn at(&self, path: PathState, point: PathPoint) -> MotionState {
        let progress = if self.length > 0.0 {
            path.s / self.length
        } else {
            1.0
        };
        MotionState {
            path,
            leg: point.leg,
            pose: point.pose,
            joints: point.joints,
            progress: progress.min(1.0),
            distance: point.distance,
            speed: path.velocity * point.metres_per_s,
            acceleration: path.acceleration * point.metres_per_s
                + path.velocity * path.velocity * point.speed_slope,
        }
    }
}

/// At the end of a time law the path is at rest, although its clock still moves.
fn rest(path: PathState, end: f64) -> PathState {
    PathState {
        s: end,
        velocity: 0.0,
        acceleration: 0.0,
        jerk: 0.0,
        done: true,
        ..path
    }
}

/// The motions of one net, in the order of the plan.
#[derive(Debug, Clone, Default)]
pub struct MotionSet(Vec<Motion>);

impl MotionSet {
    /// The blends that are smaller than requested, each with the index of its motion.
    pub fn shortened(&self) -> impl Iterator<Item = (usize, ReducedBlend)> {
        let motions = self.0.iter().enumerate();
        motions.flat_map(|(index, motion)| {
            let shortened = motion.planned_path.shortened().iter();
            shortened.map(move |shortened| (index, *shortened))
        })
    }

    /// Returns all motions to their start; does not allocate.
    pub fn reset(&mut self) {
        self.0.iter_mut().for_each(Motion::reset);
    }

    /// Number of words that [`MotionSet::save`] passes on.
    #[must_use]
    pub fn words(&self) -> usize {
        self.0.len() * WORDS
    }

    /// Passes the variable state of all motions to `each`, in pieces, for the flight recorder; does not allocate.
    pub fn save(&self, mut each: impl FnMut(&[u64])) {
        for motion in &self.0 {
            let braking = motion
                .braking
                .map(|of| [of.clock_value.to_bits(), of.stop as u64]);
            let [clock_value, stop] = braking.unwrap_or([f64::NAN.to_bits(), 0]);
            each(&[motion.section as u64, clock_value, stop]);
            each(&motion.clock.words());
        }
    }

    /// Restores the state that [`MotionSet::save`] gave. Returns `None` and changes nothing if the number of words
    /// belongs to other motions.
    pub fn restore(&mut self, words: &[u64]) -> Option<()> {
        let (motions, rest) = words.as_chunks::<WORDS>();
        if motions.len() != self.0.len() || !rest.is_empty() {
            return None;
        }
        for (motion, [section, clock_value, stop, clock @ ..]) in self.0.iter_mut().zip(motions) {
            // An invalid section number leaves the motion at its start.
            motion.section = usize::try_from(*section).unwrap_or(usize::MAX);
            let clock_value =
                Some(f64::from_bits(*clock_value)).filter(|clock_value| !clock_value.is_nan());
            motion.braking = clock_value.map(|clock_value| Braking {
                clock_value,
                stop: usize::try_from(*stop).unwrap_or(usize::MAX),
            });
            motion.clock = PathClock::from_words(clock);
        }
        Some(())
    }
}

impl Motions for MotionSet {
    fn step(&mut self, index: usize, speed_override: SpeedOverride) -> Option<MotionState> {
        self.0
            .get_mut(index)
            .map(|motion| motion.step(speed_override))
    }

    fn plan_axis(&mut self, from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
        goal::plan(from, goal, limits)
    }
}

/// Builds the motions of one net.
#[derive(Debug)]
pub struct MotionSetBuilder<'a> {
    models: &'a [DeviceModel],
    holds: &'a [Option<Joints>],
    dt_s: f64,
    motions: Vec<Option<Motion>>,
}

impl<'a> MotionSetBuilder<'a> {
    /// A builder for a net of `count` motions that is evaluated every `dt_s` (s), with arms at rest at `holds` (rad, by
    /// device; `None`: not known).
    #[must_use]
    pub fn new(
        models: &'a [DeviceModel],
        holds: &'a [Option<Joints>],
        dt_s: f64,
        count: u32,
    ) -> MotionSetBuilder<'a> {
        MotionSetBuilder {
            models,
            holds,
            dt_s,
            motions: vec![None; count as usize],
        }
    }

    /// Returns all motions.
    ///
    /// # Errors
    /// [`PrepareFault::Motion`] if a motion was not requested by any primitive.
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

impl MotionSetBuilder<'_> {
    fn motion(&self, request: &PathRequest<'_>) -> Result<Motion, MotionBuildFault> {
        let count = request.legs.len();
        if count == 0 || count > LEGS_MAX {
            let count = u32::try_from(count).unwrap_or(u32::MAX);
            return Err((0, MotionFault::Legs { count }).into());
        }
        let (arm, hold) = arm_at_rest(self.models, self.holds, request.device)?;
        let model = self.models.get(request.device as usize);
        let model = model.ok_or((0, MotionFault::NoMotion))?;
        let arm_start = ArmStart::starting(model, arm, hold, request.from);
        let arm_start = arm_start.map_err(|fault| (0, fault))?;
        let (planned_path, sections) = build(arm_start, (request.legs, request.pace), self.dt_s)?;
        let last = sections.last();
        Ok(Motion {
            length: last.map_or(0.0, |section| section.begin + section.length),
            planned_path: Box::new(planned_path),
            sections,
            section: 0,
            clock: PathClock::new(),
            braking: None,
        })
    }
}

/// Why a motion cannot be built.
enum MotionBuildFault {
    /// The arm or its hold set-point is not available.
    Arm(PrepareFault),
    /// Index of the leg and its fault.
    Leg(u32, MotionFault),
}

impl From<PrepareFault> for MotionBuildFault {
    fn from(fault: PrepareFault) -> Self {
        Self::Arm(fault)
    }
}

impl From<(u32, MotionFault)> for MotionBuildFault {
    fn from((leg, fault): (u32, MotionFault)) -> Self {
        Self::Leg(leg, fault)
    }
}

impl MotionBuilder for MotionSetBuilder<'_> {
    fn path(&mut self, index: u32, request: &PathRequest<'_>) -> Result<(), PrepareFault> {
        let fault = |leg, fault| PrepareFault::Motion {
            motion: index,
            leg,
            fault,
        };
        let motion = self.motion(request).map_err(|error| match error {
            MotionBuildFault::Arm(error) => error,
            MotionBuildFault::Leg(leg, error) => fault(leg, error),
        })?;
        let point = self.motions.get_mut(index as usize);
        *point.ok_or(fault(0, MotionFault::NoMotion))? = Some(motion);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
