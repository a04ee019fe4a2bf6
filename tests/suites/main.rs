//! All suites in one test program, because linking is slow. Each test starts a cell of its own, and the tests run in
//! parallel on the threads of the test harness.

mod arrows;
mod bad_input;
mod book;
mod cells;
mod clock;
mod configuration;
mod crash;
mod crash_others;
mod descriptors;
mod doctor;
mod endurance;
mod errors_at_start;
mod errors_in_motion;
mod events;
mod examples;
mod flood;
mod handover;
mod impedance;
mod incidents;
mod life;
mod memory;
mod outcomes;
mod output;
mod plans;
mod readme;
mod rt_calls;
mod services;
mod several_arms;
mod streams;
mod syscalls;
mod threads;
mod timing;
mod together;
mod values;
mod version;
