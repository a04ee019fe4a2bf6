//! A placed plot as SVG. Pure.

use std::fmt::Write as _;

use super::scene::{Anchor, At, Ink, PanelScene, Scene, Shape};

/// Colours of curves in light and dark schemes, distinguishable with any colour vision (Okabe and Ito, 2008; lighter
/// where they would be lost on black).
pub const COLOURS: [[&str; 2]; 8] = [
    ["#0072b2", "#4aa3df"],
    ["#d55e00", "#f07c28"],
    ["#009e73", "#2bbd92"],
    ["#cc79a7", "#dd93bb"],
    ["#e69f00", "#f0b429"],
    ["#56b4e9", "#9bd3f5"],
    ["#000000", "#ffffff"],
    ["#999999", "#aaaaaa"],
];

/// Class of each other colour, and its value in light and dark schemes.
pub const INKS: [(Ink, &str, [&str; 2]); 5] = [
    (Ink::Text, "ink", ["#000000", "#e4e9ef"]),
    (Ink::Grid, "grid", ["#dddddd", "#303841"]),
    (Ink::Axis, "axis", ["#000000", "#9aa5b3"]),
    (Ink::Limit, "limit", ["#c81e1e", "#ff6b6b"]),
    (Ink::Mark, "mark", ["#5a5a5a", "#b4bdc9"]),
];

/// Background in light and dark schemes.
pub const PAPER: [&str; 2] = ["#ffffff", "#151a21"];

/// Returns a file with the plot.
pub fn document(scene: &Scene, title: &str) -> String {
    let mut out = String::new();
    open(&mut out, scene, title);
    for panel in &scene.panels {
        panel.around.iter().for_each(|shape| draw(&mut out, shape));
        let [x, y, _, _] = panel.area;
        let _ = writeln!(
            out,
            "<g transform=\"translate({},{})\">",
            short(x),
            short(y)
        );
        panel.inside.iter().for_each(|shape| draw(&mut out, shape));
        out.push_str("</g>\n");
    }
    out.push_str("</svg>\n");
    out
}

/// Writes the beginning: size, style, background and title.
pub fn open(out: &mut String, scene: &Scene, title: &str) {
    let (width, height) = (short(scene.width), short(scene.height));
    // Writing to a String cannot fail.
    let _ = write!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" role=\"img\">\n<title>{}</title>\n<style>\n{}</style>\n<rect class=\"paper\" width=\"{width}\" height=\"{height}\"/>\n",
        escaped(title),
        style()
    );
    draw(out, &scene.title);
}

/// Returns the style sheet.
fn style() -> String {
    let scheme = |number: usize| {
        let mut text = format!(
            ".paper{{fill:{}}}text{{fill:{}}}",
            PAPER[number], INKS[0].2[number]
        );
        for (_, name, colours) in &INKS[1..] {
            let _ = write!(text, ".{name}{{stroke:{}}}", colours[number]);
        }
        for (index, colours) in COLOURS.iter().enumerate() {
            let colour = colours[number];
            let _ = write!(
                text,
                ".c{index}{{stroke:{colour}}}.d{index}{{fill:{colour}}}"
            );
        }
        text
    };
    format!(
        "text{{font-family:sans-serif}}path{{fill:none;stroke-linejoin:round}}\n{}\n@media(prefers-color-scheme:dark){{{}}}\n",
        scheme(0),
        scheme(1)
    )
}

/// Returns the class of a stroke.
fn class(ink: Ink) -> String {
    match ink {
        Ink::Curve(index) => format!("c{}", index % COLOURS.len()),
        other => {
            let row = INKS.iter().find(|(known, ..)| *known == other);
            row.map_or("ink", |(_, name, _)| name).to_owned()
        }
    }
}

/// Writes one shape.
pub fn draw(out: &mut String, shape: &Shape) {
    match shape {
        Shape::Line {
            segments,
            ink,
            width,
            name,
        } => {
            let name = match name.is_empty() {
                true => String::new(),
                false => format!(" data-name=\"{}\"", escaped(name)),
            };
            let _ = writeln!(
                out,
                "<path class=\"{}\" stroke-width=\"{width}\"{name} d=\"{}\"/>",
                class(*ink),
                path(segments)
            );
        }
        Shape::Disc { at, radius, ink } => {
            let Ink::Curve(index) = ink else { return };
            let _ = writeln!(
                out,
                "<circle class=\"d{}\" cx=\"{}\" cy=\"{}\" r=\"{radius}\"/>",
                index % COLOURS.len(),
                short(at[0]),
                short(at[1])
            );
        }
        Shape::Text {
            at,
            text,
            size,
            anchor,
            is_across,
        } => {
            let anchor = match anchor {
                Anchor::Start => "",
                Anchor::Middle => " text-anchor=\"middle\"",
                Anchor::End => " text-anchor=\"end\"",
            };
            let class = if *is_across { " class=\"tick\"" } else { "" };
            let _ = writeln!(
                out,
                "<text x=\"{}\" y=\"{}\" font-size=\"{size}\"{anchor}{class}>{}</text>",
                short(at[0]),
                short(at[1]),
                escaped(text)
            );
        }
    }
}

/// Returns the values of a panel's area as an attribute for the page's script.
pub fn range(panel: &PanelScene) -> String {
    panel.range.map(|value| value.to_string()).join(" ")
}

fn path(segments: &[Vec<At>]) -> String {
    let mut out = String::new();
    for segment in segments {
        for (number, [x, y]) in segment.iter().enumerate() {
            let letter = if number == 0 { 'M' } else { 'L' };
            let _ = write!(out, "{letter}{},{}", short(*x), short(*y));
        }
        // A round end makes a single point visible.
        if let [[x, y]] = segment[..] {
            let _ = write!(out, "L{},{}", short(x + 0.01), short(y));
        }
    }
    out
}

/// Rounds to a hundredth of a pixel.
pub fn short(value: f64) -> String {
    let rounded = (value * 100.0).round() / 100.0;
    // Avoids "-0".
    format!("{}", rounded + 0.0)
}

/// Escapes text for XML and HTML.
pub fn escaped(text: &str) -> String {
    rcc_graph::svg::escaped(text)
}
