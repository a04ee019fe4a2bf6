//! Places panels, axes, curves and legends of a plot; positions are fractions of pixels, y points downwards. Pure.

use super::simplify::simplified;
use super::ticks::{label, span, ticks};
use super::{Plot, PlotPanel};

pub const WIDTH: f64 = 1200.0;
pub const TITLE: f64 = 44.0;
/// Height of a panel over time, and of a spatial panel.
pub const HEIGHT: f64 = 240.0;
pub const SQUARE: f64 = 380.0;
const LEGEND: f64 = 230.0;
/// Margins of the plotted area within its panel: left, right, top, bottom.
const MARGINS: [f64; 4] = [72.0, 20.0, 30.0, 42.0];
/// Largest number of names in a legend.
const LEGEND_MAX: usize = 12;
/// Greatest deviation of a drawn curve from its points, pixels.
const DEVIATION: f64 = 0.05;

/// A point in pixels.
pub type At = [f64; 2];

/// Colour by meaning; its value depends on the scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ink {
    Text,
    Grid,
    Axis,
    Limit,
    Mark,
    /// Index of a curve's colour.
    Curve(usize),
}

/// Where a text is relative to its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// Something to draw.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Segments of a line.
    Line {
        segments: Vec<Vec<At>>,
        ink: Ink,
        width: f64,
        /// Name of a curve; empty otherwise.
        name: String,
    },
    Disc {
        at: At,
        radius: f64,
        ink: Ink,
    },
    /// One line of text; `at` is on its base line.
    Text {
        at: At,
        text: String,
        size: f64,
        anchor: Anchor,
        /// True for the label of a tick of the horizontal axis.
        is_across: bool,
    },
}

impl Shape {
    fn line(points: Vec<At>, ink: Ink, width: f64) -> Shape {
        Shape::Line {
            segments: vec![points],
            ink,
            width,
            name: String::new(),
        }
    }

    fn text(at: At, text: String, size: f64, anchor: Anchor) -> Shape {
        Shape::Text {
            at,
            text,
            size,
            anchor,
            is_across: false,
        }
    }
}

/// A placed panel.
#[derive(Clone, Debug, PartialEq)]
pub struct PanelScene {
    /// Left, top, width and height of the plotted area.
    pub area: [f64; 4],
    /// Left, right, bottom and top value of that area.
    pub range: [f64; 4],
    pub is_spatial: bool,
    /// Title, grid, ticks and legend.
    pub around: Vec<Shape>,
    /// Limits, marks and curves, relative to the area's top left corner.
    pub inside: Vec<Shape>,
}

/// A placed plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    pub width: f64,
    pub height: f64,
    pub title: Shape,
    pub panels: Vec<PanelScene>,
}

impl Scene {
    pub fn of(plot: &Plot) -> Scene {
        let mut panels = Vec::new();
        let mut top = TITLE;
        for row in rows(&plot.panels) {
            let is_spatial = row.iter().any(|panel| panel.is_spatial);
            let (height, columns) = if is_spatial {
                (SQUARE, 3.0)
            } else {
                (HEIGHT, 1.0)
            };
            let width = WIDTH / columns;
            for (number, panel) in row.iter().enumerate() {
                panels.push(PanelScene::of(
                    panel,
                    [number as f64 * width, top, width, height],
                ));
            }
            top += height;
        }
        let title = Shape::text([16.0, 30.0], plot.title.clone(), 22.0, Anchor::Start);
        Scene {
            width: WIDTH,
            height: top,
            title,
            panels,
        }
    }
}

/// Returns the panels in rows: up to three spatial ones that follow each other, or one over time.
fn rows(panels: &[PlotPanel]) -> Vec<&[PlotPanel]> {
    let mut rows = Vec::new();
    for group in panels.chunk_by(|one, next| one.is_spatial && next.is_spatial) {
        rows.extend(group.chunks(3));
    }
    rows
}

impl PanelScene {
    /// Places a panel in the rectangle of left, top, width and height.
    fn of(panel: &PlotPanel, [left, top, width, height]: [f64; 4]) -> PanelScene {
        let [before, after, above, below] = MARGINS;
        let legend = if panel.is_spatial { 0.0 } else { LEGEND };
        let area = [
            left + before,
            top + above,
            width - before - after - legend,
            height - above - below,
        ];
        let mut scene = PanelScene {
            area,
            range: range(panel, area[2], area[3]),
            is_spatial: panel.is_spatial,
            around: Vec::new(),
            inside: Vec::new(),
        };
        scene.axes(panel, [left + before, top + 20.0]);
        scene.curves(panel);
        if !panel.is_spatial {
            scene.legend(panel, [left + width - legend + 6.0, top + above + 4.0]);
        }
        scene
    }

    /// Returns the place of a value, relative to the area.
    fn place(&self, (x, y): (f64, f64)) -> At {
        let ([left, right, bottom, top], [_, _, width, height]) = (self.range, self.area);
        [
            (x - left) / (right - left) * width,
            (top - y) / (top - bottom) * height,
        ]
    }

    fn axes(&mut self, panel: &PlotPanel, title: At) {
        let ([left, right, bottom, top], [x, y, width, height]) = (self.range, self.area);
        let end = y + height;
        for value in ticks(left, right, if panel.is_spatial { 5 } else { 10 }) {
            let at = x + self.place((value, bottom))[0];
            let grid = Shape::line(vec![[at, y], [at, end]], Ink::Grid, 1.0);
            self.around.push(grid);
            self.around.push(Shape::Text {
                at: [at, end + 16.0],
                text: label(value),
                size: 13.0,
                anchor: Anchor::Middle,
                is_across: true,
            });
        }
        for value in ticks(bottom, top, 6) {
            let at = y + self.place((left, value))[1];
            let grid = Shape::line(vec![[x, at], [x + width, at]], Ink::Grid, 1.0);
            self.around.push(grid);
            let text = Shape::text([x - 6.0, at + 4.5], label(value), 13.0, Anchor::End);
            self.around.push(text);
        }
        let axis = vec![[x, y], [x, end], [x + width, end]];
        self.around.push(Shape::line(axis, Ink::Axis, 1.0));
        let across = [x + 0.5 * width, end + 33.0];
        let name = Shape::text(across, panel.across.clone(), 13.0, Anchor::Middle);
        self.around.push(name);
        let title = Shape::text(title, panel.title.clone(), 15.0, Anchor::Start);
        self.around.push(title);
    }

    fn curves(&mut self, panel: &PlotPanel) {
        let ([left, right, bottom, top], [_, _, width, height]) = (self.range, self.area);
        if let Some([l, r, b, t]) = panel.frame {
            let (l, r, b, t) = (l.max(left), r.min(right), b.max(bottom), t.min(top));
            let corners = [(l, b), (r, b), (r, t), (l, t), (l, b)];
            let frame = corners.map(|corner| self.place(corner)).to_vec();
            self.inside.push(Shape::line(frame, Ink::Limit, 1.0));
        }
        for limit in &panel.limits {
            let y = self.place((left, *limit))[1];
            let line = vec![[0.0, y], [width, y]];
            self.inside.push(Shape::line(line, Ink::Limit, 1.0));
        }
        for mark in &panel.marks {
            let x = self.place((*mark, bottom))[0];
            let line = vec![[x, 0.0], [x, height]];
            self.inside.push(Shape::line(line, Ink::Mark, 1.0));
        }
        let tolerance = [
            DEVIATION * (right - left) / width,
            DEVIATION * (top - bottom) / height,
        ];
        for curve in &panel.curves {
            let segments = curve.segments.iter().map(|segment| {
                let kept = simplified(segment, tolerance[0], tolerance[1]);
                kept.into_iter().map(|point| self.place(point)).collect()
            });
            let line = Shape::Line {
                segments: segments.collect(),
                ink: Ink::Curve(curve.colour),
                width: 2.0,
                name: curve.name.clone(),
            };
            self.inside.push(line);
            let begin = curve.segments.first().and_then(|segment| segment.first());
            if let (true, Some(begin)) = (panel.is_spatial, begin) {
                self.inside.push(Shape::Disc {
                    at: self.place(*begin),
                    radius: 5.0,
                    ink: Ink::Curve(curve.colour),
                });
            }
        }
    }

    fn legend(&mut self, panel: &PlotPanel, [x, y]: At) {
        let named = panel.curves.iter().filter(|curve| !curve.name.is_empty());
        let count = named.clone().count();
        for (row, curve) in named.take(LEGEND_MAX + 1).enumerate() {
            let y = y + 16.0 * row as f64;
            let text = |text: String| Shape::text([x + 26.0, y + 4.5], text, 13.0, Anchor::Start);
            if row == LEGEND_MAX {
                let more = format!("and {} more", count - LEGEND_MAX);
                self.around.push(text(more));
                return;
            }
            let line = vec![[x, y], [x + 20.0, y]];
            let ink = Ink::Curve(curve.colour);
            self.around.push(Shape::line(line, ink, 3.0));
            self.around.push(text(curve.name.clone()));
        }
    }
}

/// Returns left, right, bottom and top of the visible range, for an area of this size.
fn range(panel: &PlotPanel, width: f64, height: f64) -> [f64; 4] {
    let points = || {
        let segments = panel.curves.iter().flat_map(|curve| &curve.segments);
        segments.flatten()
    };
    let across = points().map(|(x, _)| *x);
    let limits = panel.limits.iter().copied();
    let shows = panel.shows.into_iter().flatten();
    let up = points().map(|(_, y)| *y).chain(limits).chain(shows);
    let ([left, right], [bottom, top]) = (span(across), span(up));
    if !panel.is_spatial {
        let room = 0.05 * (top - bottom);
        return [left, right, bottom - room, top + room];
    }
    let shape = width / height;
    let half = 0.55 * ((right - left) / shape).max(top - bottom).max(1e-3);
    let (x, y) = (0.5 * (left + right), 0.5 * (bottom + top));
    [x - half * shape, x + half * shape, y - half, y + half]
}
