//! The language of nets: from a text to a checked net and its plan, with all faults of the text at once.
//! Run by the loader's threads and by `rcc-cli check`; nothing here is real-time.
//!
//! Without the feature `plan` there are only [`syntax`], [`write`](mod@write) and [`fault`], for programs that make or change nets.

#[cfg(feature = "plan")]
pub mod anatomy;
#[cfg(feature = "plan")]
pub mod bundle;
#[cfg(feature = "plan")]
pub mod check;
#[cfg(feature = "plan")]
pub mod compile;
#[cfg(feature = "plan")]
pub mod devices;
#[cfg(feature = "plan")]
pub mod directionet;
#[cfg(feature = "plan")]
pub mod expand;
pub mod fault;
#[cfg(feature = "plan")]
pub mod format;
#[cfg(feature = "plan")]
pub mod infer;
#[cfg(feature = "plan")]
pub mod library;
#[cfg(feature = "plan")]
pub mod lower;
#[cfg(feature = "plan")]
pub mod names;
#[cfg(feature = "plan")]
pub mod nulls;
#[cfg(feature = "plan")]
pub mod rate;
#[cfg(feature = "plan")]
pub mod resolve;
#[cfg(feature = "plan")]
pub mod schema;
#[cfg(feature = "plan")]
pub mod setting;
#[cfg(feature = "plan")]
pub mod sources;
pub mod syntax;
pub mod write;

#[cfg(feature = "plan")]
pub use compile::{Compiled, compile, compile_for, compile_with, dissect};
pub use rcc_config::diagnostic::Faults;
