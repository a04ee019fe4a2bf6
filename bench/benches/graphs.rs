//! Benchmarks the graphs: the interpreter, and with `--features straight-line` the same graphs as plain Rust in the
//! same run. Run with `cargo bench -p rcc-bench --features straight-line --bench graphs`. Only ratios within one run
//! carry over to other machines; `--example performance` measures in turns and writes docs/performance.md.
#![allow(missing_docs)] // criterion generates an undocumented function.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use rcc_bench::graph::{Graph, MIXES, SIZES};
use rcc_bench::instance::GraphInstance;
use rcc_bench::straight::{ALL, GraphInputs};

fn graphs(criterion: &mut Criterion) {
    for mix in MIXES {
        for size in SIZES {
            let graph = Graph::load(mix, size).expect("a graph of this package");
            let mut instance = GraphInstance::new(&graph).expect("the tests compile it");
            let mut group = criterion.benchmark_group(format!("{mix}_{size}"));
            group.throughput(Throughput::Elements(size as u64));
            group.bench_function("interpreter", |b| b.iter(|| instance.evaluate()));
            straight_line(&mut group, &format!("{mix}_{size}"));
            group.finish();
        }
    }
}

fn straight_line(
    group: &mut criterion::BenchmarkGroup<'_, criterion::measurement::WallTime>,
    graph: &str,
) {
    let inputs: Vec<GraphInputs> = (1..=64).map(GraphInputs::of).collect();
    for straight in ALL.iter().filter(|straight| straight.graph == graph) {
        let mut program = (straight.make)();
        let name = if straight.null {
            "straight-line, null is NaN"
        } else {
            "straight-line, never null"
        };
        group.bench_function(name, |b| {
            b.iter_custom(|iterations| {
                let begun = std::time::Instant::now();
                for first in (0..iterations).step_by(inputs.len()) {
                    let count = (iterations - first).min(inputs.len() as u64);
                    program.run(&inputs[..count as usize]);
                }
                begun.elapsed()
            });
        });
    }
}

criterion_group!(benches, graphs);
criterion_main!(benches);
