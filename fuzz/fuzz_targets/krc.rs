//! `cargo +nightly fuzz run krc`: see `rcc_fuzz::krc`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::krc::run(data));
