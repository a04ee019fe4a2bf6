//! The result of an endurance run, formatted as markdown tables.
//! Pure functions.

use std::fmt;
use std::time::Duration;

use super::Options;
use crate::census::Census;
use crate::lateness::{Cause, LateCycles, LatenessReport};

/// Number of explained late cycles that are listed one by one.
const LISTED: usize = 40;

/// The result of a run.
#[derive(Clone, Debug)]
pub struct Report {
    /// Parameters of the run.
    pub options: Options,
    /// Duration of the run.
    pub time: Duration,
    /// False if the system grants no SCHED_FIFO: late cycles cannot be attributed then.
    pub judged: bool,
    /// Late cycles with their causes.
    pub lateness: LatenessReport,
    /// First count of the current executor, after the warm-up.
    pub first: Option<Census>,
    /// Index in `course` of that count.
    first_index: usize,
    /// Resources that grew during the life of each executor except the last.
    pub grown: Vec<String>,
    /// Maximum of each figure.
    pub most: Census,
    /// Last count.
    pub last: Census,
    /// Time of each count, with the executor's resident memory (kB) and the cell's shared memory (bytes).
    pub course: Vec<(Duration, u64, u64)>,
    /// Number of times each activity was carried out.
    pub counts: Vec<(&'static str, u64)>,
    /// Violated conditions, as far as they are kept.
    pub findings: Vec<String>,
    /// Number of all findings, including those not kept.
    pub found: u64,
    /// Motions that ended with a fault although nothing was killed.
    pub disturbed: Vec<String>,
    /// Steal time of the executor's core during the run, ticks of 10 ms.
    pub steal_ticks: u64,
}

impl Report {
    /// Creates an empty report.
    pub fn new(options: Options) -> Report {
        Report {
            options,
            time: Duration::ZERO,
            judged: false,
            lateness: LatenessReport::default(),
            first: None,
            first_index: 0,
            grown: Vec::new(),
            most: Census::default(),
            last: Census::default(),
            course: Vec::new(),
            counts: Vec::new(),
            findings: Vec::new(),
            found: 0,
            disturbed: Vec::new(),
            steal_ticks: 0,
        }
    }

    /// Adds a count.
    pub fn count(&mut self, at: Duration, now: Census) {
        self.first.get_or_insert(now);
        self.most = self.most.max(&now);
        self.last = now;
        self.course.push((at, now.rss_kb, now.shared_bytes));
    }

    /// Returns the resources that grew between the warm-up and the last count, for each executor.
    pub fn growth(&self) -> Vec<String> {
        let last = self.first.map_or(Vec::new(), |first| {
            // Large nets come at random, and the memory for the first of them is kept: the reference is the maximum of
            // the first third of the executor's life. What leaks goes on growing after it.
            let life = &self.course[self.first_index..];
            let third = &life[..life.len().div_ceil(3)];
            let rss_kb = third.iter().map(|(_, rss_kb, _)| *rss_kb).max();
            self.last.growth(&Census {
                rss_kb: rss_kb.unwrap_or(first.rss_kb),
                ..first
            })
        });
        [self.grown.clone(), last].concat()
    }

    /// Ends the comparison for a killed executor: the next count is the first one of its successor.
    pub fn executor_replaced(&mut self) {
        self.grown = self.growth();
        self.first = None;
        self.first_index = self.course.len();
    }

    /// True if all conditions hold.
    pub fn holds(&self) -> bool {
        let late = !self.judged || self.lateness.unexplained == 0 && self.lateness.consecutive;
        late && self.found == 0 && self.growth().is_empty() && self.lateness.dropped_records == 0
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let minutes = self.time.as_secs_f64() / 60.0;
        writeln!(f, "## {minutes:.1} minutes, seed {}\n", self.options.seed)?;
        writeln!(
            f,
            "{}\n",
            if self.holds() {
                "All conditions hold."
            } else {
                "**Some conditions do not hold.**"
            }
        )?;
        writeln!(f, "| what was done | how often |\n|---|---:|")?;
        for (words, number) in &self.counts {
            writeln!(f, "| {words} | {number} |")?;
        }
        self.show_late(f)?;
        self.show_counts(f)?;
        for (title, lines) in [
            ("Findings", &self.findings),
            ("Resources that grew", &self.growth()),
            (
                "Motions that ended by a fault although nothing was killed",
                &self.disturbed,
            ),
        ] {
            if !lines.is_empty() {
                writeln!(f, "\n### {title}\n")?;
            }
            for line in lines {
                writeln!(f, "- {line}")?;
            }
        }
        Ok(())
    }
}

impl Report {
    fn show_late(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lateness = &self.lateness;
        if !self.judged {
            return writeln!(
                f,
                "\nSCHED_FIFO is not permitted here: late cycles were not attributed."
            );
        }
        let milliseconds = |ns: u64| ns as f64 * 1e-6;
        writeln!(f, "\n| the executor's cycles | |\n|---|---:|")?;
        for (words, number) in [
            ("cycles", lateness.cycles),
            ("late", lateness.late),
            (
                "of them: the reference thread was late at the same time",
                lateness.by_machine,
            ),
            (
                "of them: the host took time from the core",
                lateness.by_steal,
            ),
            ("of them: unexplained", lateness.unexplained),
            ("monitor records dropped", lateness.dropped_records),
            (
                "wake-ups of the reference thread later than 0.1 ms",
                lateness.stalls,
            ),
            (
                "time the host took from the core, in 10 ms",
                self.steal_ticks,
            ),
        ] {
            writeln!(f, "| {words} | {number} |")?;
        }
        writeln!(
            f,
            "| longest stall of the reference thread, ms | {:.2} |",
            milliseconds(lateness.stall_max_ns)
        )?;
        writeln!(
            f,
            "| longest computation of a cycle, ms | {:.3} |",
            milliseconds(lateness.exec_max_ns)
        )?;
        if lateness.each.is_empty() {
            return Ok(());
        }
        writeln!(
            f,
            "\n| late cycle | count | woke late, ms | computed, ms | stretch, ms | reference late, ms | cause |\n\
             |---:|---:|---:|---:|---:|---:|---|"
        )?;
        let is_ours = |late: &&LateCycles| late.cause == Cause::Unexplained;
        let ours = lateness.each.iter().filter(is_ours);
        let machine = lateness
            .each
            .iter()
            .filter(|late| !is_ours(late))
            .take(LISTED);
        for late in ours.chain(machine) {
            let (stalled_ns, cause) = match late.cause {
                Cause::Machine { stalled_ns } => (stalled_ns, "machine".to_owned()),
                Cause::Steal { ticks } => (0, format!("host took {ticks} ticks")),
                Cause::Unexplained => (0, format!("**unexplained**: {:?}", late.beside)),
            };
            writeln!(
                f,
                "| {} | {} | {:.2} | {:.2} | {:.2} | {:.2} | {cause} |",
                late.cycle,
                late.count,
                milliseconds(late.wake_ns),
                milliseconds(late.exec_ns),
                milliseconds(late.to_ns - late.from_ns),
                milliseconds(stalled_ns)
            )?;
        }
        if lateness.each.len() > LISTED {
            writeln!(
                f,
                "\n(The first {LISTED} of {} stretches.)",
                lateness.each.len()
            )?;
        }
        Ok(())
    }

    fn show_counts(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(first) = self.first else {
            return Ok(());
        };
        writeln!(
            f,
            "\n| in a quiet moment | after the warm-up | most | at the end |\n|---|---:|---:|---:|"
        )?;
        let rows = first
            .rows()
            .into_iter()
            .zip(self.most.rows())
            .zip(self.last.rows());
        for (((name, first), (_, most)), (_, last)) in rows {
            writeln!(f, "| {name} | {first} | {most} | {last} |")?;
        }
        let course: Vec<String> = self
            .course
            .iter()
            .map(|(at, rss, _)| format!("{}: {rss}", at.as_secs()))
            .collect();
        writeln!(
            f,
            "\nResident memory of the executor, kB, by second: {}",
            course.join(", ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::census::Census;

    fn grown(resident_kb: &[u64]) -> Vec<String> {
        let options = Options {
            time: Duration::ZERO,
            seed: 1,
            restarts: 0,
            monitors: 0,
            pairs: 0,
            executor_pairs: 0,
            load: false,
            warm_up: Duration::ZERO,
            census_every: Duration::ZERO,
        };
        let mut report = Report::new(options);
        let count = |report: &mut Report, rss_kb| {
            let census = Census {
                rss_kb,
                ..Census::default()
            };
            report.count(Duration::ZERO, census);
        };
        // The predecessor needed more: it must not be the reference.
        count(&mut report, 900_000);
        report.executor_replaced();
        for rss_kb in resident_kb {
            count(&mut report, *rss_kb);
        }
        report.growth()
    }

    #[test]
    fn a_leak_is_reported_and_the_memory_of_the_first_large_net_is_not() {
        assert!(grown(&[108_900, 112_700, 112_700, 111_700, 112_800, 112_700]).is_empty());
        let leak = grown(&[108_000, 109_000, 110_000, 111_000, 112_000, 113_000]);
        assert_eq!(leak, ["executor: resident memory, kB: 109000 → 113000"]);
        assert!(grown(&[]).is_empty());
    }
}
