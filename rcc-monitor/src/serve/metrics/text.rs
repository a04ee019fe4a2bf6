//! The text of metrics: OpenMetrics 1.0, and Prometheus' text format 0.0.4 for readers that do not know it. Pure
//! functions; run by the serving thread.

use std::borrow::Cow;
use std::fmt;

use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, NoLabelSet, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::Registry;

/// A format of the text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextFormat {
    /// OpenMetrics 1.0: a counter's family has the name without `_total`, and each family states its unit.
    OpenMetrics,
    /// Text format 0.0.4: a counter's family has the whole name.
    Prometheus,
}

impl TextFormat {
    /// Returns the value of `content-type`.
    #[must_use]
    pub fn content_type(self) -> &'static str {
        match self {
            TextFormat::OpenMetrics => "application/openmetrics-text; version=1.0.0; charset=utf-8",
            TextFormat::Prometheus => "text/plain; version=0.0.4; charset=utf-8",
        }
    }
}

/// The unit of a family, the last part of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Seconds.
    Seconds,
    /// 0 to 1.
    Ratio,
}

/// A value.
#[derive(Clone, Debug, PartialEq)]
pub enum Number {
    /// A whole number.
    Whole(u64),
    /// Any number.
    Real(f64),
    /// A histogram.
    Distribution {
        /// Sum of all samples.
        sum: f64,
        /// Their number.
        count: u64,
        /// Inclusive upper bound and number of samples above the previous bound; the last bound is infinite.
        buckets: Vec<(f64, u64)>,
    },
}

impl Number {
    /// 1 for true, 0 for false.
    #[must_use]
    pub fn of(value: bool) -> Number {
        Number::Whole(u64::from(value))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Counter,
    Gauge,
    Histogram,
}

type Labels = Vec<(&'static str, String)>;

/// Values of one kind.
#[derive(Clone, Debug)]
pub struct Family {
    /// Its name, without unit and `_total`.
    pub name: &'static str,
    help: &'static str,
    kind: Kind,
    unit: Option<Unit>,
    samples: Vec<(Labels, Number)>,
}

impl Family {
    fn new(name: &'static str, help: &'static str, kind: Kind) -> Family {
        Family {
            name,
            help,
            kind,
            unit: None,
            samples: Vec::new(),
        }
    }

    /// A family of numbers that only grow while the executor lives.
    #[must_use]
    pub fn counter(name: &'static str, help: &'static str) -> Family {
        Family::new(name, help, Kind::Counter)
    }

    /// A family of numbers that change.
    #[must_use]
    pub fn gauge(name: &'static str, help: &'static str) -> Family {
        Family::new(name, help, Kind::Gauge)
    }

    /// A family of histograms.
    #[must_use]
    pub fn histogram(name: &'static str, help: &'static str) -> Family {
        Family::new(name, help, Kind::Histogram)
    }

    /// Gives it a unit.
    #[must_use]
    pub fn unit(mut self, unit: Unit) -> Family {
        self.unit = Some(unit);
        self
    }

    /// Adds a value.
    #[must_use]
    pub fn with(mut self, labels: &[(&'static str, &str)], number: Number) -> Family {
        self.add(labels, number);
        self
    }

    /// Adds a value.
    pub fn add(&mut self, labels: &[(&'static str, &str)], number: Number) {
        let labels = labels
            .iter()
            .map(|(key, value)| (*key, (*value).to_owned()));
        self.samples.push((labels.collect(), number));
    }
}

/// Writes all families; each value has the cell's name as a label.
///
/// # Errors
/// Never, in effect: the text is written to memory.
pub fn written(
    cell: &str,
    families: Vec<Family>,
    format: TextFormat,
) -> Result<String, fmt::Error> {
    let label = (Cow::Borrowed("cell"), Cow::Owned(cell.to_owned()));
    let mut registry = Registry::with_labels([label].into_iter());
    registry.register_collector(Box::new(Families { families, format }));
    let mut written = String::new();
    text::encode(&mut written, &registry)?;
    if format == TextFormat::Prometheus {
        let known = |line: &&str| !line.starts_with("# UNIT ") && *line != "# EOF";
        let lines = written.lines().filter(known);
        written = lines.flat_map(|line| [line, "\n"]).collect();
    }
    Ok(written)
}

#[derive(Debug)]
struct Families {
    families: Vec<Family>,
    format: TextFormat,
}

impl Collector for Families {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        use prometheus_client::registry::Unit as Suffix;
        for family in self
            .families
            .iter()
            .filter(|family| !family.samples.is_empty())
        {
            let whole_name = family.kind == Kind::Counter && self.format == TextFormat::Prometheus;
            let name = match whole_name {
                true => format!("{}_total", family.name),
                false => family.name.to_owned(),
            };
            let kind = match family.kind {
                Kind::Counter => MetricType::Counter,
                Kind::Gauge => MetricType::Gauge,
                Kind::Histogram => MetricType::Histogram,
            };
            let unit = family.unit.map(|unit| match unit {
                Unit::Seconds => Suffix::Seconds,
                Unit::Ratio => Suffix::Other("ratio".to_owned()),
            });
            let mut told = encoder.encode_descriptor(&name, family.help, unit.as_ref(), kind)?;
            for (labels, number) in &family.samples {
                let mut sample = told.encode_family(labels)?;
                match number {
                    Number::Whole(value) if family.kind == Kind::Counter && !whole_name => {
                        sample.encode_counter::<NoLabelSet, u64, u64>(value, None)?;
                    }
                    Number::Whole(value) => sample.encode_gauge(value)?,
                    Number::Real(value) => sample.encode_gauge(value)?,
                    Number::Distribution {
                        sum,
                        count,
                        buckets,
                    } => {
                        sample.encode_histogram::<NoLabelSet>(*sum, *count, buckets, None)?;
                    }
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn families() -> Vec<Family> {
        vec![
            Family::counter("rcc_cycles", "Cycles").with(&[], Number::Whole(7)),
            Family::gauge("rcc_nets", "Nets").with(&[("net", "a\"b\\c\nd")], Number::Whole(1)),
            Family::gauge("rcc_none", "No sample"),
            Family::histogram("rcc_wakeup", "Delay")
                .unit(Unit::Seconds)
                .with(
                    &[],
                    Number::Distribution {
                        sum: 0.5,
                        count: 3,
                        buckets: vec![(1.535e-6, 1), (f64::INFINITY, 2)],
                    },
                ),
        ]
    }

    #[test]
    fn open_metrics_tells_types_units_and_the_end() {
        let text = written("demo", families(), TextFormat::OpenMetrics).expect("text");
        let expected = "\
# HELP rcc_cycles Cycles
# TYPE rcc_cycles counter
rcc_cycles_total{cell=\"demo\"} 7
# HELP rcc_nets Nets
# TYPE rcc_nets gauge
rcc_nets{cell=\"demo\",net=\"a\\\"b\\\\c\\nd\"} 1
# HELP rcc_wakeup_seconds Delay
# TYPE rcc_wakeup_seconds histogram
# UNIT rcc_wakeup_seconds seconds
rcc_wakeup_seconds_sum{cell=\"demo\"} 0.5
rcc_wakeup_seconds_count{cell=\"demo\"} 3
rcc_wakeup_seconds_bucket{cell=\"demo\",le=\"0.000001535\"} 1
rcc_wakeup_seconds_bucket{cell=\"demo\",le=\"+Inf\"} 3
# EOF
";
        assert_eq!(text, expected);
    }

    #[test]
    fn the_older_format_has_whole_names_and_neither_units_nor_an_end() {
        let text = written("demo", families(), TextFormat::Prometheus).expect("text");
        assert!(text.starts_with(
            "# HELP rcc_cycles_total Cycles\n# TYPE rcc_cycles_total counter\nrcc_cycles_total{cell=\"demo\"} 7\n"
        ));
        assert!(!text.contains("# UNIT") && !text.contains("# EOF"));
        assert!(text.ends_with("le=\"+Inf\"} 3\n"));
    }
}
