//! Measures the latency of CANCEL by name while every interface of a loader is flooded, and prints its distribution for
//! each interface beside the machine's own stalls. Usage: `cargo run --release -p rcc-tests --example cancel_latency`.

use std::process::Command;

use clap::Parser;
use rcc_tests::flood::{self, Options, kinds::FloodKind};

/// Measures the latency of CANCEL by name while the loader is flooded with requests.
#[derive(Parser)]
struct Arguments {
    /// Number of large nets loaded before the flood.
    #[arg(long, default_value_t = 40)]
    nets: usize,
    /// Primitives of each large net.
    #[arg(long, default_value_t = 5000)]
    primitives: usize,
    /// Number of CANCELs.
    #[arg(long, default_value_t = 300)]
    cancels: usize,
    /// Processes for each kind of flood; 0 measures without floods.
    #[arg(long, default_value_t = 1)]
    processes: usize,
    /// Kind of flood, repeatable; all kinds by default.
    #[arg(long = "kind", value_parser = kind)]
    kinds: Vec<FloodKind>,
}

fn kind(name: &str) -> Result<FloodKind, String> {
    let all = || FloodKind::ALL.map(FloodKind::name).join(", ");
    FloodKind::named(name).ok_or_else(|| format!("one of: {}", all()))
}

fn main() {
    flood::flood_if_asked();
    rcc_tests::cell::without_time_limit();
    let Arguments {
        nets,
        primitives,
        cancels,
        processes,
        kinds,
    } = Arguments::parse();
    let options = Options {
        nets,
        primitives,
        cancels,
        processes,
        kinds: if kinds.is_empty() {
            FloodKind::ALL.to_vec()
        } else {
            kinds
        },
    };
    let again = || Command::new(std::env::current_exe().expect("a program has a path"));
    println!("{}", flood::run(&options, &again));
}
