//! Benchmarks loading, by notation and size: compiling the text of a net to a plan, and building the net from the plan.
//! Run with `cargo bench -p rcc-bench --bench load`; the example `loading` and docs/performance.md have the stages.
#![allow(missing_docs)] // criterion generates an undocumented function.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rcc_bench::formulas::net_of;
use rcc_bench::graph::SIZES;
use rcc_bench::instance::cell;
use rcc_bench::notations::NOTATIONS;
use rcc_directionet::compiler;
use rcc_engine::net::Net;
use rcc_language::compile_for;

fn load(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("load");
    group.sample_size(10);
    let cell = cell();
    let models = cell.models();
    let compiler = compiler(&cell);
    for ((notation, text), size) in NOTATIONS.iter().flat_map(|it| SIZES.map(|size| (it, size))) {
        let text = text(size).expect("a graph of this package");
        let compiled = compiler.compile(&text, "net");
        let plan = compiled.expect("the tests compile it").plan;
        group.throughput(Throughput::Elements(size as u64));
        group.bench_function(BenchmarkId::new(format!("{notation} to plan"), size), |b| {
            b.iter(|| compiler.compile(&text, "net"));
        });
        if *notation == "json" {
            group.bench_function(BenchmarkId::new("plan to net", size), |b| {
                b.iter(|| Net::build(plan.clone(), &models, cell.fingerprint, &[None], 1e-3));
            });
        }
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
