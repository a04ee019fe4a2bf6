//! The sections of a motion from rest to rest, with the limits of their clocks.

use super::speed_limits::BrakingLimits;
use crate::after_until::LegAfterUntil;
use crate::path_clock::{PathBounds, duration_s};

/// A part of the motion from rest to rest, with the limits of its clock.
#[derive(Debug, Clone)]
pub(crate) struct MotionSection {
    /// Clock value at which it begins: the sum of the lengths of all previous sections.
    pub(crate) begin: f64,
    /// Increase of the clock value from its beginning to its end.
    pub(crate) length: f64,
    /// Limits of its clock.
    pub(crate) bounds: PathBounds,
    /// Only for a section with a time law, which is at rest at both ends by itself, so that its clock starts and ends
    /// at speed.
    pub(crate) stops: Option<LawStops>,
    /// How time passes on it.
    pub(crate) time_scaling: TimeScaling,
    /// Indices of its first and its last leg.
    pub(crate) legs: [u32; 2],
    /// Index of the condition before which it does not begin.
    pub(crate) wait: Option<u32>,
    /// Index of the condition that ends its last leg.
    pub(crate) until: Option<u32>,
    /// If `until` may end the section before: how its leg is travelled from there.
    pub(crate) after_until: Option<Box<LegAfterUntil>>,
}

/// How time passes on a section from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeScaling {
    /// With one acceleration and one jerk for the whole section.
    Even,
    /// With a time law that was found quickly, within the limits of every place.
    Adapted,
    /// With the soonest time law, within the limits of every place.
    TimeOptimal,
    /// With a first time law, which keeps the limits but is not the soonest: the method that improves it did not end.
    FirstLaw,
}

/// A section of a motion from rest to rest, as planned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedSection {
    /// Indices of its first and its last leg.
    pub legs: [u32; 2],
    /// How time passes on it.
    pub time_scaling: TimeScaling,
    /// Duration at full speed, s.
    pub duration_s: f64,
}

impl MotionSection {
    pub(crate) fn planned(&self) -> PlannedSection {
        let duration_s = match self.time_scaling {
            TimeScaling::Even => duration_s(&self.bounds),
            TimeScaling::Adapted | TimeScaling::TimeOptimal | TimeScaling::FirstLaw => self.length,
        };
        PlannedSection {
            legs: self.legs,
            time_scaling: self.time_scaling,
            duration_s,
        }
    }
}

/// Limits for stops on a section with a time law, by clocks that count the path parameter directly.
#[derive(Debug, Clone)]
pub(crate) struct LawStops {
    /// For any state of which a set of limits allows a stop, those with the hardest braking first.
    pub(crate) anywhere: Box<[BrakingLimits]>,
    /// For the states of the law, followed at full speed, at certain times, in their order.
    pub(crate) on_law: Box<[BrakingLimits]>,
    /// Most cycles for which the law is followed further to one of `on_law`.
    pub(crate) wait_cycles: f64,
}

impl LawStops {
    /// Limits by index: `anywhere`, then `on_law`.
    pub(crate) fn get(&self, index: usize) -> Option<&BrakingLimits> {
        let behind = index.checked_sub(self.anywhere.len());
        match behind {
            None => self.anywhere.get(index),
            Some(behind) => self.on_law.get(behind),
        }
    }

    /// The first limits for a state of the law that is not before `s`, and their index in `on_law`.
    pub(crate) fn next_on_law(&self, s: f64) -> Option<(usize, &BrakingLimits)> {
        let number = self.on_law.partition_point(|stop| stop.is_before(s));
        Some((number, self.on_law.get(number)?))
    }
}
