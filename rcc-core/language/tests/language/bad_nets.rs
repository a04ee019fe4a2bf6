//! Every diagnostic code has a net in `tests/nets/bad` that causes it, with the expected rendering beside it.
//! `RCC_BLESS=1` rewrites the expected texts; review each of them before committing.

use std::collections::BTreeSet;
use std::path::PathBuf;

use crate::expected::{files, stem};
use rcc_language::codes::DESCRIPTIONS;

/// Returns the nets of the folder, in YAML and in DirectIONet.
fn nets() -> Vec<PathBuf> {
    [files("yaml"), files("net")].concat()
}

#[test]
fn every_bad_net_gives_its_expected_diagnostics() {
    crate::expected::check_diagnostics("yaml", &[]);
}

#[test]
fn every_code_has_a_net() {
    let stems = nets().iter().map(|path| stem(path)).collect::<Vec<_>>();
    for description in DESCRIPTIONS {
        let has = stems.iter().any(|stem| stem.starts_with(description.code));
        assert!(
            has,
            "{}: {} needs a file in tests/nets/bad",
            description.code, description.meaning
        );
    }
}

#[test]
fn nets_and_expected_texts_come_in_pairs() {
    let nets: BTreeSet<String> = nets().iter().map(|path| stem(path)).collect();
    let texts: BTreeSet<String> = files("txt").iter().map(|path| stem(path)).collect();
    assert_eq!(nets, texts);
}

#[test]
fn errors_refuse_a_net_and_warnings_do_not() {
    crate::expected::check_refusals("yaml", &[]);
}
