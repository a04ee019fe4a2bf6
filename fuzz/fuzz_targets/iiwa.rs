//! `cargo +nightly fuzz run iiwa`: see `rcc_fuzz::iiwa`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::iiwa::run(data));
