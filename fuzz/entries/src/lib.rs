//! Entry points of the fuzz targets: one module per target, each with one function that takes bytes and panics when a
//! rule is violated. Run by libFuzzer's one thread, and by the test that replays the kept corpus.
//!
//! No program uses this package. A rule that a target checks is computed here independently, not with the code under
//! test.

pub mod boards;
pub mod cell;
pub mod directionet;
pub mod engine;
pub mod fri;
pub mod iiwa;
pub mod incident;
pub mod krc;
pub mod modbus;
pub mod net;
pub mod plan;
pub mod requests;
pub mod rest;
pub mod set_point_checker;
pub mod shipped;
pub mod wire;

/// Name and entry point of a target.
pub type Target = (&'static str, fn(&[u8]));

/// All targets; each has a program of the same name in `fuzz/fuzz_targets` and a folder in `fuzz/corpus`.
pub const TARGETS: &[Target] = &[
    ("boards", boards::run),
    ("cell", cell::run),
    ("directionet", directionet::run),
    ("fri", fri::run),
    ("iiwa", iiwa::run),
    ("incident", incident::run),
    ("krc", krc::run),
    ("modbus", modbus::run),
    ("net", net::run),
    ("plan", plan::run),
    ("requests", requests::run),
    ("rest", rest::run),
    ("wire", wire::run),
];
