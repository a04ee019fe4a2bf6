//! The nets of `tests/nets/bad` in DirectIONet give their expected diagnostics.

#[path = "../../language/tests/expected/mod.rs"]
mod expected;

use rcc_directionet::NOTATION;

#[test]
fn every_bad_net_gives_its_expected_diagnostics() {
    assert!(!expected::files("net").is_empty());
    expected::check_diagnostics("net", &[NOTATION]);
}

#[test]
fn errors_refuse_a_net_and_warnings_do_not() {
    expected::check_refusals("net", &[NOTATION]);
}
