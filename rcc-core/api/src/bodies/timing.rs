//! Bodies about the computation times of nets and primitives.

use serde::{Deserialize, Serialize};
#[cfg(feature = "openapi")]
use utoipa::ToSchema;

/// Distributions of times since the last acknowledgement or the start, and the cost of primitives.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct TimingView {
    /// Executor cycle in which this was written.
    pub cycle: u64,
    /// Cycle of the last acknowledgement; 0 if there was none.
    pub acknowledged_cycle: u64,
    /// Base period, ns.
    pub period_ns: u64,
    /// Delay of the wake-up after the deadline.
    pub wake: HistogramView,
    /// Time from the wake-up until everything is written.
    pub exec: HistogramView,
    /// Time from one wake-up to the next.
    pub length: HistogramView,
    /// Delay of the wake-up after the deadline, since the start of the executor: not reset by an acknowledgement.
    #[serde(default)]
    pub wake_since_start: TotalView,
    /// Time from the wake-up until everything is written, since the start of the executor.
    #[serde(default)]
    pub exec_since_start: TotalView,
    /// Types of primitives that ran, the most expensive first.
    pub primitives: Vec<PrimitiveTimeView>,
}

/// A distribution of times.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct HistogramView {
    /// Number of samples.
    pub count: u64,
    /// Minimum, ns.
    pub min_ns: u64,
    /// Mean, ns.
    pub mean_ns: u64,
    /// Median, within 6 %, ns.
    pub p50_ns: u64,
    /// 99th percentile, within 6 %, ns.
    pub p99_ns: u64,
    /// 99.9th percentile, within 6 %, ns.
    pub p999_ns: u64,
    /// Maximum, ns.
    pub max_ns: u64,
    /// The buckets that are not empty.
    pub buckets: Vec<BucketView>,
}

/// A distribution of times that only grows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
#[serde(default)]
pub struct TotalView {
    /// Number of samples.
    pub count: u64,
    /// Their sum, ns.
    pub sum_ns: u64,
    /// The buckets that are not empty.
    pub buckets: Vec<BucketView>,
}

/// One bucket of a histogram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct BucketView {
    /// Upper bound, inclusive, ns.
    pub to_ns: u64,
    /// Number of samples above the previous bound and up to this one.
    pub count: u64,
}

/// Cost of the primitives of one type, by sampling: the sums of several types are in the ratio of their total costs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(ToSchema))]
pub struct PrimitiveTimeView {
    /// The type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Number of runs of equal primitives that were timed.
    pub runs: u64,
    /// Number of primitives in these runs.
    pub primitives: u64,
    /// Total time of these runs, ns.
    pub sum_ns: u64,
    /// Longest run, ns.
    pub max_ns: u64,
}
