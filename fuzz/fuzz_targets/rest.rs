//! `cargo +nightly fuzz run rest`: see `rcc_fuzz::rest`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::rest::run(data));
