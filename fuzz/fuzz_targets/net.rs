//! `cargo +nightly fuzz run net`: see `rcc_fuzz::net`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::net::run(data));
