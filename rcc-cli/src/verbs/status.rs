//! `status`: the executor's health, the RT grade it really obtained, and the processes of the cell.

use rcc_loader::server::api::StatusView;
use serde::Serialize;

use crate::context::Context;
use crate::doctor::record::Record;
use crate::failure::Failure;
use crate::table::{self, grouped, time};

/// Nothing more to say.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

/// Does it.
///
/// # Errors
/// Not reachable.
pub fn run(context: &Context, _arguments: Arguments) -> Result<(), Failure> {
    let status = Status {
        cell: context.client()?.get("/status")?,
        measured: Record::last(),
    };
    context.print(&status, |status| {
        human(&status.cell, status.measured.as_ref())
    });
    Ok(())
}

/// The cell's own word, and how punctual the machine was when it was last measured.
#[derive(Serialize)]
struct Status {
    #[serde(flatten)]
    cell: StatusView,
    measured: Option<Record>,
}

fn human(status: &StatusView, measured: Option<&Record>) -> String {
    let executor = &status.executor;
    let late = if executor.late == 0 {
        "no late cycle".to_owned()
    } else {
        format!(
            "{} late cycles, first {}, last {}, {} periods skipped",
            grouped(executor.late),
            grouped(executor.first_late_cycle),
            grouped(executor.last_late_cycle),
            grouped(executor.skipped_periods)
        )
    };
    let head = format!(
        "cell {}  {}\nexecutor  cycle {}  period {}  {late}\n          execution last {}, longest {}; worst wake-up {} \
         after its time; {} nets running\n{}\nmachine   {}\n",
        status.cell,
        status.config,
        grouped(executor.cycle),
        time(executor.period_ns),
        time(executor.exec_last_ns),
        time(executor.exec_max_ns),
        time(executor.worst_wake_ns),
        executor.running,
        executor.grade,
        measured.map_or_else(
            || "not graded yet: rcc-cli doctor".to_owned(),
            Record::words
        )
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
    format!("{head}\n{}", table::text(&rows))
}
