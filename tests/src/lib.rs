//! Harness for tests across processes: builds the programs once, gives each test its own cell, kills processes on
//! request, and cleans up even when the test fails. Runs on the threads of the test harness.

pub mod cell;
pub mod cell_fixture;
pub mod census;
pub mod cycle_times;
pub mod dashboard;
pub mod endurance;
pub mod flood;
pub mod handover;
pub mod injection;
pub mod journal;
pub mod lateness;
pub mod matrix;
pub mod nets;
pub mod process;
pub mod processes;
pub mod programs;
pub mod records;
pub mod reference;
pub mod rest;
pub mod rt_calls;
pub mod rules;
pub mod set_points;
pub mod simulator;
pub mod software_age;
pub mod stalls;
pub mod turns;
pub mod unsupervised_cell;
pub mod waiting;

pub use cell::TestCell;
pub use cell_fixture::CellFixture;
pub use programs::{program, repository};
pub use unsupervised_cell::UnsupervisedCell;
pub use waiting::{LIMIT, await_some, await_told};
