//! The contents of `top`: sentences and columns, for the live view and for `--once`. Pure.

use rcc_api::bodies::{BucketView, CommandView, HistogramView};
use rcc_terminal::columns::{Cells, Column, fit};

use super::TopSnapshot;
use crate::doctor::histogram::drawing;
use crate::follow;
use crate::table::{counted, grouped, span, time};
use crate::verbs::status::late_words;

/// Returns a part of a whole in percent.
fn percent(part: u64, whole: u64) -> f64 {
    part as f64 * 100.0 / (whole.max(1) as f64)
}

/// Describes the cell and the load of its cycles, in parts.
pub(super) fn head(snapshot: &TopSnapshot) -> Vec<String> {
    let (executor, timing) = (&snapshot.status.executor, &snapshot.timing);
    let period_ns = executor.period_ns;
    let mut parts = vec![
        format!("cell {}", snapshot.status.cell),
        format!("cycle {}", grouped(executor.cycle)),
        format!("period {}", time(period_ns)),
        format!(
            "load {:.1} % (99 % of cycles: {:.1} %)",
            percent(timing.exec.mean_ns, period_ns),
            percent(timing.exec.p99_ns, period_ns)
        ),
    ];
    if executor.budget_ns > 0 {
        parts.push(format!(
            "budget {} used of {}",
            span(executor.committed_ns),
            span(executor.budget_ns)
        ));
    }
    parts
}

/// Returns true if there are late cycles that are not acknowledged.
pub(super) fn is_late(snapshot: &TopSnapshot) -> bool {
    let executor = &snapshot.status.executor;
    executor.late > executor.late_acknowledged
}

/// Describes the late cycles, one sentence per line.
pub(super) fn late(snapshot: &TopSnapshot) -> Vec<String> {
    let executor = &snapshot.status.executor;
    let new = executor.late.saturating_sub(executor.late_acknowledged);
    let mut lines = vec![match new {
        0 => format!(
            "no unacknowledged late cycles ({} since the start)",
            grouped(executor.late)
        ),
        new => format!(
            "{}, {} since the start",
            counted(new, "late cycle"),
            grouped(executor.late)
        ),
    }];
    let latched = [
        ("first", &executor.first_late),
        ("last", &executor.last_late),
    ];
    lines.extend(latched.into_iter().filter_map(|(which, late)| {
        let late = late.as_ref()?;
        Some(format!("{which:>7}: {}", late_words(late)))
    }));
    lines
}

/// Lists the nets that have not ended: active ones first, the most expensive first.
pub(super) fn nets(snapshot: &TopSnapshot) -> Vec<Column> {
    let period_ns = snapshot.status.executor.period_ns;
    let mut nets: Vec<&CommandView> = snapshot
        .nets
        .iter()
        .filter(|net| !follow::is_over(net))
        .collect();
    nets.sort_by_key(|net| {
        (
            !net.is_active(),
            std::cmp::Reverse(net.exec_mean_ns),
            net.id,
        )
    });
    let words = |of: &dyn Fn(&CommandView) -> String| nets.iter().map(|net| of(net)).collect();
    let times = |of: &dyn Fn(&CommandView) -> u64| nets.iter().map(|net| of(net) as f64).collect();
    let load = nets.iter().map(|net| percent(net.exec_mean_ns, period_ns));
    vec![
        Column("NET", Cells::Words(words(&follow::title))),
        Column("STATE", Cells::Words(words(&follow::state_text))),
        Column("LOAD", Cells::Percent(load.collect())),
        Column("MEAN", Cells::Times(times(&|net| net.exec_mean_ns))),
        Column("MAX", Cells::Times(times(&|net| net.exec_max_ns))),
        Column("LAST", Cells::Times(times(&|net| net.exec_last_ns))),
        Column("EXPECTED", Cells::Times(times(&|net| net.expected_ns))),
    ]
}

/// Lists the types of primitives, the most expensive first.
pub(super) fn types(snapshot: &TopSnapshot) -> Vec<Column> {
    let rows = &snapshot.timing.primitives;
    let sum: u64 = rows
        .iter()
        .map(|row| row.sum_ns)
        .fold(0, u64::saturating_add);
    let names = rows.iter().map(|row| row.ty.clone());
    let each = rows
        .iter()
        .map(|row| row.sum_ns as f64 / (row.primitives.max(1) as f64));
    let share = rows.iter().map(|row| percent(row.sum_ns, sum));
    let longest = rows.iter().map(|row| row.max_ns as f64);
    vec![
        Column("PRIMITIVE", Cells::Words(names.collect())),
        Column("EACH", Cells::Times(each.collect())),
        Column("SHARE", Cells::Percent(share.collect())),
        Column("MAX RUN", Cells::Times(longest.collect())),
    ]
}

/// Returns the histograms with their names.
pub(super) fn histograms(snapshot: &TopSnapshot) -> [(&'static str, &HistogramView); 3] {
    let timing = &snapshot.timing;
    [
        ("wake-up latency", &timing.wake),
        ("execution", &timing.exec),
        ("cycle", &timing.length),
    ]
}

/// Lists the quantiles of the histograms.
pub(super) fn quantiles(snapshot: &TopSnapshot) -> Vec<Column> {
    let rows = histograms(snapshot);
    let times = |of: &dyn Fn(&HistogramView) -> u64| {
        Cells::Times(rows.iter().map(|(_, row)| of(row) as f64).collect())
    };
    let names = rows.iter().map(|(name, _)| (*name).to_owned());
    vec![
        Column("TIME", Cells::Words(names.collect())),
        Column("MEDIAN", times(&|row| row.p50_ns)),
        Column("MAX", times(&|row| row.max_ns)),
        Column("99 %", times(&|row| row.p99_ns)),
        Column("99.9 %", times(&|row| row.p999_ns)),
    ]
}

/// Returns the occupied buckets of a histogram.
pub(super) fn buckets(histogram: &HistogramView) -> impl Iterator<Item = BucketView> + '_ {
    histogram.buckets.iter().copied()
}

/// Formats everything as text.
pub(super) fn text(snapshot: &TopSnapshot) -> String {
    let table = |columns| fit(columns, usize::MAX).lines.join("\n");
    let drawings = histograms(snapshot)
        .map(|(name, histogram)| format!("{name}\n{}", drawing(buckets(histogram))));
    format!(
        "{}\n{}\n{}\n\n{}\n\n{}\n\n{}\n{}",
        head(snapshot).join("  "),
        snapshot.status.executor.grade,
        late(snapshot).join("\n"),
        table(nets(snapshot)),
        table(quantiles(snapshot)),
        drawings.join("\n"),
        table(types(snapshot))
    )
}
