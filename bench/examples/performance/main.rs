//! Measures and writes docs/performance.md: `cargo run --profile deploy -p rcc-bench --features straight-line --example
//! performance -- [--rounds N] [--hal FILE] [--wakeup FILE] [--output FILE] [--short]`. The files are written by `bench/hal
//! --json` and `bench/wakeup --json`; without a file the page says that it was not measured. One thread.

mod executor;
mod graphs;
mod load;
mod machine;
mod others;
mod primitives;
mod table;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rcc_bench::measure::Effort;

/// The commands that create the page.
const CONSOLE: &str = "\
$ bench/hal --json target/hal.json; bench/wakeup --json target/wakeup.json      # as root, where installed\n\
$ cargo build --profile deploy -p rcc-bench --features straight-line --example performance\n\
$ chrt -f 10 taskset -c 1 target/deploy/examples/performance --hal target/hal.json --wakeup target/wakeup.json\n";

/// Command-line arguments.
struct Arguments {
    effort: Effort,
    hal: Option<PathBuf>,
    wakeup: Option<PathBuf>,
    output: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = arguments()?;
    // In this order, because the effects of a long run on the machine must not disturb the shortest times.
    let machine = machine::section("Performance", CONSOLE, &arguments.effort)?;
    let graphs = graphs::section(arguments.effort)?;
    let executor = executor::section(arguments.effort)?;
    let primitives = primitives::section(arguments.effort)?;
    let load = load::section(arguments.effort)?;
    let others = others::section(arguments.hal.as_deref(), arguments.wakeup.as_deref())?;
    let text = [machine, graphs, executor, others, primitives, load].join("\n");
    fs::write(&arguments.output, text)?;
    eprintln!("performance: wrote {}", arguments.output.display());
    Ok(())
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut arguments = Arguments {
        effort: Effort {
            // A virtual machine may run at half its speed for seconds to minutes: the rounds of a row outlast that.
            rounds: 31,
            stretches: 25,
            stretch: Duration::from_millis(1),
        },
        hal: None,
        wakeup: None,
        output: Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/performance.md"),
    };
    let mut given = std::env::args().skip(1);
    while let Some(name) = given.next() {
        if name == "--short" {
            arguments.effort = Effort::SHORT;
            continue;
        }
        let value = given
            .next()
            .ok_or_else(|| format!("{name} needs a value"))?;
        match name.as_str() {
            "--rounds" => arguments.effort.rounds = value.parse::<usize>()?.max(5),
            "--hal" => arguments.hal = Some(value.into()),
            "--wakeup" => arguments.wakeup = Some(value.into()),
            "--output" => arguments.output = value.into(),
            _ => {
                return Err(format!(
                    "unknown option `{name}`: use --rounds, --hal, --wakeup, --output or --short"
                )
                .into());
            }
        }
    }
    Ok(arguments)
}
