//! The compiler of nets: from text to a checked net and its plan, with all errors of the text reported at once. Runs on
//! the loader's threads and in `rcc-cli check`; not real-time.
//!
//! The passes, in order: [`syntax`], `library` and `expand`, `resolve`, `infer`, `check`, `lower`. `compile` runs them.

pub mod bundle;
pub mod check;
pub mod codes;
pub mod compile;
pub mod devices;
pub mod directionet;
pub mod expand;
pub mod format;
pub mod infer;
pub mod input_values;
pub mod library;
pub mod lower;
pub mod names;
pub mod null_analysis;
pub mod rate;
pub mod resolve;
pub mod schema;
pub mod source_map;
pub mod structure;
pub mod syntax;
pub mod write;

pub use compile::{Compiled, compile, compile_for, compile_with, compile_with_structure};
pub use rcc_config::diagnostic::Faults;
