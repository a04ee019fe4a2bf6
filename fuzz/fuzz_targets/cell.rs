//! `cargo +nightly fuzz run cell`: see `rcc_fuzz::cell`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::cell::run(data));
