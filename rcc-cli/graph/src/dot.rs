//! Draws a net for Graphviz: each primitive is a record with its ports, constants are text, delayed links are dashed,
//! and fragments are clusters. Pure.

use std::fmt::Write as _;

use rcc_language::structure::{NetStructure, PortInfo, PrimitiveInfo, PrimitiveRole};

use super::{PortValues, constant, constants, drawn_role, frame_title, links};

/// Returns the DOT source of a net.
#[must_use]
pub fn dot(net: &NetStructure, values: Option<&PortValues>) -> String {
    let mut out = format!(
        "digraph {} {{\n  rankdir=LR;\n  node [shape=plain, fontname=\"Helvetica\", fontsize=11];\n  edge [color=\"#7f8a99\", arrowsize=0.6];\n",
        quoted(&net.net)
    );
    clusters(&mut out, net, values);
    for (reader, input, _, link) in links(net) {
        if constant(net, link).is_some() {
            continue;
        }
        let style = match link.delayed {
            true => " [style=dashed, constraint=false]",
            false => "",
        };
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "  n{}:o{}:e -> n{reader}:i{input}:w{style};",
            link.primitive, link.output
        );
    }
    out.push_str("}\n");
    out
}

/// Writes the nodes; those of a fragment within its cluster.
fn clusters(out: &mut String, net: &NetStructure, values: Option<&PortValues>) {
    let mut parts: Vec<(Vec<&str>, usize)> = net
        .primitives
        .iter()
        .enumerate()
        .filter(|(_, part)| part.role != PrimitiveRole::Constant)
        .map(|(number, part)| (part.frames().collect(), number))
        .collect();
    // Groups the primitives of a frame, whatever the order of the file.
    parts.sort();
    let mut open: Vec<&str> = Vec::new();
    for (frames, number) in &parts {
        let same = open.iter().zip(frames).take_while(|(a, b)| a == b).count();
        for _ in same..open.len() {
            out.push_str("  }\n");
        }
        open.truncate(same);
        for frame in &frames[same..] {
            let title = frame_title(net, frame);
            let _ = writeln!(
                out,
                "  subgraph {} {{ label={}; style=rounded; color=\"#9aa4b1\"; fontname=\"Helvetica\";",
                quoted(&format!("cluster_{frame}")),
                quoted(&title)
            );
            open.push(frame);
        }
        node(out, net, *number, &net.primitives[*number], values);
    }
    for _ in open {
        out.push_str("  }\n");
    }
}

const fn colour(role: PrimitiveRole) -> &'static str {
    match role {
        PrimitiveRole::Measures => "#dcecfb",
        PrimitiveRole::Input => "#dff3e4",
        PrimitiveRole::Moves => "#ece4fa",
        PrimitiveRole::Commands => "#fde6d8",
        PrimitiveRole::Ends => "#f9dfe3",
        PrimitiveRole::Shows => "#d9f2f1",
        PrimitiveRole::Plain | PrimitiveRole::Constant => "#eef1f5",
    }
}

fn node(
    out: &mut String,
    net: &NetStructure,
    number: usize,
    part: &PrimitiveInfo,
    values: Option<&PortValues>,
) {
    let device = part.device.as_ref().map(|device| format!(" · {device}"));
    let mut rows = format!(
        "<TR><TD COLSPAN=\"2\" BGCOLOR=\"{}\"><B>{}</B><BR/>{}</TD></TR>",
        colour(drawn_role(part)),
        html(&part.id),
        html(&format!("{}{}", part.type_name, device.unwrap_or_default()))
    );
    for (name, value) in &part.parameters {
        let _ = write!(
            rows,
            "<TR><TD COLSPAN=\"2\" ALIGN=\"LEFT\">{}</TD></TR>",
            html(&format!("{name} {value}"))
        );
    }
    let value = |pin: &PortInfo| values?.get(&format!("{}.{}", part.id, pin.name)).cloned();
    for row in 0..part.inputs.len().max(part.outputs.len()) {
        rows.push_str("<TR>");
        match part.inputs.get(row) {
            Some(pin) => {
                let label = input(net, pin, value(pin));
                let _ = write!(
                    rows,
                    "<TD PORT=\"i{row}\" ALIGN=\"LEFT\">{}</TD>",
                    html(&label)
                );
            }
            None => rows.push_str("<TD></TD>"),
        }
        match part.outputs.get(row) {
            Some(pin) => {
                let label = format!("{} {}", pin.name, value(pin).unwrap_or_else(|| kind(pin)));
                let _ = write!(
                    rows,
                    "<TD PORT=\"o{row}\" ALIGN=\"RIGHT\">{}</TD>",
                    html(&label)
                );
            }
            None => rows.push_str("<TD></TD>"),
        }
        rows.push_str("</TR>");
    }
    let _ = writeln!(
        out,
        "  n{number} [label=<<TABLE BORDER=\"0\" CELLBORDER=\"1\" CELLSPACING=\"0\" CELLPADDING=\"3\">{rows}</TABLE>>];"
    );
}

fn kind(pin: &PortInfo) -> String {
    match &pin.unit {
        Some(unit) => format!("{} {unit}", pin.type_name),
        None => pin.type_name.clone(),
    }
}

/// Returns the text of an input: constants with their values, links with name and type.
fn input(net: &NetStructure, pin: &PortInfo, value: Option<String>) -> String {
    match (constants(net, pin), value) {
        (Some(constants), _) => format!("{} = {constants}", pin.name),
        (None, Some(value)) => format!("{} {value}", pin.name),
        (None, None) => format!("{} {}", pin.name, kind(pin)),
    }
}

/// Quotes a string for DOT, where only quote and backslash are special.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// Escapes text for an HTML-like label.
fn html(text: &str) -> String {
    super::svg::escaped(text)
}
