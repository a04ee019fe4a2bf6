//! The legend below a diagram: only what the diagram contains. Pure.

use std::fmt::Write as _;

use rcc_language::structure::PrimitiveRole;

use super::{MARGIN, ROLES, short, text};
use crate::boxes::PORT_SIZE;
use crate::scene::NetScene;
use crate::text::width;

/// Style classes and texts of the colours and marks in a diagram.
pub struct Legend(Vec<(&'static str, &'static str)>);

impl Legend {
    /// Collects the entries for a scene.
    pub fn of(scene: &NetScene) -> Legend {
        let has = |role: PrimitiveRole| scene.boxes.iter().any(|(it, _)| it.role == role);
        let roles = ROLES.iter().filter(|(role, ..)| has(*role));
        let mut rows: Vec<_> = roles.map(|(_, name, label, _)| (*name, *label)).collect();
        if scene.links.iter().any(|segment| segment.signal.2) {
            rows.push(("delayed", "delayed by one cycle"));
        }
        let mut ports = scene
            .boxes
            .iter()
            .flat_map(|(it, _)| it.inputs.iter().chain(&it.outputs));
        if ports.any(|port| port.null && port.linked) {
            rows.push(("null", "can be null"));
        }
        if scene
            .boxes
            .iter()
            .any(|(it, _)| it.notes.iter().any(|note| note.starts_with('◉')))
        {
            rows.push(("eye", "read by a monitor"));
        }
        Legend(rows)
    }

    fn entry_width(label: &str) -> f64 {
        22.0 + width(label, PORT_SIZE) + 18.0
    }

    /// Arranges the entries in rows of at most this width.
    pub fn rows(&self, most: f64) -> Vec<Vec<(&'static str, &'static str)>> {
        let mut rows: Vec<Vec<_>> = vec![Vec::new()];
        let mut used = 0.0;
        for entry in &self.0 {
            let space = Legend::entry_width(entry.1);
            if used > 0.0 && used + space > most {
                rows.push(Vec::new());
                used = 0.0;
            }
            used += space;
            if let Some(row) = rows.last_mut() {
                row.push(*entry);
            }
        }
        rows
    }

    /// Draws the legend at the bottom.
    pub fn draw(&self, out: &mut String, rows: &[Vec<(&'static str, &'static str)>], high: f64) {
        for (number, row) in rows.iter().rev().enumerate() {
            let y = high - 18.0 - 20.0 * number as f64;
            let mut x = MARGIN;
            for (name, label) in row {
                let (left, middle) = (short(x), short(y - 4.0));
                let _ = match *name {
                    "delayed" => writeln!(
                        out,
                        "<path class=\"link delayed\" d=\"M{left},{middle}h16\"/>"
                    ),
                    "null" => writeln!(
                        out,
                        "<circle class=\"dot null\" cx=\"{}\" cy=\"{middle}\" r=\"3.5\"/>",
                        short(x + 9.0)
                    ),
                    "eye" => writeln!(
                        out,
                        "<text class=\"note\" x=\"{left}\" y=\"{}\">◉</text>",
                        short(y)
                    ),
                    name => writeln!(
                        out,
                        "<rect class=\"{name}\" x=\"{left}\" y=\"{}\" width=\"14\" height=\"11\" rx=\"2\"/>",
                        short(y - 9.5)
                    ),
                };
                text(out, "kind", x + 22.0, y, label, "");
                x += Legend::entry_width(label);
            }
        }
    }
}
