//! A chain of shapes with a common path parameter s, joined by blends or by points of rest. Built off the real-time
//! thread, which evaluates it: a binary search, then one shape.

use super::blend::{JointBlend, PoseBlend};
use super::circle::Circle;
use super::jet::{Jet, JetScalar};
use super::line::{JointLine, Line};
use super::spline::Spline;
use super::{LENGTH_MIN, Placement};

/// One shape.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A straight line of the flange.
    Line(Line),
    /// An arc of a circle.
    Circle(Circle),
    /// A smooth curve through poses.
    Spline(Spline),
    /// A straight line in joint space.
    Joints(JointLine),
    /// A blend of the flange.
    PoseBlend(PoseBlend),
    /// A blend in joint space.
    JointBlend(JointBlend),
}

/// The point of a shape at s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ShapePoint<T> {
    /// Pose of the flange in the base frame of the arm.
    Flange(Placement<T>),
    /// Joints, rad.
    Joints([T; 8]),
}

impl Shape {
    /// The point at `s`, counted from the beginning of the shape.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> ShapePoint<T> {
        match self {
            Shape::Line(line) => ShapePoint::Flange(line.at(s)),
            Shape::Circle(circle) => ShapePoint::Flange(circle.at(s)),
            Shape::Spline(spline) => ShapePoint::Flange(spline.at(s)),
            Shape::PoseBlend(blend) => ShapePoint::Flange(blend.at(s)),
            Shape::Joints(line) => ShapePoint::Joints(line.at(s)),
            Shape::JointBlend(blend) => ShapePoint::Joints(blend.at(s)),
        }
    }

    /// Returns true if the flange translates or rotates along it.
    #[must_use]
    pub fn moves(&self) -> bool {
        match self {
            Shape::Line(line) => line.moves(),
            _ => true,
        }
    }

    /// Speed of the flange per unit of s, |dx/ds|, if it is constant.
    #[must_use]
    pub fn constant_speed(&self) -> Option<f64> {
        match self {
            Shape::Line(line) => Some(line.speed()),
            Shape::Circle(circle) => Some(circle.speed()),
            Shape::Spline(spline) => spline.speed_by_arc(),
            Shape::PoseBlend(_) | Shape::Joints(_) | Shape::JointBlend(_) => None,
        }
    }

    /// Length in s (≥ 0); 0 for a blend, whose piece has the length.
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

/// A shape of a chain and its transition to the next one.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainLink {
    /// The shape.
    pub shape: Shape,
    /// Length of the blend before its end and after the beginning of the next shape, in s of each; 0: no blend, the
    /// motion stops at the end. At most half of either shape is used.
    pub zone: [f64; 2],
}

/// A part of a chain that follows one shape.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainPiece {
    /// Beginning, s of the chain.
    pub begin: f64,
    /// End, s of the chain.
    pub end: f64,
    /// s of the shape where the piece begins.
    offset: f64,
    /// The shape that it follows.
    pub shape: Shape,
    /// Index of its link; a blend belongs to the link before it.
    pub link: usize,
    /// It is a blend.
    pub blend: bool,
    /// The motion must be at rest at its end.
    pub rest: bool,
}

impl ChainPiece {
    /// The point at s of the chain.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> ShapePoint<T> {
        self.shape.at(s + T::constant(self.offset - self.begin))
    }

    /// s of its shape at s of the chain.
    #[inline]
    #[must_use]
    pub fn on_shape(&self, s: f64) -> f64 {
        s + (self.offset - self.begin)
    }

    /// Length in s.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.end - self.begin
    }

    /// Fraction of its shape that is covered at a fraction of the piece; 1 on a blend.
    #[must_use]
    pub fn of_shape(&self, fraction: f64) -> f64 {
        let length = self.shape.length();
        if self.blend || length <= 0.0 {
            return 1.0;
        }
        (self.offset + self.length() * fraction) / length
    }
}

/// Shapes one after the other, with their blends.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Chain {
    pieces: Vec<ChainPiece>,
}

impl Chain {
    /// Joins shapes, each of which begins where the previous one ends. `joints` returns the joints, with derivatives,
    /// of the link with this index at s of its shape: a blend from or to a line in joint space is made in joint space.
    ///
    /// # Errors
    /// Returns the error of `joints`. A blend that cannot be made (it rotates by more than 4 rad) is left out: the
    /// motion stops there.
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

    /// Length in s.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.pieces.last().map_or(0.0, |piece| piece.end)
    }

    /// Index of the piece at s; 0 for an empty chain.
    #[inline]
    #[must_use]
    pub fn number(&self, s: f64) -> usize {
        let number = self.pieces.partition_point(|piece| piece.end <= s);
        number.min(self.pieces.len().saturating_sub(1))
    }

    /// The point at s in [0, length]; `None` for an empty chain.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> Option<ShapePoint<T>> {
        let piece = self.pieces.get(self.number(s.value()));
        piece.map(|piece| piece.at(s))
    }
}
