//! Reads wrenches and poses from the output of other verbs: the table of `simulate --csv`, or lines of `tail --output
//! json`. Pure; runs on the caller's thread.

use std::collections::BTreeMap;

use serde_json::Value;
use thiserror::Error;

use super::Reading;
use crate::csv;

/// Selects the values that are the wrench and the rotation; `None` selects the only value of its length.
#[derive(Clone, Debug, Default)]
pub struct ReadingSelection {
    /// Suffix of the name of a value of six numbers.
    pub wrench: Option<String>,
    /// Suffix of the name of a value of seven numbers (a pose) or four (a rotation).
    pub pose: Option<String>,
}

/// Reason why a file yields no readings.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ReadingsError {
    /// The file is empty or has an unknown format.
    #[error("line {line}: neither a CSV table with a header line nor lines of JSON: {cause}")]
    Form {
        /// Number of the line, counted from 1.
        line: usize,
        /// Cause, as a message.
        cause: String,
    },
    /// No value, or more than one, can be the wrench or the pose.
    #[error("expected one {role}, found {found} {what}: {names}")]
    Choice {
        /// `wrench` or `pose`.
        role: &'static str,
        /// Kind of the values.
        what: &'static str,
        /// Number of candidates.
        found: usize,
        /// Names of the candidates, or of all values if there are none.
        names: String,
    },
    /// No row contains both values.
    #[error("no line contains both wrench and pose: give their monitors the same rate")]
    Nothing,
}

/// Values by name, one row per moment; `None` means not due or null.
struct ReadingTable {
    names: Vec<(String, usize)>,
    /// One element per entry of `names`.
    rows: Vec<Vec<Option<Vec<f64>>>>,
}

/// Reads all readings of a file.
///
/// # Errors
/// Fails if the file has another format, or does not contain exactly one wrench and one pose.
pub fn read(text: &str, wanted: &ReadingSelection) -> Result<Vec<Reading>, ReadingsError> {
    let table = match text.trim_start().starts_with('{') {
        true => lines(text)?,
        false => table(text)?,
    };
    let wrench = choose(
        &table,
        "wrench",
        "groups of six numbers",
        &[6],
        wanted.wrench.as_deref(),
    )?;
    let what = "groups of seven (a pose) or four numbers (a rotation)";
    let pose = choose(&table, "pose", what, &[7, 4], wanted.pose.as_deref())?;
    let readings = table.rows.iter().filter_map(|row| {
        let wrench = row.get(wrench)?.as_ref()?;
        let pose = row.get(pose)?.as_ref()?;
        Some(Reading {
            wrench: *wrench.first_chunk()?,
            rotation: *pose.last_chunk()?,
        })
    });
    let readings: Vec<Reading> = readings.collect();
    if readings.is_empty() {
        return Err(ReadingsError::Nothing);
    }
    Ok(readings)
}

fn choose(
    table: &ReadingTable,
    role: &'static str,
    what: &'static str,
    widths: &[usize],
    wanted: Option<&str>,
) -> Result<usize, ReadingsError> {
    let fits = |(_, (name, width)): &(usize, &(String, usize))| {
        widths.contains(width) && wanted.is_none_or(|end| name.ends_with(end))
    };
    let found: Vec<_> = table.names.iter().enumerate().filter(fits).collect();
    if let [(index, _)] = found[..] {
        return Ok(index);
    }
    let names: Vec<&str> = match found.is_empty() {
        true => table.names.iter().map(|(name, _)| name.as_str()).collect(),
        false => found.iter().map(|(_, (name, _))| name.as_str()).collect(),
    };
    Err(ReadingsError::Choice {
        role,
        what,
        found: found.len(),
        names: names.join(", "),
    })
}

/// Parses CSV such as `time [s],net/ft.wrench[0],…`: columns `name[0]` to `name[n - 1]` form one value.
fn table(text: &str) -> Result<ReadingTable, ReadingsError> {
    let mut lines = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty());
    let form = |line: usize, cause: &str| ReadingsError::Form {
        line: line + 1,
        cause: cause.to_owned(),
    };
    let (_, head) = lines.next().ok_or_else(|| form(0, "the file is empty"))?;
    let mut names: Vec<(String, usize)> = Vec::new();
    let columns: Vec<usize> = csv::cells(head)
        .iter()
        .map(|cell| {
            // Strips the unit and the index of the element.
            let name = cell.split(" [").next().unwrap_or(cell).trim();
            let base = name.split('[').next().unwrap_or(name);
            match names.iter_mut().position(|(known, _)| known == base) {
                Some(index) => {
                    names[index].1 += 1;
                    index
                }
                None => {
                    names.push((base.to_owned(), 1));
                    names.len() - 1
                }
            }
        })
        .collect();
    let mut rows = Vec::new();
    for (number, line) in lines {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != columns.len() {
            let cause = format!(
                "found {} cells, but the header line has {}",
                cells.len(),
                columns.len()
            );
            return Err(form(number, &cause));
        }
        let mut row: Vec<Option<Vec<f64>>> = vec![Some(Vec::new()); names.len()];
        for (cell, column) in cells.iter().zip(&columns) {
            let value = match *cell {
                "" | "null" => None,
                text => Some(
                    text.parse::<f64>()
                        .map_err(|_| form(number, &format!("`{text}` is not a number")))?,
                ),
            };
            let all = row[*column].take();
            row[*column] = all.zip(value).map(|(mut all, value)| {
                all.push(value);
                all
            });
        }
        rows.push(row);
    }
    Ok(ReadingTable { names, rows })
}

/// Parses lines such as `{"name": "net/ft.wrench", "cycle": 12, "value": [0.1, …], …}`; values of one cycle form one
/// row.
fn lines(text: &str) -> Result<ReadingTable, ReadingsError> {
    let mut names: Vec<(String, usize)> = Vec::new();
    let mut cycles: BTreeMap<u64, Vec<(usize, Vec<f64>)>> = BTreeMap::new();
    for (number, line) in text.lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        let record: Value = serde_json::from_str(line).map_err(|error| ReadingsError::Form {
            line: number + 1,
            cause: error.to_string(),
        })?;
        // Other lines report starts, ends and losses.
        let (Some(name), Some(cycle), Some(value)) = (
            record["name"].as_str(),
            record["cycle"].as_u64(),
            record["value"].as_array(),
        ) else {
            continue;
        };
        let index = match names.iter().position(|(known, _)| known == name) {
            Some(index) => index,
            None => {
                names.push((name.to_owned(), value.len()));
                names.len() - 1
            }
        };
        let numbers: Option<Vec<f64>> = value.iter().map(Value::as_f64).collect();
        if let Some(numbers) = numbers.filter(|numbers| numbers.len() == names[index].1) {
            cycles.entry(cycle).or_default().push((index, numbers));
        }
    }
    let rows = cycles.into_values().map(|values| {
        let mut row = vec![None; names.len()];
        for (index, numbers) in values {
            row[index] = Some(numbers);
        }
        row
    });
    Ok(ReadingTable {
        rows: rows.collect(),
        names,
    })
}
