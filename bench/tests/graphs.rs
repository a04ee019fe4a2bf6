//! Compiles every graph with the whole loader, and compares its results with those of an independent interpreter.

use rcc_bench::graph::{Graph, MIXES, SIZES};
use rcc_bench::instance::GraphInstance;

fn agrees(mix: &str, size: usize) {
    let graph = Graph::load(mix, size).unwrap();
    let mut instance = GraphInstance::new(&graph).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(graph.expected.len(), 4, "{mix} {size}");
    for (cycle, expected) in &graph.expected {
        while instance.cycles() < *cycle {
            instance.step();
        }
        for (node, value) in &expected.values {
            let op = graph.nodes[*node].op;
            let got = instance.value(*node);
            assert_eq!(
                got, *value,
                "{mix} {size}, cycle {cycle}, node {node}, {op:?}"
            );
        }
        assert_eq!(
            instance.hash().hex(),
            expected.sinks_hash,
            "{mix} {size}, cycle {cycle}"
        );
    }
}

#[test]
fn scalar_graphs_agree_with_the_reference() {
    SIZES.iter().for_each(|size| agrees(MIXES[0], *size));
}

#[test]
fn graphs_with_transforms_and_feedback_agree_with_the_reference() {
    SIZES.iter().for_each(|size| agrees(MIXES[1], *size));
}

#[test]
fn graphs_with_null_agree_with_the_reference() {
    SIZES.iter().for_each(|size| agrees(MIXES[2], *size));
}

#[test]
fn equal_primitives_are_grouped_into_runs() {
    // At least three per run, in the mix with the deepest graphs and the fewest operations; sorting by the longest
    // ready list gives 2.2.
    let graph = Graph::load("scalar", 2000).unwrap();
    let instance = GraphInstance::new(&graph).unwrap_or_else(|faults| panic!("{faults}"));
    let runs = instance.net.plan.runs.len();
    assert!(runs * 3 < instance.primitives(), "{runs} runs");
}
