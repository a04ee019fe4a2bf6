//! The documentation is correct: its nets compile for the demo cell, and the primitive that it explains is the one in
//! the catalogue.

#[allow(dead_code)] // Pages need no cycle.
use std::fs;
use std::path::PathBuf;

use crate::harness::{cell, folder};
use rcc_language::compile;

/// Returns the README and every page of `docs/`.
fn pages() -> Vec<(PathBuf, String)> {
    let docs = fs::read_dir(folder("docs")).expect("the docs");
    let docs = docs.map(|entry| entry.expect("an entry").path());
    let pages = docs.chain([folder("README.md")]);
    pages
        .filter(|path| path.extension().is_some_and(|extension| extension == "md"))
        .map(|path| {
            let text = fs::read_to_string(&path).expect("a page");
            (path, text)
        })
        .collect()
}

/// Returns the code blocks of a kind.
fn blocks<'a>(text: &'a str, kind: &str) -> Vec<&'a str> {
    let fence = format!("```{kind}\n");
    let parts = text.split(fence.as_str()).skip(1);
    parts
        .map(|part| part.split("\n```").next().unwrap_or_default())
        .collect()
}

#[test]
fn every_net_of_the_documentation_compiles() {
    let (demo, golden) = (
        cell("configs/cells/demo.yaml"),
        cell("tests/nets/cell.yaml"),
    );
    let mut nets = 0;
    for (path, text) in pages() {
        for block in blocks(&text, "yaml") {
            let whole = block.lines().any(|line| line.starts_with("net:"));
            if !whole || !block.contains("\nprimitives:") {
                continue;
            }
            nets += 1;
            let page = path.display().to_string();
            if let Err(faults) = compile(block, &page, &demo) {
                compile(block, &page, &golden).unwrap_or_else(|_| panic!("{faults}"));
            }
        }
    }
    assert!(nets >= 3, "{nets} nets in the documentation");
}

#[test]
fn the_primitive_in_the_documentation_is_the_one_in_the_catalogue() {
    let page = fs::read_to_string(folder("docs/primitive.md")).expect("the page");
    let shown = blocks(&page, "rust");
    let file =
        fs::read_to_string(folder("rcc-core/src/primitives/logic/toggle.rs")).expect("the file");
    assert_eq!(shown[0].trim_end(), file.trim_end());
    let table = fs::read_to_string(folder("rcc-core/src/primitives/logic.rs")).expect("the table");
    for line in blocks(&page, "text")[0].lines() {
        let found = table.lines().filter(|row| row.trim() == line).count();
        assert_eq!(found, 1, "`{line}` stands in the table once");
    }
}
