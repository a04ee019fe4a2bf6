//! Benchmarks each kernel of the catalogue: a run of 256 of it in a net that otherwise contains only `Termination`. Run
//! with `cargo bench -p rcc-bench --bench primitives`. Only ratios within one run carry over to other machines.
#![allow(missing_docs)] // criterion generates an undocumented function.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use rcc_bench::kernel_nets::{count, devices, models, net, rows};

/// Number of cycles between two starts, so few that no motion comes to its end.
const CYCLES: u64 = 100;

fn catalogue(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("primitive");
    let (models, devices) = (models(), devices());
    for row in rows() {
        let count = count(&row.entry.spec);
        let mut net = net(&row, count).expect("the catalogue's test says so");
        group.throughput(Throughput::Elements(u64::from(count)));
        group.bench_function(BenchmarkId::new(row.name(), count), |b| {
            b.iter_custom(|iterations| {
                let mut total = std::time::Duration::ZERO;
                for first in (0..iterations).step_by(CYCLES as usize) {
                    net.reset();
                    let begun = std::time::Instant::now();
                    for _ in first..iterations.min(first + CYCLES) {
                        net.evaluate(&models, &devices, 1e-3);
                    }
                    total += begun.elapsed();
                }
                total
            });
        });
    }
    group.finish();
}

criterion_group!(benches, catalogue);
criterion_main!(benches);
