//! Measures how old the values of a software device are in the cycle that reads them, with a program in Python.
//! Runs on the thread of the program that measures.

use std::fmt;
use std::fs;
use std::time::Duration;

use rcc_testing::quantile;

use crate::cell_fixture::CellFixture;
use crate::records::RecordCollector;
use crate::{TestCell, await_some, repository};

/// Answers each line with the time at which it does so (CLOCK_MONOTONIC, s).
const PROGRAM: &str = "\
import json, sys, time
for line in sys.stdin:
    frame = json.loads(line)['frame']
    print(json.dumps({'frame': frame, 'values': {'answered': time.monotonic()}}), flush=True)
";

/// Reads both times in every cycle; the order of its monitors is that of [`AGE`] and [`ANSWERED`].
const NET: &str = "\
net: age
primitives:
  cancel:   {type: Cancel}
  age:      {type: AnalogInput, parameters: {device: program, channel: age}}
  answered: {type: AnalogInput, parameters: {device: program, channel: answered}}
  end:      {type: Termination, inputs: {done: cancel.requested}}
  watch_age:      {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: age.out}}
  watch_answered: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: answered.out}}
";
const AGE: u32 = 0;
const ANSWERED: u32 = 1;

/// How old the values are at one period of the device; times in s, sorted, one for each cycle with a known value.
#[derive(Clone, Debug, Default)]
pub struct AgeRow {
    /// Period of the device, ms.
    pub period_ms: u32,
    /// Cycles of the executor.
    pub cycles: usize,
    /// Cycles in which the value was null.
    pub nulls: usize,
    /// The input `age`: since the outputs left from which the program made its values, when the driver read them.
    pub ages: Vec<f64>,
    /// From the program's answer to the cycle that reads it.
    pub since_answer: Vec<f64>,
}

/// The heading of the rows.
pub const HEADING: &str = "\
| period of the device | time | cycles | null | least, ms | p50, ms | p90, ms | p99, ms | p99.9, ms | max, ms |
|---|---|---|---|---|---|---|---|---|---|";

impl fmt::Display for AgeRow {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = [
            ("`age`", &self.ages),
            ("answer → cycle", &self.since_answer),
        ];
        for (name, sorted) in rows {
            let (period, cycles, nulls) = (self.period_ms, self.cycles, self.nulls);
            write!(formatter, "| {period} ms | {name} | {cycles} | {nulls} |")?;
            for part in [0.0, 0.5, 0.9, 0.99, 0.999, 1.0] {
                let value = quantile(sorted, part).unwrap_or(f64::NAN);
                write!(formatter, " {:.2} |", value * 1e3)?;
            }
            if name == "`age`" {
                writeln!(formatter)?;
            }
        }
        Ok(())
    }
}

/// Measures for `time` in a cell of its own.
///
/// # Panics
/// Panics if the cell does not start, or the program does not answer.
pub fn measure(period_ms: u32, time: Duration) -> AgeRow {
    let place = CellFixture::new(&repository().join("configs/cells/demo.yaml"), |_| {
        format!(
            "cell: age
period: 1 ms
stale_after: 250 ms
executor: {{priority: 80}}
devices:
  program:
    driver: software
    settings: {{command: [python3, answer.py], period: {period_ms} ms, timeout: 1 s}}
    channels:
      age:      {{kind: analog input, address: age, unit: s}}
      answered: {{kind: analog input, address: answered, unit: s}}
"
        )
    });
    fs::write(place.folder().join("answer.py"), PROGRAM).expect("a file");
    let cell = TestCell::in_fixture(place);
    let id = cell.run(NET);
    await_some("the program to answer", || {
        let reply = cell.rest("GET", &format!("/commands/{id}/values?ports=age.out"), "");
        reply.body["values"][0]["value"].as_f64()
    });
    let records = RecordCollector::follow(&cell);
    // The time is the measurement's length: there is no event to wait for.
    std::thread::sleep(time);
    let records = records.finish();
    cell.done(id, "cancel");
    cell.assert_ends(id, "canceled");
    cell.stop();
    let mut row = AgeRow {
        period_ms,
        ..AgeRow::default()
    };
    for record in records.iter().filter(|record| record.command == id) {
        let value = record.values[0];
        match record.monitor {
            AGE => {
                row.cycles += 1;
                row.nulls += usize::from(value.is_nan());
                row.ages.extend((!value.is_nan()).then_some(value));
            }
            ANSWERED if !value.is_nan() => {
                row.since_answer.push(record.stamp_ns as f64 * 1e-9 - value);
            }
            _ => {}
        }
    }
    row.ages.sort_by(f64::total_cmp);
    row.since_answer.sort_by(f64::total_cmp);
    row
}
