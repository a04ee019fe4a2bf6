//! Arcs of a circle through three points, or of a given angle. Plain numbers; evaluated by the real-time thread.

use rcc_core::pose::Pose;
use rcc_core::vector::{self, Vector};

use super::jet::JetScalar;
use super::line::{AxisRotation, distance};
use super::{COINCIDENT_M, GeometryError, PathMetric, Placement, finite};

/// Three points whose triangle has a sine below this count as collinear: the radius would exceed 2000 times the
/// distance, and rounding of its derivatives would slow a motion down to a crawl.
const COLLINEAR_SINE: f64 = 2.5e-4;

/// Orientation along a circle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CircleOrientation {
    /// Rotates evenly from that of the start to that of the end (KUKA: `#VAR`, base-related).
    Even,
    /// Stays as at the start (KUKA: `#CONSTANT`).
    Constant,
    /// Stays as at the start relative to the path's tangent: turns with the circle (path-related).
    Path,
}

/// An arc of a circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    centre: Vector,
    /// Vector from the centre to the start, m.
    out: Vector,
    /// Vector from the centre to the point a quarter turn further, m.
    side: Vector,
    /// Angle of the arc, rad; negative: the other way round.
    angle: f64,
    turn: AxisRotation,
    length: f64,
}

impl Circle {
    /// The arc from `from` through the point `via` to `to`. With an `angle` (rad, not 0; negative: the other way round)
    /// the arc has that angle instead, and the point `to` only defines the circle. The orientation of `to` is used with
    /// [`CircleOrientation::Even`] only.
    ///
    /// # Errors
    /// Returns [`GeometryError`] if points coincide or are collinear, the angle is 0, the orientations differ by half a
    /// turn, or a value is not finite.
    pub fn new(
        from: &Pose,
        via: Vector,
        to: &Pose,
        (orientation, angle): (CircleOrientation, Option<f64>),
        metric: PathMetric,
    ) -> Result<Self, GeometryError> {
        finite(from)?;
        finite(to)?;
        if !via.iter().all(|x| x.is_finite()) || angle.is_some_and(|x| !x.is_finite()) {
            return Err(GeometryError::NotFinite);
        }
        if angle == Some(0.0) {
            return Err(GeometryError::NoAngle);
        }
        let (a, b, c) = (from.position, via, to.position);
        for (first, second, p, q) in [(0, 1, a, b), (1, 2, b, c), (0, 2, a, c)] {
            let distance_m = distance(p, q);
            if distance_m < COINCIDENT_M {
                return Err(GeometryError::Coincident {
                    first,
                    second,
                    distance_m,
                });
            }
        }
        let (u, w) = (vector::subtract(b, a), vector::subtract(c, a));
        let normal = vector::cross(u, w);
        let (uu, ww, nn) = (
            vector::dot(u, u),
            vector::dot(w, w),
            vector::dot(normal, normal),
        );
        if nn < uu * ww * COLLINEAR_SINE * COLLINEAR_SINE {
            return Err(GeometryError::Collinear);
        }
        // Centre of the circumcircle relative to the start.
        let to_centre = vector::scale(
            vector::add(
                vector::scale(vector::cross(normal, u), ww),
                vector::scale(vector::cross(w, normal), uu),
            ),
            0.5 / nn,
        );
        let centre = vector::add(a, to_centre);
        let out = vector::scale(to_centre, -1.0);
        let axis = vector::scale(normal, 1.0 / libm::sqrt(nn));
        let side = vector::cross(axis, out);
        let end = vector::subtract(c, centre);
        let around = libm::atan2(vector::dot(side, end), vector::dot(out, end));
        let around = if around > 0.0 {
            around
        } else {
            around + 2.0 * core::f64::consts::PI
        };
        let angle = angle.unwrap_or(around);
        let turn = match orientation {
            CircleOrientation::Even => AxisRotation::between(from.orientation, to.orientation)?,
            CircleOrientation::Constant => AxisRotation::none(from.orientation),
            CircleOrientation::Path => AxisRotation::about(from.orientation, axis, angle),
        };
        let way_m = vector::norm(out) * libm::fabs(angle);
        Ok(Self {
            centre,
            out,
            side,
            angle,
            turn,
            length: metric.length(way_m, libm::fabs(turn.angle)),
        })
    }

    /// Length in s (> 0).
    #[must_use]
    pub fn length(&self) -> f64 {
        self.length
    }

    /// The radius, m.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        vector::norm(self.out)
    }

    /// Metres of the flange per unit of s.
    #[must_use]
    pub fn speed(&self) -> f64 {
        self.radius_m() * libm::fabs(self.angle) / self.length
    }

    /// The pose at `s`.
    #[inline]
    pub fn at<T: JetScalar>(&self, s: T) -> Placement<T> {
        let fraction = s.over(self.length);
        let (sin, cos) = fraction.scaled(self.angle).sin_cos();
        let mut position = self.centre.map(T::constant);
        for ((place, out), side) in position.iter_mut().zip(self.out).zip(self.side) {
            *place = *place + cos.scaled(out) + sin.scaled(side);
        }
        Placement {
            position,
            orientation: self.turn.at(fraction),
        }
    }
}
