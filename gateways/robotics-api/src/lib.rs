//! Gateway for the Java Robotics API v2: its applications drive a cell of RCC over their own protocol, unmodified. A
//! process of its own and a client of the loader; nothing of it runs in the cycle. See `docs/robotics-api.md`.

#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod attached;
pub mod cell_stream;
pub mod condition;
pub mod devices;
pub mod dio;
pub mod engine;
#[cfg(test)]
mod fake_loader;
pub mod firing;
pub mod gateway;
pub mod http;
pub mod loader;
pub mod mirror;
pub mod net_text;
pub mod net_values;
pub mod net_watch;
pub mod outbox;
pub mod own_cell;
pub mod pushes;
pub mod rate_limiter;
pub mod requests;
pub mod rules;
pub mod server;
pub mod state;
pub mod stop_kind;
pub mod stops;
mod text_reader;
pub mod values;
pub mod websocket;

pub use text_reader::SyntaxError;
