//! Shapes one after the other with one s, joined by roundings or by points of rest.
//! Built off the real-time thread; evaluated by it: a search in a sorted list, then one shape.

use super::blend::{JointBlend, PoseBlend};
use super::circle::Circle;
use super::jet::{Jet, Scalar};
use super::line::{JointLine, Line};
use super::spline::Spline;
use super::{LENGTH_MIN, Placement};

/// One shape.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A straight line of the flange.
    Line(Line),
    /// An arc.
    Circle(Circle),
    /// A curve through poses.
    Spline(Spline),
    /// A straight line of the joints.
    Joints(JointLine),
    /// A rounding of the flange.
    PoseBlend(PoseBlend),
    /// A rounding of the joints.
    JointBlend(JointBlend),
}

/// What a shape says at s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ShapePoint<T> {
    /// The flange is here.
    Flange(Placement<T>),
    /// The joints are here, rad.
    Joints([T; 8]),
}

impl Shape {
    /// Where it is after `s` of its own way.
    #[inline]
    pub fn at<T: Scalar>(&self, s: T) -> ShapePoint<T> {
        match self {
            Shape::Line(line) => ShapePoint::Flange(line.at(s)),
            Shape::Circle(circle) => ShapePoint::Flange(circle.at(s)),
            Shape::Spline(spline) => ShapePoint::Flange(spline.at(s)),
            Shape::PoseBlend(blend) => ShapePoint::Flange(blend.at(s)),
            Shape::Joints(line) => ShapePoint::Joints(line.at(s)),
            Shape::JointBlend(blend) => ShapePoint::Joints(blend.at(s)),
        }
    }

    /// The flange moves or turns along it.
    #[must_use]
    pub fn moves(&self) -> bool {
        match self {
            Shape::Line(line) => line.moves(),
            _ => true,
        }
    }

    /// |dx/ds| of the flange where it is the same everywhere.
    #[must_use]
    pub fn constant_speed(&self) -> Option<f64> {
        match self {
            Shape::Line(line) => Some(line.speed()),
            Shape::Circle(circle) => Some(circle.speed()),
            Shape::Spline(spline) => spline.speed_by_arc(),
            Shape::PoseBlend(_) | Shape::Joints(_) | Shape::JointBlend(_) => None,
        }
    }

    /// Length in s (≥ 0); a rounding's is that of its piece.
    #[must_use]
    pub fn length(&self) -> f64 {
        match self {
            Shape::Line(line) => line.length(),
            Shape::Circle(circle) => circle.length(),
            Shape::Spline(spline) => spline.length(),
            Shape::Joints(line) => line.length(),
            Shape::PoseBlend(_) | Shape::JointBlend(_) => 0.0,
        }
    }
}

/// A shape of a chain and how it goes over into the next one.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainLink {
    /// The shape.
    pub shape: Shape,
    /// How long before its end and behind the next one's beginning the rounding is, in s of each: 0 = none, the motion rests
    /// at the end. At most half of either shape is used.
    pub zone: [f64; 2],
}

/// A part of a chain on which one shape is followed.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainPiece {
    /// Where it begins, s of the chain.
    pub begin: f64,
    /// Where it ends, s of the chain.
    pub end: f64,
    /// s of the shape where the piece begins.
    offset: f64,
    /// What it follows.
    pub shape: Shape,
    /// The link that it belongs to; a rounding belongs to the one before it.
    pub link: usize,
    /// It is a rounding.
    pub blend: bool,
    /// The motion must be at rest where it ends.
    pub rest: bool,
}

impl ChainPiece {
    /// Where it is at s of the chain.
    #[inline]
    pub fn at<T: Scalar>(&self, s: T) -> ShapePoint<T> {
        self.shape.at(s + T::constant(self.offset - self.begin))
    }

    /// s of its shape at s of the chain.
    #[inline]
    #[must_use]
    pub fn on_shape(&self, s: f64) -> f64 {
        s + (self.offset - self.begin)
    }

    /// Its length in s.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.end - self.begin
    }

    /// Which part of its shape has been gone at this part of the piece; all of it on a rounding.
    #[must_use]
    pub fn of_shape(&self, fraction: f64) -> f64 {
        let length = self.shape.length();
        if self.blend || length <= 0.0 {
            return 1.0;
        }
        (self.offset + self.length() * fraction) / length
    }
}

/// Shapes one after the other.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Chain {
    pieces: Vec<ChainPiece>,
}

impl Chain {
    /// Joins shapes, each of which begins where the one before it ends. `joints` gives the joints, with derivatives, of the
    /// link with this number at s of its shape: a rounding from or to a line of joints is one of joints.
    ///
    /// # Errors
    /// What `joints` says. A rounding that cannot be made (it turns by more than 4 rad) is left out: the motion rests there.
    pub fn new<E>(
        links: Vec<ChainLink>,
        mut joints: impl FnMut(usize, &Shape, f64) -> Result<[Jet; 8], E>,
    ) -> Result<Self, E> {
        let mut pieces: Vec<ChainPiece> = Vec::new();
        let (mut begin, mut offset) = (0.0, 0.0);
        let mut links = links.into_iter().enumerate().peekable();
        while let Some((link, ChainLink { shape, zone })) = links.next() {
            let length = shape.length();
            let next = links.peek().map(|(_, next)| &next.shape);
            let [before, behind] = next.map_or([0.0; 2], |next| {
                [zone[0].min(length / 2.0), zone[1].min(next.length() / 2.0)]
            });
            let mut blend = None;
            if before > LENGTH_MIN && behind > LENGTH_MIN {
                let (from, over) = (length - before, before + behind);
                blend = match (next, shape.at(Jet::variable(from))) {
                    (None, _) => None,
                    (Some(next), ShapePoint::Flange(place)) => match next.at(Jet::variable(behind))
                    {
                        ShapePoint::Flange(to) => {
                            PoseBlend::between(&place, &to, over).map(Shape::PoseBlend)
                        }
                        ShapePoint::Joints(to) => {
                            let from = joints(link, &shape, from)?;
                            let blend = JointBlend::between(from, to, over);
                            Some(Shape::JointBlend(blend))
                        }
                    },
                    (Some(next), ShapePoint::Joints(from)) => {
                        let to = joints(link + 1, next, behind)?;
                        let blend = JointBlend::between(from, to, over);
                        Some(Shape::JointBlend(blend))
                    }
                };
            }
            let over = blend.as_ref().map(|_| [before, behind]);
            let [before, behind] = over.unwrap_or([0.0; 2]);
            let end = begin + (length - before - offset).max(0.0);
            pieces.push(ChainPiece {
                begin,
                end,
                offset,
                shape,
                link,
                blend: false,
                rest: blend.is_none(),
            });
            begin = end;
            offset = behind;
            if let Some(shape) = blend {
                let end = begin + before + behind;
                pieces.push(ChainPiece {
                    begin,
                    end,
                    offset: 0.0,
                    shape,
                    link,
                    blend: true,
                    rest: false,
                });
                begin = end;
            }
        }
        Ok(Self { pieces })
    }

    /// Its pieces in order.
    #[must_use]
    pub fn pieces(&self) -> &[ChainPiece] {
        &self.pieces
    }

    /// Its length.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.pieces.last().map_or(0.0, |piece| piece.end)
    }

    /// The number of the piece at s; 0 if the chain has none.
    #[inline]
    #[must_use]
    pub fn number(&self, s: f64) -> usize {
        let number = self.pieces.partition_point(|piece| piece.end <= s);
        number.min(self.pieces.len().saturating_sub(1))
    }

    /// Where it is at s in [0, length]; `None` if it has no pieces.
    #[inline]
    pub fn at<T: Scalar>(&self, s: T) -> Option<ShapePoint<T>> {
        let piece = self.pieces.get(self.number(s.value()));
        piece.map(|piece| piece.at(s))
    }
}
