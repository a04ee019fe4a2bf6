//! A motion as a person watches it: a bar with distance, speed, force and torch.
//! Printed by the demo's main thread; redrawn in place on a terminal, a few lines elsewhere.

use crate::output::Printer;
use std::io::{self, IsTerminal};

/// Cells of the bar.
const WIDTH: usize = 28;

/// What is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionProgress {
    /// Part of the way, 0 to 1.
    pub part: f64,
    /// m.
    pub distance: f64,
    /// m/s, if the net shows it.
    pub speed: Option<f64>,
    /// N, if the net shows it.
    pub force: Option<f64>,
    /// The torch, if the net has one.
    pub torch: Option<bool>,
}

/// The bar of one motion.
pub struct Bar {
    name: String,
    live: bool,
    shown: Option<String>,
    /// A terminal that is gone, or stopped, is no reason to stop a robot in some other way than by its net.
    printer: Printer,
}

impl Bar {
    /// A bar with this name before it.
    #[must_use]
    pub fn new(name: &str, quiet: bool, printer: &Printer) -> Bar {
        Bar {
            name: name.to_owned(),
            live: !quiet && io::stdout().is_terminal(),
            shown: None,
            printer: printer.clone(),
        }
    }

    /// Shows the motion as it is now; only on a terminal.
    pub fn show(&mut self, view: &MotionProgress) {
        let line = line(&self.name, view);
        if self.live && self.shown.as_ref() != Some(&line) {
            self.printer.overwrite(&line, false);
        }
        self.shown = Some(line);
    }

    /// The last line stays, with how it ended.
    pub fn end(&mut self, view: &MotionProgress, words: &str) {
        let text = format!("{}  {words}", line(&self.name, view));
        if self.live {
            self.printer.overwrite(&text, true);
        } else {
            self.printer.print_line(&text);
        }
    }
}

fn line(name: &str, view: &MotionProgress) -> String {
    let part = if view.part.is_finite() {
        view.part.clamp(0.0, 1.0)
    } else {
        0.0
    };
    let full = (part * WIDTH as f64).round() as usize;
    let bar: String = (0..WIDTH)
        .map(|cell| if cell < full { '█' } else { '░' })
        .collect();
    let mut text = format!("  {name:<24} {bar} {:>6.1} mm", view.distance * 1e3);
    if let Some(speed) = view.speed {
        text.push_str(&format!("  {:>5.1} mm/s", speed * 1e3));
    }
    if let Some(force) = view.force {
        text.push_str(&format!("  {force:>5.1} N"));
    }
    if let Some(torch) = view.torch {
        text.push_str(if torch { "  torch ✹" } else { "  torch ·" });
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_way_is_half_of_the_bar() {
        let view = MotionProgress {
            part: 0.5,
            distance: 0.075,
            torch: Some(true),
            ..MotionProgress::default()
        };
        let text = line("figure 5", &view);
        assert_eq!(text.matches('█').count(), WIDTH / 2);
        assert!(text.contains("75.0 mm") && text.ends_with('✹'), "{text}");
    }

    #[test]
    fn null_is_no_way() {
        let view = MotionProgress {
            part: f64::NAN,
            ..MotionProgress::default()
        };
        assert_eq!(line("x", &view).matches('█').count(), 0);
    }
}
