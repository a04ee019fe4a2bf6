//! Generates `docs/from-the-predecessor.md` from the table of types, with `cargo run -p rcc-language --example
//! from_the_predecessor`. Runs in that program and in the test that checks that the file is current.

use std::fmt::Write as _;

use super::table::{self, ConversionRow, Counterpart, FAMILIES, TypeEntry};
use super::text::{AstArgument, AstFragment, AstPrimitive, AstValue};

const HEAD: &str = "\
# From the predecessor's types to ours

Made by `cargo run -p rcc-language --example from_the_predecessor > docs/from-the-predecessor.md`; the reader of DirectIONet
([directionet.md](directionet.md)) works by the same table. Right of the types stands what becomes of them, its inputs and parameters
by their names there. *null* says what a null input does there, and so what is put before ours where an input can be null:
*last* the last known value (`LastKnown`), *parameter* the parameter of the same name (`OrElse`), nothing: it is null.
`inActive` is `active` of ours, for every type that has it.
";

/// Returns the document.
#[must_use]
pub fn markdown() -> String {
    let mut text = HEAD.to_string();
    let count = table::all().len();
    let without = table::all().values();
    let without = without
        .filter(|entry| matches!(entry.row.to, Counterpart::None(_)))
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
                    null_column(row),
                    becomes(entry),
                    row.note
                );
            }
        }
    }
    text
}

fn null_column(row: &ConversionRow) -> &'static str {
    let ports = row.inputs.is_empty() || matches!(row.to, Counterpart::None(_));
    match row.reads {
        _ if ports => "",
        table::NullReading::Last => "last",
        table::NullReading::Parameter => "parameter",
        table::NullReading::Null => "",
    }
}

fn becomes(entry: &TypeEntry) -> String {
    match (entry.row.to, entry.nets.as_slice()) {
        (Counterpart::None(reason), _) => format!("– ({})", format!("{reason:?}").to_lowercase()),
        (Counterpart::Special(conversion), _) => special(conversion).to_string(),
        (Counterpart::By(parameter, ..), [yes, no]) => {
            format!("`{parameter}`: {}; else {}", net(yes), net(no))
        }
        (_, [only]) => net(only),
        _ => String::new(),
    }
}

fn special(conversion: table::SpecialConversion) -> &'static str {
    use table::SpecialConversion;
    match conversion {
        SpecialConversion::Pre => "a delayed link",
        SpecialConversion::Array | SpecialConversion::ArraySet | SpecialConversion::ArraySlice => {
            "a list of links"
        }
        SpecialConversion::ArrayGet => "an element of a link",
        SpecialConversion::ArrayIsNull => "`IsNull`",
        SpecialConversion::ArraySetNull => "`NullIf`",
        SpecialConversion::NetcommIn => "`Input`",
        SpecialConversion::NetcommOut => "`Monitor`, or `Publish`",
        SpecialConversion::InterNetcommIn => "`Subscribe`",
        SpecialConversion::InterNetcommOut => "`Publish`",
        SpecialConversion::InvKin => "`InverseKinematics` or `InverseKinematicsNear`",
        SpecialConversion::JointMonitor => "`JointState`, `JointVelocity`",
        SpecialConversion::JointPosition => "`JointPositionCommand`",
    }
}

/// Returns a net of a row as text: each output with its definition.
fn net(fragment: &AstFragment) -> String {
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

fn read(from: &AstPrimitive, port: &str) -> String {
    match from {
        AstPrimitive::Named(name) if name.name == "parent" => port.to_string(),
        AstPrimitive::Typed(ty, arguments) => match (ty.name.as_str(), arguments.as_slice()) {
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

fn argument(argument: &AstArgument) -> String {
    match &argument.value {
        AstValue::Text(text, _) => text.clone(),
        AstValue::Link(from, port) => read(from, &port.name),
    }
}

fn primitive(from: &AstPrimitive) -> String {
    match from {
        AstPrimitive::Named(name) => name.name.clone(),
        AstPrimitive::Typed(ty, arguments) => {
            let arguments: Vec<String> = arguments
                .iter()
                .map(|it| format!("{}: {}", it.name.name, argument(it)))
                .collect();
            format!("{}({})", ty.name, arguments.join(", "))
        }
        AstPrimitive::Fragment(..) => String::new(),
    }
}
