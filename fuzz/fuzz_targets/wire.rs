//! `cargo +nightly fuzz run wire`: see `rcc_fuzz::wire`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::wire::run(data));
