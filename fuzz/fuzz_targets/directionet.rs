//! `cargo +nightly fuzz run directionet`: see `rcc_fuzz::directionet`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::directionet::run(data));
