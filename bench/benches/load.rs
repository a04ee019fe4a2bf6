//! Benchmarks loading, by size: compiling the text of a net to a plan, and building the net from the plan. Run with
//! `cargo bench -p rcc-bench --bench load`; docs/performance.md has the stages of the loader.
#![allow(missing_docs)] // criterion generates an undocumented function.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rcc_bench::formulas::net_of;
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
        let text = net_of(formulas);
        group.throughput(Throughput::Elements(500));
        group.bench_function(BenchmarkId::new("text to plan", name), |b| {
            b.iter(|| compile_for(&text, "formulas.yaml", &cell));
        });
    }
    group.finish();
}

criterion_group!(benches, load);
criterion_main!(benches);
