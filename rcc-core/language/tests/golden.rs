//! Golden traces: every example net, run in virtual time with a script of inputs, computes the same bits as when its
//! trace was written, in debug and in release (`cargo test --release -p rcc-language --test golden`).
//!
//! `RCC_BLESS=1` rewrites the traces; a changed trace is explained in its commit.

mod harness;

use std::fmt::Write as _;
use std::fs;

use harness::{DEMO_START, NetHarness, cell, example, folder};
use rcc_config::CellConfig;
use rcc_core::fnv;

/// Cycles whose values are in the trace; the last one ends the run.
const SHOWN: [u64; 5] = [1, 10, 100, 950, 2950];

/// Returns a pseudo-random number below 1000.
fn noise(cycle: u64, number: u64) -> u64 {
    let mixed = (cycle / 50 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15 ^ number << 32);
    mixed >> 40 & 0x3ff
}

/// Sets inputs that change every 50 cycles, with a device absent for ten of a thousand cycles, and CANCEL at the end.
fn script(harness: &mut NetHarness) {
    let cycle = harness.cycle;
    for (number, input) in (0..).zip(harness.inputs.iter_mut()) {
        input.present = cycle % 1000 < 990 || input.measurement.joints > 0;
        input.measurement.digital = noise(cycle, number);
        for (channel, value) in (0..).zip(&mut input.measurement.analog) {
            *value = noise(cycle, number * 64 + channel) as f64 / 64.0;
        }
        // Contact now and then, the first time after a second.
        let pressed = cycle > 1000 && noise(cycle, 7) > 768;
        input.measurement.wrench[2] = if pressed { 20.0 } else { 0.5 };
    }
    harness.cancel = cycle >= 2500;
}

/// All nulls count as one value.
fn bits(value: f64) -> u64 {
    if value.is_nan() {
        u64::MAX
    } else {
        value.to_bits()
    }
}

fn trace(name: &str, cell: &CellConfig) -> String {
    let mut harness = NetHarness::new(example(name, cell), cell, DEMO_START);
    let outputs: Vec<String> = harness
        .net
        .names
        .primitives
        .iter()
        .flat_map(|primitive| {
            let ports = primitive.outputs.iter();
            ports.map(|port| format!("{}.{}", primitive.id, port.name))
        })
        .collect();
    // Of the bits of every output, by name and element.
    let mut hash = fnv::EMPTY;
    let mut text = String::new();
    for cycle in 1..=SHOWN[SHOWN.len() - 1] {
        script(&mut harness);
        harness.step();
        let values: Vec<Vec<f64>> = outputs.iter().map(|name| harness.values(name)).collect();
        let all = values.iter().flatten().map(|value| bits(*value));
        let commanded = harness.outputs.iter().flat_map(|output| {
            let position = output.position.iter().map(|value| bits(*value));
            position.chain([output.digital, output.digital_commanded])
        });
        hash = all
            .chain(commanded)
            .fold(hash, |hash, bits| fnv::add(hash, &bits.to_le_bytes()));
        if !SHOWN.contains(&cycle) {
            continue;
        }
        writeln!(text, "cycle {cycle}: hash {hash:016x}").expect("memory");
        for (name, values) in outputs.iter().zip(values) {
            let words: Vec<String> = values.iter().map(|value| format!("{value:?}")).collect();
            writeln!(text, "  {name} {}", words.join(" ")).expect("memory");
        }
    }
    text
}

#[test]
fn every_example_computes_the_bits_of_its_trace() {
    let cell = cell("configs/cells/demo.yaml");
    let bless = std::env::var_os("RCC_BLESS").is_some();
    let mut wrong = Vec::new();
    for entry in fs::read_dir(folder("configs/nets")).expect("the example nets") {
        let path = entry.expect("an entry").path();
        if path.extension().is_none_or(|extension| extension != "yaml") {
            continue;
        }
        let name = path.file_stem().expect("a name").to_string_lossy();
        let have = trace(&name, &cell);
        let golden = folder("tests/data/golden").join(format!("{name}.trace"));
        if bless {
            fs::write(&golden, &have).expect("the golden folder");
        }
        let want = fs::read_to_string(&golden).unwrap_or_default();
        let differs = have
            .lines()
            .zip(want.lines())
            .find(|(have, want)| have != want);
        if have != want {
            wrong.push(format!("{name}: {differs:?}"));
        }
    }
    assert!(wrong.is_empty(), "have, want: {wrong:#?}");
}

#[test]
fn a_net_run_twice_computes_the_same_bits() {
    let cell = cell("configs/cells/demo.yaml");
    assert_eq!(trace("guarded-line", &cell), trace("guarded-line", &cell));
}
