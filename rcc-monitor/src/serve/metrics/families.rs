//! The metric families, from the values of one scrape. Pure functions; run by the
//! serving thread.

use std::collections::BTreeMap;

use rcc_api::bodies::{ExecutorView, TotalView};
use rcc_core::message::DeviceState;

use super::text::{Family, Number, Unit};
use super::{DeviceReading, Reading};

/// Label of all nets whose names have none of their own.
const OTHER: &str = "other";
const NS_PER_S: f64 = 1e9;
/// Octaves of the histograms' bounds: 1 µs to 134 ms.
const OCTAVES: std::ops::Range<u32> = 10..27;

/// Returns all families of a scrape. What could not be read is left out: a value is never old or made up.
pub fn all(reading: &Reading) -> Vec<Family> {
    let mut all = vec![
        Family::gauge("rcc_loader_up", "1 if the loader answered")
            .with(&[], Number::of(reading.loader)),
        Family::gauge("rcc_executor_up", "1 if the cell has a running executor")
            .with(&[], Number::of(reading.status.is_some())),
        Family::gauge("rcc_build_info", "Version of rcc-monitor").with(
            &[("version", rcc_protocol::version::version())],
            Number::of(true),
        ),
        Family::counter(
            "rcc_executor_restarts",
            "Executors that replaced another one between two scrapes of this server",
        )
        .with(&[], Number::Whole(reading.restarts)),
    ];
    if let Some(started_s) = reading.started_s {
        let family = Family::gauge(
            "rcc_executor_start_time",
            "Start of the executor since the epoch",
        );
        all.push(
            family
                .unit(Unit::Seconds)
                .with(&[], Number::Real(started_s)),
        );
    }
    if let Some(status) = &reading.status {
        all.extend(executor(&status.executor));
        all.extend(nets(reading));
        all.extend(devices(&reading.devices));
    }
    if let Some(timing) = &reading.timing {
        let histogram = |name, help, total: &TotalView| {
            let family = Family::histogram(name, help).unit(Unit::Seconds);
            family.with(&[], distribution(total))
        };
        all.push(histogram(
            "rcc_cycle_execution",
            "Time from the wake-up of a cycle until all outputs are written",
            &timing.exec_since_start,
        ));
        all.push(histogram(
            "rcc_cycle_wakeup",
            "Delay of the wake-up of a cycle after its deadline",
            &timing.wake_since_start,
        ));
    }
    all
}

fn executor(executor: &ExecutorView) -> Vec<Family> {
    let counter = |name, help, value| Family::counter(name, help).with(&[], Number::Whole(value));
    let seconds = |name, help, ns: u64| {
        let family = Family::gauge(name, help).unit(Unit::Seconds);
        family.with(&[], Number::Real(ns as f64 / NS_PER_S))
    };
    let mut all =
        vec![
        counter("rcc_cycles", "Cycles of the executor", executor.cycle),
        Family::counter(
            "rcc_late_cycles",
            "Cycles that woke or ended after the next deadline, by the larger part of the lateness",
        )
        .with(&[("cause", "woken_late")], Number::Whole(executor.late_woken))
        .with(&[("cause", "computed_long")], Number::Whole(executor.late_computed)),
        counter(
            "rcc_skipped_periods",
            "Periods that were skipped because of late cycles",
            executor.skipped_periods,
        ),
        counter(
            "rcc_dropped_records",
            "Monitored values that were lost inside of the executor",
            executor.dropped_records,
        ),
        counter(
            "rcc_incidents",
            "Recordings that the flight recorder froze to be written",
            executor.incidents,
        ),
        seconds("rcc_cycle_period", "Base period of the executor", executor.period_ns),
        seconds(
            "rcc_cycle_committed",
            "Time that the running nets are expected to take together in one cycle",
            executor.committed_ns,
        ),
        Family::gauge("rcc_realtime_granted", "1 if the system granted it to the executor")
            .with(&[("grant", "sched_fifo")], Number::of(executor.fifo))
            .with(&[("grant", "memory_locked")], Number::of(executor.locked))
            .with(&[("grant", "own_core")], Number::of(executor.pinned)),
    ];
    // 0: there is no limit.
    if executor.budget_ns > 0 {
        all.push(seconds(
            "rcc_cycle_budget",
            "Time that all nets together may take in one cycle",
            executor.budget_ns,
        ));
    }
    all
}

fn nets(reading: &Reading) -> Vec<Family> {
    let mut states: BTreeMap<(&str, &str), u64> = BTreeMap::new();
    let mut ends: BTreeMap<(&str, &str), u64> = BTreeMap::new();
    let mut longest: BTreeMap<&str, u64> = BTreeMap::new();
    for net in &reading.nets {
        let name = match reading.names.contains(&net.net) {
            true => net.net.as_str(),
            false => OTHER,
        };
        *states.entry((name, net.state.as_str())).or_default() += 1;
        if let Some(reason) = &net.reason {
            *ends.entry((name, reason.as_str())).or_default() += 1;
        }
        let longest = longest.entry(name).or_default();
        *longest = net.exec_max_ns.max(*longest);
    }
    let mut by_state = Family::gauge("rcc_nets", "Loaded nets by name and state");
    for ((net, state), count) in states {
        by_state.add(&[("net", net), ("state", state)], Number::Whole(count));
    }
    let mut by_reason = Family::gauge(
        "rcc_nets_ended",
        "Nets that have terminated and are still loaded, by name and reason",
    );
    for ((net, reason), count) in ends {
        by_reason.add(&[("net", net), ("reason", reason)], Number::Whole(count));
    }
    let mut by_time = Family::gauge(
        "rcc_net_longest_evaluation",
        "Longest evaluation of the loaded nets of this name",
    )
    .unit(Unit::Seconds);
    for (net, ns) in longest {
        by_time.add(&[("net", net)], Number::Real(ns as f64 / NS_PER_S));
    }
    vec![by_state, by_reason, by_time]
}

fn devices(devices: &[DeviceReading]) -> Vec<Family> {
    let mut state = Family::gauge("rcc_device_state", "1 for the present state of the device");
    let mut quality = Family::gauge(
        "rcc_device_quality",
        "Quality of the connection to the device, 1 is best",
    )
    .unit(Unit::Ratio);
    let mut losses = Family::counter(
        "rcc_device_losses",
        "Times that the executor lost the device",
    );
    let mut drivers = [
        (
            "rcc_device_late_exchanges",
            "Exchanges with the device that were late or lost",
        ),
        (
            "rcc_device_refused_datagrams",
            "Datagrams of the device that its driver refused",
        ),
        (
            "rcc_device_starved_exchanges",
            "Exchanges in which a net commanded the device and there was no fresh set-point",
        ),
    ]
    .map(|(name, help)| Family::counter(name, help));
    for DeviceReading { view, driver } in devices {
        let device = ("device", view.name.as_str());
        for known in DeviceState::ALL {
            let is_it = known.name() == view.state;
            state.add(&[device, ("state", known.name())], Number::of(is_it));
        }
        let ratio = f64::from(view.quality_permille) / 1000.0;
        quality.add(&[device], Number::Real(ratio));
        losses.add(&[device], Number::Whole(view.losses));
        if let Some(counts) = driver {
            for (family, count) in drivers.iter_mut().zip(counts) {
                family.add(&[device], Number::Whole(*count));
            }
        }
    }
    [state, quality, losses]
        .into_iter()
        .chain(drivers)
        .collect()
}

/// Upper bounds of the buckets, inclusive, ns: two an octave. Each is a bound of the executor's own, finer buckets.
fn bounds_ns() -> impl Iterator<Item = u64> {
    OCTAVES.flat_map(|octave| [(3 << (octave - 1)) - 1, (1 << (octave + 1)) - 1])
}

fn distribution(total: &TotalView) -> Number {
    let mut buckets: Vec<(f64, u64)> = Vec::new();
    let mut below = 0;
    for bound in bounds_ns() {
        let rows = total.buckets.iter();
        let upto: u64 = rows
            .filter(|row| row.to_ns <= bound)
            .map(|row| row.count)
            .sum();
        buckets.push((bound as f64 / NS_PER_S, upto - below));
        below = upto;
    }
    let all: u64 = total.buckets.iter().map(|row| row.count).sum();
    buckets.push((f64::INFINITY, all - below));
    Number::Distribution {
        sum: total.sum_ns as f64 / NS_PER_S,
        // A histogram whose count differs from its last bucket would be refused.
        count: all,
        buckets,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_api::bodies::BucketView;
    use rcc_core::histogram::Histogram;

    #[test]
    fn every_bound_is_one_of_the_executor_s_buckets() {
        for bound in bounds_ns() {
            let mut histogram = Histogram::default();
            histogram.add(bound);
            histogram.add(bound + 1);
            let uppers: Vec<u64> = histogram.buckets().map(|(upper, _)| upper).collect();
            assert_eq!(uppers.first(), Some(&bound));
            assert_eq!(uppers.len(), 2, "{bound}");
        }
    }

    #[test]
    fn a_distribution_has_every_sample_once() {
        let mut histogram = Histogram::default();
        for ns in [0, 900, 5_000, 5_100, 80_000, 400_000_000, u64::MAX / 2] {
            histogram.add(ns);
        }
        let rows = histogram.buckets();
        let total = TotalView {
            count: histogram.count(),
            sum_ns: histogram.sum(),
            buckets: rows
                .map(|(to_ns, count)| BucketView { to_ns, count })
                .collect(),
        };
        let Number::Distribution { count, buckets, .. } = distribution(&total) else {
            panic!("no distribution");
        };
        assert_eq!(count, 7);
        assert_eq!(buckets.iter().map(|(_, count)| count).sum::<u64>(), 7);
        assert_eq!(buckets.first().map(|bucket| bucket.1), Some(2));
        assert_eq!(buckets.last(), Some(&(f64::INFINITY, 2)));
    }

    #[test]
    fn without_an_executor_there_are_no_old_values() {
        let names: Vec<&str> = all(&Reading::default())
            .iter()
            .map(|family| family.name)
            .collect();
        assert_eq!(
            names,
            [
                "rcc_loader_up",
                "rcc_executor_up",
                "rcc_build_info",
                "rcc_executor_restarts"
            ]
        );
    }
}
