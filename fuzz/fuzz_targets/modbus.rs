//! `cargo +nightly fuzz run modbus`: see `rcc_fuzz::modbus`. Run by libFuzzer's one thread.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| rcc_fuzz::modbus::run(data));
