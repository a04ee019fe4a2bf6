//! `cargo +nightly fuzz run fri`: see `rcc_fuzz::fri`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::fri::run(data));
