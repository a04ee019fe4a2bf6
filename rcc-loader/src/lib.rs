//! From the text of a net to a plan, and the server that offers it: see the modules.
//! Run by the loader's threads and by `rcc-cli check`; nothing here is real-time.

pub mod check;
pub mod compile;
pub mod devices;
pub mod fault;
pub mod infer;
pub mod lower;
pub mod names;
pub mod rate;
pub mod resolve;
pub mod server;
pub mod syntax;

pub use compile::{Compiled, compile, compile_for};
pub use rcc_config::diagnostic::Faults;
