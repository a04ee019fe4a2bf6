//! A simulated Sunrise Cabinet with a KUKA LBR iiwa or LBR Med, and the application that runs on it: it sends first,
//! supervises the answers, and moves a simulated arm.
//! [`cabinet::Cabinet`] is the pure model in virtual time; [`program`] adds sockets, a clock and threads.

mod application;
pub mod cabinet;
pub mod control;
pub mod fault;
mod message;
pub mod options;
pub mod pose;
pub mod program;
pub mod robot;
pub mod settings;
pub mod station;
pub mod statistics;

#[cfg(test)]
mod tests;

pub use super::arm::{JOINTS, Joints};
