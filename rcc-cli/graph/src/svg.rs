//! Draws a laid-out net as SVG 1.1 with a style sheet for light and dark schemes; loads nothing external. Pure.

use std::fmt::Write as _;

use rcc_language::structure::{NetStructure, PrimitiveInfo, PrimitiveRole};

mod legend;

use self::legend::Legend;
use super::boxes::{PortLabel, PrimitiveBox};
use super::layout::{LinkRoute, PlanePoint};
use super::scene::{FragmentFrame, LinkSegment, NetScene};
use super::text::{fit, lines};

const MARGIN: f64 = 24.0;
const TITLE: f64 = 20.0;
const HEAD: f64 = 40.0;
const ROUND: f64 = 7.0;
const SIDE: f64 = 12.0;
const LEGEND: f64 = 44.0;
const LEAST_WIDTH: f64 = 420.0;

/// Style class of each role, its text in the legend, and fill and stroke colours for light and dark schemes.
const ROLES: [(PrimitiveRole, &str, &str, [&str; 4]); 7] = [
    (
        PrimitiveRole::Plain,
        "plain",
        "computation",
        ["#eef1f5", "#aab4c1", "#2a313b", "#566173"],
    ),
    (
        PrimitiveRole::Measures,
        "measures",
        "measurement",
        ["#dcecfb", "#5a9bd8", "#173a5c", "#4a8ccb"],
    ),
    (
        PrimitiveRole::Input,
        "input",
        "external input",
        ["#dff3e4", "#57b174", "#17402a", "#46a164"],
    ),
    (
        PrimitiveRole::Moves,
        "moves",
        "motion",
        ["#ece4fa", "#9a7bd6", "#352a57", "#8b6bcb"],
    ),
    (
        PrimitiveRole::Commands,
        "commands",
        "device command",
        ["#fde6d8", "#e08a52", "#552f18", "#d27b43"],
    ),
    (
        PrimitiveRole::Ends,
        "ends",
        "cancel, termination",
        ["#f9dfe3", "#d96b7c", "#52222b", "#c95a6c"],
    ),
    (
        PrimitiveRole::Shows,
        "shows",
        "published or monitored",
        ["#d9f2f1", "#45aaa6", "#16403f", "#3c9c98"],
    ),
];

const STYLE: &str = "\
text{font-family:'Helvetica Neue',Helvetica,Arial,sans-serif;fill:#1d2530}
.paper{fill:#ffffff}.title{font-size:17px;font-weight:600}.words{font-size:12px;fill:#5d6876}
.box{fill:#ffffff;stroke:#b9c2cd}.id{font-size:13px;font-weight:600}.kind{font-size:11px;fill:#566170}
.port{font-size:11px}.small{font-size:9.5px;fill:#768190}.note{font-size:9.5px;fill:#2e8480}
.link{fill:none;stroke:#7f8a99;stroke-width:1.5}.delayed{stroke-dasharray:6 4}
.dot{fill:#7f8a99;stroke:#7f8a99;stroke-width:1.4}.null{fill:#ffffff}
.frame{fill:#7f8a99;fill-opacity:.07;stroke:#9aa4b1;stroke-dasharray:1 0}.frame-title{font-size:12px;font-weight:600;fill:#566170}
";

const DARK: &str = "\
text{fill:#e4e9ef}.paper{fill:#151a21}.words{fill:#9aa5b3}
.box{fill:#1c232c;stroke:#475263}.kind{fill:#b4bdc9}.small{fill:#8b96a5}.note{fill:#59bdb8}
.link{stroke:#8793a3}.dot{fill:#8793a3;stroke:#8793a3}.null{fill:#1c232c}
.frame{fill:#8793a3;stroke:#5d6979}.frame-title{fill:#b4bdc9}
";

/// Returns the SVG of a net.
#[must_use]
pub fn svg(net: &NetStructure, scene: &NetScene) -> String {
    let wide = (scene.width + 2.0 * MARGIN).max(LEAST_WIDTH).ceil();
    let description = lines(&net.description, 12.0, wide - 2.0 * MARGIN, 4);
    let top = MARGIN + TITLE + 18.0 * description.len() as f64 + 14.0;
    let legend = Legend::of(scene);
    let rows = legend.rows(wide - 2.0 * MARGIN);
    let high = (top + scene.height + LEGEND + 20.0 * (rows.len() as f64 - 1.0)).ceil();
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{wide}\" height=\"{high}\" viewBox=\"0 0 {wide} {high}\" role=\"img\">\n<title>{}</title>\n<style>\n{}</style>\n<rect class=\"paper\" width=\"{wide}\" height=\"{high}\" rx=\"8\"/>\n",
        escaped(&net.net),
        style()
    );
    text(
        &mut out,
        "title",
        MARGIN,
        MARGIN + 12.0,
        &fit(&net.net, 17.0, wide - 2.0 * MARGIN),
        "",
    );
    for (row, line) in description.iter().enumerate() {
        text(
            &mut out,
            "words",
            MARGIN,
            MARGIN + TITLE + 14.0 + 18.0 * row as f64,
            line,
            "",
        );
    }
    let left = ((wide - scene.width) / 2.0).floor();
    let _ = writeln!(
        out,
        "<g transform=\"translate({},{})\">",
        short(left),
        short(top)
    );
    scene
        .frames
        .iter()
        .for_each(|frame| draw_frame(&mut out, frame));
    scene
        .links
        .iter()
        .for_each(|segment| draw_link(&mut out, net, segment));
    for (it, at) in &scene.boxes {
        if let Some(part) = net.primitives.get(it.part) {
            draw_box(&mut out, part, it, *at);
        }
    }
    out.push_str("</g>\n");
    legend.draw(&mut out, &rows, high);
    out.push_str("</svg>\n");
    out
}

fn style() -> String {
    let (mut light, mut dark) = (STYLE.to_owned(), DARK.to_owned());
    for (_, name, _, colours) in ROLES {
        let [tint, line, dark_tint, dark_line] = colours;
        let _ = writeln!(light, ".{name}{{fill:{tint};stroke:{line}}}");
        let _ = writeln!(dark, ".{name}{{fill:{dark_tint};stroke:{dark_line}}}");
    }
    format!("{light}@media(prefers-color-scheme:dark){{\n{dark}}}\n")
}

fn role_name(role: PrimitiveRole) -> &'static str {
    let row = ROLES.iter().find(|(known, ..)| *known == role);
    row.map_or("plain", |(_, name, ..)| name)
}

fn draw_frame(out: &mut String, frame: &FragmentFrame) {
    let PlanePoint { x, y } = frame.at;
    let _ = writeln!(
        out,
        "<rect class=\"frame\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"10\"/>",
        short(x),
        short(y),
        short(frame.width),
        short(frame.height)
    );
    text(
        out,
        "frame-title",
        x + SIDE,
        y + 19.0,
        &fit(&frame.title, 12.0, frame.width - 2.0 * SIDE),
        "",
    );
}

fn draw_link(out: &mut String, net: &NetStructure, segment: &LinkSegment) {
    let (part, output, delayed) = segment.signal;
    let part = net.primitives.get(part);
    let port = part.and_then(|part| part.outputs.get(output));
    let (id, port) = (
        part.map_or("", |part| part.id.as_str()),
        port.map_or("", |port| &port.name),
    );
    let class = if delayed { "link delayed" } else { "link" };
    let to = segment.to.and_then(|(reader, input)| {
        let reader = net.primitives.get(reader)?;
        Some(format!(
            " → {}.{}",
            reader.id,
            reader.inputs.get(input)?.name
        ))
    });
    let _ = writeln!(
        out,
        "<path class=\"{class}\" d=\"{}\"><title>{}</title></path>",
        path(&segment.route),
        escaped(&format!(
            "{id}.{port}{}{}",
            to.unwrap_or_default(),
            if delayed {
                ", of the previous cycle"
            } else {
                ""
            }
        ))
    );
}

/// Converts a course to SVG path commands.
fn path(route: &LinkRoute) -> String {
    let mut out = String::new();
    let points = route.points();
    let Some(first) = points.first() else {
        return out;
    };
    let _ = write!(out, "M{},{}", short(first.x), short(first.y));
    match route {
        LinkRoute::Curve(_) => {
            for pair in points.windows(2) {
                let [from, to] = [pair[0], pair[1]];
                if (from.y - to.y).abs() < 0.05 {
                    let _ = write!(out, "H{}", short(to.x));
                } else {
                    let middle = short((from.x + to.x) / 2.0);
                    let _ = write!(
                        out,
                        "C{middle},{} {middle},{} {},{}",
                        short(from.y),
                        short(to.y),
                        short(to.x),
                        short(to.y)
                    );
                }
            }
        }
        LinkRoute::Around(_) => {
            for corner in points.windows(3) {
                let [before, at, after] = [corner[0], corner[1], corner[2]];
                let [near, far] = [towards(at, before), towards(at, after)];
                let _ = write!(
                    out,
                    "L{},{}Q{},{} {},{}",
                    short(near.x),
                    short(near.y),
                    short(at.x),
                    short(at.y),
                    short(far.x),
                    short(far.y)
                );
            }
            if let Some(last) = points.last() {
                let _ = write!(out, "L{},{}", short(last.x), short(last.y));
            }
        }
    }
    out
}

/// Returns a point near `from` on the way to `to`, for a rounded corner.
fn towards(from: PlanePoint, to: PlanePoint) -> PlanePoint {
    let (x, y) = (to.x - from.x, to.y - from.y);
    let length = x.abs().max(y.abs());
    let part = if length > 0.0 {
        (ROUND.min(length / 2.0)) / length
    } else {
        0.0
    };
    PlanePoint {
        x: from.x + x * part,
        y: from.y + y * part,
    }
}

fn draw_box(out: &mut String, part: &PrimitiveInfo, it: &PrimitiveBox, at: PlanePoint) {
    let PlanePoint { x, y } = at;
    let (w, h) = (it.width, it.height);
    let _ = writeln!(
        out,
        "<g class=\"primitive\" data-id=\"{}\"><title>{}</title>\n<rect class=\"box\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"{ROUND}\"/>",
        escaped(&part.id),
        escaped(&format!("{}: {}", part.id, part.type_name)),
        short(x),
        short(y),
        short(w),
        short(h)
    );
    let (side, round) = (HEAD - ROUND, w - 2.0 * ROUND);
    let _ = writeln!(
        out,
        "<path class=\"{}\" d=\"M{},{}v-{side}a{ROUND},{ROUND} 0 0 1 {ROUND},-{ROUND}h{}a{ROUND},{ROUND} 0 0 1 {ROUND},{ROUND}v{side}z\"/>",
        role_name(it.role),
        short(x),
        short(y + HEAD),
        short(round)
    );
    text(out, "id", x + SIDE, y + 17.0, &it.id, "");
    text(out, "kind", x + SIDE, y + 32.0, &it.kind, "");
    for (row, line) in it.parameters.iter().enumerate() {
        text(
            out,
            "small",
            x + SIDE,
            y + PrimitiveBox::first_line() + PrimitiveBox::LINE * row as f64,
            line,
            "",
        );
    }
    for port in &it.inputs {
        let why = part
            .inputs
            .get(port.port)
            .and_then(|pin| pin.null.as_deref());
        draw_input(out, port, PlanePoint { x, y: y + port.y }, why);
    }
    for port in &it.outputs {
        draw_output(
            out,
            port,
            PlanePoint {
                x: x + w,
                y: y + port.y,
            },
            part.null.as_deref(),
        );
    }
    for (row, line) in it.notes.iter().enumerate() {
        let class = if line.starts_with('◉') {
            "note"
        } else {
            "small"
        };
        text(
            out,
            class,
            x + SIDE,
            y + it.first_note() + PrimitiveBox::LINE * row as f64,
            line,
            "",
        );
    }
    out.push_str("</g>\n");
}

fn draw_input(out: &mut String, port: &PortLabel, at: PlanePoint, why: Option<&str>) {
    let class = if port.null { "dot null" } else { "dot" };
    if port.linked {
        let _ = writeln!(
            out,
            "<path class=\"{class}\" d=\"M{},{}l8,4l-8,4z\">{}</path>",
            short(at.x - 4.0),
            short(at.y - 4.0),
            reason(why)
        );
    }
    port_words(out, port, at.x + SIDE, at.y, "");
}

fn draw_output(out: &mut String, port: &PortLabel, at: PlanePoint, why: Option<&str>) {
    let class = if port.null { "dot null" } else { "dot" };
    let _ = writeln!(
        out,
        "<circle class=\"{class}\" cx=\"{}\" cy=\"{}\" r=\"3.5\">{}</circle>",
        short(at.x),
        short(at.y),
        reason(why)
    );
    port_words(out, port, at.x - SIDE, at.y, " text-anchor=\"end\"");
}

/// Writes a port's name, and its type and unit or value.
fn port_words(out: &mut String, port: &PortLabel, x: f64, y: f64, more: &str) {
    text(out, "port", x, y + 1.0, &port.name, more);
    text(out, "small", x, y + 12.0, &port.small, more);
}

fn reason(why: Option<&str>) -> String {
    why.map_or_else(String::new, |why| {
        format!("<title>can be null: {}</title>", escaped(why))
    })
}

fn text(out: &mut String, class: &str, x: f64, y: f64, content: &str, more: &str) {
    let _ = writeln!(
        out,
        "<text class=\"{class}\" x=\"{}\" y=\"{}\"{more}>{}</text>",
        short(x),
        short(y),
        escaped(content)
    );
}

/// Rounds to a tenth, which is finer than any screen, so that the text is the same everywhere.
fn short(value: f64) -> String {
    let tenths = (value * 10.0).round() / 10.0;
    // Avoids "-0".
    format!("{}", tenths + 0.0)
}

/// Escapes text for an element or an attribute.
#[must_use]
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // XML allows no other control characters.
            letter if letter.is_control() && letter != '\n' && letter != '\t' => {
                out.push('\u{fffd}')
            }
            letter => out.push(letter),
        }
    }
    out
}
