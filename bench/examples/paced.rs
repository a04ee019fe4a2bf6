//! Runs a graph in a SCHED_FIFO loop, as the executor would: `paced GRAPH [--seconds S] [--core N] [--period US]`
//! prints one line of JSON with the median duration of a cycle. Used by `bench/hal`, which runs LinuxCNC HAL in turns
//! with it.

use std::process::ExitCode;
use std::time::Instant;

use rcc_bench::graph::Graph;
use rcc_bench::instance::GraphInstance;
use rcc_bench::measure::median;
use rcc_exec::setup::{FIFO, Grants, lock_memory, prefault_stack, promote_thread};
use rcc_os::clock::{monotonic_ns, sleep_until};

/// The priority of an executor, below the kernel's watchdogs.
const PRIORITY: u8 = 80;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let option = |name: &str| {
        let place = arguments.iter().position(|argument| argument == name)?;
        arguments.get(place + 1)?.parse::<f64>().ok()
    };
    let name = arguments.first().and_then(|name| name.split_once('_'));
    let graph = name.and_then(|(mix, nodes)| Graph::load(mix, nodes.parse().ok()?).ok());
    let Some(instance) = graph.and_then(|graph| GraphInstance::new(&graph).ok()) else {
        eprintln!("paced: GRAPH is one of bench/graphs, such as scalar_50");
        return ExitCode::from(2);
    };
    let (seconds, core) = (
        option("--seconds").unwrap_or(2.0),
        option("--core").map(|core| core as usize),
    );
    let mut grants = Grants::default();
    lock_memory(&mut grants);
    promote_thread(PRIORITY, core, &mut grants);
    prefault_stack();
    let period_us = option("--period").unwrap_or(1e3).max(1.0);
    let cycles = (seconds * 1e6 / period_us) as usize;
    let cycle_ns = run(instance, cycles, (period_us * 1e3) as u64);
    println!(
        "{{\"cycle_ns\": {cycle_ns}, \"fifo\": {}}}",
        grants.bits & FIFO != 0
    );
    ExitCode::SUCCESS
}

/// Returns the median duration of a cycle, ns, including two reads of the clock.
fn run(mut instance: GraphInstance, cycles: usize, period_ns: u64) -> f64 {
    let mut times = Vec::with_capacity(cycles);
    let mut deadline_ns = monotonic_ns();
    for _ in 0..cycles {
        deadline_ns += period_ns;
        sleep_until(deadline_ns);
        let begun = Instant::now();
        instance.evaluate();
        times.push(begun.elapsed().as_nanos() as f64);
    }
    median(times)
}
