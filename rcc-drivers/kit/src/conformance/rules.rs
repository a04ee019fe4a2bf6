//! The rules, one function each; a rule panics if the driver violates it.
//! Test code only.

mod configuration;
mod exchange;
mod faults;
mod in_a_cell;
mod outputs;
mod rest;
mod restart;

pub use configuration::*;
pub use exchange::*;
pub use faults::*;
pub use in_a_cell::*;
pub use outputs::*;
pub use rest::*;
pub use restart::*;

pub use super::capture::{replays_a_recording, replays_its_capture};

#[test]
fn every_rule_is_in_the_docs() {
    let suite = include_str!("../conformance.rs");
    let docs = include_str!("../../../../docs/drivers.md");
    let table = suite.split("macro_rules! conformance").nth(1);
    let table = table.and_then(|text| text.split("\n}\n").next());
    let lines = table.expect("the table of rules").lines();
    let rule = |line: &'static str| line.strip_prefix("            ")?.strip_suffix(',');
    let names: Vec<&str> = lines
        .filter_map(rule)
        .filter(|name| !name.contains('$'))
        .collect();
    assert!(names.len() > 30, "{names:?}");
    for name in names {
        assert!(
            docs.contains(&format!("`{name}`")),
            "docs/drivers.md lacks {name}"
        );
    }
}
