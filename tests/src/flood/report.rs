//! What a flood did to CANCEL, as a distribution. Pure.

use std::fmt;
use std::time::Duration;

use super::Options;

/// Where a request goes in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interface {
    /// HTTP over the Unix socket.
    Unix,
    /// HTTP over TCP, with the token.
    Tcp,
    /// `rcc-cli cancel NAME`, a process from its start to its end, over the Unix socket.
    Cli,
}

impl Interface {
    /// Every door.
    pub const ALL: [Interface; 3] = [Interface::Unix, Interface::Tcp, Interface::Cli];

    fn name(self) -> &'static str {
        match self {
            Interface::Unix => "HTTP, Unix socket",
            Interface::Tcp => "HTTP, TCP",
            Interface::Cli => "rcc-cli (whole process)",
        }
    }
}

/// One CANCEL.
#[derive(Clone, Debug)]
pub struct Cancel {
    /// Where it went in.
    pub door: Interface,
    /// From its sending to its answer.
    pub took: Duration,
    /// It was answered, and not refused.
    pub answered: bool,
    /// The net ended as cancelled.
    pub done: bool,
    /// What was answered.
    pub words: String,
}

/// What was measured.
#[derive(Clone, Debug)]
pub struct Report {
    options: Options,
    /// Every CANCEL.
    pub cancels: Vec<Cancel>,
    /// How late the machine woke a thread that slept.
    pub stalls: Vec<Duration>,
    /// Late cycles of the executor, all of the run.
    pub late: u64,
    /// The loader's resident memory with the large nets, before the flood.
    pub loader_before: u64,
    /// The greatest that was seen.
    pub loader_peak: u64,
    /// It did not live through the flood.
    pub loader_restarted: bool,
}

impl Report {
    pub(super) fn new(options: Options, loader_before: u64) -> Report {
        Report {
            options,
            cancels: Vec::new(),
            stalls: Vec::new(),
            late: 0,
            loader_before,
            loader_peak: loader_before,
            loader_restarted: false,
        }
    }

    /// The CANCELs that were refused, not answered, or not done.
    pub fn failed(&self) -> impl Iterator<Item = &Cancel> {
        self.cancels
            .iter()
            .filter(|cancel| !cancel.answered || !cancel.done)
    }
}

/// Median, 99th percentile and maximum.
fn distribution(times: impl Iterator<Item = Duration>) -> [Duration; 3] {
    let mut times: Vec<Duration> = times.collect();
    times.sort();
    let at = |permille: usize| {
        let index = (times.len() * permille).div_ceil(1000).saturating_sub(1);
        times.get(index).copied().unwrap_or_default()
    };
    [at(500), at(990), at(1000)]
}

impl fmt::Display for Report {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Options {
            nets,
            primitives,
            processes,
            kinds,
            ..
        } = &self.options;
        let names: Vec<&str> = kinds.iter().map(|kind| kind.name()).collect();
        writeln!(
            formatter,
            "{nets} nets of {primitives} primitives; {processes} process(es) each of: {}",
            names.join(", ")
        )?;
        writeln!(
            formatter,
            "{:<26} {:>6} {:>10} {:>10} {:>10}",
            "CANCEL by name through", "count", "p50", "p99", "max"
        )?;
        let mut row = |name: &str, times: Vec<Duration>| {
            let [p50, p99, max] = distribution(times.iter().copied());
            let ms = |time: Duration| format!("{:.2} ms", time.as_secs_f64() * 1e3);
            writeln!(
                formatter,
                "{name:<26} {:>6} {:>10} {:>10} {:>10}",
                times.len(),
                ms(p50),
                ms(p99),
                ms(max)
            )
        };
        for door in Interface::ALL {
            let of = self.cancels.iter().filter(|cancel| cancel.door == door);
            row(door.name(), of.map(|cancel| cancel.took).collect())?;
        }
        row("machine: late wake-ups", self.stalls.clone())?;
        let mib = |bytes: u64| bytes >> 20;
        writeln!(
            formatter,
            "loader: {} MiB before, {} MiB at most{}; late cycles: {}",
            mib(self.loader_before),
            mib(self.loader_peak),
            if self.loader_restarted {
                ", and it had to be restarted"
            } else {
                ""
            },
            self.late
        )?;
        let failed: Vec<&Cancel> = self.failed().collect();
        writeln!(
            formatter,
            "refused, unanswered or not done: {}",
            failed.len()
        )?;
        for Cancel {
            door, took, words, ..
        } in failed
        {
            writeln!(formatter, "  {} after {took:?}: {words}", door.name())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distribution_is_of_all_that_was_measured() {
        let ms = |count: u64| Duration::from_millis(count);
        assert_eq!(distribution((1..=200).map(ms)), [ms(100), ms(198), ms(200)]);
        assert_eq!(distribution([ms(7)].into_iter()), [ms(7); 3]);
        assert_eq!(distribution(std::iter::empty()), [Duration::ZERO; 3]);
    }
}
