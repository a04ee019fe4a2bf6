//! Results of other programs, measured in turns with ours: LinuxCNC HAL (`bench/hal`) and cyclictest (`bench/wakeup`).

use std::error::Error;
use std::fs;
use std::path::Path;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::table::{digits, table};

const HAL_GOAL: f64 = 4.0;
const WAKEUP_GOAL: f64 = 1.3;

/// A row of `bench/hal --json`.
#[derive(Deserialize)]
struct HalRow {
    nodes: usize,
    period_us: u64,
    rounds: usize,
    hal_ns: f64,
    rcc_ns: f64,
    ratio: f64,
    fifo: bool,
}

/// A row of `bench/wakeup --json`.
#[derive(Deserialize)]
struct WakeupRow {
    condition: String,
    rounds: usize,
    seconds: f64,
    priority: u8,
    core: usize,
    fifo: bool,
    cyclictest_us: [f64; 3],
    rcc_us: [f64; 3],
    ratio_p99: f64,
    ratio_low: f64,
    ratio_high: f64,
    load_average: f64,
}

/// Returns the section of the page; see the module.
pub fn section(hal: Option<&Path>, wakeup: Option<&Path>) -> Result<String, Box<dyn Error>> {
    let hal: Option<Vec<HalRow>> = hal.map(read).transpose()?;
    let wakeup: Option<Vec<WakeupRow>> = wakeup.map(read).transpose()?;
    Ok(format!(
        "## LinuxCNC HAL\n\n{}\n## Wake-up\n\n{}\n## Elsewhere\n\n\
         `cargo run --profile deploy -p rcc-bench --example nets` measures loading by size, fragments that are not active, reading \
         values and the predecessor's nets, and writes them into `docs/performance-nets.md`. [performance-motion.md](performance-motion.md) \
         has kinematics, motions and other programs of kinematics.{}{}\n",
        hal_text(hal.as_deref()),
        wakeup_text(wakeup.as_deref()),
        if hal.is_none() {
            " Not measured: LinuxCNC HAL."
        } else {
            ""
        },
        if wakeup.is_none() {
            " Not measured: the wake-up against cyclictest."
        } else {
            ""
        },
    ))
}

/// Reads the rows that a script wrote.
fn read<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, Box<dyn Error>> {
    Ok(serde_json::from_str(&fs::read_to_string(path)?)?)
}

fn goal(ratio: f64, met: bool, sign: char, goal: f64) -> String {
    format!(
        "{sign} {goal}: {}",
        if met {
            "met".to_owned()
        } else {
            format!("**missed**, {}", digits(ratio))
        }
    )
}

fn hal_text(rows: Option<&[HalRow]>) -> String {
    let Some(rows) = rows else {
        return "Not measured here: run `bench/hal --json FILE` where `linuxcnc-uspace` is installed.\n".into();
    };
    let fair = rows.iter().all(|row| row.fifo);
    let cells = rows.iter().map(|row| {
        vec![
            format!("scalar_{}, every {} µs", row.nodes, row.period_us),
            digits(row.hal_ns),
            digits(row.rcc_ns),
            digits(row.ratio),
            goal(row.ratio, row.ratio >= HAL_GOAL, '≥', HAL_GOAL),
        ]
    });
    format!(
        "ns per component, with the same graph in both, {} rounds in turns, each in a loop under SCHED_FIFO on the same core{}; \
         *ratio* is the median of the rounds' ratios. HAL's results were compared with the graph's. HAL as shipped \
         reads the clock before and after every component, which is most of its cost per component; the comparison is \
         with HAL as it is used. A long pause between cycles cools the caches of both, and other programs on that core \
         cool them further.\n\n{}",
        rows.first().map_or(0, |row| row.rounds),
        if fair {
            ""
        } else {
            " (**not granted to both: no fair comparison**)"
        },
        table(
            &["graph", "HAL", "RCC", "ratio", "goal"],
            &cells.collect::<Vec<_>>()
        )
    )
}

fn wakeup_text(rows: Option<&[WakeupRow]>) -> String {
    let Some(rows) = rows.filter(|rows| !rows.is_empty()) else {
        return "Not measured here: run `bench/wakeup --json FILE` as root where `rt-tests` and `stress-ng` are installed.\n".into();
    };
    let (first, fair) = (&rows[0], rows.iter().all(|row| row.fifo));
    let three = |figures: [f64; 3]| figures.map(digits).join(" / ");
    let cells = rows.iter().map(|row| {
        vec![
            format!(
                "{}, load average {}",
                row.condition,
                digits(row.load_average)
            ),
            three(row.cyclictest_us),
            three(row.rcc_us),
            format!(
                "{} ({}–{})",
                digits(row.ratio_p99),
                digits(row.ratio_low),
                digits(row.ratio_high)
            ),
            goal(
                row.ratio_p99,
                row.ratio_p99 <= WAKEUP_GOAL,
                '≤',
                WAKEUP_GOAL,
            ),
        ]
    });
    format!(
        "How long after its deadline the thread runs, µs: p50 / p99 / max, medians of {} runs of {} s each, in turns, period 1 ms, \
         SCHED_FIFO {} on core {}{}. RCC is the real executor, idle in a cell of its own, measured by its own \
         histogram. *Ratio* is the ratio of the p99 values: the median of the pairs, and their range. The tails are \
         caused by the machine; a load average above that of stress-ng alone means that other programs ran on these \
         cores.\n\n{}",
        first.rounds,
        first.seconds,
        first.priority,
        first.core,
        if fair {
            ""
        } else {
            " (**not granted to both: no fair comparison**)"
        },
        table(
            &["machine", "cyclictest", "RCC", "ratio of p99", "goal"],
            &cells.collect::<Vec<_>>()
        )
    )
}
