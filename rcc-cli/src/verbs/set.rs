//! `set NET NAME=VALUE…`: sets inputs of a net, all from the same cycle on, or none of them.

use rcc_api::bodies::{InputsSet, ValuesView};
use rcc_api::codes;
use rcc_language::names::{InputNames, Names};

use crate::client::segment;
use crate::context::Context;
use crate::failure::Failure;
use crate::follow;
use crate::table::{self, grouped};
use crate::value::Style;

/// Arguments of `set`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Net: id, name (the newest with that name), or name#id
    net: String,
    /// Values such as speed="0.2 m/s" or goal="{xyz: [0.5, 0, 0.3], rpy: [0, 0, 0]}"; null unsets. Without values, all
    /// inputs are listed
    #[arg(value_name = "NAME=VALUE")]
    values: Vec<String>,
    /// Inputs to set to null
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    unset: Vec<String>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the loader cannot be reached, the input does not exist, the value does not fit, or the net is neither ready
/// nor running.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let client = context.client()?;
    let net = &arguments.net;
    if arguments.values.is_empty() && arguments.unset.is_empty() {
        let detail = follow::state(&client, net)?;
        let names: Names = serde_json::from_value(detail.names).unwrap_or_default();
        let inputs: Vec<&InputNames> = names.settable().map(|(_, input)| input).collect();
        let ports = inputs.iter().flat_map(|input| {
            let id = &input.primitive;
            [format!("{id}.value"), format!("{id}.age")]
        });
        let ports: Vec<String> = ports.collect();
        let id = detail.command.id.to_string();
        let values = match ports.is_empty() {
            true => ValuesView::default(),
            false => client.values(&id, &ports)?,
        };
        context.print(&inputs, |inputs| list(inputs, &values));
        return Ok(());
    }
    let set = arguments.values.iter().map(|pair| line(pair));
    let mut lines: Vec<String> = set.collect::<Result<_, _>>()?;
    for name in &arguments.unset {
        lines.push(line(&format!("{name}=null"))?);
    }
    let path = format!("/commands/{}/inputs", segment(net));
    let set: InputsSet = client.put(&path, lines.concat())?;
    context.print(&set, |set| {
        let (net, id, cycle) = (&set.net, set.id, grouped(set.cycle));
        format!(
            "{net}#{id}  set {}  from cycle {cycle} on",
            set.set.join(", ")
        )
    });
    Ok(())
}

/// Converts `NAME=VALUE` to a line of the request's body.
fn line(pair: &str) -> Result<String, Failure> {
    let usage = |message: String| {
        Failure::new(
            codes::BAD_REQUEST,
            message,
            "write NAME=VALUE, as in speed=\"0.2 m/s\"",
        )
    };
    let Some((name, value)) = pair.split_once('=') else {
        return Err(usage(format!("`{pair}` is not an assignment")));
    };
    let (name, value) = (name.trim(), value.trim());
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-/.".contains(c);
    if name.is_empty() || !name.chars().all(plain) {
        return Err(usage(format!("invalid input name `{name}`")));
    }
    if value.is_empty() || value.contains(char::is_control) {
        return Err(usage(format!("`{name}` needs a single-line value")));
    }
    Ok(format!("{name}: {value}\n"))
}

fn list(inputs: &[&InputNames], values: &ValuesView) -> String {
    if inputs.is_empty() {
        return "the net has no Input primitive: nothing can be set".to_owned();
    }
    let mut rows = table::table(&["INPUT", "TYPE", "UNIT", "RANGE", "EXPIRES", "VALUE", "AGE"]);
    for (number, input) in inputs.iter().enumerate() {
        let shown = |offset: usize, unit: &str| {
            let view = values.values.get(2 * number + offset);
            let text = view.map_or_else(String::new, |view| Style::default().human(view));
            match text.as_str() {
                "null" => text,
                _ => format!("{text}{unit}"),
            }
        };
        rows.add_row([
            input.primitive.clone(),
            input.type_name.clone(),
            input.unit.clone().unwrap_or_default(),
            range(input),
            input
                .expires_s
                .map_or_else(String::new, |seconds| format!("{seconds} s")),
            shown(0, ""),
            shown(1, " s"),
        ]);
    }
    table::text(&rows)
}

fn range(input: &InputNames) -> String {
    // An element without a bound is NaN.
    let shown = |value: &f64| match value.is_nan() {
        true => "…".to_owned(),
        false => value.to_string(),
    };
    let bound = |values: &[f64]| match values {
        [] => "…".to_owned(),
        [one] => shown(one),
        all => format!("[{}]", all.iter().map(shown).collect::<Vec<_>>().join(", ")),
    };
    match (&input.at_least[..], &input.at_most[..]) {
        ([], []) => String::new(),
        (least, most) => format!("{} to {}", bound(least), bound(most)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_becomes_a_line() {
        let good = |pair| line(pair).ok();
        assert_eq!(good("speed=0.2 m/s").as_deref(), Some("speed: 0.2 m/s\n"));
        assert_eq!(
            good("a/x = {xyz: [1, 2, 3]}").as_deref(),
            Some("a/x: {xyz: [1, 2, 3]}\n")
        );
    }

    #[test]
    fn invalid_assignments_are_refused_as_usage() {
        for pair in ["speed", "=1", "speed=", "a b=1", "x=1\ny: 2", "{x=1"] {
            let refused = line(pair).map_err(|failure| failure.exit);
            assert_eq!(refused, Err(codes::exit::USAGE), "{pair}");
        }
    }
}
