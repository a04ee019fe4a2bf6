//! `cargo +nightly fuzz run incident`: see `rcc_fuzz::incident`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::incident::run(data));
