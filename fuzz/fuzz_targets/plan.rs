//! `cargo +nightly fuzz run plan`: see `rcc_fuzz::plan`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::plan::run(data));
