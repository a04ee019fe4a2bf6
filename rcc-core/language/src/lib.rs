//! The language of nets: from a text to a checked net and its plan, with all faults of the text at once.
//! Run by the loader's threads and by `rcc-cli check`; nothing here is real-time.

pub mod anatomy;
pub mod check;
pub mod compile;
pub mod devices;
pub mod directionet;
pub mod expand;
pub mod fault;
pub mod format;
pub mod infer;
pub mod library;
pub mod lower;
pub mod names;
pub mod nulls;
pub mod rate;
pub mod resolve;
pub mod schema;
pub mod setting;
pub mod sources;
pub mod syntax;
pub mod write;

pub use compile::{Compiled, compile, compile_for, compile_with, dissect};
pub use rcc_config::diagnostic::Faults;
