//! Compares a net of 500 formulas with the same net of primitives: loading (text to plan) and a cycle, measured in turns
//! in one run; both must compute the same bits. Runs on the main thread. Usage:
//! `cargo run --release -p rcc-bench --example formulas [--short]`

use std::time::Duration;

use rcc_bench::formulas::{FORMULAS, net_of};
use rcc_bench::instance::cell;
use rcc_bench::measure::{Effort, MeasuredSubject, TimeStats, alternate};
use rcc_core::cycle::{ReadyRun, cycle};
use rcc_core::frame::Frame;
use rcc_language::{Compiled, compile_for};

/// A compiled net in virtual time, without devices.
struct Running {
    net: Compiled,
    runs: Box<[ReadyRun]>,
    reals: Vec<f64>,
    bools: Vec<u8>,
    ints: Vec<i64>,
    cycles: u64,
}

impl Running {
    fn new(formulas: bool) -> Running {
        let net = compile_for(&net_of(formulas), "formulas.yaml", &cell()).expect("a net");
        Running {
            runs: net.plan.ready_runs(),
            reals: net.plan.reals.clone(),
            bools: net.plan.bools.clone(),
            ints: net.plan.ints.clone(),
            cycles: 0,
            net,
        }
    }

    fn evaluate(&mut self) {
        let mut frame = Frame {
            reals: &mut self.reals,
            bools: &mut self.bools,
            ints: &mut self.ints,
            models: &[],
            devices: &[],
            arms: &[],
            outputs: &mut [],
            motions: &mut (),
            dt_s: 1e-3,
            cycle: self.cycles,
            cancel_requested: false,
            terminated: false,
            outcome: 0,
            motion_failed: false,
        };
        cycle(&self.net.plan.schedule(&self.runs), &mut frame);
        self.cycles = frame.cycle;
    }

    /// The value of the last formula.
    fn last(&self) -> u64 {
        let all = &self.net.names.primitives;
        let last = all.iter().find(|primitive| primitive.id == "f500");
        let slot = last.expect("the last formula").outputs[0].slot;
        self.reals[slot as usize].to_bits()
    }
}

fn main() {
    let short = std::env::args().any(|argument| argument == "--short");
    let effort = match short {
        true => Effort::SHORT,
        false => Effort {
            rounds: 15,
            ..Effort::USUAL
        },
    };
    let mut nets = [true, false].map(Running::new);
    for _ in 0..10_000 {
        nets.iter_mut().for_each(Running::evaluate);
        assert_eq!(nets[0].last(), nets[1].last(), "not the same bits");
    }
    let counts = [0, 1].map(|net: usize| nets[net].net.plan.operands.len());
    assert_eq!(counts[0], counts[1], "not the same primitives");
    let mut running: Vec<_> = nets
        .iter_mut()
        .map(|net| MeasuredSubject::new(|cycles| (0..cycles).for_each(|_| net.evaluate())))
        .collect();
    report("a cycle, µs", 1e-3, &alternate(&mut running, effort));
    let (texts, cell) = ([true, false].map(net_of), cell());
    let mut loading: Vec<_> = texts
        .iter()
        .map(|text| {
            MeasuredSubject::new(|times| {
                for _ in 0..times {
                    let compiled = compile_for(text, "formulas.yaml", &cell);
                    std::hint::black_box(compiled.expect("a net"));
                }
            })
        })
        .collect();
    // A net takes milliseconds to load.
    let effort = match short {
        true => effort,
        false => Effort {
            stretch: Duration::from_millis(20),
            ..effort
        },
    };
    report("loading, ms", 1e-6, &alternate(&mut loading, effort));
}

fn report(what: &str, unit: f64, stats: &[TimeStats]) {
    let [formulas, primitives] = stats else {
        return;
    };
    let text = |stats: &TimeStats| {
        let [median, low, high] = [stats.median, stats.low, stats.high].map(|ns| ns * unit);
        format!("{median:.2} ({low:.2}–{high:.2})")
    };
    println!(
        "| {what} | {} | {} | {:.2} |",
        text(formulas),
        text(primitives),
        formulas.median / primitives.median
    );
    println!("{FORMULAS} formulas, their primitives, ratio");
}
