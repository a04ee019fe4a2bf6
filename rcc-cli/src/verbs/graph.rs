//! `graph NET|FILE`: draws a net, optionally with the values of a running one, or the nets and rules of a task.

use std::path::PathBuf;

use rcc_api::bodies::ValueView;
use rcc_api::codes;
use rcc_graph::PortValues;
use rcc_graph::scene::{BOXES_MAX, scene};
use rcc_graph::{dot::dot, mermaid::mermaid, svg::svg};
use rcc_language::structure::literal_label;
use rcc_language::syntax::literal::{Literal, LiteralShape};
use serde_json::Value;

use crate::context::Context;
use crate::failure::Failure;
use crate::net_source::{self, ResolvedNet};
use crate::result_file::ResultTarget;
use crate::task::{self, TaskFile};

/// Arguments of `graph`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// File (YAML or JSON; - reads standard input), or loaded net by name or id
    net: String,
    /// Output format [default: by the name of the file, else svg]
    #[arg(long, value_enum)]
    format: Option<GraphFormat>,
    #[command(flatten)]
    target: ResultTarget,
    /// Show the values of a running net, all of one cycle, instead of types
    #[arg(long)]
    values: bool,
    /// Cell configuration whose devices the net uses [default: the running cell's, else the demo cell's]
    #[arg(long)]
    config: Option<PathBuf>,
}

/// Output formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum GraphFormat {
    /// Image for browsers and documents
    Svg,
    /// Graphviz source
    Dot,
    /// Mermaid source for Markdown
    Mermaid,
}

impl Arguments {
    fn format(&self) -> Result<GraphFormat, Failure> {
        let ending = self.target.path().and_then(|path| path.extension());
        match (self.format, ending.map(|ending| ending.to_string_lossy())) {
            (Some(format), _) => Ok(format),
            (None, None) => Ok(GraphFormat::Svg),
            (None, Some(ending)) => match &*ending {
                "svg" => Ok(GraphFormat::Svg),
                "dot" | "gv" => Ok(GraphFormat::Dot),
                "mmd" | "mermaid" => Ok(GraphFormat::Mermaid),
                other => Err(Failure::new(
                    codes::BAD_REQUEST,
                    format!("a graph cannot be drawn as `.{other}`"),
                    "use a file name that ends in .svg, .dot, .gv or .mmd, or name the format with --format",
                )),
            },
        }
    }
}

/// Runs the verb.
///
/// # Errors
/// Fails if the file does not exist or is invalid, the net does not exist or is too large for SVG, or the output cannot
/// be written.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    if context.remote.is_some() && !arguments.values && net_source::is_file(&arguments.net) {
        let message = format!("`graph {}` draws a file and needs no cell", arguments.net);
        return Err(Failure::new(
            codes::BAD_REQUEST,
            message,
            "omit --url (RCC_URL)",
        ));
    }
    let format = arguments.format()?;
    if net_source::is_file(&arguments.net) && TaskFile::is_one(&arguments.net)? {
        return task(context, &arguments, format);
    }
    let ResolvedNet { structure, .. } =
        net_source::find(context, &arguments.net, arguments.config)?;
    let values = match arguments.values {
        true => Some(values(context, &arguments.net)?),
        false => None,
    };
    let values = values.as_ref();
    let picture = match format {
        GraphFormat::Dot => dot(&structure, values),
        GraphFormat::Mermaid => mermaid(&structure, values),
        GraphFormat::Svg => {
            let scene = scene(&structure, values).map_err(|many| {
                let message = format!("the net has {} boxes; at most {BOXES_MAX} can be drawn as SVG", many.boxes);
                let help = "use `--format dot`, which Graphviz draws at any size (`sfdp`), or `rcc-cli explain`";
                Failure::new(codes::BAD_REQUEST, message, help)
            })?;
            svg(&structure, &scene)
        }
    };
    arguments.target.write(context, &picture)
}

/// Draws the nets and rules of a task.
fn task(context: &Context, arguments: &Arguments, format: GraphFormat) -> Result<(), Failure> {
    if arguments.values || arguments.config.is_some() {
        let message = "a task is drawn without values and without a cell";
        let help = "omit --values and --config, or draw one of its nets";
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    let task = TaskFile::read(&arguments.net)?;
    let structure = task::graph::structure(&task, &task.net_names()?);
    let picture = match format {
        GraphFormat::Dot => dot(&structure, None),
        GraphFormat::Mermaid => mermaid(&structure, None),
        GraphFormat::Svg => {
            let scene = scene(&structure, None).map_err(|many| {
                let message = format!(
                    "the task has {} nets; at most {BOXES_MAX} can be drawn as SVG",
                    many.boxes
                );
                Failure::new(codes::BAD_REQUEST, message, "use `--format dot`")
            })?;
            svg(&structure, &scene)
        }
    };
    arguments.target.write(context, &picture)
}

/// Returns the values of a loaded net by port, as text.
fn values(context: &Context, net: &str) -> Result<PortValues, Failure> {
    let answer = context.client()?.values(net, &[])?;
    let rows = answer.values.iter();
    Ok(rows
        .map(|row| (row.port.clone(), value_text(row)))
        .collect())
}

/// Elements shown of an array.
const ELEMENTS_MAX: usize = 3;

/// Formats a value: "0.25 m/s", "[0.1, 0.2, 0.3, …] rad", "null".
fn value_text(row: &ValueView) -> String {
    let text = match &row.value {
        Value::Array(values) => {
            let shown = values.iter().take(ELEMENTS_MAX).map(format_scalar);
            let more = (values.len() > ELEMENTS_MAX).then(|| "…".to_owned());
            let shown: Vec<String> = shown.chain(more).collect();
            format!("[{}]", shown.join(", "))
        }
        value => format_scalar(value),
    };
    match &row.unit {
        Some(unit) if !row.value.is_null() => format!("{text} {unit}"),
        _ => text,
    }
}

fn format_scalar(value: &Value) -> String {
    if let Value::String(infinite) = value {
        return infinite.clone();
    }
    match value.as_f64().filter(|_| !value.is_i64()) {
        Some(number) => literal_label(&Literal::new(
            LiteralShape::Real(number, None),
            Default::default(),
        )),
        None => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn values_are_short_and_null_is_null() {
        for (value, unit, expected) in [
            (json!(0.123_456), Some("m/s"), "0.1235 m/s"),
            (json!(null), Some("m"), "null"),
            (json!(true), None, "true"),
            (json!(7), None, "7"),
            (json!("-inf"), None, "-inf"),
            (json!([0.5, null]), Some("rad"), "[0.5, null] rad"),
            (json!([1.0, 2.0, 3.0, 4.0]), None, "[1, 2, 3, …]"),
        ] {
            let row = ValueView {
                unit: unit.map(str::to_owned),
                value,
                ..ValueView::default()
            };
            assert_eq!(super::value_text(&row), expected);
        }
    }
}
