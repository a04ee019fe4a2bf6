//! A placed plot as pixels: anti-aliased lines by their distance to each pixel's centre, and text of the one font that is
//! built in, so that pictures are the same everywhere. Pure.

use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};

use super::PlotError;
use super::scene::{Anchor, At, Ink, Scene, Shape};
use super::svg::{COLOURS, INKS, PAPER};

/// Red, green and blue, 0 to 255.
type Colour = [f32; 3];

/// A picture.
pub struct Image {
    pub width: u32,
    pub height: u32,
    pixels: Vec<Colour>,
}

/// Draws a plot in light colours.
pub fn image(scene: &Scene) -> Result<Image, PlotError> {
    let font = FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT);
    let font = font.map_err(|_| PlotError::Font)?;
    let (width, height) = (scene.width as u32, scene.height as u32);
    let mut image = Image {
        width,
        height,
        pixels: vec![colour(PAPER[0]); width as usize * height as usize],
    };
    image.draw(&scene.title, [0.0, 0.0], &font);
    for panel in &scene.panels {
        let [x, y, _, _] = panel.area;
        for shape in &panel.around {
            image.draw(shape, [0.0, 0.0], &font);
        }
        for shape in &panel.inside {
            image.draw(shape, [x, y], &font);
        }
    }
    Ok(image)
}

/// Reads `#rrggbb`; black if it is not one.
fn colour(text: &str) -> Colour {
    let number = u32::from_str_radix(text.trim_start_matches('#'), 16).unwrap_or(0);
    [16, 8, 0].map(|shift| (number >> shift & 0xff) as f32)
}

fn light(ink: Ink) -> Colour {
    match ink {
        Ink::Curve(index) => colour(COLOURS[index % COLOURS.len()][0]),
        other => {
            let row = INKS.iter().find(|(known, ..)| *known == other);
            row.map_or([0.0; 3], |(_, _, colours)| colour(colours[0]))
        }
    }
}

impl Image {
    /// Returns three bytes per pixel, row by row.
    pub fn bytes(&self) -> Vec<u8> {
        let values = self.pixels.iter().flatten();
        values
            .map(|value| value.round().clamp(0.0, 255.0) as u8)
            .collect()
    }

    fn draw(&mut self, shape: &Shape, [left, top]: At, font: &FontRef<'_>) {
        match shape {
            Shape::Line {
                segments,
                ink,
                width,
                ..
            } => {
                for segment in segments {
                    let points: Vec<At> =
                        segment.iter().map(|[x, y]| [x + left, y + top]).collect();
                    self.line(&points, 0.5 * width, light(*ink));
                }
            }
            Shape::Disc { at, radius, ink } => {
                let centre = [at[0] + left, at[1] + top];
                self.line(&[centre], *radius, light(*ink));
            }
            Shape::Text {
                at,
                text,
                size,
                anchor,
                ..
            } => self.text([at[0] + left, at[1] + top], text, *size, *anchor, font),
        }
    }

    /// Draws a line with round ends; a single point is a disc. Each pixel is covered once, however often the line
    /// crosses it.
    fn line(&mut self, points: &[At], half: f64, colour: Colour) {
        let reach = half + 1.0;
        let of = |axis: usize| points.iter().map(move |point| point[axis]);
        let low = |axis, most: u32| {
            let least = of(axis).fold(f64::INFINITY, f64::min) - reach;
            (least.floor().max(0.0) as usize).min(most as usize)
        };
        let high = |axis, most: u32| {
            let greatest = of(axis).fold(f64::NEG_INFINITY, f64::max) + reach;
            (greatest.ceil().max(0.0) as usize).min(most as usize)
        };
        let (left, right) = (low(0, self.width), high(0, self.width));
        let (top, bottom) = (low(1, self.height), high(1, self.height));
        if left >= right || top >= bottom {
            return;
        }
        let columns = right - left;
        let mut covered = vec![0.0_f32; columns * (bottom - top)];
        let single = [points[0], points[0]];
        let pairs = points
            .windows(2)
            .chain((points.len() == 1).then_some(&single[..]));
        for pair in pairs {
            let [from, to] = [pair[0], pair[1]];
            let rows = from[1].min(to[1]) - reach..from[1].max(to[1]) + reach;
            let first = (rows.start.max(top as f64) as usize).max(top);
            for y in first..(rows.end.ceil().max(0.0) as usize).min(bottom) {
                // The part of the row that the segment can touch.
                let [x0, x1] = touched(from, to, y as f64 + 0.5, reach);
                let first = (x0.max(left as f64) as usize).max(left);
                for x in first..(x1.ceil().max(0.0) as usize).min(right) {
                    let distance = distance([x as f64 + 0.5, y as f64 + 0.5], from, to);
                    let share = (half + 0.5 - distance).clamp(0.0, 1.0) as f32;
                    let place = &mut covered[(y - top) * columns + x - left];
                    *place = place.max(share);
                }
            }
        }
        for (number, share) in covered.into_iter().enumerate() {
            self.mix(
                left + number % columns,
                top + number / columns,
                colour,
                share,
            );
        }
    }

    fn text(&mut self, at: At, text: &str, size: f64, anchor: Anchor, font: &FontRef<'_>) {
        // Sizes are those of CSS: of the em square.
        let em = font.units_per_em().unwrap_or(1000.0);
        let scale = PxScale::from(size as f32 * font.height_unscaled() / em);
        let scaled = font.as_scaled(scale);
        let mut glyphs: Vec<Glyph> = Vec::new();
        let mut x = 0.0;
        for letter in text.chars() {
            let id = scaled.glyph_id(letter);
            if let Some(last) = glyphs.last() {
                x += scaled.kern(last.id, id);
            }
            glyphs.push(id.with_scale_and_position(scale, point(x, 0.0)));
            x += scaled.h_advance(id);
        }
        let before = match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5 * x,
            Anchor::End => x,
        };
        for mut glyph in glyphs {
            glyph.position.x += at[0] as f32 - before;
            glyph.position.y += at[1] as f32;
            let Some(outline) = font.outline_glyph(glyph) else {
                continue;
            };
            let corner = outline.px_bounds().min;
            outline.draw(|x, y, share| {
                let (x, y) = (corner.x + x as f32, corner.y + y as f32);
                if x >= 0.0 && y >= 0.0 {
                    self.mix(x as usize, y as usize, light(Ink::Text), share);
                }
            });
        }
    }

    /// Mixes a colour into a pixel; ignores pixels outside.
    fn mix(&mut self, x: usize, y: usize, colour: Colour, share: f32) {
        if x >= self.width as usize {
            return;
        }
        if let Some(pixel) = self.pixels.get_mut(y * self.width as usize + x) {
            for (own, other) in pixel.iter_mut().zip(colour) {
                *own += (other - *own) * share.min(1.0);
            }
        }
    }
}

/// Returns the range of x in the row at `y` that is within `reach` of a segment.
fn touched(from: At, to: At, y: f64, reach: f64) -> [f64; 2] {
    let (low, high) = (from[0].min(to[0]), from[0].max(to[0]));
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    if dy.abs() < 1e-9 {
        return [low - reach, high + reach];
    }
    let slope = dx / dy;
    let middle = from[0] + (y - from[1]) * slope;
    let room = reach * (1.0 + slope * slope).sqrt() + reach;
    [
        (middle - room).max(low - reach),
        (middle + room).min(high + reach),
    ]
}

/// Returns the distance of a point from a segment, pixels.
fn distance(at: At, from: At, to: At) -> f64 {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let square = dx * dx + dy * dy;
    let along = match square > 0.0 {
        true => (((at[0] - from[0]) * dx + (at[1] - from[1]) * dy) / square).clamp(0.0, 1.0),
        false => 0.0,
    };
    (at[0] - from[0] - along * dx).hypot(at[1] - from[1] - along * dy)
}
