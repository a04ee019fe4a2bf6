//! A bench for tests across processes: builds the programs once, starts a cell of its own for each
//! test, kills what is asked for, and leaves nothing behind, also when the test fails.

pub mod cell;
pub mod programs;
pub mod reference;
pub mod simulator;

pub use cell::TestCell;
pub use programs::{program, repository};
