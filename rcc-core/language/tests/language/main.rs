//! Nets from the text to the values of a cycle, in virtual time. One program: each links the compiler and the engine. Run by the
//! threads of the test harness.

#[path = "../expected/mod.rs"]
mod expected;
#[path = "../generate/mod.rs"]
mod generate;
#[path = "../harness/mod.rs"]
mod harness;

mod arrays;
mod bad_nets;
mod compiler;
mod docs;
mod example_nets;
mod formulas;
mod fragments;
mod goals;
mod inputs;
mod layout;
mod lists;
mod nulls;
mod outcomes;
mod random_nets;
mod regions;
mod schema;
mod several_arms;
mod single_mistakes;
mod space;
mod types;
mod worked;
mod write;
