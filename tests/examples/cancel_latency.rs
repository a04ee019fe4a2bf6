//! Measures CANCEL by name while every door of a loader is flooded, and prints the distribution for each door, with the
//! machine's own stalls beside it. Run by hand: `cargo run --release -p rcc-tests --example cancel_latency`.

use std::process::Command;

use clap::Parser;
use rcc_tests::flood::{self, Options, kinds::FloodKind};

/// CANCEL by name, while everything else is asked for as often as possible.
#[derive(Parser)]
struct Arguments {
    /// Large nets that are loaded before.
    #[arg(long, default_value_t = 40)]
    nets: usize,
    /// Primitives of each.
    #[arg(long, default_value_t = 5000)]
    primitives: usize,
    /// CANCELs.
    #[arg(long, default_value_t = 300)]
    cancels: usize,
    /// Processes of each kind of flood; 0 measures without.
    #[arg(long, default_value_t = 1)]
    processes: usize,
    /// Kinds of floods; all without.
    #[arg(long = "kind", value_parser = kind)]
    kinds: Vec<FloodKind>,
}

fn kind(name: &str) -> Result<FloodKind, String> {
    let all = || FloodKind::ALL.map(FloodKind::name).join(", ");
    FloodKind::named(name).ok_or_else(|| format!("one of: {}", all()))
}

fn main() {
    flood::flood_if_asked();
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
