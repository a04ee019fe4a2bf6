//! Measures wake-up latency like the executor: same clock, call, core, priority and period. Uses a thread of its own
//! that does not allocate while it measures; the main thread waits for it.

use std::io;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use nix::sched::{CpuSet, sched_setaffinity};
use nix::sys::resource::{UsageWho, getrusage};
use nix::unistd::Pid;
use rcc_core::histogram::Histogram;
use rcc_os::clock::{monotonic_ns, sleep_until};
use serde::Serialize;

use super::histogram::{Bucket, buckets, drawing};
use super::trial::become_fifo;

/// Wake-ups that are not counted, because they touch memory for the first time.
const WARM_UP: u64 = 20;

/// Parameters of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeasurementPlan {
    /// SCHED_FIFO priority; `None` measures an ordinary thread.
    pub priority: Option<u8>,
    /// Core; `None` leaves the choice to the scheduler.
    pub core: Option<usize>,
    /// Time between two wake-ups, ns.
    pub period_ns: u64,
    /// Length of the measurement.
    pub length: Duration,
}

/// Measured wake-up latency.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct WakeUpMeasurement {
    /// SCHED_FIFO priority in effect; `None` for an ordinary thread.
    pub priority: Option<u8>,
    /// Core that the thread was bound to; `None` if not bound.
    pub core: Option<usize>,
    /// Period, ns.
    pub period_ns: u64,
    /// Number of wake-ups.
    pub cycles: u64,
    /// Shortest latency, ns.
    pub min_ns: u64,
    /// Median latency, ns.
    pub p50_ns: u64,
    /// 99th percentile, ns.
    pub p99_ns: u64,
    /// 99.9th percentile, ns.
    pub p999_ns: u64,
    /// Longest latency, ns.
    pub max_ns: u64,
    /// Wake-ups after the next deadline, which would have missed a cycle.
    pub missed: u64,
    /// Involuntary context switches of the thread.
    pub preempted: u64,
    /// Distribution of the latencies.
    pub histogram: Vec<Bucket>,
    /// Histogram as text.
    #[serde(skip)]
    pub drawing: String,
}

/// Measures; takes `plan.length`.
///
/// # Errors
/// Fails if the system cannot create the thread or refuses the core.
pub fn measure(plan: MeasurementPlan) -> io::Result<WakeUpMeasurement> {
    let (sender, receiver) = mpsc::channel();
    let thread = thread::Builder::new()
        .name("wake-ups".into())
        .spawn(move || {
            // The receiver waits for the result.
            let _ = sender.send(run(plan));
        })?;
    let result = receiver
        .recv()
        .map_err(|_| io::Error::other("the measuring thread panicked"))?;
    // The thread has sent its result and is about to end.
    let _ = thread.join();
    result
}

fn run(plan: MeasurementPlan) -> io::Result<WakeUpMeasurement> {
    if let Some(core) = plan.core {
        let mut set = CpuSet::new();
        set.set(core)
            .and_then(|()| sched_setaffinity(Pid::from_raw(0), &set))?;
    }
    let fifo = plan
        .priority
        .filter(|priority| become_fifo(*priority).is_ok());
    let mut histogram = Histogram::default();
    let before = preempted();
    let missed = wake_ups(plan, &mut histogram);
    Ok(WakeUpMeasurement {
        priority: fifo,
        core: plan.core,
        period_ns: plan.period_ns,
        cycles: histogram.count(),
        min_ns: histogram.min(),
        p50_ns: histogram.quantile(500),
        p99_ns: histogram.quantile(990),
        p999_ns: histogram.quantile(999),
        max_ns: histogram.max(),
        missed,
        preempted: preempted().saturating_sub(before),
        drawing: drawing(buckets(&histogram)),
        histogram: buckets(&histogram),
    })
}

/// Adds the latencies to the histogram; returns the number of wake-ups after the next deadline.
fn wake_ups(plan: MeasurementPlan, histogram: &mut Histogram) -> u64 {
    let period_ns = plan.period_ns.max(10_000);
    let mut deadline_ns = monotonic_ns() + period_ns;
    let end_ns = deadline_ns + u64::try_from(plan.length.as_nanos()).unwrap_or(u64::MAX / 2);
    let (mut woken, mut missed) = (0, 0);
    while deadline_ns < end_ns {
        sleep_until(deadline_ns);
        let late_ns = monotonic_ns().saturating_sub(deadline_ns);
        woken += 1;
        if woken > WARM_UP {
            histogram.add(late_ns);
            missed += u64::from(late_ns >= period_ns);
        }
        // Missed periods are skipped, never caught up.
        deadline_ns += (late_ns / period_ns + 1) * period_ns;
    }
    missed
}

fn preempted() -> u64 {
    let count =
        getrusage(UsageWho::RUSAGE_THREAD).map(|usage| usage.involuntary_context_switches());
    count
        .ok()
        .and_then(|count| u64::try_from(count).ok())
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_real_measurement_counts_its_wake_ups_in_order() -> io::Result<()> {
        let plan = MeasurementPlan {
            priority: None,
            core: None,
            period_ns: 1_000_000,
            length: Duration::from_millis(200),
        };
        let measured = measure(plan)?;
        assert!((1..=200).contains(&measured.cycles), "{measured:?}");
        let order = [
            measured.min_ns,
            measured.p50_ns,
            measured.p99_ns,
            measured.p999_ns,
            measured.max_ns,
        ];
        assert!(order.is_sorted(), "{measured:?}");
        let sum: u64 = measured.histogram.iter().map(|bucket| bucket.count).sum();
        assert_eq!(sum, measured.cycles);
        assert_eq!(measured.priority, None);
        Ok(())
    }

    #[test]
    fn a_missing_core_is_refused() {
        let plan = MeasurementPlan {
            priority: None,
            core: Some(1000),
            period_ns: 1_000_000,
            length: Duration::from_millis(10),
        };
        assert!(measure(plan).is_err());
    }
}
