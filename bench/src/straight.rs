//! The graphs as straight-line Rust, made by the build step: what a compiler makes of the same dataflow when it knows
//! all of it. What the interpreter is measured against; run by the benchmarks. Without the feature `straight-line` there are
//! none: compiling them takes 20 s.
#![allow(dead_code)] // Without that feature nothing uses the operations.

mod common;
mod null;
mod plain;

/// What the build step made; not for reading.
#[allow(clippy::all, unused_imports)]
mod generated {
    use super::{Hash, Inputs, Program, StraightLineProgram, null, plain};

    include!(concat!(env!("OUT_DIR"), "/straight.rs"));
}
pub use generated::ALL;

/// External inputs of one cycle.
#[derive(Clone, Copy, Debug)]
pub struct Inputs {
    /// `u`.
    pub u: [f64; 8],
    /// `v`.
    pub v: [bool; 4],
}

impl Inputs {
    /// The inputs of cycle `cycle`, counted from 1, as the graphs' expected values were made with.
    #[must_use]
    pub fn of(cycle: u64) -> Inputs {
        let u = |k: u64| ((cycle * (2 * k + 3)) % 1000) as f64 / 500.0 - 1.0;
        Inputs {
            u: [0, 1, 2, 3, 4, 5, 6, 7].map(u),
            v: [0, 1, 2, 3].map(|k| cycle >> k & 1 == 1),
        }
    }
}

/// A program and its state.
pub trait Program {
    /// One cycle for each of the inputs.
    fn run(&mut self, inputs: &[Inputs]);
    /// The hash of its results after the last cycle, as the graphs' files define it.
    fn hash(&self) -> u64;
}

/// A graph as a program.
#[derive(Clone, Copy, Debug)]
pub struct StraightLineProgram {
    /// Name of the graph's file without its end.
    pub graph: &'static str,
    /// Null is NaN and checked for; otherwise nothing is ever null.
    pub null: bool,
    /// Makes it, in its first state.
    pub make: fn() -> Box<dyn Program>,
}

/// FNV over 64-bit words.
struct Hash(u64);

impl Hash {
    fn new() -> Hash {
        Hash(0xcbf2_9ce4_8422_2325)
    }

    fn word(&mut self, word: u64) {
        self.0 = (self.0 ^ word).wrapping_mul(0x100_0000_01b3);
    }

    /// All NaNs are one null.
    fn real(&mut self, value: f64) {
        self.word(if value.is_nan() {
            0x7ff8_0000_0000_1eaf
        } else {
            value.to_bits()
        });
    }

    fn value(&self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_program_computes_what_its_graph_expects() {
        let inputs: Vec<Inputs> = (1..=1000).map(Inputs::of).collect();
        assert_eq!(
            ALL.len(),
            if cfg!(feature = "straight-line") {
                20
            } else {
                0
            }
        );
        for straight in ALL {
            let path = format!(
                "{}/graphs/{}.json",
                env!("CARGO_MANIFEST_DIR"),
                straight.graph
            );
            let text = std::fs::read_to_string(path).expect("a graph");
            let graph: serde_json::Value = serde_json::from_str(&text).expect("JSON");
            let (mut program, mut done) = ((straight.make)(), 0);
            for cycle in [1, 10, 100, 1000] {
                program.run(&inputs[done..cycle]);
                done = cycle;
                let expected = &graph["expected"][cycle.to_string()]["sinks_hash"];
                let name = straight.graph;
                assert_eq!(
                    *expected,
                    format!("{:016x}", program.hash()),
                    "{name}, cycle {cycle}"
                );
            }
        }
    }
}
