//! Measures the benchmark graphs: the interpreter against straight-line Rust, after both have computed the expected
//! results.

use std::error::Error;
use std::hint::black_box;

use rcc_bench::graph::{Graph, MIXES, SIZES};
use rcc_bench::instance::{GraphInstance, cell};
use rcc_bench::measure::{Effort, MeasuredSubject, TimeStats, alternate};
use rcc_bench::straight::{ALL, CycleProgram, GraphInputs};
use rcc_engine::net::Net;

use crate::table::{digits, spread, table, verdict};

/// The gain for every graph from which on a compiler to native code would be worth its weight.
const NATIVE_GAIN: f64 = 3.0;
/// The goal for the part of the hash in the time of a cycle, %.
const HASH_GOAL: f64 = 10.0;

/// Returns the goal for a graph, ns per node.
fn goal(mix: &str, size: usize) -> f64 {
    match (mix, size) {
        ("mat", _) => 2.0,
        (_, 10_000) => 3.5,
        _ => 1.8,
    }
}

/// Returns the section of the page; see the module.
pub fn section(effort: Effort) -> Result<String, Box<dyn Error>> {
    let (mut rows, mut low) = (Vec::new(), Vec::new());
    for mix in MIXES {
        for size in SIZES {
            eprintln!("performance: {mix}_{size}");
            let (cells, ratio) = row(mix, size, effort)?;
            if ratio.is_some_and(|ratio| ratio < NATIVE_GAIN) {
                low.push(format!("`{mix}_{size}`"));
            }
            rows.push(cells);
        }
    }
    let head = [
        "graph",
        "interpreter",
        "a primitive",
        "straight-line, null",
        "never null",
        "ratio",
        "goal",
        "hash, %",
        "goal",
    ];
    let native = match low.as_slice() {
        [] => String::new(),
        low => format!(
            "The ratio is the most that native code for nets could gain, through rustc's optimiser and with all of a graph in one function. It would have to be at least {NATIVE_GAIN} for every graph to be worth a compiler in the executor; it is less for {}.\n",
            low.join(", ")
        ),
    };
    let built = if ALL.is_empty() {
        "Straight-line code was not built (`--features straight-line`).\n"
    } else {
        ""
    };
    Ok(format!(
        "## The interpreter\n\n\
         ns per node of the graph, including null and all checks: the cycle of a net as the executor runs it, without devices. \
         *A primitive* is the same time divided by the number of primitives that the net evaluates (inputs and \
         `Termination` count, elements of transforms do not). *Straight-line* is Rust generated from the same graph by \
         the build script: with null as NaN, and also without null where nothing is ever null. *Ratio* is \
         interpreter to straight-line with null. *Hash* is the part of the hash of all slots, which the executor computes after \
         each cycle, in the time of both. Before the measurement each of them has computed the expected results of cycles 1, 10, 100 and 1000. {built}\n\n{}\n{native}",
        table(&head, &rows)
    ))
}

/// Returns the cells of a graph's row, and the ratio of the interpreter to straight-line code, if that was built.
fn row(
    mix: &str,
    size: usize,
    effort: Effort,
) -> Result<(Vec<String>, Option<f64>), Box<dyn Error>> {
    let name = format!("{mix}_{size}");
    let graph = Graph::load(mix, size)?;
    let mut instance = GraphInstance::new(&graph)?;
    let inputs: Vec<GraphInputs> = (1..=1000).map(GraphInputs::of).collect();
    let made = ALL.iter().filter(|straight| straight.graph == name);
    let mut programs: Vec<(bool, Box<dyn CycleProgram>)> = made
        .map(|straight| (straight.null, (straight.make)()))
        .collect();
    check(&name, &graph, &mut instance, &mut programs, &inputs)?;
    let primitives = instance.primitives() as f64;
    let inputs = &inputs[..64];
    let cell = cell();
    let plan = instance.net.plan.clone();
    let net = Net::build(plan, &cell.models(), cell.fingerprint, &[None], 1e-3)
        .map_err(|refusal| format!("{refusal:?}"))?;
    let mut subjects = vec![MeasuredSubject::new(|cycles| {
        for cycle in 0..cycles {
            instance.measure(&inputs[cycle % inputs.len()]);
            instance.evaluate();
        }
    })];
    let nulls: Vec<bool> = programs.iter().map(|(null, _)| *null).collect();
    for (_, program) in &mut programs {
        subjects.push(MeasuredSubject::new(|cycles| {
            for first in (0..cycles).step_by(inputs.len()) {
                program.run(&inputs[..inputs.len().min(cycles - first)]);
            }
        }));
    }
    subjects.push(MeasuredSubject::new(|cycles| {
        for _ in 0..cycles {
            black_box(black_box(&net).hash());
        }
    }));
    let figures = alternate(&mut subjects, effort);
    let straight = |null: bool| -> Option<TimeStats> {
        let place = nulls.iter().position(|of| *of == null)?;
        figures.get(place + 1).copied()
    };
    let hash = figures.last().map_or(f64::NAN, |figure| figure.median);
    let share = 100.0 * hash / (hash + figures[0].median);
    let nodes = size as f64;
    let ours = figures[0].median / nodes;
    let text = |figure: Option<TimeStats>| {
        figure.map_or("–".to_owned(), |figure| digits(figure.median / nodes))
    };
    let ratio = straight(true).map(|figure| figures[0].median / figure.median);
    let cells = vec![
        name,
        spread(figures[0], nodes),
        digits(figures[0].median / primitives),
        text(straight(true)),
        text(straight(false)),
        ratio.map_or("–".to_owned(), digits),
        verdict(ours, goal(mix, size)),
        digits(share),
        verdict(share, HASH_GOAL),
    ];
    Ok((cells, ratio))
}

/// Checks that every subject computes what the graph's file expects.
fn check(
    name: &str,
    graph: &Graph,
    instance: &mut GraphInstance,
    programs: &mut [(bool, Box<dyn CycleProgram>)],
    inputs: &[GraphInputs],
) -> Result<(), Box<dyn Error>> {
    let mut done = 0;
    for (cycle, expected) in &graph.expected {
        let cycle = *cycle as usize;
        (done..cycle).for_each(|_| instance.step());
        let mut hashes = vec![instance.hash().hex()];
        for (_, program) in programs.iter_mut() {
            program.run(&inputs[done..cycle]);
            hashes.push(format!("{:016x}", program.hash()));
        }
        if hashes.iter().any(|hash| *hash != expected.sinks_hash) {
            return Err(format!(
                "{name}, cycle {cycle}: {hashes:?}, not {}",
                expected.sinks_hash
            )
            .into());
        }
        done = cycle;
    }
    Ok(())
}
