//! The compiler of nets: from text to a checked net and its plan, with all errors of the text reported at once. Runs on
//! the loader's threads and in `rcc-cli check`; not real-time.
//!
//! `compile` runs the passes in order: [`parse`], `library`, `leg_conditions`, `formula`, `expand`, `resolve`, `infer`, `check`, `lower`; each is the
//! module of its name. [`syntax`] is what they begin with, `names` what users see of the plan.

mod adjacency;
pub mod bundle;
pub mod check;
pub mod codes;
pub mod compile;
mod components;
pub mod condition;
pub mod devices;
pub mod expand;
pub mod format;
pub mod formula;
pub mod infer;
pub mod input_values;
pub mod leg_conditions;
pub mod library;
pub mod lower;
pub mod names;
pub mod null_analysis;
pub mod parse;
pub mod resolve;
pub mod schema;
pub mod source_map;
pub mod structure;
pub mod syntax;
pub mod write;

pub use compile::{Compiled, Compiler, compile, compile_for};
pub use rcc_config::diagnostic::Faults;
