//! Late cycles of a stretch of the log, folded into one line. Pure.

use rcc_protocol::events::{Event, EventKind};

use super::filter::EventFilter;
use crate::table::{counted, grouped};

/// Reports of late cycles without anything important in between.
#[derive(Clone, Debug)]
pub(super) struct LateFold {
    /// The first report, with the counts and worst values of all.
    pub(super) whole: Event,
    last: Event,
    reports: u64,
}

impl LateFold {
    /// Begins with a report; `None` for every other event.
    pub(super) fn begin(event: &Event) -> Option<LateFold> {
        matches!(event.what, EventKind::Late { .. }).then(|| LateFold {
            whole: event.clone(),
            last: event.clone(),
            reports: 1,
        })
    }

    /// Adds a report of the same executor; returns false, and changes nothing, for any other event.
    pub(super) fn add(&mut self, event: &Event) -> bool {
        if event.source != self.whole.source {
            return false;
        }
        let (
            EventKind::Late {
                count,
                worst_wake_us,
                worst_exec_us,
                computed_long,
                command,
                command_us,
                ..
            },
            EventKind::Late {
                count: more,
                worst_wake_us: wake_us,
                worst_exec_us: exec_us,
                computed_long: more_long,
                command: other,
                command_us: other_us,
                ..
            },
        ) = (&mut self.whole.what, &event.what)
        else {
            return false;
        };
        *count = count.saturating_add(*more);
        *worst_wake_us = worst_wake_us.max(*wake_us);
        *worst_exec_us = worst_exec_us.max(*exec_us);
        // An older build gives no cause: then that of the whole is unknown.
        *computed_long = computed_long
            .zip(*more_long)
            .map(|(a, b)| a.saturating_add(b));
        if other_us.unwrap_or(0.0) > command_us.unwrap_or(0.0) {
            (*command, *command_us) = (*other, *other_us);
        }
        self.last = event.clone();
        self.reports += 1;
        true
    }

    /// Formats all of it as a sentence.
    pub(super) fn sentence(&self, filter: &EventFilter) -> String {
        let whole = self.whole.sentence_with(filter);
        if self.reports == 1 {
            return whole;
        }
        let time = self.last.time.get(11..19).unwrap_or(&self.last.time);
        let cycle = self
            .last
            .cycle
            .map_or_else(String::new, |cycle| format!(", cycle {}", grouped(cycle)));
        format!(
            "{whole}; {}, the last at {time}{cycle}",
            counted(self.reports, "report")
        )
    }
}
