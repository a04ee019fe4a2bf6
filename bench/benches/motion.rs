//! Benchmarks motion in a cycle: kinematics, the path clock, each kind of motion, and whole nets that move one arm and
//! two. Run with `cargo bench -p rcc-bench --bench motion`. Only ratios within one run carry over to other machines.
#![allow(missing_docs)] // criterion generates an undocumented function.

use criterion::{Criterion, criterion_group, criterion_main};
use rcc_bench::motion::groups;

fn motion(criterion: &mut Criterion) {
    for group in groups() {
        let mut criterion = criterion.benchmark_group(group.name);
        for mut it in group.subjects {
            criterion.bench_function(it.name, |b| {
                b.iter_custom(|cycles| it.subject.run(cycles as usize));
            });
        }
        criterion.finish();
    }
}

criterion_group!(benches, motion);
criterion_main!(benches);
