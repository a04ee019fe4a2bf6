//! The engine with nets, rules and devices, in virtual time. One program: each links engine and compiler. Run by the threads of the
//! test harness.

#[path = "../common/mod.rs"]
mod common;

mod admission;
mod handover;
mod hostile;
mod impedance;
mod inputs;
mod lifecycle;
mod rates;
mod rehearsal;
mod replay;
mod rules;
mod timing;
mod topics;
mod work;
