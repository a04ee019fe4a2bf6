//! Measures the time from the write of a value to the cycle that sees it, through a set-point channel and by requests,
//! quiet and beside a moving arm. Usage: `cargo run --release -p rcc-tests --example set_points`.

use clap::Parser;
use rcc_tests::set_points::{HEADING, MeasurementPlan, measure};

/// Measures the time from the write of a value to the cycle that sees it.
#[derive(Parser)]
struct Arguments {
    /// Duration of each row, s.
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
    /// Rate of the channel, Hz; repeatable.
    #[arg(long = "rate", default_values_t = [100, 500, 1000])]
    rates: Vec<u32>,
}

fn main() {
    rcc_tests::cell::without_time_limit();
    let Arguments { seconds, rates } = Arguments::parse();
    println!("{HEADING}");
    for row in measure(&MeasurementPlan { rates, seconds }) {
        println!("{row}");
    }
}
