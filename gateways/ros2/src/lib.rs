//! Gateway: a cell among ROS 2 nodes. It publishes joint states, frames, wrenches, diagnostics, events and what nets publish;
//! with `--control` it starts nets, sets their Inputs, and executes `FollowJointTrajectory`. A process of its own that reads
//! what monitors read and is a client of the loader; nothing here can delay a cycle.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod cell;
pub mod loader;
pub mod names;
pub mod nets;
pub mod node;
pub mod parameters;
pub mod raw;
pub mod services;
pub mod sink;
pub mod topics;
pub mod trajectory;
