//! Draws curves as SVG, HTML or PNG: panels with axes, limits and a legend. Runs on the caller's thread; the same curves
//! give the same bytes.

use std::io::Write;

use thiserror::Error;

mod html;
mod raster;
mod scene;
mod simplify;
mod svg;
mod ticks;

use scene::Scene;

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
#[derive(Debug, Error)]
pub enum PlotError {
    /// The font of the program is not one; this never happens.
    #[error("the font cannot be read")]
    Font,
    /// The picture cannot be written.
    #[error("cannot write the picture: {0}")]
    Write(#[from] png::EncodingError),
}

impl Plot {
    /// Draws the plot as SVG with colours for light and dark schemes.
    #[must_use]
    pub fn svg(&self) -> String {
        svg::document(&Scene::of(self), &self.title)
    }

    /// Draws the plot as one HTML page that shows values under the pointer and zooms in time; it loads nothing.
    #[must_use]
    pub fn html(&self) -> String {
        html::page(&Scene::of(self), &self.title)
    }

    /// Writes the plot as PNG, in light colours.
    ///
    /// # Errors
    /// Fails if writing fails.
    pub fn png(&self, out: impl Write) -> Result<(), PlotError> {
        let scene = Scene::of(self);
        let image = raster::image(&scene)?;
        let mut encoder = png::Encoder::new(out, image.width, image.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&image.bytes())?;
        Ok(writer.finish()?)
    }
}

#[cfg(test)]
mod tests;
