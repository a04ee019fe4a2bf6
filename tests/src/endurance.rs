//! Endurance run: a moving cell under load from all sides for any time, in which every late cycle must be explained, no
//! resource may grow and nothing may move unrequested. Runs on the calling thread, which starts one thread per
//! activity.

mod arm;
mod clients;
mod field;
mod io;
mod machine;
mod monitors;
mod pairs;
mod report;
mod restart;

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use rcc_core::message::DeviceState;
use rcc_protocol::Role;

pub use field::{Counts, Field};
pub use report::Report;

use crate::UnsupervisedCell;
use crate::census::Census;
use crate::journal::Journal;
use crate::lateness::{LatenessMonitor, steal_ticks};
use crate::process::Process;

/// Core of the executor and the reference thread.
pub const CORE: usize = 1;
/// SCHED_FIFO priority of the executor; the reference thread has the next higher one.
pub const PRIORITY: u8 = 88;

/// Parameters of a run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Minimum duration.
    pub time: Duration,
    /// Seed of all random choices.
    pub seed: u64,
    /// Total number of driver restarts after a kill.
    pub restarts: u64,
    /// Number of monitors that start, stall and end.
    pub monitors: u64,
    /// Number of times that two processes are killed at the same moment.
    pub pairs: u64,
    /// Number of additional times that the executor and another process are killed at the same moment.
    pub executor_pairs: u32,
    /// Whether to add floods of requests, big nets, killed loaders, and load on processor, disk and memory.
    pub load: bool,
    /// Time until the first count, so that one-time allocations are over.
    pub warm_up: Duration,
    /// Interval between two counts.
    pub census_every: Duration,
}

/// Runs until the options are fulfilled or the journal is ended.
///
/// # Panics
/// Panics if the cell does not start. Later failures are findings in the report.
pub fn run(options: Options, journal: &Arc<Journal>) -> Report {
    let begun = Instant::now();
    let pin = format!("{{priority: {PRIORITY}, core: {CORE}}}");
    // Plans of unloaded nets are kept while a recording may need them; with 1 s they are gone when resources are
    // counted.
    let mut cell = UnsupervisedCell::new(move |text| {
        let text = text.replace("{priority: 80}", &pin);
        text.replacen(
            "period: 1 ms\n",
            "period: 1 ms\nrecorder: {seconds: 1}\n",
            1,
        )
    });
    for name in ["lwr-sim", "io-sim"] {
        cell.start_simulator(name);
    }
    let mut executor = Process::of_cell(&cell, "executor", "rcc-exec", &[]);
    let pid = executor.start(&cell);
    crate::await_some("the executor to be announced", || {
        let announced = cell.cell().announced(Role::Executor, "exec");
        (announced.ok().flatten()?.pid == pid).then_some(())
    });
    let field = Field::new(&cell, options, pid, Arc::clone(journal));
    let steal = steal_ticks(CORE);
    let mut report = Report::new(options);
    thread::scope(|scope| {
        scope.spawn(|| clients::loader(&field));
        scope.spawn(|| arm::run(&field));
        scope.spawn(|| io::run(&field));
        // The threads above start the rest of the cell, which the ones below need.
        await_ready(&field);
        for number in 0..3 {
            let field = &field;
            scope.spawn(move || monitors::run(field, number));
        }
        if options.load {
            scope.spawn(|| clients::big_nets(&field));
            for number in 0..3 {
                let field = &field;
                scope.spawn(move || clients::flood(field, number));
            }
            scope.spawn(|| machine::disk(&field));
            scope.spawn(|| machine::memory(&field));
            for _ in 0..2 {
                scope.spawn(|| machine::processor(&field));
            }
        }
        // Ends the journal also on a panic; otherwise the threads of this scope would run forever.
        let _end = EndJournalOnDrop(journal);
        watch(&field, &mut report, &mut executor);
    });
    report.time = begun.elapsed();
    report.steal_ticks = steal_ticks(CORE).saturating_sub(steal);
    report.counts = field.counts.numbers();
    (report.findings, report.found) = journal.findings();
    report.disturbed = field.disturbed();
    field.end(&mut executor);
    cell.stop();
    report
}

/// Ends the journal on drop.
struct EndJournalOnDrop<'a>(&'a Journal);

impl Drop for EndJournalOnDrop<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

/// Waits until the loader answers and both devices are ready; they are started by threads that have just begun.
fn await_ready(field: &Field<'_>) {
    let watch = field.place.watch();
    crate::await_some("the cell to be up", || {
        let tables = watch.tables();
        let ready = |index: usize| tables.devices[index].state == DeviceState::Ready as u32;
        let serving = field.place.try_rest("GET", "/status", "").is_some();
        (serving && ready(0) && ready(1)).then_some(())
    });
}

/// Counts the resources at intervals while no round is running, and prints the progress. At regular times the executor
/// is killed together with another process; its successor gets a new lateness monitor and a new first count.
fn watch(field: &Field<'_>, report: &mut Report, executor: &mut Process) {
    let (options, journal, begun) = (field.options, &field.journal, field.begun);
    let mut random = field.random(30);
    let start_monitor = || LatenessMonitor::start(field.place, CORE, PRIORITY, journal);
    let mut monitor = start_monitor();
    report.judged = monitor.is_some();
    journal.pause(options.warm_up);
    let mut struck = 0;
    loop {
        let wanted = options.restarts.min(field.counts.restarts())
            + options.monitors.min(field.counts.monitors())
            == options.restarts + options.monitors;
        let over = begun.elapsed() >= options.time && wanted || journal.is_over();
        // Ends anyway after 110 % of the time plus 60 s; the report shows which numbers were not reached.
        let over = over || begun.elapsed() >= options.time * 11 / 10 + Duration::from_secs(60);
        let quiet = journal.quiet();
        let now = settled(field, report.first.as_ref());
        report.count(begun.elapsed(), now);
        eprintln!(
            "{:7.0} s  {} motions, {} driver restarts, {} monitors, {} late cycles unexplained, {} findings",
            begun.elapsed().as_secs_f64(),
            field.counts.motions(),
            field.counts.restarts(),
            field.counts.monitors(),
            monitor.as_ref().map_or(0, LatenessMonitor::unexplained),
            journal.findings().1,
        );
        if over {
            // No thread begins another round after this.
            journal.end();
            drop(quiet);
            if let Some(monitor) = monitor {
                report.lateness.add(monitor.finish());
            }
            return;
        }
        let due = options.time * (struck + 1) / (options.executor_pairs + 1);
        if struck < options.executor_pairs && begun.elapsed() >= due {
            struck += 1;
            if let Some(monitor) = monitor.take() {
                report.lateness.add(monitor.finish());
            }
            pairs::strike_executor(field, executor, &mut random);
            report.executor_replaced();
            monitor = start_monitor();
            drop(quiet);
            journal.pause(options.warm_up);
            continue;
        }
        drop(quiet);
        let left = options.time.saturating_sub(begun.elapsed());
        let pause = if left.is_zero() {
            Duration::from_secs(5)
        } else {
            left
        };
        journal.pause(pause.min(options.census_every));
    }
}

/// Counts the resources once leftovers of dead processes are cleaned up, or after 8 s. The janitor removes incomplete
/// files and names of missing commands only when they are old enough, and the executor closes its connections to dead
/// monitors with the next record that it publishes.
fn settled(field: &Field<'_>, first: Option<&Census>) -> Census {
    let begun = Instant::now();
    // One that was killed with the executor would be missing in the first count of the next executor.
    restart::all(field);
    loop {
        clients::publish(field);
        field.unload_rejected();
        field.clean();
        let now = Census::of(field.place, field.executor());
        let within = first.is_some_and(|first| now.growth(first).is_empty());
        if within || begun.elapsed() > Duration::from_secs(8) {
            return now;
        }
        thread::sleep(Duration::from_millis(200));
    }
}
