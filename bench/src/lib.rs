//! Benchmark subjects: the benchmark graphs (`graphs/`), nets of one kernel of the catalogue, and the graphs as
//! straight-line Rust. Used by `cargo bench -p rcc-bench` and by the programs in `examples/`; nothing here is
//! real-time.
//!
//! `cargo bench -p rcc-bench --features straight-line` compares with straight-line code in the same run; `bench/hal`,
//! `bench/wakeup` and `bench/kinematics/compare` compare with LinuxCNC HAL, cyclictest and other kinematics libraries.

pub use rcc_engine::kernel_nets;

pub mod executor;
pub mod formulas;
pub mod graph;
pub mod instance;
pub mod measure;
pub mod motion;
pub mod net;
pub mod notations;
pub mod straight;
