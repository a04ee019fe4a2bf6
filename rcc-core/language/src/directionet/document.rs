//! The table of types as people read it: `docs/from-the-predecessor.md`, made by `cargo run -p rcc-language --example
//! from_the_predecessor`. Runs in that program and in the test that says whether the file is current.

use std::fmt::Write as _;

use super::table::{self, Entry, FAMILIES, Row, To};
use super::text::{Argument, Fragment, Primitive, Value};

const HEAD: &str = "\
# From the predecessor's types to ours

Made by `cargo run -p rcc-language --example from_the_predecessor > docs/from-the-predecessor.md`; the reader of DirectIONet
([directionet.md](directionet.md)) works by the same table. Right of the types stands what becomes of them, its inputs and parameters
by their names there. *null* says what a null input does there, and so what is put before ours where an input can be null:
*last* the last known value (`LastKnown`), *parameter* the parameter of the same name (`OrElse`), nothing: it is null.
`inActive` is `active` of ours, for every type that has it.
";

/// The whole document.
#[must_use]
pub fn markdown() -> String {
    let mut text = HEAD.to_string();
    let count = table::all().len();
    let without = table::all().values();
    let without = without
        .filter(|entry| matches!(entry.row.to, To::None(_)))
        .count();
    // Writing into a String cannot fail.
    let _ = writeln!(
        text,
        "\n{count} types, {} with a counterpart, {without} with a reason why there is none.",
        count - without
    );
    for (title, rows) in table::rows() {
        let _ = writeln!(text, "\n## {title}\n");
        if title == "Families" {
            let names: Vec<String> = FAMILIES
                .iter()
                .map(|(name, _)| format!("`{name}`"))
                .collect();
            let _ = writeln!(
                text,
                "Each for the {} element types {}: `Core::DoubleValue`, `World::FrameArrayGet`.\n",
                names.len(),
                names.join(", ")
            );
        }
        text.push_str("| type | null | becomes | what differs, or why there is nothing |\n|---|---|---|---|\n");
        for row in rows {
            let prefix = if title == "Families" {
                "Core::Double"
            } else {
                ""
            };
            if let Some(entry) = table::all().get(&format!("{prefix}{}", row.name)) {
                let name = if prefix.is_empty() {
                    row.name.to_string()
                } else {
                    format!("…{}", row.name)
                };
                let _ = writeln!(
                    text,
                    "| `{name}` | {} | {} | {} |",
                    null(row),
                    becomes(entry),
                    row.note
                );
            }
        }
    }
    text
}

fn null(row: &Row) -> &'static str {
    let ports = row.inputs.is_empty() || matches!(row.to, To::None(_));
    match row.reads {
        _ if ports => "",
        table::Reads::Last => "last",
        table::Reads::Parameter => "parameter",
        table::Reads::Null => "",
    }
}

fn becomes(entry: &Entry) -> String {
    match (entry.row.to, entry.nets.as_slice()) {
        (To::None(reason), _) => format!("– ({})", format!("{reason:?}").to_lowercase()),
        (To::Special(builtin), _) => special(builtin).to_string(),
        (To::By(parameter, ..), [yes, no]) => {
            format!("`{parameter}`: {}; else {}", net(yes), net(no))
        }
        (_, [only]) => net(only),
        _ => String::new(),
    }
}

fn special(builtin: table::Builtin) -> &'static str {
    use table::Builtin;
    match builtin {
        Builtin::Pre => "a delayed link",
        Builtin::Array | Builtin::ArraySet | Builtin::ArraySlice => "a list of links",
        Builtin::ArrayGet => "an element of a link",
        Builtin::ArrayIsNull => "`IsNull`",
        Builtin::ArraySetNull => "`NullIf`",
        Builtin::NetcommIn => "`Input`",
        Builtin::NetcommOut => "`Monitor`, or `Publish`",
        Builtin::InterNetcommIn => "`Subscribe`",
        Builtin::InterNetcommOut => "`Publish`",
        Builtin::InvKin => "`InverseKinematics` or `InverseKinematicsNear`",
        Builtin::JointMonitor => "`JointState`, `JointVelocity`",
        Builtin::JointPosition => "`JointPositionCommand`",
    }
}

/// A net of ours as text: each output with what it is.
fn net(fragment: &Fragment) -> String {
    let mut parts = Vec::new();
    for item in &fragment.items {
        let what = primitive(&item.primitive);
        match &item.port {
            Some(port) => parts.push(format!(
                "`{}` = `{}`",
                item.name.name,
                read(&item.primitive, &port.name)
            )),
            None => parts.push(format!("`{}: {what}`", item.name.name)),
        }
    }
    parts.join("<br>")
}

fn read(from: &Primitive, port: &str) -> String {
    match from {
        Primitive::Named(name) if name.name == "parent" => port.to_string(),
        Primitive::Typed(ty, arguments) => match (ty.name.as_str(), arguments.as_slice()) {
            ("List", elements) => format!(
                "[{}]",
                elements.iter().map(argument).collect::<Vec<_>>().join(", ")
            ),
            ("At", [of, index]) => format!("{}[{}]", argument(of), argument(index)),
            ("Else", [link, otherwise]) => format!("{} or {}", argument(link), argument(otherwise)),
            _ => format!("{}.{port}", primitive(from)),
        },
        from => format!("{}.{port}", primitive(from)),
    }
}

fn argument(argument: &Argument) -> String {
    match &argument.value {
        Value::Text(text, _) => text.clone(),
        Value::Link(from, port) => read(from, &port.name),
    }
}

fn primitive(from: &Primitive) -> String {
    match from {
        Primitive::Named(name) => name.name.clone(),
        Primitive::Typed(ty, arguments) => {
            let arguments: Vec<String> = arguments
                .iter()
                .map(|it| format!("{}: {}", it.name.name, argument(it)))
                .collect();
            format!("{}({})", ty.name, arguments.join(", "))
        }
        Primitive::Fragment(..) => String::new(),
    }
}
