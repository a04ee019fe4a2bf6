//! `cargo +nightly fuzz run door`: see `rcc_fuzz::door`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::door::run(data));
