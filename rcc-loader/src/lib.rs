//! The server that loads nets, see the module.
//! Run by the loader's threads; nothing here is real-time.

pub mod server;
