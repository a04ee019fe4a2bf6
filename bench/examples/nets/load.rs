//! Measures how the loading time grows with the size of the text, from the text to the checked plan: chains and the
//! mixed graphs.

use std::error::Error;
use std::fmt::Write;
use std::time::Instant;

use rcc_bench::graph::{Graph, SIZES};
use rcc_bench::instance::cell;
use rcc_bench::measure::{Effort, median};
use rcc_bench::net::net;
use rcc_language::compile_for;

use crate::table::{digits, table, verdict};

/// Texts from this size on, bytes, have a goal for the loading time, ms: well under a second.
const MEGABYTE: usize = 1_000_000;
const GOAL_MS: f64 = 500.0;
const CHAINS: [usize; 6] = [500, 1000, 2000, 4000, 8000, 20_000];

/// Returns the section of the page; see the module.
pub fn section(effort: Effort) -> Result<String, Box<dyn Error>> {
    let (mut rows, rounds) = (Vec::new(), effort.rounds);
    for size in CHAINS {
        rows.push(row(format!("chain of {size}"), size, &chain(size), rounds)?);
    }
    for size in SIZES {
        let text = net(&Graph::load("full", size)?).text;
        rows.push(row(format!("mixed graph of {size}"), size, &text, rounds)?);
    }
    Ok(format!(
        "## Loading\n\n\
         From the text to the checked plan, fastest and median of {rounds}; the time per primitive shows whether the \
         loading time grows faster than the text.\n\n{}",
        table(
            &[
                "net",
                "text, kB",
                "fastest, ms",
                "median, ms",
                "µs a primitive (fastest)",
                "MB/s (fastest)",
                "a megabyte, ms",
            ],
            &rows
        )
    ))
}

fn row(
    name: String,
    size: usize,
    text: &str,
    rounds: usize,
) -> Result<Vec<String>, Box<dyn Error>> {
    eprintln!("nets: loading {name}");
    let (cell, mut times) = (cell(), Vec::new());
    for _ in 0..rounds {
        let begun = Instant::now();
        compile_for(text, "net.yaml", &cell)?;
        times.push(begun.elapsed().as_secs_f64() * 1e3);
    }
    let fastest = times.iter().copied().fold(f64::INFINITY, f64::min);
    Ok(vec![
        name,
        digits(text.len() as f64 / 1e3),
        digits(fastest),
        digits(median(times)),
        digits(fastest * 1e3 / size as f64),
        digits(text.len() as f64 / fastest / 1e3),
        if text.len() >= MEGABYTE {
            verdict(fastest, GOAL_MS)
        } else {
            String::new()
        },
    ])
}

/// Returns the text of a net with a chain of sums.
fn chain(size: usize) -> String {
    let mut text = "net: chain\nprimitives:\n  n0: {type: Time}\n".to_owned();
    for number in 1..size {
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "  n{number}: {{type: Add, inputs: {{a: n{}.out, b: {number}.5}}}}",
            number - 1
        );
    }
    let last = size - 1;
    let _ = writeln!(
        text,
        "  far: {{type: Greater, inputs: {{a: n{last}.out, b: -1.0}}}}\n  end: {{type: Termination, inputs: {{done: far.out}}}}"
    );
    text.replace(
        "{type: Time}",
        "{type: AnalogInput, parameters: {device: station, channel: u0}}",
    )
}
