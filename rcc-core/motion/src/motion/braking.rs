//! A stop on a section with a time law that keeps a reserve. Run by the real-time thread.
//!
//! A stop counts the path parameter directly: the time law alone would keep accelerating while its time is slowed down. It
//! begins as soon as a set of braking limits allows it; until then the time of the law slows down, as in a pause. While the
//! law is followed at full speed, the stops that were checked for its states are harder than those for any state, and worth
//! waiting for: a few cycles, or as long as it takes if the law reserves hardly anything.

use rcc_core::axis::AxisState;
use rcc_core::path::{PathState, SpeedOverride};

use super::{Braking, Motion};
use crate::path_clock::PathClock;
use crate::planned_path::speed_limits::BrakingLimits;
use crate::planned_path::{LawStops, MotionSection, PathPoint};

/// Distance from a whole number of cycles, in cycles, within which the law reaches the state of a checked stop.
const CYCLE_TOLERANCE: f64 = 1e-7;

/// Distance of the speed of a clock from that of its law, 1, and of its acceleration from 0, at which it follows the law.
const FOLLOWS: f64 = 1e-9;

/// How a stop begins.
enum StopBeginning {
    /// In this cycle, from a state, with the limits of an index.
    Now(usize, AxisState),
    /// The law is followed for another cycle.
    Later,
}

/// A stop that was checked for a state of the law.
struct StopOnLaw {
    index: usize,
    /// Time until the law is in that state, s; 0: it is.
    after_s: f64,
    /// Duration from then on, s.
    duration_s: f64,
}

impl Motion {
    /// One cycle of a stop on a section with a time law; `None` if no braking limits allow one yet.
    pub(super) fn brake(&mut self) -> Option<(PathState, PathPoint)> {
        let section = self.sections.get(self.section)?;
        let begin = section.begin;
        let begin_s = self.planned_path.section_begin_s(begin);
        let stops = section.stops.as_ref()?;
        if self.braking.is_none() {
            match self.stop_beginning(section, stops)? {
                StopBeginning::Later => return Some(self.follow_section(SpeedOverride::RUN)),
                StopBeginning::Now(stop, state) => {
                    let clock_value = begin + self.clock.last().s;
                    self.braking = Some(Braking { clock_value, stop });
                    self.clock = PathClock::moving(state);
                }
            }
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
        Some((path, self.planned_path.at_path_parameter(s)))
    }

    /// The shortest stop, if there is one.
    fn stop_beginning(&self, section: &MotionSection, stops: &LawStops) -> Option<StopBeginning> {
        let now = self.clock.last();
        if now.done {
            return None;
        }
        let here = self.section_state(section, now.s, [now.velocity, now.acceleration]);
        let allows =
            |stop: &BrakingLimits| stop.begins_at(here.position) && stop.bounds.allows_stop(here);
        let anywhere = stops.anywhere.iter().position(allows);
        let limits = anywhere.and_then(|index| stops.anywhere.get(index));
        let anywhere_s = limits.map_or(f64::INFINITY, |limits| limits.stop_duration_s(here));
        let on_law = self.stop_on_law(section, stops, (now, here.position));
        match on_law.filter(|stop| stop.after_s + stop.duration_s < anywhere_s) {
            Some(stop) if stop.after_s > 0.0 => Some(StopBeginning::Later),
            Some(stop) => Some(StopBeginning::Now(stop.index, here)),
            None => anywhere.map(|index| StopBeginning::Now(index, here)),
        }
    }

    /// The next stop that was checked for a state of the law, if the law is followed and is soon in that state.
    fn stop_on_law(
        &self,
        section: &MotionSection,
        stops: &LawStops,
        (now, position): (PathState, f64),
    ) -> Option<StopOnLaw> {
        if (now.velocity - 1.0).abs() > FOLLOWS || now.acceleration.abs() > FOLLOWS {
            return None;
        }
        let (number, limits) = stops.next_on_law(position)?;
        let index = stops.anywhere.len() + number;
        let begin_s = self.planned_path.section_begin_s(section.begin);
        let clock_value = (self.planned_path)
            .clock_value_at(section.begin, begin_s + limits.begin())
            - section.begin;
        let after_s = match limits.begins_at(position) {
            true => 0.0,
            false => clock_value - now.s,
        };
        let cycles = after_s / section.bounds.dt_s();
        let reaches = (cycles - libm::round(cycles)).abs() <= CYCLE_TOLERANCE;
        let state = self.section_state(section, clock_value, [1.0, 0.0]);
        (reaches && (0.0..=stops.wait_cycles).contains(&cycles)).then(|| StopOnLaw {
            index,
            after_s,
            duration_s: limits.stop_duration_s(state),
        })
    }

    /// State of the path parameter, counted from the beginning of a section, at a clock value on it and its rates.
    fn section_state(
        &self,
        section: &MotionSection,
        clock_value: f64,
        rates: [f64; 2],
    ) -> AxisState {
        let mut state = self
            .planned_path
            .path_state_at(section.begin + clock_value, rates);
        state.position -= self.planned_path.section_begin_s(section.begin);
        state
    }
}
