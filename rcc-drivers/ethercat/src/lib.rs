//! EtherCAT (IEC 61158, type 12; ETG.1000): a line of simulated terminals.
//! Each program of this package is a process of its own; each module says which thread runs it.

#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod sim;
