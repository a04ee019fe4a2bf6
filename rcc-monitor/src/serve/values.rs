//! Values of ports between their source and the pages: gathered until the next batch, then sent as columns. Filled by the
//! thread that reads records and by the serving thread.

use std::collections::BTreeMap;
use std::sync::Mutex;

use rcc_protocol::pattern::Pattern;
use serde_json::{Value, json};

use super::locked::locked;

/// Maximum number of rows of all columns that wait for the next batch; further ones are counted as lost.
const ROWS_MAX: usize = 50_000;

/// Where values come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// A `Monitor`: every cycle of its rate.
    Monitor,
    /// Samples by the loader.
    Sample,
}

impl Source {
    /// Returns the name on the page.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Source::Monitor => "monitor",
            Source::Sample => "sample",
        }
    }
}

/// A port of a command.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The command's id.
    pub id: u64,
    /// The net's name.
    pub net: String,
    /// `primitive.port`.
    pub port: String,
    /// Its type.
    pub ty: String,
    /// Its unit, if there is one.
    pub unit: Option<String>,
    /// Where its values come from.
    pub source: Source,
}

impl Series {
    /// Returns the name that is unique while the executor lives: `line#3/move.pose`.
    #[must_use]
    pub fn key(&self) -> String {
        format!("{}#{}/{}", self.net, self.id, self.port)
    }

    /// Returns true if a page's pattern means this port: by the net's name, or by name and id.
    #[must_use]
    pub fn is_meant_by(&self, pattern: &Pattern) -> bool {
        pattern.matches(&format!("{}/{}", self.net, self.port)) || pattern.matches(&self.key())
    }

    /// Returns the description for the page.
    #[must_use]
    pub fn described(&self) -> Value {
        json!({
            "key": self.key(), "id": self.id, "net": self.net, "port": self.port, "type": self.ty, "unit": self.unit,
            "source": self.source.name(),
        })
    }
}

/// Values of a port, oldest first.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The port.
    pub series: Series,
    /// Executor cycle of each value.
    pub cycles: Vec<u64>,
    /// The values: a number, a truth value, or a list of them; null is null.
    pub values: Vec<Value>,
}

#[derive(Debug, Default)]
struct CollectedValues {
    columns: BTreeMap<(u64, String), Column>,
    rows: usize,
    lost: u64,
}

/// Values that wait for the next batch.
#[derive(Debug, Default)]
pub struct Collector {
    gathered: Mutex<CollectedValues>,
}

impl Collector {
    /// Adds a value. Samples of a port are dropped while its monitor sends, which misses no cycle.
    pub fn add(&self, series: &Series, cycle: u64, value: Value) {
        let mut gathered = locked(&self.gathered);
        if gathered.rows >= ROWS_MAX {
            gathered.lost += 1;
            return;
        }
        let place = (series.id, series.port.clone());
        let column = gathered.columns.entry(place).or_insert_with(|| Column {
            series: series.clone(),
            cycles: Vec::new(),
            values: Vec::new(),
        });
        if column.series.source != series.source {
            if series.source == Source::Sample {
                return;
            }
            column.series = series.clone();
            column.cycles.clear();
            column.values.clear();
        }
        column.cycles.push(cycle);
        column.values.push(value);
        gathered.rows += 1;
    }

    /// Takes all columns, and the number of values that were lost for want of room.
    pub fn take(&self) -> (Vec<Column>, u64) {
        let gathered = std::mem::take(&mut *locked(&self.gathered));
        (gathered.columns.into_values().collect(), gathered.lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(source: Source) -> Series {
        Series {
            id: 3,
            net: "line".into(),
            port: "move.pose".into(),
            ty: "Pose".into(),
            unit: None,
            source,
        }
    }

    #[test]
    fn a_monitor_is_preferred_to_samples_of_the_same_port() {
        let collector = Collector::default();
        collector.add(&series(Source::Sample), 1, json!(1));
        collector.add(&series(Source::Monitor), 1, json!(1));
        collector.add(&series(Source::Sample), 2, json!(9));
        collector.add(&series(Source::Monitor), 2, json!(null));
        let (columns, lost) = collector.take();
        assert_eq!((columns.len(), lost), (1, 0));
        assert_eq!(columns[0].series.source, Source::Monitor);
        assert_eq!(columns[0].cycles, [1, 2]);
        assert_eq!(columns[0].values, [json!(1), json!(null)]);
        assert!(collector.take().0.is_empty());
    }

    #[test]
    fn what_waits_is_bounded_and_what_is_lost_is_counted() {
        let collector = Collector::default();
        for cycle in 0..ROWS_MAX as u64 + 7 {
            collector.add(&series(Source::Monitor), cycle, json!(0));
        }
        let (columns, lost) = collector.take();
        assert_eq!((columns[0].cycles.len(), lost), (ROWS_MAX, 7));
    }

    #[test]
    fn a_pattern_means_a_net_by_name_or_by_name_and_id() {
        let means = |pattern: &str| {
            series(Source::Sample).is_meant_by(&pattern.parse().expect("a pattern"))
        };
        for (pattern, meant) in [
            ("line/move.pose", true),
            ("line#3/move.pose", true),
            ("line#4/move.pose", false),
            ("line#3/*", true),
            ("*/move.*", true),
            ("other/move.pose", false),
        ] {
            assert_eq!(means(pattern), meant, "{pattern}");
        }
    }
}
