//! The motions of a net: each is a planned path with its path clock. Built when a net is made ready (this allocates),
//! stepped by the real-time thread (this does not).

use rcc_core::axis::{AxisState, AxisTask, Phases, plan_together};
use rcc_core::path::{
    LegConditions, LegSignals, MotionLimits, MotionState, Motions, PathState, SpeedOverride,
};

use crate::after_until::{LineFromRest, RestPoint};
use crate::goal;
use crate::path_clock::{CLOCK_WORDS, PathBounds, PathClock};
use crate::planned_path::{
    MotionSection, PathPoint, PlannedPath, PlannedSection, ReducedBlend, SlowSection,
};

mod braking;
mod builder;

pub use builder::MotionSetBuilder;

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
    progress: LegProgress,
    /// Set while a leg is travelled from where `until` ended the leg before.
    line: Option<LineFromRest>,
    /// Limits of the clock on that line; allocated when the motion is built.
    line_bounds: PathBounds,
}

/// State of a stop on a section with a time law.
#[derive(Debug, Clone, Copy)]
struct Braking {
    /// Value of the clock at which braking began.
    clock_value: f64,
    /// Index of the [`BrakingLimits`] in use.
    stop: usize,
}

/// How far a motion is in its legs.
#[derive(Debug, Clone, Copy, Default)]
struct LegProgress {
    /// A stop was requested: the motion never begins another leg.
    stopped: bool,
    /// `until` is ending the current leg.
    ending: bool,
    /// The last leg with `until` that is over was ended by it.
    until_met: bool,
    /// Index of the leg of the last set-point.
    leg: u32,
    /// Distance that the flange travelled more than planned, because legs were ended early, m.
    detour_m: f64,
}

/// Words saved per motion: section, value of the clock at which braking began, index of the braking limits, progress of
/// the legs, detour, the point from which a line begins, and the clock.
const WORDS: usize = CLOCK_WORDS + 5 + LineFromRest::WORDS;

impl LegProgress {
    /// Everything but the detour, and whether a line is being travelled, in one word.
    fn word(&self, line: bool) -> u64 {
        u64::from(self.stopped)
            | u64::from(self.ending) << 1
            | u64::from(self.until_met) << 2
            | u64::from(line) << 3
            | u64::from(self.leg) << 32
    }

    /// Returns the progress of a word, and whether a line was being travelled.
    fn of(word: u64, detour_m: f64) -> (Self, bool) {
        let progress = Self {
            stopped: word & 1 != 0,
            ending: word & 2 != 0,
            until_met: word & 4 != 0,
            leg: (word >> 32) as u32,
            detour_m,
        };
        (progress, word & 8 != 0)
    }
}

impl Motion {
    fn reset(&mut self) {
        (self.section, self.clock, self.braking) = (0, PathClock::new(), None);
        (self.progress, self.line) = (LegProgress::default(), None);
    }

    /// The conditions that apply in this cycle.
    fn conditions(&self) -> LegConditions {
        let Some(section) = self.sections.get(self.section) else {
            return LegConditions::default();
        };
        let begun = self.clock.has_begun();
        let LegProgress {
            stopped,
            ending,
            leg,
            ..
        } = self.progress;
        let [first, last] = section.legs;
        let on_last_leg = if begun { leg >= last } else { first == last };
        let over = stopped || ending || self.clock.last().done;
        LegConditions {
            wait: section.wait.filter(|_| !begun && !over),
            until: section.until.filter(|_| on_last_leg && !over),
        }
    }

    /// Returns the state of this cycle; `None` if nothing leads from where a leg was ended to the goal of the next one: the
    /// net then ends with a fault, and the arm is held where it rests.
    fn step(&mut self, speed_override: SpeedOverride, signals: LegSignals) -> Option<MotionState> {
        let conditions = self.conditions();
        self.progress.stopped |= speed_override.stop;
        if !self.progress.stopped {
            if conditions.wait.is_some() && !signals.begin {
                return Some(self.waiting());
            }
            self.progress.ending |= conditions.until.is_some() && signals.end;
        }
        let speed_override = SpeedOverride {
            stop: self.progress.stopped || self.progress.ending,
            ..speed_override
        };
        let (mut path, point) = match self.line {
            Some(line) => self.step_line(&line, speed_override),
            None => {
                let (path, mut point) = self.step_planned(speed_override);
                point.distance += self.progress.detour_m;
                (path, point)
            }
        };
        path.stopping = self.progress.stopped;
        self.progress.leg = point.leg;
        let state = self.at(path, point);
        if path.done && !self.progress.stopped {
            return self.end_section(state);
        }
        Some(state)
    }

    /// One cycle on the planned path.
    fn step_planned(&mut self, speed_override: SpeedOverride) -> (PathState, PathPoint) {
        if speed_override.stop
            && let Some(state) = self.brake()
        {
            return state;
        }
        self.follow_section(speed_override)
    }

    /// One cycle of the clock of the present section.
    fn follow_section(&mut self, speed_override: SpeedOverride) -> (PathState, PathPoint) {
        let Some(section) = self.sections.get(self.section) else {
            let path = PathState::default();
            return (path, self.planned_path.at(path.s));
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
        (path, self.planned_path.at(path.s))
    }

    /// One cycle on a line from where `until` ended the leg before.
    fn step_line(
        &mut self,
        line: &LineFromRest,
        speed_override: SpeedOverride,
    ) -> (PathState, PathPoint) {
        let before = line.at(self.clock.last().s).pose;
        let path = self.clock.step(&self.line_bounds, speed_override);
        let (on_line, mut point) = self.on_line(line, path.s);
        self.progress.detour_m += before.distance_to(&point.pose);
        point.distance += self.progress.detour_m;
        let path = PathState {
            s: on_line.s,
            ..path
        };
        (path, point)
    }

    /// Position and point at clock value `s` of a line. The distance is that of the planned path up to the leg.
    fn on_line(&self, line: &LineFromRest, s: f64) -> (PathState, PathPoint) {
        let section = self.sections.get(self.section);
        let (begin, length) = section.map_or((0.0, 0.0), |it| (it.begin, it.length));
        let on_line = line.at(s);
        let fraction = if line.limits.length > 0.0 {
            s / line.limits.length
        } else {
            1.0
        };
        let point = PathPoint {
            pose: on_line.pose,
            joints: on_line.joints,
            leg: section.map_or(0, |section| section.legs[0]),
            distance: self.planned_path.at(begin).distance,
            metres_per_s: on_line.metres_per_s,
            speed_slope: 0.0,
        };
        let path = PathState {
            s: begin + length * fraction,
            ..PathState::default()
        };
        (path, point)
    }

    /// At rest at the beginning of the section, whose condition does not hold.
    fn waiting(&mut self) -> MotionState {
        let section = self.sections.get(self.section);
        let (begin, leg) = section.map_or((0.0, 0), |it| (it.begin, it.legs[0]));
        let (path, mut point) = match &self.line {
            Some(line) => self.on_line(line, 0.0),
            None => {
                let path = PathState {
                    s: begin,
                    ..PathState::default()
                };
                (path, self.planned_path.at(begin))
            }
        };
        point.leg = leg;
        point.distance += self.progress.detour_m;
        self.progress.leg = leg;
        MotionState {
            waiting: true,
            ..self.at(path, point)
        }
    }

    /// At rest at the end of a section, or where `until` ended it: the next section begins in the next cycle.
    fn end_section(&mut self, mut state: MotionState) -> Option<MotionState> {
        let Some(section) = self.sections.get(self.section) else {
            return Some(state);
        };
        let ending = self.progress.ending;
        if section.until.is_some() {
            self.progress.until_met = ending;
            state.until_met = self.progress.until_met;
        }
        let Some(next) = self.sections.get(self.section + 1) else {
            return Some(state);
        };
        let before_end = match &self.line {
            Some(line) => self.clock.last().s < line.limits.length,
            None => state.path.s < next.begin,
        };
        let early = ending && before_end;
        let line = next.after_until.as_ref().filter(|_| early);
        let line = line.and_then(|leg| {
            leg.from(RestPoint {
                joints: state.joints,
                pose: state.pose,
                clock_value: state.path.s,
            })
        });
        if early && line.is_none() {
            // The builder refuses legs that cannot follow.
            return None;
        }
        if early || self.line.is_some() {
            let planned_m = self.planned_path.at(next.begin).distance;
            self.progress.detour_m = state.distance - planned_m;
        }
        self.progress.ending = false;
        self.line = line;
        if let Some(line) = &self.line {
            self.line_bounds.become_line(&line.limits);
        }
        (self.section, self.clock, self.braking) = (self.section + 1, PathClock::new(), None);
        state.path.done = false;
        Some(state)
    }

    /// Restores the progress of the legs, and the line that is made from the point where it begins.
    fn restore_legs(&mut self, word: u64, detour_m: f64, line: &[u64; LineFromRest::WORDS]) {
        let (progress, on_line) = LegProgress::of(word, detour_m);
        let section = self.sections.get(self.section);
        let leg = section.and_then(|section| section.after_until.as_ref());
        let leg = leg.filter(|_| on_line);
        self.progress = progress;
        self.line = leg.and_then(|leg| leg.from(RestPoint::from_words(line)));
        if let Some(line) = &self.line {
            self.line_bounds.become_line(&line.limits);
        }
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
            waiting: false,
            until_met: self.progress.until_met,
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

    /// The sections that take much longer than their limits require, each with the index of its motion.
    pub fn slow(&self) -> impl Iterator<Item = (usize, SlowSection)> {
        let motions = self.0.iter().enumerate();
        motions.flat_map(|(index, motion)| {
            let slow = motion.planned_path.slow().iter();
            slow.map(move |slow| (index, *slow))
        })
    }

    /// The sections from rest to rest of all motions, each with the index of its motion.
    pub fn sections(&self) -> impl Iterator<Item = (usize, PlannedSection)> {
        let motions = self.0.iter().enumerate();
        motions.flat_map(|(index, motion)| {
            let sections = motion.sections.iter();
            sections.map(move |section| (index, section.planned()))
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
            let line = motion.line.as_ref().map(LineFromRest::words);
            let progress = motion.progress.word(line.is_some());
            let detour = motion.progress.detour_m.to_bits();
            each(&[motion.section as u64, clock_value, stop, progress, detour]);
            each(&line.unwrap_or_default());
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
        for (motion, words) in self.0.iter_mut().zip(motions) {
            let [section, clock_value, stop, progress, detour, rest @ ..] = words;
            let (line, clock) = rest.split_first_chunk::<{ LineFromRest::WORDS }>()?;
            let clock = clock.first_chunk::<CLOCK_WORDS>()?;
            // An invalid section number leaves the motion at its start.
            motion.section = usize::try_from(*section).unwrap_or(usize::MAX);
            let clock_value =
                Some(f64::from_bits(*clock_value)).filter(|clock_value| !clock_value.is_nan());
            motion.braking = clock_value.map(|clock_value| Braking {
                clock_value,
                stop: usize::try_from(*stop).unwrap_or(usize::MAX),
            });
            motion.clock = PathClock::from_words(clock);
            motion.restore_legs(*progress, f64::from_bits(*detour), line);
        }
        Some(())
    }
}

impl Motions for MotionSet {
    fn step(&mut self, index: usize, speed_override: SpeedOverride) -> Option<MotionState> {
        self.step_leg(index, speed_override, LegSignals::RUN)
    }

    fn leg_conditions(&self, index: usize) -> LegConditions {
        self.0
            .get(index)
            .map(Motion::conditions)
            .unwrap_or_default()
    }

    fn step_leg(
        &mut self,
        index: usize,
        speed_override: SpeedOverride,
        signals: LegSignals,
    ) -> Option<MotionState> {
        let motion = self.0.get_mut(index)?;
        motion.step(speed_override, signals)
    }

    fn plan_axis(&mut self, from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
        goal::plan(from, goal, limits)
    }

    fn plan_axes(&mut self, tasks: &[AxisTask], ways: &mut [Phases]) {
        let soonest = |task: &AxisTask| goal::plan(&task.from, task.goal, &task.limits);
        plan_together(tasks, ways, soonest, goal::plan_lasting);
    }
}

#[cfg(test)]
mod tests;
