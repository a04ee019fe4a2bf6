//! Timing for clients: late cycles with their nets, histograms, and the cost of primitives. Read from boards by
//! blocking threads of the server; only the acknowledgement calls the executor.

use rcc_api::bodies::{
    Acknowledged, BucketView, HistogramView, LateView, PrimitiveTimeView, TimingView, TotalView,
};
use rcc_api::error::ApiError;
use rcc_core::histogram::Histogram;
use rcc_core::message::CommandState;
use rcc_core::primitives::{self, CATALOGUE};
use rcc_core::timing::{LateCause, LateCycle, PrimitiveTime};
use rcc_protocol::control::{Answer, Call};

use super::{Service, unexpected};
use crate::server::caller::Caller;
use crate::server::executor::{ExecutorConnection, TableSnapshot};
use crate::server::store::CommandStore;

impl Service {
    /// Returns the histograms and the cost of primitives.
    ///
    /// # Errors
    /// Returns an error if there is no executor.
    pub fn timing(&self) -> Result<TimingView, ApiError> {
        let (attached, _) = self.attach()?;
        Ok(view(&attached))
    }

    /// Acknowledges late cycles: latched cycles, worst values and histograms are reset.
    ///
    /// # Errors
    /// Returns an error if there is no executor.
    pub fn acknowledge(&self, caller: &Caller) -> Result<Acknowledged, ApiError> {
        let (attached, store) = self.attach()?;
        let status = attached.status();
        let late = status.late.saturating_sub(status.late_acknowledged);
        match self.executor.call_for(caller, &Call::Acknowledge)? {
            Answer::Done { cycle } => Ok(Acknowledged { cycle, late }),
            Answer::Refused(refusal) | Answer::RefusedFor { refusal, .. } => {
                Err(self.with_names(Some(&store), |names| names.refusal(0, refusal)))
            }
            _ => Err(unexpected()),
        }
    }

    /// Converts a late cycle, with the name of its net; `None` if there was none.
    pub(super) fn late(&self, store: &CommandStore, late: &LateCycle) -> Option<LateView> {
        let net = |id| self.with_names(Some(store), |names| (names.net)(id));
        (late.cycle != 0).then(|| LateView {
            cycle: late.cycle,
            cause: LateCause::from_number(late.cause).name().to_owned(),
            wake_ns: late.wake_ns,
            exec_ns: late.exec_ns,
            skipped_periods: late.skipped_periods,
            net: (late.command != 0).then(|| net(late.command)),
            net_ns: late.command_ns,
        })
    }
}

/// Returns the time that the active nets are expected to take together in one cycle, ns.
pub(super) fn committed_ns(snapshot: &TableSnapshot) -> u64 {
    let rows = snapshot.commands.iter();
    rows.filter(|row| CommandState::from_number(row.state).is_active())
        .fold(0, |sum: u64, row| sum.saturating_add(row.expected_ns))
}

fn view(attached: &ExecutorConnection) -> TimingView {
    let timing = attached.timing();
    let mut types: Vec<PrimitiveTimeView> = CATALOGUE
        .iter()
        .zip(&timing.primitives)
        .filter(|(_, row)| row.runs > 0 && timing.catalogue == primitives::fingerprint())
        .map(|(entry, row)| primitive(entry.spec.name, row))
        .collect();
    types.sort_by_key(|row| std::cmp::Reverse(row.sum_ns));
    TimingView {
        cycle: timing.cycle,
        acknowledged_cycle: timing.acknowledged_cycle,
        period_ns: attached.status().period_ns,
        wake: histogram(&timing.wake),
        exec: histogram(&timing.exec),
        length: histogram(&timing.length),
        wake_since_start: total(&timing.wake_acknowledged, &timing.wake),
        exec_since_start: total(&timing.exec_acknowledged, &timing.exec),
        primitives: types,
    }
}

fn primitive(name: &str, row: &PrimitiveTime) -> PrimitiveTimeView {
    PrimitiveTimeView {
        ty: name.to_owned(),
        runs: row.runs,
        primitives: row.primitives,
        sum_ns: row.sum_ns,
        max_ns: row.max_ns,
    }
}

fn histogram(times: &Histogram) -> HistogramView {
    HistogramView {
        count: times.count(),
        min_ns: times.min(),
        mean_ns: times.mean(),
        p50_ns: times.quantile(500),
        p99_ns: times.quantile(990),
        p999_ns: times.quantile(999),
        max_ns: times.max(),
        buckets: buckets(times),
    }
}

fn buckets(times: &Histogram) -> Vec<BucketView> {
    let rows = times.buckets();
    rows.map(|(to_ns, count)| BucketView { to_ns, count })
        .collect()
}

/// Returns the distribution since the start: up to the last acknowledgement, and after it.
fn total(acknowledged: &Histogram, since: &Histogram) -> TotalView {
    let mut all = *acknowledged;
    all.merge(since);
    TotalView {
        count: all.count(),
        sum_ns: all.sum(),
        buckets: buckets(&all),
    }
}
