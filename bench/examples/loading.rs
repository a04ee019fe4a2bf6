//! Measures where the time of loading goes: each pass of the compiler, and the work of the executor's helper thread, by
//! notation and size, as processor time of this thread; and whether the time per primitive grows with the net. `cargo run --profile deploy -p rcc-bench
//! --example loading -- [--rounds N] [--only NOTATION SIZE] [--short]`. One thread.

use std::error::Error;

use rcc_bench::graph::SIZES;
use rcc_bench::instance::cell;
use rcc_bench::notations::NOTATIONS;
use rcc_directionet::NOTATION;
use rcc_engine::net::Net;
use rcc_language::check::check;
use rcc_language::devices::DeviceTable;
use rcc_language::expand::expand;
use rcc_language::formula;
use rcc_language::infer::{Typed, infer};
use rcc_language::lower::{lower, prove};
use rcc_language::names::names;
use rcc_language::parse::parse;
use rcc_language::resolve::resolve;
use rcc_language::source_map::SourceMap;
use rcc_testing::work::processor_time;

const STAGES: [&str; 9] = [
    "parse", "expand", "resolve", "infer", "check", "lower", "prove", "names", "executor",
];
type Times = [f64; STAGES.len()];

/// How much longer a primitive of the largest net may take than one of the smallest that fills no cache: what a linear
/// compiler loses to caches.
const GROWTH_MAX: f64 = 2.0;
/// The size with which the largest is compared.
const COMPARED: usize = 500;

struct Arguments {
    rounds: usize,
    only: Option<(String, usize)>,
    sizes: Vec<usize>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = arguments()?;
    let cell = cell();
    println!(
        "ms of processor time, least of {}; per primitive in µs\n",
        arguments.rounds
    );
    println!("| net | kB | all | a primitive | {} |", STAGES.join(" | "));
    println!("| --- |{}", " ---: |".repeat(STAGES.len() + 3));
    let mut grown = Vec::new();
    for (notation, text_of) in NOTATIONS {
        let mut costs = Vec::new();
        for &size in &arguments.sizes {
            let chosen = arguments.only.as_ref();
            if chosen.is_some_and(|(name, only)| name != notation || *only != size) {
                continue;
            }
            let text = text_of(size)?;
            let cost = measure(
                &format!("{notation} {size}"),
                &text,
                size,
                arguments.rounds,
                &cell,
            )?;
            costs.push((size, cost));
        }
        let of = |wanted| {
            costs
                .iter()
                .find(|(size, _)| *size == wanted)
                .map(|row| row.1)
        };
        if let (Some(small), Some((size, large))) = (of(COMPARED), costs.last().copied()) {
            grown.push((notation, size, large / small));
        }
    }
    println!();
    for (notation, size, growth) in grown {
        let verdict = match growth <= GROWTH_MAX {
            true => "met".to_owned(),
            false => "**missed**".to_owned(),
        };
        println!(
            "{notation}: a primitive of {size} takes {growth:.2} times as long as one of {COMPARED}; \
             at most {GROWTH_MAX}: {verdict}"
        );
    }
    Ok(())
}

/// Measures a net, prints its row, and returns the time of a primitive, µs.
fn measure(
    name: &str,
    text: &str,
    size: usize,
    rounds: usize,
    cell: &DeviceTable,
) -> Result<f64, Box<dyn Error>> {
    let rounds: Result<Vec<Times>, _> = (0..rounds).map(|_| stages(text, cell)).collect();
    let rounds = rounds?;
    let least = |times: &mut dyn Iterator<Item = f64>| times.fold(f64::INFINITY, f64::min);
    let stages = (0..STAGES.len()).map(|stage| least(&mut rounds.iter().map(|it| it[stage])));
    let times: Vec<f64> = stages.collect();
    let all = least(&mut rounds.iter().map(|times| times.iter().sum()));
    let each = all * 1e3 / size as f64;
    let times: Vec<String> = times.iter().map(|time| format!("{time:.3}")).collect();
    let kilobytes = text.len() / 1000;
    println!(
        "| {name} | {kilobytes} | {all:.3} | {each:.2} | {} |",
        times.join(" | ")
    );
    Ok(each)
}

/// Returns the duration of each stage, ms.
fn stages(text: &str, cell: &DeviceTable) -> Result<Times, Box<dyn Error>> {
    let mut times = [0.0; STAGES.len()];
    let mut begun = processor_time();
    let mut lap = |stage: usize| {
        let now = processor_time();
        times[stage] = (now - begun).as_secs_f64() * 1e3;
        begun = now;
    };
    let mut faults = Vec::new();
    let mut sources = SourceMap::new("net", text);
    let mut net = parse(text, "net", cell, &[NOTATION], &mut faults).ok_or("no net")?;
    lap(0);
    formula::lower(&mut net, &mut Vec::new(), &sources, &mut faults);
    let flat = expand(net, &[], &mut sources, &mut faults).ok_or("no expanded net")?;
    lap(1);
    let graph = resolve(&flat, cell, &mut faults);
    lap(2);
    let inferred = infer(&graph);
    lap(3);
    let typed = Typed {
        graph: &graph,
        inferred: &inferred,
    };
    let checked = check(typed, &mut faults).ok_or_else(|| format!("{faults:?}"))?;
    lap(4);
    let lowered = lower(checked).map_err(|fault| format!("{fault:?}"))?;
    lap(5);
    prove(&lowered.plan, cell).map_err(|fault| format!("{fault:?}"))?;
    lap(6);
    let named = names(typed, &lowered);
    lap(7);
    let built = Net::build(
        lowered.plan,
        &cell.models(),
        cell.fingerprint,
        &[None],
        1e-3,
    );
    built.map_err(|refusal| format!("{refusal:?}"))?;
    lap(8);
    drop(named);
    Ok(times)
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut arguments = Arguments {
        rounds: 15,
        only: None,
        sizes: SIZES.to_vec(),
    };
    let mut given = std::env::args().skip(1);
    while let Some(name) = given.next() {
        let mut value = || given.next().ok_or_else(|| format!("{name} needs a value"));
        match name.as_str() {
            "--rounds" => arguments.rounds = value()?.parse::<usize>()?.max(1),
            "--only" => arguments.only = Some((value()?, value()?.parse()?)),
            "--short" => {
                arguments.rounds = 1;
                arguments.sizes.truncate(2);
            }
            _ => {
                return Err(
                    format!("unknown option `{name}`: use --rounds, --only or --short").into(),
                );
            }
        }
    }
    Ok(arguments)
}
