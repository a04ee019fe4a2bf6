//! From the text of a net to a plan, and the server that offers it: see the modules.
//! Run by the loader's threads and by `rcc-cli check`; nothing here is real-time.

pub mod server;
