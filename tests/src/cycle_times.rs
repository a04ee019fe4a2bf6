//! Cycle times of a cell while something runs beside it, for programs that compare: parts with and without it take turns in
//! one run, and what belongs together is added up. Runs on the main thread of measuring programs.

use std::collections::BTreeMap;
use std::sync::Arc;

use rcc_core::counted::Counted;
use serde_json::Value;

use crate::cell_fixture::CellFixture;
use crate::endurance::{CORE, PRIORITY};
use crate::journal::Journal;
use crate::lateness::{LatenessMonitor, LatenessReport};

/// A distribution of times that can be added to others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Distribution {
    /// Number of samples by the upper bound of their bucket, ns.
    buckets: BTreeMap<u64, u64>,
    max_ns: u64,
}

impl Distribution {
    fn of(view: &Value) -> Distribution {
        let number = |row: &Value, name: &str| row[name].as_u64().unwrap_or(0);
        let buckets = view["buckets"].as_array().into_iter().flatten();
        Distribution {
            buckets: buckets
                .map(|row| (number(row, "to_ns"), number(row, "count")))
                .collect(),
            max_ns: number(view, "max_ns"),
        }
    }

    fn add(&mut self, other: &Distribution) {
        for (to_ns, count) in &other.buckets {
            *self.buckets.entry(*to_ns).or_default() += count;
        }
        self.max_ns = self.max_ns.max(other.max_ns);
    }

    /// Returns the time, ns, that this share of the samples (0 to 1) does not exceed, within the width of a bucket.
    fn quantile(&self, share: f64) -> u64 {
        let total: u64 = self.buckets.values().sum();
        let wanted = (share * total as f64).ceil() as u64;
        let mut seen = 0;
        let mut bounds = self.buckets.iter();
        let found = bounds.find(|(_, count)| {
            seen += *count;
            seen >= wanted
        });
        found.map_or(0, |(to_ns, _)| (*to_ns).min(self.max_ns))
    }

    fn columns(&self) -> String {
        let us = |ns: u64| format!("{:>8.1}", ns as f64 / 1e3);
        let [p50, p99] = [0.5, 0.99].map(|share| us(self.quantile(share)));
        format!("{p50} {p99} {}", us(self.max_ns))
    }
}

/// Cycles of one part, or of several.
#[derive(Clone, Debug, Default)]
pub struct CycleTimes {
    /// Number of cycles.
    pub cycles: u64,
    /// Late cycles whose larger part was the wake-up, and those that computed long.
    pub late: [u64; 2],
    /// Late cycles during which a reference thread on the same core was late too, which the host's steal time explains, and
    /// that nothing explains; `None` without real-time priorities.
    pub causes: Option<[u64; 3]>,
    wake: Distribution,
    exec: Distribution,
}

/// Changes a cell's configuration so that late cycles can be attributed: the executor has a core of its own.
pub fn pinned(text: String) -> String {
    let pin = format!("{{priority: {PRIORITY}, core: {CORE}}}");
    text.replace("{priority: 80}", &pin)
}

impl CycleTimes {
    /// Resets the executor's histograms, does `work`, and returns the cycles meanwhile. The cell is [`pinned`].
    pub fn during(cell: &CellFixture, work: impl FnOnce()) -> CycleTimes {
        let status = || cell.rest("GET", "/status", "").body["executor"].clone();
        let reset = cell.rest("POST", "/status/acknowledge", "");
        assert_eq!(reset.status, 200, "{reset:?}");
        let monitor = LatenessMonitor::start(cell, CORE, PRIORITY, &Arc::new(Journal::default()));
        let before = status();
        work();
        let after = status();
        let timing = cell.rest("GET", "/timing", "").body;
        let grown = |name: &str| {
            let of = |status: &Value| status[name].as_u64().unwrap_or(0);
            of(&after) - of(&before)
        };
        let causes = monitor.map(|monitor| {
            let LatenessReport {
                by_machine,
                by_steal,
                unexplained,
                ..
            } = monitor.finish();
            [by_machine, by_steal, unexplained]
        });
        CycleTimes {
            cycles: grown("cycle"),
            late: [grown("late_woken"), grown("late_computed")],
            causes,
            wake: Distribution::of(&timing["wake"]),
            exec: Distribution::of(&timing["exec"]),
        }
    }

    /// Adds another part.
    pub fn add(&mut self, other: &CycleTimes) {
        self.causes = match (self.causes, other.causes) {
            (Some(own), Some(more)) => Some(std::array::from_fn(|one| own[one] + more[one])),
            _ if self.cycles == 0 => other.causes,
            _ => None,
        };
        self.cycles += other.cycles;
        self.late = [self.late[0] + other.late[0], self.late[1] + other.late[1]];
        self.wake.add(&other.wake);
        self.exec.add(&other.exec);
    }

    /// The heading of [`CycleTimes::row`].
    pub const HEADING: &str = "part            cycles    late:  woken computed | machine    steal    other | wake-up, µs: p50      p99      max | execution, µs: p50 p99      max";

    /// Returns a row of a table.
    pub fn row(&self, name: &str) -> String {
        let [woken, computed] = self.late;
        let causes = match self.causes {
            Some([machine, steal, other]) => format!("{machine:>8} {steal:>8} {other:>8}"),
            None => format!("{:>8} {:>8} {:>8}", "–", "–", "–"),
        };
        format!(
            "{name:<14} {:>7} {woken:>13} {computed:>8} | {causes} |    {} |       {}",
            self.cycles,
            self.wake.columns(),
            self.exec.columns()
        )
    }

    /// Says in one line what is added to what happens anyway.
    pub fn compared(&self, alone: &CycleTimes) -> String {
        let late = |one: &CycleTimes| one.late.iter().sum::<u64>();
        let per_million = |one: &CycleTimes| late(one) as f64 * 1e6 / (one.cycles.max(1) as f64);
        format!(
            "{} alone, {} beside it: {:.0} and {:.0} of a million cycles",
            Counted(late(alone), "late cycle"),
            Counted(late(self), "late cycle"),
            per_million(alone),
            per_million(self)
        )
    }
}

/// A net of twenty monitors at 1 kHz, which runs until it is canceled.
pub fn watched_net() -> String {
    let mut text = String::from(
        "net: watched\nprimitives:\n  cancel: {type: Cancel}\n  clock: {type: Time}\n  end: {type: Termination, inputs: \
         {done: cancel.requested}}\n",
    );
    for number in 0..20 {
        text.push_str(&format!(
            "  see_{number}: {{type: Monitor, parameters: {{rate: 1000 Hz}}, inputs: {{value: clock.out}}}}\n"
        ));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn added_distributions_have_the_quantiles_of_all_samples() {
        let part = |rows: &[(u64, u64)], max_ns: u64| {
            let rows = rows
                .iter()
                .map(|(to, count)| json!({"to_ns": to, "count": count}));
            Distribution::of(&json!({"buckets": rows.collect::<Value>(), "max_ns": max_ns}))
        };
        let mut all = part(&[(10, 60), (20, 38)], 19);
        assert_eq!((all.quantile(0.5), all.quantile(0.99)), (10, 19));
        all.add(&part(&[(20, 1), (4000, 1)], 3500));
        assert_eq!(all.quantile(0.5), 10);
        assert_eq!((all.quantile(0.99), all.quantile(1.0)), (20, 3500));
        assert_eq!(Distribution::default().quantile(0.5), 0);
    }
}
