//! The compiler of nets: from text to a checked net and its plan, with all errors of the text reported at once. Runs on
//! the loader's threads and in `rcc-cli check`; not real-time.
//!
//! The passes, in order: [`syntax`], `library` and `expand`, `resolve`, `infer`, `check`, `lower`. `compile` runs them.
//!
//! Without the feature `plan` there are only [`syntax`], [`write`](mod@write) and [`codes`], for programs that generate
//! or modify nets.

#[cfg(feature = "plan")]
pub mod bundle;
#[cfg(feature = "plan")]
pub mod check;
pub mod codes;
#[cfg(feature = "plan")]
pub mod compile;
#[cfg(feature = "plan")]
pub mod devices;
#[cfg(feature = "plan")]
pub mod directionet;
#[cfg(feature = "plan")]
pub mod expand;
#[cfg(feature = "plan")]
pub mod format;
#[cfg(feature = "plan")]
pub mod infer;
#[cfg(feature = "plan")]
pub mod input_values;
#[cfg(feature = "plan")]
pub mod library;
#[cfg(feature = "plan")]
pub mod lower;
#[cfg(feature = "plan")]
pub mod names;
#[cfg(feature = "plan")]
pub mod null_analysis;
#[cfg(feature = "plan")]
pub mod rate;
#[cfg(feature = "plan")]
pub mod resolve;
#[cfg(feature = "plan")]
pub mod schema;
#[cfg(feature = "plan")]
pub mod source_map;
#[cfg(feature = "plan")]
pub mod structure;
pub mod syntax;
pub mod write;

#[cfg(feature = "plan")]
pub use compile::{Compiled, compile, compile_for, compile_with, compile_with_structure};
pub use rcc_config::diagnostic::Faults;
