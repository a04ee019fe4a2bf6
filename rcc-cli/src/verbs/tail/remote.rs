//! `tail` of the cell at an address: asks its loader for the values that follow the last ones. Run by the main thread.

use std::time::{Duration, Instant};

use rcc_api::bodies::{HistoryPage, MonitoredValue};
use rcc_core::counted::Counted;
use rcc_core::printable::OneLine;
use serde_json::{Value, json};

use crate::client::{LoaderClient, segment};
use crate::context::{Context, OutputFormat};
use crate::failure::Failure;
use crate::interrupt::Interrupts;
use crate::output::{print_note, print_record};

/// Interval between two requests, unless more values are waiting.
const REQUEST_INTERVAL: Duration = Duration::from_millis(100);
/// Maximum number of values of an answer.
const LIMIT: usize = 10_000;

/// Values to print, and for how long.
pub(super) struct RemoteTail<'a> {
    pub patterns: &'a [String],
    pub count: Option<u64>,
    pub duration: Option<Duration>,
}

impl RemoteTail<'_> {
    /// Prints values until the count or the time is reached.
    ///
    /// # Errors
    /// Fails if the loader cannot be reached or refuses a pattern, or if Ctrl-C ended the verb.
    pub fn run(&self, context: &Context) -> Result<(), Failure> {
        let interrupts = Interrupts::listen()?;
        let client = context.client()?;
        let (begun, mut printed) = (Instant::now(), 0);
        let mut printer = Printer {
            format: context.format,
            first_stamp_ns: None,
        };
        let mut after = self.page(&client, "limit=0")?.next;
        while self.count.is_none_or(|most| printed < most) {
            if interrupts.asked() {
                return Err(Failure::interrupted());
            }
            if self.duration.is_some_and(|limit| begun.elapsed() >= limit) {
                break;
            }
            let left = self.count.map_or(LIMIT as u64, |most| most - printed);
            let limit = left.min(LIMIT as u64);
            let page = self.page(&client, &format!("limit={limit}&after={after}"))?;
            printer.note_loss(&page);
            page.values.iter().for_each(|value| printer.print(value));
            printed += page.values.len() as u64;
            after = page.next;
            if (page.values.len() as u64) < limit {
                std::thread::sleep(REQUEST_INTERVAL);
            }
        }
        Ok(())
    }

    fn page(&self, client: &LoaderClient, query: &str) -> Result<HistoryPage, Failure> {
        let ports: Vec<String> = self.patterns.iter().map(|port| segment(port)).collect();
        let ports = match ports.is_empty() {
            true => String::new(),
            false => format!("&ports={}", ports.join(",")),
        };
        client.get(&format!("/history?{query}{ports}"))
    }
}

/// Prints values as `rcc-monitor` does.
struct Printer {
    format: OutputFormat,
    first_stamp_ns: Option<u64>,
}

impl Printer {
    fn note_loss(&self, page: &HistoryPage) {
        if !page.continues {
            print_note(
                "values are missing here: the executor or the loader was restarted, or the loader keeps no more",
            );
        }
        match self.format {
            OutputFormat::Human if page.lost > 0 => {
                print_note(&format!("lost here: {}", Counted(page.lost, "record")));
            }
            OutputFormat::Json if page.lost > 0 => {
                print_record(&json!({"lost": page.lost}).to_string());
            }
            OutputFormat::Human | OutputFormat::Json => {}
        }
    }

    fn print(&mut self, value: &MonitoredValue) {
        match self.format {
            // Serializing numbers and texts cannot fail.
            OutputFormat::Json => print_record(&serde_json::to_string(value).unwrap_or_default()),
            OutputFormat::Human => {
                let first = *self.first_stamp_ns.get_or_insert(value.stamp_ns);
                print_record(&line(value, first));
            }
        }
    }
}

/// Formats a value for people, with its time since the first one.
fn line(value: &MonitoredValue, first_stamp_ns: u64) -> String {
    let seconds = value.stamp_ns.saturating_sub(first_stamp_ns) as f64 / 1e9;
    let mut line = format!("{seconds:10.3} s  {:<24}", OneLine(&value.name).to_string());
    let whole = matches!(value.ty.split('[').next(), Some("Bool" | "Int"));
    let element = |element: &Value| match element {
        Value::Null => "–".to_owned(),
        Value::Number(number) if !whole => format!("{:.6}", number.as_f64().unwrap_or(f64::NAN)),
        other => other.to_string(),
    };
    let elements = match &value.value {
        Value::Array(all) => all.iter().map(element).collect(),
        one => vec![element(one)],
    };
    for element in elements {
        line.push_str(&format!(" {element:>11}"));
    }
    match value.unit.as_deref() {
        None | Some("" | "1") => {}
        Some(unit) => line.push_str(&format!(" {unit}")),
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(ty: &str, value: Value) -> MonitoredValue {
        MonitoredValue {
            name: "line/move.pose".to_owned(),
            ty: ty.to_owned(),
            unit: Some("m".to_owned()),
            stamp_ns: 1_250_000_000,
            value,
            ..MonitoredValue::default()
        }
    }

    #[test]
    fn people_see_time_name_elements_null_and_unit() {
        let shown = line(&value("Real[2]", json!([0.5, null])), 1_000_000_000);
        let words: Vec<&str> = shown.split_whitespace().collect();
        assert_eq!(
            words,
            ["0.250", "s", "line/move.pose", "0.500000", "–", "m"]
        );
        let shown = line(&value("Int", json!(7)), 0);
        assert!(shown.ends_with(" 7 m"), "{shown}");
    }
}
