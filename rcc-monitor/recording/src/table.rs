//! A message type made for one net or device: a number of named columns, one field each, one message a cycle. The true
//! names, types and units are in the channel's metadata. Pure.
//!
//! Null is NaN, which viewers draw as a gap: so Bool (0, 1) and Int are `float64` too, unless they are known never to be
//! null. An Int beyond ±2^53 is rounded to the nearest `float64`; [`Table::encode`] counts them.

use std::collections::{BTreeMap, BTreeSet};

use rcc_core::types::NULL_INT;

use crate::cdr::{CdrReader, CdrWriter};
use crate::schemas::MessageSchema;

/// The greatest Int up to which every Int is a `float64`.
const EXACT_MAX: u64 = 1 << 53;

/// The type of a column's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnType {
    /// `float64`; NaN is null.
    Real,
    /// 0 or 1; NaN is null.
    Bool,
    /// The bits of an i64 in an `f64`, as in the records of monitors; [`NULL_INT`] is null.
    Int,
}

impl ColumnType {
    /// Returns the element type of a named type: `Bool`, `Int[3]`, `Pose`, …
    #[must_use]
    pub fn of(type_name: &str) -> ColumnType {
        match type_name.split('[').next() {
            Some("Bool") => ColumnType::Bool,
            Some("Int") => ColumnType::Int,
            _ => ColumnType::Real,
        }
    }
}

/// A column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// True name, such as `ik.joints`.
    pub name: String,
    /// Type, such as `Real[7]` or `Pose`.
    pub type_name: String,
    /// Unit, if there is one that the type does not imply.
    pub unit: Option<String>,
    /// Number of elements; one element is a number, not an array.
    pub width: usize,
    /// Its elements are never null: Bool is `bool`, Int is `int64`.
    pub never_null: bool,
}

impl Column {
    fn field_type(&self) -> &'static str {
        match (ColumnType::of(&self.type_name), self.never_null) {
            (ColumnType::Bool, true) => "bool",
            (ColumnType::Int, true) => "int64",
            _ => "float64",
        }
    }
}

/// The net or device that a table describes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TableSubject {
    /// Name of the net or device.
    pub name: String,
    /// Topic, such as `/nets/line`.
    pub topic: String,
    /// Further metadata of the channel.
    pub metadata: BTreeMap<String, String>,
}

/// A message type with its columns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    /// Topic.
    pub topic: String,
    /// Schema.
    pub schema: MessageSchema,
    /// Metadata of the channel.
    pub metadata: BTreeMap<String, String>,
    columns: Vec<Column>,
    /// Names of the fields, by column.
    fields: Vec<String>,
}

/// The numbers that every message has besides its columns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TableKey {
    /// Executor cycle, or the number of a device's measurement.
    pub cycle: u64,
    /// Id of the command; 0 for a device.
    pub command: u64,
}

impl Table {
    /// Makes the type of a table; names of fields follow the rules of ROS.
    #[must_use]
    pub fn new(subject: TableSubject, columns: Vec<Column>) -> Table {
        let mut used: BTreeSet<String> = ["cycle", "command"].map(str::to_owned).into();
        let mut text = String::from("uint64 cycle\nuint64 command\n");
        let mut metadata = subject.metadata;
        let mut fields = Vec::new();
        for column in &columns {
            let field = unused(&field_name(&column.name), &mut used);
            let array = match column.width {
                1 => String::new(),
                width => format!("[{width}]"),
            };
            text.push_str(&format!("{}{array} {field}\n", column.field_type()));
            metadata.insert(format!("name.{field}"), column.name.clone());
            metadata.insert(format!("type.{field}"), column.type_name.clone());
            if let Some(unit) = &column.unit {
                metadata.insert(format!("unit.{field}"), unit.clone());
            }
            fields.push(field);
        }
        let name = format!("rcc/msg/{}", message_name(&subject.name));
        Table {
            topic: subject.topic,
            schema: MessageSchema { name, text },
            metadata,
            columns,
            fields,
        }
    }

    /// The columns, in order.
    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Names of the fields, by column.
    #[must_use]
    pub fn fields(&self) -> &[String] {
        &self.fields
    }

    /// Number of elements of all columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.columns.iter().map(|column| column.width).sum()
    }

    /// Encodes a message from the elements of all columns, one after the other; a missing element is null. Returns how many
    /// Ints were rounded.
    pub fn encode(&self, key: TableKey, values: &[f64], out: &mut CdrWriter) -> u64 {
        out.clear();
        out.u64(key.cycle);
        out.u64(key.command);
        let (mut values, mut rounded) = (values.iter().copied(), 0);
        for column in &self.columns {
            let kind = ColumnType::of(&column.type_name);
            for _ in 0..column.width {
                let value = values.next();
                match (kind, column.never_null) {
                    (ColumnType::Bool, true) => out.u8(u8::from(value == Some(1.0))),
                    (ColumnType::Int, true) => {
                        out.i64(value.map_or(NULL_INT, |value| value.to_bits().cast_signed()));
                    }
                    (ColumnType::Int, false) => {
                        let int = value.map_or(NULL_INT, |value| value.to_bits().cast_signed());
                        rounded += u64::from(int != NULL_INT && int.unsigned_abs() > EXACT_MAX);
                        out.f64(if int == NULL_INT {
                            f64::NAN
                        } else {
                            int as f64
                        });
                    }
                    _ => out.f64(value.unwrap_or(f64::NAN)),
                }
            }
        }
        rounded
    }
}

/// Returns a name that is not used yet, and marks it as used.
fn unused(wanted: &str, used: &mut BTreeSet<String>) -> String {
    let mut name = wanted.to_owned();
    let mut number = 2;
    while !used.insert(name.clone()) {
        name = format!("{wanted}_{number}");
        number += 1;
    }
    name
}

/// Words of a name: what is between characters that ROS does not allow.
fn words(name: &str) -> impl Iterator<Item = &str> {
    name.split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|word| !word.is_empty())
}

/// Converts a name to a field or topic of ROS: lower case, digits and single `_`, beginning with a letter.
#[must_use]
pub fn field_name(name: &str) -> String {
    let joined = words(name).collect::<Vec<_>>().join("_").to_lowercase();
    match joined.chars().next() {
        Some('a'..='z') => joined,
        _ => format!("n_{joined}").trim_end_matches('_').to_owned(),
    }
}

/// Converts a name to the name of a message type: `guarded-move` becomes `GuardedMove`.
fn message_name(name: &str) -> String {
    let capitalised = words(name).map(|word| {
        let (first, rest) = word.split_at(1);
        format!("{}{rest}", first.to_uppercase())
    });
    let joined: String = capitalised.collect();
    match joined.chars().next() {
        Some('A'..='Z') => joined,
        _ => format!("Net{joined}"),
    }
}

/// A message of a table as read: its key, and the elements of all fields as `float64`, NaN = null.
#[derive(Clone, Debug, PartialEq)]
pub struct TableRow {
    /// Cycle and command.
    pub key: TableKey,
    /// Elements of all fields, one after the other.
    pub values: Vec<f64>,
}

/// The fields of a schema of this module: type, number of elements, name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TableLayout {
    fields: Vec<(FieldType, usize, String)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FieldType {
    Float64,
    Int64,
    Bool,
}

impl TableLayout {
    /// Reads the text of a schema; `None` if it is not one of this module.
    #[must_use]
    pub fn parse(text: &str) -> Option<TableLayout> {
        let rest = text.strip_prefix("uint64 cycle\nuint64 command\n")?;
        let fields = rest.lines().map(|line| {
            let (kind, name) = line.split_once(' ')?;
            let (kind, width) = match kind.split_once('[') {
                None => (kind, 1),
                Some((kind, width)) => (kind, width.strip_suffix(']')?.parse().ok()?),
            };
            let kind = match kind {
                "float64" => FieldType::Float64,
                "int64" => FieldType::Int64,
                "bool" => FieldType::Bool,
                _ => return None,
            };
            // A file may come from anywhere: no field is larger than any value of a net.
            (width <= 1 << 20).then(|| (kind, width, name.to_owned()))
        });
        Some(TableLayout {
            fields: fields.collect::<Option<_>>()?,
        })
    }

    /// Names and numbers of elements of the fields.
    pub fn fields(&self) -> impl Iterator<Item = (&str, usize)> {
        self.fields
            .iter()
            .map(|(_, width, name)| (name.as_str(), *width))
    }

    /// Decodes a message; `None` if it is too short.
    #[must_use]
    pub fn decode(&self, message: &[u8]) -> Option<TableRow> {
        let mut reader = CdrReader::new(message)?;
        let key = TableKey {
            cycle: reader.u64()?,
            command: reader.u64()?,
        };
        let mut values = Vec::new();
        for (kind, width, _) in &self.fields {
            for _ in 0..*width {
                values.push(match kind {
                    FieldType::Float64 => reader.f64()?,
                    FieldType::Int64 => reader.u64()?.cast_signed() as f64,
                    FieldType::Bool => f64::from(reader.u8()?),
                });
            }
        }
        Some(TableRow { key, values })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(name: &str, type_name: &str, width: usize, never_null: bool) -> Column {
        Column {
            name: name.into(),
            type_name: type_name.into(),
            unit: (type_name == "Real[2]").then(|| "rad".into()),
            width,
            never_null,
        }
    }

    fn table(columns: Vec<Column>) -> Table {
        let subject = TableSubject {
            name: "guarded-move 2".into(),
            topic: "/nets/guarded_move_2".into(),
            ..TableSubject::default()
        };
        Table::new(subject, columns)
    }

    #[test]
    fn each_port_is_a_field_and_its_true_name_and_unit_are_in_the_metadata() {
        let table = table(vec![
            column("ik.joints", "Real[2]", 2, false),
            column("touch.out", "Bool", 1, false),
            column("count.Out", "Int", 1, true),
        ]);
        assert_eq!(table.schema.name, "rcc/msg/GuardedMove2");
        assert_eq!(
            table.schema.text,
            "uint64 cycle\nuint64 command\nfloat64[2] ik_joints\nfloat64 touch_out\nint64 count_out\n"
        );
        assert_eq!(table.metadata["name.ik_joints"], "ik.joints");
        assert_eq!(table.metadata["unit.ik_joints"], "rad");
        assert_eq!(table.metadata["type.count_out"], "Int");
    }

    #[test]
    fn names_that_become_the_same_are_told_apart() {
        let names = ["a.b_c", "a_b.c", "cycle", "7.x", "ä.ö"];
        let columns = names.map(|name| column(name, "Real", 1, false));
        let table = table(columns.to_vec());
        assert_eq!(
            table.fields(),
            ["a_b_c", "a_b_c_2", "cycle_2", "n_7_x", "n"]
        );
    }

    #[test]
    fn null_of_every_type_is_nan_and_the_rest_is_read_again() {
        let table = table(vec![
            column("r.out", "Real[2]", 2, false),
            column("b.out", "Bool", 1, false),
            column("i.out", "Int[2]", 2, false),
            column("c.out", "Bool", 1, true),
            column("j.out", "Int", 1, true),
        ]);
        let int = |value: i64| f64::from_bits(value as u64);
        let values = [0.5, f64::NAN, 1.0, int(-7), int(NULL_INT), 1.0, int(9)];
        let mut out = CdrWriter::new();
        let key = TableKey {
            cycle: 3,
            command: 4,
        };
        assert_eq!(table.encode(key, &values, &mut out), 0);
        let layout = TableLayout::parse(&table.schema.text).expect("our own schema");
        let row = layout.decode(out.bytes()).expect("a whole message");
        assert_eq!(row.key, key);
        let shown = format!("{:?}", row.values);
        assert_eq!(shown, "[0.5, NaN, 1.0, -7.0, NaN, 1.0, 9.0]");
        let short = &out.bytes()[..out.bytes().len() - 1];
        assert_eq!(layout.decode(short), None);
    }

    #[test]
    fn an_int_that_a_float64_cannot_hold_is_counted() {
        let table = table(vec![column("i.out", "Int", 1, false)]);
        let mut out = CdrWriter::new();
        let huge = f64::from_bits((1_u64 << 53) + 1);
        assert_eq!(table.encode(TableKey::default(), &[huge], &mut out), 1);
    }
}
