//! Draws a net as a Mermaid flow chart for Markdown: boxes with name and type, links labelled with their ports, delayed
//! links dotted, fragments as subgraphs. Pure.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use rcc_language::structure::{NetStructure, PrimitiveRole};

use super::{PortValues, constant, constants, drawn_role, frame_title, links};

/// Returns the Mermaid source of a net.
#[must_use]
pub fn mermaid(net: &NetStructure, values: Option<&PortValues>) -> String {
    let mut out = "flowchart LR\n".to_owned();
    nodes(&mut out, net);
    for (reader, input, element, link) in links(net) {
        if constant(net, link).is_some() {
            continue;
        }
        let source = &net.primitives[link.primitive];
        let (reader_id, pin) = (reader, &net.primitives[reader].inputs[input]);
        let output = &source.outputs[link.output].name;
        let value = values.and_then(|values| values.get(&format!("{}.{output}", source.id)));
        let part = link.part.as_deref().unwrap_or_default();
        let element = element.map_or_else(String::new, |element| format!("[{element}]"));
        let value = value.map_or_else(String::new, |value| format!(": {value}"));
        let label = format!("{output}{part} → {}{element}{value}", pin.name);
        let arrow = if link.delayed { "-.->" } else { "-->" };
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "  n{} {arrow}|\"{}\"| n{reader_id}",
            link.primitive,
            escaped(&label)
        );
    }
    for (class, colours) in [
        ("measures", "fill:#dcecfb,stroke:#5a9bd8,color:#1d2530"),
        ("input", "fill:#dff3e4,stroke:#57b174,color:#1d2530"),
        ("moves", "fill:#ece4fa,stroke:#9a7bd6,color:#1d2530"),
        ("commands", "fill:#fde6d8,stroke:#e08a52,color:#1d2530"),
        ("ends", "fill:#f9dfe3,stroke:#d96b7c,color:#1d2530"),
        ("shows", "fill:#d9f2f1,stroke:#45aaa6,color:#1d2530"),
    ] {
        if net
            .primitives
            .iter()
            .any(|part| name(drawn_role(part)) == Some(class))
        {
            let _ = writeln!(out, "  classDef {class} {colours}");
        }
    }
    out
}

const fn name(role: PrimitiveRole) -> Option<&'static str> {
    match role {
        PrimitiveRole::Measures => Some("measures"),
        PrimitiveRole::Input => Some("input"),
        PrimitiveRole::Moves => Some("moves"),
        PrimitiveRole::Commands => Some("commands"),
        PrimitiveRole::Ends => Some("ends"),
        PrimitiveRole::Shows => Some("shows"),
        PrimitiveRole::Plain | PrimitiveRole::Constant => None,
    }
}

fn nodes(out: &mut String, net: &NetStructure) {
    let mut parts: BTreeMap<Vec<&str>, Vec<usize>> = BTreeMap::new();
    for (number, part) in net.primitives.iter().enumerate() {
        if part.role != PrimitiveRole::Constant {
            let frames: Vec<&str> = part.frames().collect();
            // Adds frames that contain only frames, too.
            for depth in 0..=frames.len() {
                parts.entry(frames[..depth].to_vec()).or_default();
            }
            parts.entry(frames).or_default().push(number);
        }
    }
    let mut open = 0;
    for (number, (frames, members)) in parts.iter().enumerate() {
        while open >= frames.len() && open > 0 {
            out.push_str("  end\n");
            open -= 1;
        }
        if let Some(frame) = frames.last() {
            let title = frame_title(net, frame);
            let _ = writeln!(out, "  subgraph f{number} [\"{}\"]", escaped(&title));
            open += 1;
        }
        for member in members {
            node(out, net, *member);
        }
    }
    for _ in 0..open {
        out.push_str("  end\n");
    }
}

fn node(out: &mut String, net: &NetStructure, number: usize) {
    let part = &net.primitives[number];
    let id = part.id.rsplit('/').next().unwrap_or_default();
    let device = part
        .device
        .as_ref()
        .map_or_else(String::new, |device| format!(" · {device}"));
    let mut label = format!(
        "<b>{}</b><br/>{}{}",
        escaped(id),
        part.type_name,
        escaped(&device)
    );
    for pin in &part.inputs {
        if let Some(constants) = constants(net, pin) {
            let _ = write!(
                label,
                "<br/>{}",
                escaped(&format!("{} = {constants}", pin.name))
            );
        }
    }
    let class = name(drawn_role(part)).map_or_else(String::new, |class| format!(":::{class}"));
    let _ = writeln!(out, "  n{number}[\"{label}\"]{class}");
}

/// Escapes a quoted text: entities for characters special to Mermaid or HTML.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for letter in text.chars() {
        match letter {
            '"' | '<' | '>' | '&' | '#' | '`' | '|' | '[' | ']' | '{' | '}' | '(' | ')' | '\\'
            | ';' => {
                let _ = write!(out, "#{};", u32::from(letter));
            }
            letter if letter.is_control() => out.push(' '),
            letter => out.push(letter),
        }
    }
    out
}
