//! The contents of `top` as rows of text, for the live view and for `--once`. Pure.

use rcc_api::bodies::{CommandView, HistogramView};

use super::TopSnapshot;
use crate::doctor::histogram::drawing;
use crate::follow;
use crate::table::{self, grouped, time};
use crate::verbs::status::late_words;

/// Headings of the table of nets.
pub(super) const NET_HEADS: [&str; 6] = ["NET", "STATE", "LOAD", "MEAN", "LAST/MAX", "EXPECTED"];
/// Headings of the table of primitives.
pub(super) const TYPE_HEADS: [&str; 4] = ["PRIMITIVE", "EACH", "SHARE", "LONGEST RUN"];

/// Formats a part of a whole in percent.
fn percent(part: u64, whole: u64) -> String {
    format!("{:.1} %", part as f64 * 100.0 / (whole.max(1) as f64))
}

/// Describes the cell, the load of its cycles, and its late cycles.
pub(super) fn head(snapshot: &TopSnapshot) -> Vec<String> {
    let (executor, timing) = (&snapshot.status.executor, &snapshot.timing);
    let period_ns = executor.period_ns;
    let mut lines = vec![
        format!(
            "cell {}  cycle {}  period {}  load {} (99 %: {})  budget {} of {}",
            snapshot.status.cell,
            grouped(executor.cycle),
            time(period_ns),
            percent(timing.exec.mean_ns, period_ns),
            percent(timing.exec.p99_ns, period_ns),
            time(executor.committed_ns),
            time(executor.budget_ns)
        ),
        executor.grade.clone(),
    ];
    let new = executor.late.saturating_sub(executor.late_acknowledged);
    lines.push(match new {
        0 => format!(
            "no unacknowledged late cycles ({} since the start)",
            grouped(executor.late)
        ),
        new => format!(
            "{} late cycles, {} since the start",
            grouped(new),
            grouped(executor.late)
        ),
    });
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
pub(super) fn nets(snapshot: &TopSnapshot) -> Vec<[String; 6]> {
    let period_ns = snapshot.status.executor.period_ns;
    let mut nets: Vec<&CommandView> = snapshot
        .nets
        .iter()
        .filter(|net| !follow::is_over(net))
        .collect();
    let runs = |net: &CommandView| matches!(net.state.as_str(), "running" | "canceling");
    nets.sort_by_key(|net| (!runs(net), std::cmp::Reverse(net.exec_mean_ns), net.id));
    nets.into_iter()
        .map(|net| {
            [
                follow::title(net),
                follow::state_text(net),
                percent(net.exec_mean_ns, period_ns),
                time(net.exec_mean_ns),
                format!("{} / {}", time(net.exec_last_ns), time(net.exec_max_ns)),
                time(net.expected_ns),
            ]
        })
        .collect()
}

/// Lists the types of primitives, the most expensive first.
pub(super) fn types(snapshot: &TopSnapshot) -> Vec<[String; 4]> {
    let rows = &snapshot.timing.primitives;
    let sum: u64 = rows
        .iter()
        .map(|row| row.sum_ns)
        .fold(0, u64::saturating_add);
    rows.iter()
        .map(|row| {
            let each = row.sum_ns as f64 / (row.primitives.max(1) as f64);
            [
                row.ty.clone(),
                format!("{each:.1} ns"),
                percent(row.sum_ns, sum),
                time(row.max_ns),
            ]
        })
        .collect()
}

/// Returns the histograms with their titles.
pub(super) fn histograms(snapshot: &TopSnapshot) -> [(String, String); 3] {
    let timing = &snapshot.timing;
    let of = |name: &str, histogram: &HistogramView| {
        let title = format!(
            "{name}: median {}, 99 % {}, 99.9 % {}, longest {}",
            time(histogram.p50_ns),
            time(histogram.p99_ns),
            time(histogram.p999_ns),
            time(histogram.max_ns)
        );
        (title, drawing(histogram.buckets.iter().copied()))
    };
    [
        of("wake-up latency", &timing.wake),
        of("execution", &timing.exec),
        of("cycle", &timing.length),
    ]
}

/// Formats everything as text.
pub(super) fn text(snapshot: &TopSnapshot) -> String {
    let mut nets_table = table::table(&NET_HEADS);
    nets(snapshot).into_iter().for_each(|row| {
        nets_table.add_row(row);
    });
    let mut types_table = table::table(&TYPE_HEADS);
    types(snapshot).into_iter().for_each(|row| {
        types_table.add_row(row);
    });
    let drawings = histograms(snapshot).map(|(title, drawing)| format!("{title}\n{drawing}"));
    format!(
        "{}\n\n{}\n\n{}\n{}",
        head(snapshot).join("\n"),
        table::text(&nets_table),
        drawings.join("\n"),
        table::text(&types_table)
    )
}
