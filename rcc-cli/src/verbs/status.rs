//! `status`: shows the executor's health, its late cycles until they are acknowledged, the real-time grade that it
//! obtained, and the processes of the cell.

use rcc_api::bodies::{Acknowledged, ClockView, ExecutorView, HelperView, LateView, StatusView};
use serde::Serialize;

use crate::context::Context;
use crate::doctor::record::GradeRecord;
use crate::failure::Failure;
use crate::table::{self, counted, grouped, span, time};

/// Arguments of `status`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Acknowledge late cycles; resets latched values, worst values and histograms
    #[arg(long)]
    acknowledge: bool,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    if arguments.acknowledge {
        let done: Acknowledged = client.post("/status/acknowledge", String::new())?;
        context.print(&done, acknowledged);
        return Ok(());
    }
    let status = Status {
        cell: client.get("/status")?,
        // The record is about this machine.
        measured: match context.remote {
            Some(_) => None,
            None => GradeRecord::last(),
        },
    };
    let is_elsewhere = context.remote.is_some();
    context.print(&status, |status| {
        let machine = match (&status.measured, is_elsewhere) {
            (Some(measured), _) => measured.summary(),
            (None, false) => "not graded yet: run `rcc-cli doctor`".to_owned(),
            (None, true) => "graded by `rcc-cli doctor` on the machine itself".to_owned(),
        };
        human(&status.cell, &machine)
    });
    Ok(())
}

/// Status of the cell, and the machine's last measured grade.
#[derive(Serialize)]
struct Status {
    #[serde(flatten)]
    cell: StatusView,
    measured: Option<GradeRecord>,
}

/// Describes an acknowledgement.
pub(super) fn acknowledged(done: &Acknowledged) -> String {
    format!(
        "{} acknowledged at cycle {}",
        counted(done.late, "late cycle"),
        grouped(done.cycle)
    )
}

fn human(status: &StatusView, machine: &str) -> String {
    let executor = &status.executor;
    let head = format!(
        "cell {}  {}\n{}executor  cycle {}  period {}  {}\n{}          execution last {}, longest {}; worst wake-up latency {}; \
         {} running{}\n{}{}\nmachine   {}\n",
        status.cell,
        status.config,
        configuration(&status.configuration),
        grouped(executor.cycle),
        time(executor.period_ns),
        late(executor),
        latched(executor),
        time(executor.exec_last_ns),
        time(executor.exec_max_ns),
        time(executor.worst_wake_ns),
        counted(u64::from(executor.running), "net"),
        budget(executor),
        clock(&executor.clock),
        executor.grade,
        machine
    );
    let mut rows = table::table(&["PROCESS", "PID", "INCARNATION", "STATE"]);
    for process in &status.processes {
        rows.add_row([
            format!("{}/{}", process.role, process.label),
            process.pid.to_string(),
            process.incarnation.clone(),
            if process.alive { "up" } else { "dead" }.to_owned(),
        ]);
    }
    format!(
        "{head}\n{}\n\n{}",
        table::text(&rows),
        helpers(&status.helpers)
    )
}

/// Formats the helper threads of executor and loader: age and limit of each one's last turn.
fn helpers(helpers: &[HelperView]) -> String {
    let mut rows = table::table(&["HELPER", "STATE", "TURNS", "LAST", "LIMIT"]);
    for helper in helpers {
        rows.add_row([
            format!("{}/{}", helper.process, helper.name),
            helper.state.clone(),
            grouped(helper.turns),
            format!("{} ago", time(helper.age_ns)),
            time(helper.limit_ns),
        ]);
    }
    table::text(&rows)
}

/// Lists problems of the configuration, one per line.
fn configuration(sentences: &[String]) -> String {
    let lines = sentences.iter();
    lines
        .map(|sentence| format!("CONFIGURATION  {sentence}\n"))
        .collect()
}

/// Describes the number of late cycles, and how many are not acknowledged.
fn late(executor: &ExecutorView) -> String {
    let new = executor.late.saturating_sub(executor.late_acknowledged);
    match (executor.late, new) {
        (0, _) => "no late cycles".to_owned(),
        (all, 0) => format!(
            "no late cycles since the last acknowledgement ({} before)",
            grouped(all)
        ),
        (all, new) => format!(
            "{}{}, {} skipped",
            counted(new, "late cycle"),
            if all == new {
                String::new()
            } else {
                format!(" since the last acknowledgement ({} in all)", grouped(all))
            },
            counted(executor.skipped_periods, "period")
        ),
    }
}

/// Describes the first and the last late cycle, one per line.
fn latched(executor: &ExecutorView) -> String {
    let line = |(which, late): (&str, &LateView)| {
        format!("          {which} late: {}\n", late_words(late))
    };
    let first = executor.first_late.as_ref().map(|late| ("first", late));
    let last = executor.last_late.as_ref().map(|late| ("last", late));
    let last = last.filter(|(_, last)| first.is_none_or(|(_, first)| first.cycle != last.cycle));
    let hint = first.map(|_| "          (kept until `rcc-cli status --acknowledge`)\n".to_owned());
    first
        .into_iter()
        .chain(last)
        .map(line)
        .chain(hint)
        .collect()
}

/// Describes a late cycle.
pub(super) fn late_words(late: &LateView) -> String {
    let net = late.net.as_ref().map_or_else(String::new, |net| {
        format!(", most of it {net} ({})", time(late.net_ns))
    });
    let net = if late.cause == "computed long" {
        net
    } else {
        String::new()
    };
    format!(
        "cycle {} {}: woke up {} late, computed for {}{net}",
        grouped(late.cycle),
        late.cause,
        time(late.wake_ns),
        time(late.exec_ns)
    )
}

/// Describes the time committed to nets, and the budget.
fn budget(executor: &ExecutorView) -> String {
    if executor.budget_ns == 0 {
        return String::new();
    }
    format!(
        ", expected to take {} of the budget of {} per cycle",
        span(executor.committed_ns),
        span(executor.budget_ns)
    )
}

/// Describes the clock if it follows a device; empty for the executor's own clock.
fn clock(clock: &ClockView) -> String {
    let Some(device) = &clock.device else {
        return String::new();
    };
    let state = match clock.state.as_str() {
        "locked" => format!(
            "locked, period {:.6} ms ({:+.0} ppm), packet jitter ± {:.0} µs, cycle error {:+.1} µs",
            clock.device_period_ns * 1e-6,
            clock.rate_ppm,
            clock.jitter_ns * 1e-3,
            clock.error_ns * 1e-3
        ),
        "unfit" => "not followed: its period is not a multiple of the cell's".to_owned(),
        _ => "searching: the executor runs on its own clock".to_owned(),
    };
    format!(
        "clock     {device}: {state}; lost {}\n",
        counted(clock.losses, "time")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_follows_a_device_has_a_line() {
        assert_eq!(clock(&ClockView::default()), "");
        let locked = ClockView {
            state: "locked".to_owned(),
            device: Some("lwr".to_owned()),
            error_ns: -400.0,
            jitter_ns: 31_000.0,
            device_period_ns: 1_000_012.0,
            rate_ppm: 12.0,
            losses: 1,
        };
        let expected = "clock     lwr: locked, period 1.000012 ms (+12 ppm), packet jitter ± 31 µs, cycle error -0.4 µs; \
                     lost 1 time\n";
        assert_eq!(clock(&locked), expected);
    }
}
