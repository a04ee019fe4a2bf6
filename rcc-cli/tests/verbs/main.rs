//! The verbs of `rcc-cli` that need no cell, run as a user runs them. One program: each links all of `rcc-cli`.

mod cancel;
mod contact;
mod convert;
mod explain;
mod hostile_texts;
mod manual;
mod plots;
mod program;
mod recipes;
mod simulate;
mod tasks;
mod trajectory;
mod units;
mod url;
mod wrench;
