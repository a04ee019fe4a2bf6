//! What the cycle is measured with: the benchmark graphs (`graphs/`), nets of one kernel of the catalogue, and the graphs
//! as straight-line Rust. Run by `cargo bench -p rcc-bench` and by the programs in `examples/`; nothing here is real-time.
//!
//! `cargo bench -p rcc-bench --features straight-line` measures against straight-line code in the same run;
//! `bench/hal`, `bench/wakeup` and `bench/kinematics/compare` measure against LinuxCNC HAL, cyclictest and other kinematics.

pub use rcc_engine::kernel_nets;

pub mod executor;
pub mod graph;
pub mod instance;
pub mod measure;
pub mod motion;
pub mod net;
pub mod straight;
