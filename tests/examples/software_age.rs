//! Measures how old the values of a software device in Python are in the cycle that reads them, at 100 Hz and at 1 kHz.
//! Usage: `cargo run --release -p rcc-tests --example software_age -- --seconds 60`.

use std::time::Duration;

use clap::Parser;
use rcc_tests::software_age::{HEADING, measure};

/// Measures how old the values of a software device in Python are in the cycle that reads them.
#[derive(Parser)]
struct Arguments {
    /// Duration of each row, s.
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Period of the device, ms; repeatable.
    #[arg(long = "period", default_values_t = [10, 1])]
    periods: Vec<u32>,
}

fn main() {
    rcc_tests::cell::without_time_limit();
    let Arguments { seconds, periods } = Arguments::parse();
    println!("{HEADING}");
    for period in periods {
        println!("{}", measure(period, Duration::from_secs_f64(seconds)));
    }
}
