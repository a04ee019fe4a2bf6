//! Benchmarks loading, by size: compiling the text of a net to a plan, and building the net from the plan. Run with
//! `cargo bench -p rcc-bench --bench load`; docs/performance.md has the stages of the loader.
#![allow(missing_docs)] // criterion generates an undocumented function.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rcc_bench::graph::{Graph, SIZES};
use rcc_bench::instance::cell;
use rcc_bench::net::net;
use rcc_engine::net::Net;
use rcc_language::compile_for;

fn load(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("load");
    group.sample_size(10);
    let cell = cell();
    let models = cell.models();
    for size in SIZES {
        let graph = Graph::load("full", size).expect("a graph of this package");
        let text = net(&graph).text;
        let plan = compile_for(&text, "graph.json", &cell)
            .expect("the tests compile it")
            .plan;
        group.throughput(Throughput::Elements(size as u64));
        group.bench_function(BenchmarkId::new("text to plan", size), |b| {
            b.iter(|| compile_for(&text, "graph.json", &cell));
        });
        group.bench_function(BenchmarkId::new("plan to net", size), |b| {
            b.iter(|| Net::build(plan.clone(), &models, cell.fingerprint, &[None], 1e-3));
        });
    }
    for (name, formulas) in [("formulas", true), ("their primitives", false)] {
        let text = five_hundred(formulas);
        group.throughput(Throughput::Elements(500));
        group.bench_function(BenchmarkId::new("text to plan", name), |b| {
            b.iter(|| compile_for(&text, "formulas.yaml", &cell));
        });
    }
    group.finish();
}

/// 500 formulas of three operations each, or the primitives that they stand for: both become the same plan.
fn five_hundred(formulas: bool) -> String {
    let mut text = String::from("net: formulas\nprimitives:\n  f0: {type: Time}\n");
    for number in 1..=500 {
        let before = format!("f{}.out", number - 1);
        text.push_str(&match formulas {
            true => format!(
                "  f{number}: {{type: Formula, parameters: {{expr: 'clamp(({before} - 2 s) * 3, 0 s, 100 s)'}}}}\n"
            ),
            false => format!(
                "  s{number}: {{type: Subtract, inputs: {{a: {before}, b: 2 s}}}}
  m{number}: {{type: Multiply, inputs: {{a: s{number}.out, b: 3}}}}
  f{number}: {{type: Limit, inputs: {{in: m{number}.out, low: 0 s, high: 100 s}}}}\n"
            ),
        });
    }
    text.push_str("  watch: {type: Monitor, inputs: {value: f500.out}}\n  over: {type: Greater, inputs: {a: f0.out, b: 9 s}}\n");
    text.push_str("  end: {type: Termination, inputs: {done: over.out}}\n");
    text
}

criterion_group!(benches, load);
criterion_main!(benches);
