//! `cargo +nightly fuzz run boards`: see `rcc_fuzz::boards`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::boards::run(data));
