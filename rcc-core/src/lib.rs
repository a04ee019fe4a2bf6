//! Everything that runs inside a control cycle: types, primitives, plan, `cycle()`, guard, kinematics, and the messages
//! between processes.
//!
//! This crate is the real-time boundary: no `std`, no `alloc`, no `unsafe`, no panic. Anything that is forbidden in a
//! cycle does not compile here; whatever is computed before a cycle reaches it as plain data.
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

// Some files of `testing/` are compiled into the unit tests too, where `rcc_core` is this crate.
#[cfg(test)]
extern crate self as rcc_core;
#[cfg(test)]
extern crate std;

pub mod axis;
pub mod branchless;
pub mod counted;
pub mod cycle;
pub mod duration;
pub mod filter;
pub mod fnv;
pub mod frame;
pub mod guard;
pub mod helper;
pub mod histogram;
pub mod impedance;
pub mod joints;
pub mod kinematics;
pub mod linear;
pub mod message;
pub mod path;
pub mod plan;
pub mod pose;
pub mod primitive;
pub mod primitives;
pub mod printable;
pub mod rotation;
pub mod spatial;
pub mod timing;
pub mod topic;
pub mod types;
pub mod unit;
pub mod vector;
pub mod workspace;

#[cfg(test)]
mod testing;
