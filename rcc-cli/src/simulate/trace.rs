//! Monitored values of a simulated net: last values, a table over time, and bounded series for plots. Used on the
//! caller's thread.

use std::io::{self, Write};

use rcc_core::message::{MONITOR_WIDTH_MAX, MonitorRecord};
use rcc_core::types::Store;
use rcc_language::names::{MonitorNames, Names};

use crate::csv;
use crate::plot::{PlotCurve, PlotPanel};

/// Number of buckets of a series from which pairs are merged; at least two per pixel of a plot.
const BUCKETS_MAX: usize = 4096;

/// One column: an element of a monitored value.
#[derive(Clone, Debug)]
pub struct MonitorColumn {
    /// Name `net/primitive.port`, with `[index]` for elements.
    pub name: String,
    /// Unit; empty if none.
    pub unit: String,
    monitor: usize,
    element: usize,
    store: Store,
    /// Newest value; `None` is null.
    pub last: Option<f64>,
    /// True once a value was recorded.
    pub seen: bool,
    /// Values over time, for plots.
    pub series: BucketedSeries,
}

/// Values over time, stored as the range of values in equal intervals.
#[derive(Clone, Debug, Default)]
pub struct BucketedSeries {
    buckets: Vec<SeriesBucket>,
    /// Number of values per bucket.
    each: u32,
    filled: u32,
}

/// One interval of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeriesBucket {
    /// Start of the interval, s.
    pub time_s: f64,
    /// Smallest and largest value; `None` if any value was null.
    pub range: Option<[f64; 2]>,
}

impl BucketedSeries {
    /// Adds a value; `None` is null.
    pub fn push(&mut self, time_s: f64, value: Option<f64>) {
        let range = value.map(|value| [value, value]);
        match self.buckets.last_mut() {
            Some(bucket) if self.filled < self.each => {
                bucket.range = merge_ranges(bucket.range, range);
                self.filled += 1;
            }
            _ => {
                if self.buckets.len() >= BUCKETS_MAX {
                    self.halve();
                }
                self.each = self.each.max(1);
                self.buckets.push(SeriesBucket { time_s, range });
                self.filled = 1;
            }
        }
    }

    fn halve(&mut self) {
        let pairs = self.buckets.chunks(2).map(|pair| SeriesBucket {
            range: pair
                .iter()
                .skip(1)
                .fold(pair[0].range, |all, one| merge_ranges(all, one.range)),
            ..pair[0]
        });
        self.buckets = pairs.collect();
        self.each = self.each.saturating_mul(2);
    }

    /// Returns the intervals in order of time.
    #[must_use]
    pub fn buckets(&self) -> &[SeriesBucket] {
        &self.buckets
    }
}

/// Merges two ranges; a null in either gives a null.
fn merge_ranges(one: Option<[f64; 2]>, other: Option<[f64; 2]>) -> Option<[f64; 2]> {
    let ([a, b], [c, d]) = (one?, other?);
    Some([a.min(c), b.max(d)])
}

/// All columns of a net.
#[derive(Debug)]
pub struct MonitorTrace {
    columns: Vec<MonitorColumn>,
}

impl MonitorTrace {
    /// Creates the columns of a net. Values shown by several monitors get one column.
    #[must_use]
    pub fn new(names: &Names) -> MonitorTrace {
        let mut columns: Vec<MonitorColumn> = Vec::new();
        for (monitor, row) in names.monitors.iter().enumerate() {
            let width = (row.width as usize).min(MONITOR_WIDTH_MAX);
            for element in 0..width {
                let name = column_name(&names.net, row, element);
                if columns.iter().all(|column| column.name != name) {
                    columns.push(MonitorColumn {
                        name,
                        unit: row.unit.clone().unwrap_or_default(),
                        monitor,
                        element,
                        store: row.store,
                        last: None,
                        seen: false,
                        series: BucketedSeries::default(),
                    });
                }
            }
        }
        MonitorTrace { columns }
    }

    /// Returns the columns in the order of the net's monitors.
    #[must_use]
    pub fn columns(&self) -> &[MonitorColumn] {
        &self.columns
    }

    /// Records the values of one cycle at `time_s` (s since the start); returns true if there were any.
    pub fn record(&mut self, time_s: f64, records: &[MonitorRecord]) -> bool {
        for column in &mut self.columns {
            let record = records
                .iter()
                .find(|record| record.monitor as usize == column.monitor);
            let value = record.and_then(|record| record.values.get(column.element));
            if let Some(value) = value {
                column.seen = true;
                column.last = number(column.store, *value);
                column.series.push(time_s, column.last);
            }
        }
        !records.is_empty()
    }

    /// Writes the header line of the table.
    ///
    /// # Errors
    /// Returns the writer's error.
    pub fn write_head(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut heads = vec!["time [s]".to_owned()];
        for MonitorColumn { name, unit, .. } in &self.columns {
            heads.push(match unit.as_str() {
                "" => name.clone(),
                unit => format!("{name} [{unit}]"),
            });
        }
        writeln!(out, "{}", csv::line(&heads))
    }

    /// Writes one line with the values of a cycle: null is `null`, and values not due are empty.
    ///
    /// # Errors
    /// Returns the writer's error.
    pub fn write_line(
        &self,
        out: &mut dyn Write,
        time_s: f64,
        records: &[MonitorRecord],
    ) -> io::Result<()> {
        write!(out, "{time_s}")?;
        for column in &self.columns {
            let due = records
                .iter()
                .any(|record| record.monitor as usize == column.monitor);
            match (due, column.last) {
                (false, _) => write!(out, ",")?,
                (true, None) => write!(out, ",null")?,
                (true, Some(value)) => write!(out, ",{value}")?,
            }
        }
        writeln!(out)
    }
}

/// Returns one panel per unit, with a curve through the smallest and largest value of each interval of every recorded
/// column.
#[must_use]
pub fn panels(columns: &[MonitorColumn]) -> Vec<PlotPanel> {
    let mut panels: Vec<PlotPanel> = Vec::new();
    for column in columns.iter().filter(|column| column.seen) {
        let unit = if column.unit.is_empty() {
            "1"
        } else {
            &column.unit
        };
        let empty = panel_of(unit);
        let index = match panels.iter().position(|panel| panel.title == empty.title) {
            Some(index) => index,
            None => {
                panels.push(empty);
                panels.len() - 1
            }
        };
        let curves = &mut panels[index].curves;
        curves.push(PlotCurve {
            name: column.name.clone(),
            segments: segments(column.series.buckets()),
            colour: curves.len(),
        });
    }
    panels
}

/// Returns an empty panel of values with this unit over time.
#[must_use]
pub fn panel_of(unit: &str) -> PlotPanel {
    PlotPanel::over_time(format!("[{unit}]"), Vec::new())
}

/// Returns a curve through the smallest and largest value of each interval; null is a gap.
#[must_use]
pub fn segments(buckets: &[SeriesBucket]) -> Vec<Vec<(f64, f64)>> {
    let known = buckets.split(|bucket| bucket.range.is_none());
    let stretch = |buckets: &[SeriesBucket]| {
        let pairs = buckets
            .iter()
            .filter_map(|bucket| Some((bucket.time_s, bucket.range?)));
        let points = pairs.flat_map(|(time_s, [low, high])| {
            let second = (low != high).then_some((time_s, high));
            [(time_s, low)].into_iter().chain(second)
        });
        points.collect::<Vec<_>>()
    };
    known
        .map(stretch)
        .filter(|points| !points.is_empty())
        .collect()
}

fn column_name(net: &str, row: &MonitorNames, element: usize) -> String {
    match row.width {
        1 => format!("{net}/{}", row.source),
        _ => format!("{net}/{}[{element}]", row.source),
    }
}

/// Converts a monitored element to a number; `None` is null. Int is transmitted as its bits.
fn number(store: Store, value: f64) -> Option<f64> {
    match store {
        Store::Int => {
            let value = value.to_bits().cast_signed();
            (value != i64::MIN).then_some(value as f64)
        }
        Store::Real | Store::Bool => (!value.is_nan()).then_some(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_series_keeps_its_extremes_in_bounded_memory() {
        let mut series = BucketedSeries::default();
        for step in 0..1_000_000_u32 {
            let spike = if step == 777_777 { 5.0 } else { 0.0 };
            series.push(f64::from(step), Some(spike));
        }
        assert!(series.buckets().len() <= BUCKETS_MAX);
        let most = series.buckets().iter().filter_map(|bucket| bucket.range);
        assert_eq!(most.fold(0.0, |most: f64, [_, high]| most.max(high)), 5.0);
        assert!(
            series
                .buckets()
                .windows(2)
                .all(|pair| pair[0].time_s < pair[1].time_s)
        );
    }

    #[test]
    fn a_null_is_a_gap() {
        let mut series = BucketedSeries::default();
        series.push(0.0, Some(1.0));
        series.push(1.0, None);
        assert_eq!(series.buckets()[1].range, None);
        assert_eq!(number(Store::Bool, f64::NAN), None);
        assert_eq!(
            number(Store::Int, f64::from_bits(i64::MIN.cast_unsigned())),
            None
        );
        assert_eq!(number(Store::Int, f64::from_bits(7)), Some(7.0));
    }
}
