//! Target `directionet`: arbitrary text in the predecessor's form. The rules of `net` apply; and an accepted net must
//! remain the same when it is written as YAML and read again. Run by the thread of the target.

use rcc_directionet::{NOTATION, compiler, looks_like};
use rcc_language::parse::parse;
use rcc_language::{compile_for, write};

use crate::net;
use crate::shipped::shipped;

/// Parses the bytes as DirectIONet, runs an accepted net, and writes it as YAML.
pub fn run(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else {
        return;
    };
    if !looks_like(text) {
        return;
    }
    net::run(data);
    let table = &shipped().table;
    let Ok(theirs) = compiler(table).compile(text, "net.net") else {
        return;
    };
    let mut faults = Vec::new();
    let Some(model) = parse(text, "net.net", table, &[NOTATION], &mut faults) else {
        panic!("a text that compiles cannot be read");
    };
    let yaml = write::yaml(&model);
    match compile_for(&yaml, "net.yaml", table) {
        Ok(ours) => assert!(
            format!("{:?}", theirs.plan) == format!("{:?}", ours.plan),
            "another plan:\n{yaml}"
        ),
        Err(faults) => panic!("the YAML of an accepted net is refused:\n{yaml}\n{faults}"),
    }
}
