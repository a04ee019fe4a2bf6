//! Measures loading by size and stage, and the memory of a loaded net.

use std::error::Error;
use std::fs;
use std::time::Instant;

use rcc_bench::graph::{Graph, SIZES};
use rcc_bench::instance::cell;
use rcc_bench::measure::{Effort, median};
use rcc_bench::net::net;
use rcc_config::yaml;
use rcc_engine::net::Net;
use rcc_language::check::check;
use rcc_language::devices::DeviceTable;
use rcc_language::expand::ExpandedNet;
use rcc_language::infer::{Typed, infer};
use rcc_language::{compile_for, lower, parse, resolve};
use rcc_protocol::control::PlanData;

use crate::table::{digits, table};

/// Total size of the nets that are created at once to measure their memory, bytes: much more than loading has left free
/// in the heap.
const MEASURED: usize = 512 << 20;
/// The same for a single round, which only tries the program.
const MEASURED_SHORT: usize = 8 << 20;
const STAGES: [&str; 6] = [
    "text",
    "net",
    "names, types, rules",
    "plan",
    "check",
    "executor",
];

/// Returns the section of the page; see the module.
pub fn section(effort: Effort) -> Result<String, Box<dyn Error>> {
    let (mut times, mut memory) = (Vec::new(), Vec::new());
    for size in SIZES {
        eprintln!("performance: loading full_{size}");
        let text = net(&Graph::load("full", size)?).text;
        let rounds: Result<Vec<_>, _> =
            (0..effort.rounds).map(|_| stages(&text, &cell())).collect();
        let rounds = rounds?;
        let stage = |number: usize| median(rounds.iter().map(|round| round[number]).collect());
        let total: f64 = (0..STAGES.len()).map(stage).sum();
        let mut row = vec![
            format!("full_{size}"),
            format!("{} kB", text.len() / 1000),
            digits(total),
        ];
        row.extend((0..STAGES.len()).map(|number| digits(stage(number))));
        times.push(row);
        let plan = compile_for(&text, "graph.json", &cell())?.plan;
        memory.push(vec![
            format!("full_{size}"),
            digits(plan_bytes(&plan) as f64 / 1e3),
            digits(arena_bytes(&plan) as f64 / 1e3),
            digits(measured(&plan, effort)? / 1e3),
        ]);
    }
    let count = effort.rounds;
    let mut head = vec!["net", "text", "all, ms"];
    head.extend(STAGES);
    Ok(format!(
        "## Loading\n\n\
         ms, medians of {count}: *text* to a tree, the tree to a *net*, *names, types, rules*, lowering and sorting to a *plan*, \
         its *check*, and what the *executor* does off its real-time thread (check again, start values, memory).\n\n{}\n\
         Memory of a loaded net, kB: its plan, the arena that a cycle works on, and the growth of the process per net, \
         measured over many nets (a net keeps its plan, which contains the initial arena, beside the working arena).\n\n{}",
        table(&head, &times),
        table(&["net", "plan", "arena", "measured"], &memory)
    ))
}

/// Returns the duration of each stage, ms.
fn stages(text: &str, cell: &DeviceTable) -> Result<[f64; STAGES.len()], Box<dyn Error>> {
    let mut times = [0.0; STAGES.len()];
    let mut begun = Instant::now();
    let mut lap = |stage: usize| {
        times[stage] = begun.elapsed().as_secs_f64() * 1e3;
        begun = Instant::now();
    };
    let (root, mut faults) = yaml::read(text);
    lap(0);
    let net = parse::read_net(&root.ok_or("no text")?, &mut faults).ok_or("no net")?;
    let flat = ExpandedNet::plain(net);
    lap(1);
    let graph = resolve::resolve(&flat, cell, &mut faults);
    let inferred = infer(&graph);
    let typed = Typed {
        graph: &graph,
        inferred: &inferred,
    };
    let checked = check(typed, &mut faults).ok_or("an error")?;
    lap(2);
    let plan = lower::lower(checked)
        .map_err(|fault| format!("{fault:?}"))?
        .plan;
    lap(3);
    plan.plan()
        .check(&cell.models(), cell.fingerprint)
        .map_err(|error| format!("{error:?}"))?;
    lap(4);
    Net::build(plan, &cell.models(), cell.fingerprint, &[None], 1e-3)
        .map_err(|refusal| format!("{refusal:?}"))?;
    lap(5);
    Ok(times)
}

fn arena_bytes(plan: &PlanData) -> usize {
    size_of_val(&plan.reals[..]) + size_of_val(&plan.bools[..]) + size_of_val(&plan.ints[..])
}

fn plan_bytes(plan: &PlanData) -> usize {
    let links = size_of_val(&plan.delays[..]) + size_of_val(&plan.monitors[..]);
    arena_bytes(plan) + links + size_of_val(&plan.operands[..]) + size_of_val(&plan.runs[..])
}

/// Returns the resident memory per net, bytes.
fn measured(plan: &PlanData, effort: Effort) -> Result<f64, Box<dyn Error>> {
    let total = match effort.rounds {
        0..=1 => MEASURED_SHORT,
        _ => MEASURED,
    };
    let count = (total / (plan_bytes(plan) + arena_bytes(plan))).max(1);
    let (models, fingerprint) = (cell().models(), cell().fingerprint);
    let before = resident()?;
    let nets: Result<Vec<_>, _> = (0..count)
        .map(|_| Net::build(plan.clone(), &models, fingerprint, &[None], 1e-3))
        .collect();
    let nets = nets.map_err(|refusal| format!("{refusal:?}"))?;
    let grown = resident()?.saturating_sub(before);
    drop(nets);
    Ok(grown as f64 / count as f64)
}

/// Returns the resident memory of this process, bytes.
fn resident() -> Result<u64, Box<dyn Error>> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))
        .ok_or("no VmRSS")?;
    let kilobytes: u64 = line.trim().trim_end_matches("kB").trim().parse()?;
    Ok(kilobytes * 1024)
}
