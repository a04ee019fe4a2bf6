//! The latencies of CANCEL under a flood, as a distribution. Pure functions.

use std::fmt;
use std::time::Duration;

use super::Options;

/// An interface through which a CANCEL is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interface {
    /// HTTP over the Unix socket.
    Unix,
    /// HTTP over TCP, with the access token.
    Tcp,
    /// `rcc-cli cancel NAME` over the Unix socket, measured from the start to the exit of the process.
    Cli,
}

impl Interface {
    /// All interfaces.
    pub const ALL: [Interface; 3] = [Interface::Unix, Interface::Tcp, Interface::Cli];

    fn name(self) -> &'static str {
        match self {
            Interface::Unix => "HTTP, Unix socket",
            Interface::Tcp => "HTTP, TCP",
            Interface::Cli => "rcc-cli (whole process)",
        }
    }
}

/// The result of one CANCEL.
#[derive(Clone, Debug)]
pub struct Cancel {
    /// Interface through which it was sent.
    pub interface: Interface,
    /// Time from sending the request to its response.
    pub took: Duration,
    /// How much of that the client itself was ready to run and had no processor; 0 for a process of its own.
    pub waited: Duration,
    /// True if it was accepted.
    pub answered: bool,
    /// True if the net ended with the reason `canceled`.
    pub done: bool,
    /// Text of the response or of the error.
    pub words: String,
}

/// The measurements of a run.
#[derive(Clone, Debug)]
pub struct Report {
    options: Options,
    /// All CANCELs.
    pub cancels: Vec<Cancel>,
    /// Delay of each wake-up of a sleeping thread.
    pub stalls: Vec<Duration>,
    /// Late cycles of the executor during the whole run.
    pub late: u64,
    /// Resident memory of the loader with the large nets loaded, before the flood, bytes.
    pub loader_before: u64,
    /// Largest resident memory of the loader that was seen, bytes.
    pub loader_peak: u64,
    /// The loader's words about each slow CANCEL.
    pub slow: Vec<String>,
    /// True if the loader died during the flood.
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
            slow: Vec::new(),
            loader_restarted: false,
        }
    }

    /// Returns the CANCELs that were refused or unanswered, or whose net did not end as `canceled`.
    pub fn failed(&self) -> impl Iterator<Item = &Cancel> {
        self.cancels
            .iter()
            .filter(|cancel| !cancel.answered || !cancel.done)
    }
}

/// Returns the median, the 99th percentile and the maximum; zero if there are no values.
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
        for interface in Interface::ALL {
            let of = self
                .cancels
                .iter()
                .filter(|cancel| cancel.interface == interface);
            row(
                interface.name(),
                of.clone().map(|cancel| cancel.took).collect(),
            )?;
            if interface != Interface::Cli {
                let served = of.map(|cancel| cancel.took.saturating_sub(cancel.waited));
                row("  without client's wait", served.collect())?;
            }
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
        writeln!(formatter, "slow by the loader's log: {}", self.slow.len())?;
        for words in &self.slow {
            writeln!(formatter, "  {words}")?;
        }
        let failed: Vec<&Cancel> = self.failed().collect();
        writeln!(
            formatter,
            "refused, unanswered or not done: {}",
            failed.len()
        )?;
        for Cancel {
            interface,
            took,
            words,
            ..
        } in failed
        {
            writeln!(formatter, "  {} after {took:?}: {words}", interface.name())?;
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
