//! Series over time as an SVG picture: one panel for each unit, axes with round numbers, a legend; nulls are gaps. Pure.

use std::fmt::Write as _;

use super::trace::{Bucket, Column};

const WIDTH: f64 = 960.0;
const PANEL: f64 = 260.0;
const LEFT: f64 = 80.0;
const RIGHT: f64 = 250.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 40.0;
/// Colours that people with any colour vision tell apart (Okabe and Ito, 2008).
const COLOURS: [&str; 8] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999",
];
/// Names beyond these are not in the legend.
const LEGEND_MAX: usize = 13;

/// The picture.
#[must_use]
pub fn svg(title: &str, columns: &[Column], end_s: f64) -> String {
    let columns: Vec<&Column> = columns.iter().filter(|column| column.seen).collect();
    let mut units: Vec<&str> = Vec::new();
    for column in &columns {
        if !units.contains(&column.unit.as_str()) {
            units.push(&column.unit);
        }
    }
    let height = TOP + units.len() as f64 * PANEL;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n\
         <text x=\"{LEFT}\" y=\"22\" font-size=\"15\">{}</text>\n",
        escaped(title)
    );
    for (place, unit) in units.iter().enumerate() {
        let of_unit: Vec<&Column> = columns
            .iter()
            .copied()
            .filter(|column| column.unit == **unit)
            .collect();
        panel(&mut out, TOP + place as f64 * PANEL, unit, &of_unit, end_s);
    }
    out.push_str("</svg>\n");
    out
}

/// Where values lie in a panel.
struct Scale {
    top: f64,
    low: f64,
    high: f64,
    end_s: f64,
}

impl Scale {
    fn x(&self, time_s: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * time_s / self.end_s
    }

    fn y(&self, value: f64) -> f64 {
        self.top + (PANEL - BOTTOM) * (self.high - value) / (self.high - self.low)
    }
}

fn panel(out: &mut String, top: f64, unit: &str, columns: &[&Column], end_s: f64) {
    let ranges = columns
        .iter()
        .flat_map(|column| column.series.buckets())
        .filter_map(|bucket| bucket.range);
    let (low, high) = ranges.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), [a, b]| {
        (low.min(a), high.max(b))
    });
    let (low, high) = match (low <= high, high - low) {
        (false, _) => (0.0, 1.0),
        (true, width) if width > 1e-12 * high.abs().max(low.abs()) => {
            (low - 0.05 * width, high + 0.05 * width)
        }
        (true, _) => (low - 1.0, high + 1.0),
    };
    let scale = Scale {
        top,
        low,
        high,
        end_s: if end_s > 0.0 { end_s } else { 1.0 },
    };
    axes(out, &scale, unit);
    for (index, column) in columns.iter().enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        lines(out, &scale, colour, column.series.buckets());
        legend(out, top, index, columns.len(), colour, &column.name);
    }
}

fn axes(out: &mut String, scale: &Scale, unit: &str) {
    let (right, bottom) = (WIDTH - RIGHT, scale.top + PANEL - BOTTOM);
    let label = if unit.is_empty() { "1" } else { unit };
    // Writing to a String cannot fail.
    for value in ticks(scale.low, scale.high) {
        let y = scale.y(value);
        let _ = writeln!(
            out,
            "<line x1=\"{LEFT}\" y1=\"{y:.1}\" x2=\"{right}\" y2=\"{y:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{:.0}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            y + 4.0,
            short(value)
        );
    }
    for value in ticks(0.0, scale.end_s) {
        let x = scale.x(value);
        let _ = writeln!(
            out,
            "<line x1=\"{x:.1}\" y1=\"{:.1}\" x2=\"{x:.1}\" y2=\"{bottom:.1}\" stroke=\"#ddd\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            scale.top,
            bottom + 15.0,
            short(value)
        );
    }
    let _ = writeln!(
        out,
        "<rect x=\"{LEFT}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" stroke=\"#444\"/>\
         <text x=\"{right}\" y=\"{:.1}\" text-anchor=\"end\">time [s]</text>\
         <text x=\"{LEFT}\" y=\"{:.1}\">[{}]</text>",
        scale.top,
        right - LEFT,
        PANEL - BOTTOM,
        bottom + 30.0,
        scale.top - 4.0,
        escaped(label)
    );
}

/// A line for each stretch without null: through smallest and largest value.
fn lines(out: &mut String, scale: &Scale, colour: &str, buckets: &[Bucket]) {
    let mut points = String::new();
    let mut flush = |points: &mut String| {
        if !points.is_empty() {
            let _ = writeln!(
                out,
                "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.3\" points=\"{points}\"/>"
            );
            points.clear();
        }
    };
    for bucket in buckets {
        let Some([low, high]) = bucket.range else {
            flush(&mut points);
            continue;
        };
        let x = scale.x(bucket.time_s);
        let _ = write!(points, "{x:.2},{:.2} ", scale.y(low));
        if low != high {
            let _ = write!(points, "{x:.2},{:.2} ", scale.y(high));
        }
    }
    flush(&mut points);
}

fn legend(out: &mut String, top: f64, index: usize, count: usize, colour: &str, name: &str) {
    let (x, y) = (WIDTH - RIGHT + 12.0, top + 12.0 + 16.0 * index as f64);
    let words = match index {
        _ if index < LEGEND_MAX => escaped(name),
        _ if index == LEGEND_MAX => format!("and {} more", count - LEGEND_MAX),
        _ => return,
    };
    let _ = writeln!(
        out,
        "<line x1=\"{x:.0}\" y1=\"{y:.0}\" x2=\"{:.0}\" y2=\"{y:.0}\" stroke=\"{colour}\" stroke-width=\"2\"/>\
         <text x=\"{:.0}\" y=\"{:.0}\">{words}</text>",
        x + 18.0,
        x + 24.0,
        y + 4.0
    );
}

/// Round numbers from `low` to `high`, four to nine of them.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let raw = (high - low) / 5.0;
    if !(raw.is_finite() && raw > 0.0) {
        return Vec::new();
    }
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|factor| factor * power)
        .into_iter()
        .find(|step| *step >= raw * 0.999)
        .unwrap_or(10.0 * power);
    let first = (low / step).ceil();
    (0..20)
        .map(|number| (first + f64::from(number)) * step)
        .take_while(|value| *value <= high + 1e-9 * step)
        .collect()
}

/// With as many digits as a tick needs.
fn short(value: f64) -> String {
    let rounded = format!("{value:.6}");
    let trimmed = rounded.trim_end_matches('0').trim_end_matches('.');
    match trimmed {
        "0" | "-0" if value.abs() > 1e-12 => format!("{value:.1e}"),
        "-0" => "0".to_owned(),
        _ if value.abs() >= 1e6 => format!("{value:.2e}"),
        _ => trimmed.to_owned(),
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(ticks(0.0, 5.0), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        for (low, high) in [(-0.013, 0.07), (1e-9, 3e-9), (250.0, 1e7), (-1.0, 1.0)] {
            let ticks = ticks(low, high);
            assert!((4..=12).contains(&ticks.len()), "{ticks:?}");
            assert!(
                ticks
                    .iter()
                    .all(|tick| *tick >= low && *tick <= high * 1.000_001)
            );
        }
        assert!(ticks(1.0, 1.0).is_empty() && ticks(0.0, f64::NAN).is_empty());
    }

    #[test]
    fn names_cannot_break_the_picture() {
        assert_eq!(escaped("a<b>&\"c\""), "a&lt;b&gt;&amp;&quot;c&quot;");
    }
}
