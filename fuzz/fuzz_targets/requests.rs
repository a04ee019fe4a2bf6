//! `cargo +nightly fuzz run requests`: see `rcc_fuzz::requests`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::requests::run(data));
