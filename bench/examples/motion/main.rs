//! Measures motion and writes docs/performance-motion.md: `cargo run --profile deploy -p rcc-bench --example motion --
//! [--kinematics FILE] [--topp FILE] [--rounds N] [--output FILE]`. The files are written by `bench/kinematics/compare
//! --json` and `bench/topp/compare --json`. One thread.

#[path = "../performance/machine.rs"]
mod machine;
mod optimum;
mod others;
mod planning;
#[path = "../performance/table.rs"]
mod table;

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rcc_bench::measure::{Effort, alternate};
use rcc_bench::motion::{groups, replan};

use crate::table::{spread, table, verdict};

/// The commands that create the page.
const CONSOLE: &str = "\
$ bench/kinematics/compare --json target/kinematics.json      # as root, where the others are installed\n\
$ bench/topp/compare --json target/topp.json                  # where toppra is installed\n\
$ cargo build --profile deploy -p rcc-bench --example motion\n\
$ chrt -f 10 taskset -c 1 target/deploy/examples/motion --kinematics target/kinematics.json \\\n    --topp target/topp.json\n";

/// Number of states from which new goals are planned.
const REPLANNED: usize = 200_000;
/// The same for a single round, which only tries the program.
const REPLANNED_SHORT: usize = 200;

/// Command-line arguments.
struct Arguments {
    effort: Effort,
    kinematics: Option<PathBuf>,
    topp: Option<PathBuf>,
    output: PathBuf,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = arguments()?;
    let machine = machine::section("Performance of motion", CONSOLE, &arguments.effort)?;
    let cycles = cycles(arguments.effort);
    let replan = replanning(arguments.effort);
    let others = others::section(arguments.kinematics.as_deref())?;
    let optimum = optimum::section(arguments.topp.as_deref())?;
    let planning = planning::section(arguments.effort);
    fs::write(
        &arguments.output,
        [machine, cycles, replan, planning, others, optimum].join("\n"),
    )?;
    eprintln!("motion: wrote {}", arguments.output.display());
    Ok(())
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut arguments = Arguments {
        effort: Effort {
            rounds: 9,
            stretches: 15,
            stretch: Duration::from_millis(1),
        },
        kinematics: None,
        topp: None,
        output: Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/performance-motion.md"),
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
            "--kinematics" => arguments.kinematics = Some(value.into()),
            "--topp" => arguments.topp = Some(value.into()),
            "--output" => arguments.output = value.into(),
            _ => {
                return Err(format!(
                    "unknown option `{name}`: use --rounds, --kinematics, --topp, --output or --short"
                )
                .into());
            }
        }
    }
    Ok(arguments)
}

/// Measures all subjects in turns; one table for each group.
fn cycles(effort: Effort) -> String {
    eprintln!("motion: kinematics, path clock, motions, nets");
    let (mut heads, mut subjects) = (Vec::new(), Vec::new());
    for group in groups() {
        let names = group.subjects.iter();
        heads.push((
            group.name,
            names
                .map(|it| (it.name.clone(), it.goal_ns))
                .collect::<Vec<_>>(),
        ));
        subjects.extend(group.subjects.into_iter().map(|it| it.subject));
    }
    let mut figures = alternate(&mut subjects, effort).into_iter();
    let mut text = String::from(
        "## In a cycle\n\n\
         ns per call, from single functions up to a whole cycle of a net. Goals are compared with the fastest round, \
         which is the cost of the code: other programs on the machine only add time. Kinematics are evaluated at 256 \
         random positions in turn.\n",
    );
    for (group, names) in heads {
        let rows = names.into_iter().zip(&mut figures);
        let rows = rows.map(|((name, goal), figure)| {
            let goal = goal.map_or(String::new(), |goal| verdict(figure.low, goal));
            vec![name, spread(figure, 1.0), goal]
        });
        text += &format!(
            "\n{}",
            table(&[group, "ns", "goal"], &rows.collect::<Vec<_>>())
        );
    }
    text
}

fn replanning(effort: Effort) -> String {
    eprintln!("motion: replanning");
    let cases = match effort.rounds {
        0..=1 => REPLANNED_SHORT,
        _ => REPLANNED,
    };
    let rows = replan::measure(cases).into_iter().map(|spread| {
        let times = spread.ns.map(|ns| ns.to_string());
        [spread.name.to_owned()].into_iter().chain(times).collect()
    });
    format!(
        "## New goals while an arm moves\n\n\
         Seven joints of an LWR 4+, each planned with its limits of velocity, acceleration and jerk (`JointGoal`): the \
         duration, ns, that this share of {cases} cases did not exceed, including reading the clock. The last column \
         and most of the one before it are caused by interruptions of the machine, not by the code, in which every \
         loop has a constant bound.\n\n{}",
        table(
            &["seven joints", "50 %", "99 %", "99.9 %", "all"],
            &rows.collect::<Vec<_>>()
        )
    )
}
