//! A placed plot as one HTML page with a script that shows values under the pointer and zooms in time. Pure.

use std::fmt::Write as _;

use super::scene::Scene;
use super::svg::{draw, escaped, open, range, short};

const SCRIPT: &str = include_str!("plot.js");

/// Style of the page around the picture.
const STYLE: &str = "\
body{margin:0;background:#fff;font-family:sans-serif}body>svg{width:100%;height:auto;max-width:1600px;display:block;user-select:none}
#tip{position:fixed;pointer-events:none;display:none;font-size:12px;padding:4px 8px;border-radius:4px;background:#fffd;border:1px solid #999;color:#000;white-space:pre}
.view path{vector-effect:non-scaling-stroke}#cursor{stroke-dasharray:3 3}#span{fill:#7f8a99;fill-opacity:.25;stroke:none}
@media(prefers-color-scheme:dark){body{background:#151a21}#tip{background:#1c232cdd;color:#e4e9ef}}
";

/// Returns the page. It loads nothing; without a script it shows the picture.
pub fn page(scene: &Scene, title: &str) -> String {
    let mut out = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"color-scheme\" content=\"light dark\">\n<title>{}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n",
        escaped(title)
    );
    open(&mut out, scene, title);
    for panel in &scene.panels {
        panel.around.iter().for_each(|shape| draw(&mut out, shape));
        let [x, y, width, height] = panel.area.map(short);
        let kind = if panel.is_spatial { "space" } else { "time" };
        // An inner picture of its own cuts off what a zoom moves outside.
        let _ = writeln!(
            out,
            "<svg class=\"view {kind}\" x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" preserveAspectRatio=\"none\" data-range=\"{}\">",
            range(panel)
        );
        panel.inside.iter().for_each(|shape| draw(&mut out, shape));
        out.push_str("</svg>\n");
    }
    let _ = write!(
        out,
        "</svg>\n<div id=\"tip\"></div>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n"
    );
    out
}
