//! Progress of a motion: a bar with distance, speed, force and torch. Printed by the demo's main thread; redrawn in
//! place on a terminal, otherwise printed once at the end.

use crate::output::BackgroundPrinter;
use rcc_terminal::text::TerminalSize;

/// Width of the bar, characters, at most and at least.
const WIDTH_MAX: usize = 28;
const WIDTH_MIN: usize = 8;
/// Characters beside the bar in the longest line.
const BESIDE: usize = 69;

/// The displayed values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionProgress {
    /// Completed part of the path, 0 to 1.
    pub part: f64,
    /// Distance along the path, m.
    pub distance: f64,
    /// Speed, m/s, if the net monitors it.
    pub speed: Option<f64>,
    /// Force, N, if the net monitors it.
    pub force: Option<f64>,
    /// State of the torch, if the net has one.
    pub torch: Option<bool>,
}

/// Progress bar of one motion.
pub struct Bar {
    name: String,
    live: bool,
    /// Width of the bar, characters: a line that wraps could not be redrawn in place.
    width: usize,
    shown: Option<String>,
    /// Never blocks: a closed or stopped terminal must not change how the robot stops.
    printer: BackgroundPrinter,
}

impl Bar {
    /// Creates a bar with this title.
    #[must_use]
    pub fn new(name: &str, quiet: bool, printer: &BackgroundPrinter) -> Bar {
        let size = TerminalSize::of_stdout();
        Bar {
            name: name.to_owned(),
            live: !quiet && size.is_some(),
            width: width(size),
            shown: None,
            printer: printer.clone(),
        }
    }

    /// Redraws the bar; only on a terminal.
    pub fn show(&mut self, view: &MotionProgress) {
        let line = line(&self.name, view, self.width);
        if self.live && self.shown.as_ref() != Some(&line) {
            self.printer.overwrite(&line, false);
        }
        self.shown = Some(line);
    }

    /// Prints the final line, with how the motion ended.
    pub fn end(&mut self, view: &MotionProgress, state: &str) {
        let text = format!("{}  {state}", line(&self.name, view, self.width));
        if self.live {
            self.printer.overwrite(&text, true);
        } else {
            self.printer.print_line(&text);
        }
    }
}

fn width(size: Option<TerminalSize>) -> usize {
    let columns = size.map_or(usize::MAX, |size| size.columns);
    columns.saturating_sub(BESIDE).clamp(WIDTH_MIN, WIDTH_MAX)
}

fn line(name: &str, view: &MotionProgress, width: usize) -> String {
    let part = if view.part.is_finite() {
        view.part.clamp(0.0, 1.0)
    } else {
        0.0
    };
    let full = (part * width as f64).round() as usize;
    let bar: String = (0..width)
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
    fn half_of_the_path_is_half_of_the_bar() {
        let view = MotionProgress {
            part: 0.5,
            distance: 0.075,
            torch: Some(true),
            ..MotionProgress::default()
        };
        let text = line("figure 5", &view, WIDTH_MAX);
        assert_eq!(text.matches('█').count(), WIDTH_MAX / 2);
        assert!(text.contains("75.0 mm") && text.ends_with('✹'), "{text}");
    }

    #[test]
    fn a_null_position_shows_an_empty_bar() {
        let view = MotionProgress {
            part: f64::NAN,
            ..MotionProgress::default()
        };
        assert_eq!(line("x", &view, WIDTH_MAX).matches('█').count(), 0);
    }

    #[test]
    fn the_longest_line_fits_80_columns() {
        let size = |columns| Some(TerminalSize { columns, rows: 24 });
        for (speed, force, torch) in [(0.1, Some(65.6), None), (0.1, None, Some(true))] {
            let view = MotionProgress {
                distance: 1.0,
                speed: Some(speed),
                force,
                torch,
                ..MotionProgress::default()
            };
            for name in ["figure 4: contact", "figure 5: cancel"] {
                let text = line(name, &view, width(size(80))) + "  finished";
                assert!(text.chars().count() <= 80, "{text}");
            }
        }
        assert_eq!(width(size(120)), WIDTH_MAX);
        assert_eq!(width(None), WIDTH_MAX);
    }
}
