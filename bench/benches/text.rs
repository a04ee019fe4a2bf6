//! Benchmarks of the passes over a text, by size: each grows with the length of the text, for valid nets and for texts
//! full of errors. Run with `cargo bench -p rcc-bench --bench text`; `rcc-core/directionet/tests/linear.rs` asserts it.
#![allow(missing_docs)] // criterion generates an undocumented function.

use criterion::measurement::WallTime;
use criterion::{
    BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main,
};
use rcc_bench::instance::cell;
use rcc_config::{FileKind, yaml};
use rcc_directionet::{NOTATION, compiler};
use rcc_language::check::check;
use rcc_language::devices::DeviceTable;
use rcc_language::expand::expand;
use rcc_language::format::format;
use rcc_language::infer::{Typed, infer};
use rcc_language::lower::lower;
use rcc_language::null_analysis::{analyse_nulls, find_always_null};
use rcc_language::parse::parse;
use rcc_language::resolve::resolve;
use rcc_language::source_map::SourceMap;

const SIZES: [usize; 3] = [1_000, 4_000, 16_000];

/// A chain of `count` primitives in YAML.
fn chain(count: usize) -> String {
    let mut text = "net: chain\nprimitives:\n  a0: {type: Time}\n".to_owned();
    for number in 1..=count {
        let from = number - 1;
        text += &format!("  a{number}: {{type: Negate, inputs: {{in: a{from}.out}}}}\n");
    }
    text + &format!(
        "  end: {{type: Termination, inputs: {{done: false}}}}\ndiscard: [a{count}.out]\n"
    )
}

/// A net of the predecessor with `count` entries.
fn foreign(count: usize, entry: impl Fn(usize) -> String) -> String {
    let entries: Vec<String> = (0..count).map(entry).collect();
    format!(
        "{{t=Core::BooleanValue(Value='true'),{},outTerminate=t.outValue}}",
        entries.join(",")
    )
}

fn run<T>(
    group: &mut BenchmarkGroup<'_, WallTime>,
    name: &str,
    size: usize,
    mut pass: impl FnMut() -> T,
) {
    group.bench_function(BenchmarkId::new(name, size), |b| b.iter(&mut pass));
}

/// The passes of the compiler over a valid net, one by one.
fn passes(group: &mut BenchmarkGroup<'_, WallTime>, cell: &DeviceTable, size: usize) {
    let text = chain(size);
    group.throughput(Throughput::Bytes(text.len() as u64));
    run(group, "kind", size, || FileKind::of_text(&text));
    run(group, "tree", size, || yaml::read(&text));
    run(group, "format", size, || format(&text, "net.yaml").is_ok());
    let read = || parse(&text, "net.yaml", cell, &[NOTATION], &mut Vec::new());
    run(group, "parse", size, read);
    let net = read().expect("a valid net");
    let mut sources = SourceMap::new("net.yaml", &text);
    run(group, "expand", size, || {
        expand(net.clone(), &[], &mut sources, &mut Vec::new()).is_some()
    });
    let mut faults = Vec::new();
    let expanded = expand(net, &[], &mut sources, &mut faults).expect("a valid net");
    run(group, "resolve", size, || {
        resolve(&expanded, cell, &mut Vec::new()).items.len()
    });
    let graph = resolve(&expanded, cell, &mut faults);
    run(group, "infer", size, || infer(&graph));
    let inferred = infer(&graph);
    let typed = Typed {
        graph: &graph,
        inferred: &inferred,
    };
    run(group, "check", size, || {
        check(typed, &mut Vec::new()).is_some()
    });
    run(group, "nulls", size, || {
        (analyse_nulls(&graph), find_always_null(&graph))
    });
    let checked = check(typed, &mut faults).expect("a valid net");
    run(group, "lower", size, || lower(checked).is_ok());
}

fn text(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("text");
    group.sample_size(10);
    let cell = cell();
    for size in SIZES {
        passes(&mut group, &cell, size);
        let texts = [
            (
                "DirectIONet",
                foreign(size, |n| {
                    format!("a{n}=Core::BooleanNot(inValue=t.outValue)")
                }),
            ),
            (
                "links to nothing",
                foreign(size, |n| {
                    format!("a{n}=Core::BooleanNot(inValue=missing{n}.outValue)")
                }),
            ),
            (
                "unknown types",
                foreign(size, |n| format!("a{n}=Core::DoubleAd{n}()")),
            ),
            (
                "invalid values",
                foreign(size, |n| {
                    format!("a{n}=Core::BooleanValue(Value='maybe{n}')")
                }),
            ),
        ];
        for (name, text) in texts {
            group.throughput(Throughput::Bytes(text.len() as u64));
            run(&mut group, name, size, || {
                compiler(&cell).compile(&text, "net.net").is_ok()
            });
        }
    }
    group.finish();
}

criterion_group!(benches, text);
criterion_main!(benches);
