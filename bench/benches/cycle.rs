//! Benchmarks a cycle: chains of simple primitives, and the executor's whole cycle with a motion. Run with `cargo bench
//! -p rcc-bench --bench cycle`. Only ratios within one run carry over to other machines.
#![allow(missing_docs)] // criterion generates an undocumented function.

#[path = "../../rcc-core/engine/tests/common/mod.rs"]
mod common;

use common::{EngineFixture, TestPlan, endless_net, line_net};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rcc_bench::executor::BenchExecutor;
use rcc_bench::graph::Graph;
use rcc_bench::instance::cell;
use rcc_bench::net::net;
use rcc_language::compile_for;
use rcc_protocol::control::PlanData;
use std::time::Duration;

/// Returns a chain of `count` additions, each reading the one before.
fn chain(count: u32) -> PlanData {
    let mut plan = TestPlan::new();
    let no = plan.bool(0);
    let one = plan.reals(&[1.0]);
    let first = plan.reals(&vec![f64::NAN; count as usize + 1]);
    plan.data.reals[first as usize] = 0.0;
    let operands: Vec<u32> = (0..count)
        .flat_map(|i| [first + i, one, first + i + 1])
        .collect();
    plan.add("Add", &operands);
    plan.add("Termination", &[no]);
    plan.data
}

/// Returns `count` additions that do not depend on each other.
fn row(count: u32) -> PlanData {
    let mut plan = chain(count);
    let first = plan.operands[0];
    for group in plan.operands.chunks_exact_mut(3) {
        group[0] = first;
    }
    plan
}

fn primitives(criterion: &mut Criterion) {
    let fixture = EngineFixture::new();
    let mut group = criterion.benchmark_group("add");
    for count in [50, 500, 2000] {
        group.throughput(Throughput::Elements(u64::from(count)));
        for (kind, plan) in [("independent", row(count)), ("chain", chain(count))] {
            let mut net = fixture.build(plan).expect("a good plan");
            group.bench_function(BenchmarkId::new(kind, count), |b| {
                b.iter(|| net.evaluate(&[], &[], 1e-3))
            });
        }
    }
    group.finish();
}

fn executor(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("executor cycle");
    group.bench_function("idle, one arm", |b| {
        let mut fixture = EngineFixture::new();
        b.iter(|| fixture.step());
    });
    group.bench_function("one output net", |b| {
        let mut fixture = EngineFixture::new();
        let id = fixture.load(endless_net(0));
        fixture.start(id);
        b.iter(|| fixture.step());
    });
    group.bench_function("line, kinematics, guard, command, monitor", |b| {
        b.iter_custom(|iterations| {
            let mut total = Duration::ZERO;
            let mut left = iterations;
            while left > 0 {
                let mut fixture = EngineFixture::new();
                let id = fixture.load(line_net());
                fixture.start(id);
                let cycles = left.min(700);
                let begun = std::time::Instant::now();
                fixture.steps(cycles as usize);
                total += begun.elapsed();
                left -= cycles;
            }
            total
        });
    });
    group.finish();
}

/// Benchmarks latching, evaluation, guard, writing and recording, with boards in shared memory, as the executor itself
/// measures it.
fn whole(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("whole cycle");
    let text = net(&Graph::load("full", 50).expect("a graph of this package")).text;
    let plan = compile_for(&text, "graph.json", &cell())
        .expect("the tests compile it")
        .plan;
    for nets in [0, 1, 10, 50] {
        let mut executor = BenchExecutor::new(cell(), [0.0; 8]).expect("room for a cell");
        for _ in 0..nets {
            executor.start(plan.clone()).expect("a good plan");
        }
        group.bench_function(BenchmarkId::new("nets of 50", nets), |b| {
            b.iter_custom(|iterations| Duration::from_nanos(executor.cycles(iterations as usize)));
        });
    }
    group.finish();
}

criterion_group!(benches, primitives, executor, whole);
criterion_main!(benches);
