//! Gateway: Foxglove and Lichtblick watch a cell live. A process of its own that reads what monitors read and is a client of
//! the loader; nothing here can delay a cycle.
//!
//! A viewer gets the bytes that `rcc-cli record` writes (`rcc-reading` makes both): nets with a `ros2msg`
//! schema of their own, joint states, frames, poses, wrenches, diagnostics, and events as logs.
//!
//! The server is written here, over `tokio-tungstenite`, and not taken from the crate `foxglove` (Foxglove's SDK), because
//! that one
//!
//! - lets everybody in who reaches the port: it checks neither a token nor `Host` nor `Origin`, and any page in any browser
//!   of the machine may open a WebSocket to 127.0.0.1;
//! - accepts the subprotocol `foxglove.sdk.v1` only, under which the messages are the same: older Lichtblicks offer
//!   `foxglove.websocket.v1` and are refused;
//! - brings 110 packages; this needs nine that the workspace did not have.
//!
//! The protocol is small: ten texts and three frames ([`protocol`]).

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod access;
pub mod cell;
pub mod connection;
pub mod listener;
pub mod outbox;
pub mod parameters;
pub mod protocol;
pub mod server;
pub mod services;
pub mod viewers;
