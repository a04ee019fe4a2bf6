//! The nets that the reference of the language and of the builder show are compiled.
//! Other documents have tests of their own.

use std::fs;
use std::path::{Path, PathBuf};

use rcc_config::{CellConfig, auto_ports};
use rcc_language::compile;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

#[test]
fn every_net_of_the_reference_is_valid() {
    let path = root().join("configs/cells/demo.yaml");
    let ports = auto_ports(&path).unwrap();
    let ports = ports.into_iter().map(|(name, _)| (name, 1)).collect();
    let cell = CellConfig::load(&path, &ports).unwrap();
    let mut nets = 0;
    for name in ["docs/language.md"] {
        let text = fs::read_to_string(root().join(name)).unwrap();
        for block in text.split("\n```yaml\n").skip(1) {
            let block = block.split("```").next().unwrap();
            if block.starts_with("net: ") {
                let compiled = compile(block, name, &cell);
                let compiled = compiled.unwrap_or_else(|faults| panic!("{faults}\n{block}"));
                assert_eq!(compiled.warnings.diagnostics, [], "{block}");
                nets += 1;
            }
        }
    }
    assert!(nets >= 2);
}
