//! The lines between driver and program: JSON, one object a line.
//! Made and read by the threads of the program's lines, not by the exchange thread.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use serde::Deserialize;
use serde_json::{Map, Value, json};

/// A message to the program: `{"frame": 17, "outputs": {"lamp": true, "gain": null}}`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    outputs: Map<String, Value>,
}

impl Frame {
    /// Adds a digital output; `None`: it has no value.
    pub fn push_digital(&mut self, name: &str, value: Option<bool>) {
        self.outputs.insert(name.to_owned(), json!(value));
    }

    /// Adds an analog output; `None`: it has no value.
    pub fn push_analog(&mut self, name: &str, value: Option<f64>) {
        self.outputs.insert(name.to_owned(), json!(value));
    }

    /// Returns the line, with its end, of this frame.
    pub fn line(&self, number: u64) -> String {
        json!({"frame": number, "outputs": self.outputs}).to_string() + "\n"
    }
}

/// An answer of the program: `{"frame": 17, "values": {"x": 0.31, "found": true}}`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    frame: Option<u64>,
    values: BTreeMap<String, Option<Scalar>>,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(untagged)]
enum Scalar {
    Digital(bool),
    Analog(f64),
}

/// The program's values, and since when they are true.
#[derive(Clone, Debug)]
pub struct Values {
    values: BTreeMap<String, Option<Scalar>>,
    /// Number of the frame that it answers; `None`: it came by itself.
    pub frame: Option<u64>,
    /// When the frame was sent that it answers, or when it arrived if it came by itself.
    since: Instant,
}

impl Values {
    /// Reads a line that arrives now. `answer` takes the number of the frame that it answers, and returns when that was
    /// sent; `None` if it was not, or if it was answered before.
    ///
    /// # Errors
    /// Returns what is wrong with the line.
    pub fn read(line: &str, answer: impl FnOnce(u64) -> Option<Instant>) -> Result<Values, String> {
        let given: Answer = serde_json::from_str(line).map_err(|error| error.to_string())?;
        let infinite = |value: &&Option<Scalar>| matches!(value, Some(Scalar::Analog(number)) if !number.is_finite());
        if given.values.values().find(infinite).is_some() {
            return Err("a value is not finite".to_owned());
        }
        let since = match given.frame {
            Some(frame) => answer(frame).ok_or_else(|| {
                format!("it answers frame {frame}, which does not await an answer")
            })?,
            None => Instant::now(),
        };
        Ok(Values {
            values: given.values,
            frame: given.frame,
            since,
        })
    }

    /// Returns a digital value; `None` if the program did not give it.
    pub fn digital(&self, name: &str) -> Option<bool> {
        match self.values.get(name) {
            Some(Some(Scalar::Digital(on))) => Some(*on),
            _ => None,
        }
    }

    /// Returns an analog value as the program gave it; `None` if it did not give it.
    pub fn analog(&self, name: &str) -> Option<f64> {
        match self.values.get(name) {
            Some(Some(Scalar::Analog(number))) => Some(*number),
            _ => None,
        }
    }

    /// Returns the age of the values: the time since the outputs left from which the program made them.
    pub fn age(&self) -> Duration {
        self.since.elapsed()
    }
}
