//! Draws curves as SVG or PNG: panels with axes, limits and a legend. Runs on the caller's thread; the same curves give
//! the same bytes.

use std::io::Write;
use std::sync::OnceLock;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use thiserror::Error;

mod simplify;

/// Colours distinguishable with any colour vision (Okabe and Ito, 2008).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(153, 153, 153),
];
const LIMIT: RGBColor = RGBColor(200, 30, 30);
const WIDTH: u32 = 1200;
const TITLE: u32 = 44;
/// Height of a panel over time, and of a spatial panel, pixels.
const HEIGHT: u32 = 240;
const SQUARE: u32 = 380;
const LEGEND: u32 = 230;
/// Largest number of names in a legend.
const LEGEND_MAX: usize = 12;
const FONT: &str = "sans-serif";

/// A curve; a gap separates two segments where it has no value.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlotCurve {
    /// Name in the legend; an empty name is left out.
    pub name: String,
    /// Segments, each with its points in order.
    pub segments: Vec<Vec<(f64, f64)>>,
    /// Index into the list of colours.
    pub colour: usize,
}

/// A rectangle of the plot with its own axes.
#[derive(Clone, Debug, PartialEq)]
pub struct PlotPanel {
    /// Quantity and unit.
    pub title: String,
    /// Name and unit of the horizontal axis.
    pub across: String,
    /// True for positions in space: three panels per row, with equal scales on both axes. False for values over time:
    /// one panel per row.
    pub is_spatial: bool,
    /// Curves to draw.
    pub curves: Vec<PlotCurve>,
    /// Values that must not be exceeded, drawn as horizontal lines.
    pub limits: Vec<f64>,
    /// Times of events, drawn as vertical lines.
    pub marks: Vec<f64>,
    /// Range that the vertical axis covers at least: lower and upper value.
    pub shows: Option<[f64; 2]>,
    /// A rectangle to draw: left, right, bottom and top.
    pub frame: Option<[f64; 4]>,
}

impl PlotPanel {
    /// Creates a panel of values over time (s).
    #[must_use]
    pub fn over_time(title: String, curves: Vec<PlotCurve>) -> PlotPanel {
        PlotPanel {
            title,
            across: "time [s]".to_owned(),
            is_spatial: false,
            curves,
            limits: Vec::new(),
            marks: Vec::new(),
            shows: None,
            frame: None,
        }
    }
}

/// Panels under a common title.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Title above all panels.
    pub title: String,
    /// Panels from top to bottom; spatial panels are placed three to a row.
    pub panels: Vec<PlotPanel>,
}

/// Reason why a plot cannot be drawn.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("cannot draw the plot: {0}")]
pub struct PlotError(String);

type Area<B> = DrawingArea<B, Shift>;

fn failed(error: impl std::fmt::Display) -> PlotError {
    PlotError(error.to_string())
}

/// Registers the only font used, so that plots are the same everywhere and need no system fonts.
fn font() {
    static ONCE: OnceLock<()> = OnceLock::new();
    ONCE.get_or_init(|| {
        // Registration fails only if the data is not a font; then drawing text reports the error.
        let _ = register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
}

impl Plot {
    /// Draws the plot as SVG.
    ///
    /// # Errors
    /// Fails if drawing fails.
    pub fn svg(&self) -> Result<String, PlotError> {
        let mut text = String::new();
        self.draw(SVGBackend::with_string(&mut text, (WIDTH, self.height())))?;
        Ok(text)
    }

    /// Writes the plot as PNG.
    ///
    /// # Errors
    /// Fails if drawing or writing fails.
    pub fn png(&self, out: impl Write) -> Result<(), PlotError> {
        let (width, height) = (WIDTH, self.height());
        let mut pixels = vec![0; width as usize * height as usize * 3];
        self.draw(BitMapBackend::with_buffer(&mut pixels, (width, height)))?;
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&pixels).map_err(failed)?;
        writer.finish().map_err(failed)
    }

    fn rows(&self) -> Vec<&[PlotPanel]> {
        let mut rows = Vec::new();
        for group in self
            .panels
            .chunk_by(|one, next| one.is_spatial && next.is_spatial)
        {
            rows.extend(group.chunks(3));
        }
        rows
    }

    fn height(&self) -> u32 {
        let heights = self.rows().into_iter().map(height_of);
        TITLE + heights.sum::<u32>()
    }

    fn draw<B: DrawingBackend>(&self, backend: B) -> Result<(), PlotError>
    where
        B::ErrorType: 'static,
    {
        font();
        let root = backend.into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let (title, mut rest) = root.split_vertically(TITLE);
        let style = (FONT, 22).into_font().color(&BLACK);
        title
            .draw_text(&self.title, &style, (16, 12))
            .map_err(failed)?;
        for row in self.rows() {
            let (area, below) = rest.split_vertically(height_of(row));
            rest = below;
            let columns = if row.iter().any(|panel| panel.is_spatial) {
                3
            } else {
                1
            };
            let areas = area.split_evenly((1, columns));
            for (panel, area) in row.iter().zip(areas) {
                panel.draw(&area)?;
            }
        }
        root.present().map_err(failed)
    }
}

fn height_of(row: &[PlotPanel]) -> u32 {
    if row.iter().any(|panel| panel.is_spatial) {
        SQUARE
    } else {
        HEIGHT
    }
}

impl PlotPanel {
    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Result<(), PlotError>
    where
        B::ErrorType: 'static,
    {
        let (width, height) = area.dim_in_pixel();
        let legend = if self.is_spatial { 10 } else { LEGEND };
        let (chart, side) = area.split_horizontally(width - legend);
        let [left, right, bottom, top] = self.bounds(width - legend, height);
        let mut chart = ChartBuilder::on(&chart)
            .caption(&self.title, (FONT, 15))
            .margin(6)
            .x_label_area_size(34)
            .y_label_area_size(66)
            .build_cartesian_2d(left..right, bottom..top)
            .map_err(failed)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(221, 221, 221))
            .x_labels(if self.is_spatial { 5 } else { 10 })
            .y_labels(6)
            .x_desc(&self.across)
            .label_style((FONT, 13))
            .x_label_formatter(&|value| short(*value))
            .y_label_formatter(&|value| short(*value))
            .draw()
            .map_err(failed)?;
        if let Some([l, r, b, t]) = self.frame {
            let corners = [(l.max(left), b.max(bottom)), (r.min(right), t.min(top))];
            let frame = Rectangle::new(corners, LIMIT.stroke_width(1));
            chart.draw_series([frame]).map_err(failed)?;
        }
        let across = self
            .limits
            .iter()
            .map(|limit| [(left, *limit), (right, *limit)]);
        let limits = across.map(|ends| PathElement::new(ends, LIMIT.stroke_width(1)));
        chart.draw_series(limits).map_err(failed)?;
        let up = self
            .marks
            .iter()
            .map(|mark| [(*mark, bottom), (*mark, top)]);
        let marks = up.map(|ends| PathElement::new(ends, RGBColor(90, 90, 90).stroke_width(1)));
        chart.draw_series(marks).map_err(failed)?;
        // Deviations below half a pixel are invisible.
        let (x, y) = (
            (right - left) / f64::from(width),
            (top - bottom) / f64::from(height),
        );
        for curve in &self.curves {
            let colour = COLOURS[curve.colour % COLOURS.len()];
            for stretch in &curve.segments {
                let points = simplify::simplified(stretch, 0.4 * x, 0.4 * y);
                let line = LineSeries::new(points, colour.stroke_width(2));
                chart.draw_series(line).map_err(failed)?;
            }
        }
        self.ends(&mut chart)?;
        self.legend(&side)
    }

    /// Marks the start of each curve in a spatial panel.
    fn ends<B: DrawingBackend>(
        &self,
        chart: &mut ChartContext<'_, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
    ) -> Result<(), PlotError>
    where
        B::ErrorType: 'static,
    {
        let begins = self
            .curves
            .iter()
            .filter(|_| self.is_spatial)
            .filter_map(|curve| {
                let begin = curve.segments.first()?.first()?;
                let colour = COLOURS[curve.colour % COLOURS.len()];
                Some(Circle::new(*begin, 5, colour.filled()))
            });
        chart.draw_series(begins).map_err(failed)?;
        Ok(())
    }

    fn legend<B: DrawingBackend>(&self, area: &Area<B>) -> Result<(), PlotError>
    where
        B::ErrorType: 'static,
    {
        if self.is_spatial {
            return Ok(());
        }
        let style = (FONT, 13).into_font().color(&BLACK);
        let named = self.curves.iter().filter(|curve| !curve.name.is_empty());
        let count = named.clone().count();
        for (index, curve) in named.take(LEGEND_MAX + 1).enumerate() {
            let y = 34 + 16 * index as i32;
            if index == LEGEND_MAX {
                let more = format!("and {} more", count - LEGEND_MAX);
                return area.draw_text(&more, &style, (30, y - 6)).map_err(failed);
            }
            let colour = COLOURS[curve.colour % COLOURS.len()];
            let line = PathElement::new([(4, y), (24, y)], colour.stroke_width(3));
            area.draw(&line).map_err(failed)?;
            area.draw_text(&curve.name, &style, (30, y - 6))
                .map_err(failed)?;
        }
        Ok(())
    }

    /// Returns left, right, bottom and top of the visible range.
    fn bounds(&self, width: u32, height: u32) -> [f64; 4] {
        let points = || {
            self.curves
                .iter()
                .flat_map(|curve| curve.segments.iter().flatten())
        };
        let across = points().map(|(x, _)| *x);
        let limits = self.limits.iter().copied();
        let shows = self.shows.into_iter().flatten();
        let up = points().map(|(_, y)| *y).chain(limits).chain(shows);
        let ([left, right], [bottom, top]) = (span(across), span(up));
        if !self.is_spatial {
            let room = 0.05 * (top - bottom);
            return [left, right, bottom - room, top + room];
        }
        // Excludes the space for the axis labels.
        let shape = f64::from(width - 80) / f64::from(height - 70);
        let half = 0.55 * ((right - left) / shape).max(top - bottom).max(1e-3);
        let (x, y) = (0.5 * (left + right), 0.5 * (bottom + top));
        [x - half * shape, x + half * shape, y - half, y + half]
    }
}

/// Returns the least and greatest of some values; never an empty range.
fn span(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values
        .filter(|value| value.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
            [low.min(value), high.max(value)]
        });
    match (low <= high, high - low) {
        (false, _) => [0.0, 1.0],
        (true, width) if width > 1e-9 * high.abs().max(low.abs()).max(1e-9) => [low, high],
        (true, _) => [low - 0.5, high + 0.5],
    }
}

/// Formats a tick label with as many digits as it needs.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Plot {
        let wave = (0..1000).map(|i| (f64::from(i) * 1e-3, (f64::from(i) * 0.01).sin()));
        let curve = PlotCurve {
            name: "a<b>&\"c\"".to_owned(),
            segments: vec![wave.collect()],
            colour: 0,
        };
        let panel = PlotPanel {
            is_spatial: true,
            across: "x [m]".to_owned(),
            frame: Some([-1.0, 2.0, -2.0, f64::INFINITY]),
            ..PlotPanel::over_time("y [m]".to_owned(), vec![curve.clone()])
        };
        let empty = PlotPanel::over_time("nothing".to_owned(), vec![PlotCurve::default()]);
        let time = PlotPanel {
            limits: vec![1.0, -1.0],
            marks: vec![0.5],
            ..PlotPanel::over_time("wave [1]".to_owned(), vec![curve])
        };
        Plot {
            title: "a net".to_owned(),
            panels: vec![panel.clone(), panel, time, empty],
        }
    }

    #[test]
    fn a_plot_is_reproducible_and_escapes_names() {
        let svg = picture().svg().unwrap();
        assert_eq!(svg, picture().svg().unwrap());
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        assert!(svg.contains("a&lt;b&gt;&amp;") && !svg.contains("a<b>"));
        assert!(svg.contains("time [s]") && svg.contains("wave [1]"));
        assert!(svg.len() < 60_000, "{} bytes", svg.len());
    }

    #[test]
    fn a_png_has_letters_and_lines() {
        let mut bytes = Vec::new();
        picture().png(&mut bytes).unwrap();
        let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!(
            (info.width, info.height),
            (WIDTH, TITLE + SQUARE + 2 * HEIGHT)
        );
        let rows = pixels.chunks(WIDTH as usize * 3);
        let dark = rows
            .take(TITLE as usize)
            .flatten()
            .filter(|value| **value < 100);
        assert!(dark.count() > 100, "the title is written");
    }

    #[test]
    fn a_constant_value_gets_a_range_around_it() {
        assert_eq!(span([2.0, 2.0].into_iter()), [1.5, 2.5]);
        assert_eq!(span([f64::NAN].into_iter()), [0.0, 1.0]);
        assert_eq!(span([1.0, f64::INFINITY, 3.0].into_iter()), [1.0, 3.0]);
    }
}
