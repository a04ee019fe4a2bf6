//! Checks the set-points of one motion: on its path, forward only, within the limits, finite, done once.

use std::f64::consts::TAU;

use rcc_core::rotation::{self, Quaternion};

use super::*;

/// Greatest deviation from the path, m or rad.
const OFF_MAX: f64 = 1e-9;

/// Points of a reference are at most this many of its steps apart along the flange: s of a line in joint space is not a
/// distance, and on a leg that moves the wrist only the flange covers up to 300 m per unit of s.
const WAY: f64 = 10.0;

/// Number of poses in a third difference.
const WINDOW: usize = 4;

/// How close a motion came to its limits.
#[derive(Debug, Clone, Copy, Default)]
pub struct WorstCase {
    /// Deviation from the path, m.
    pub off_m: f64,
    /// Velocity, acceleration and jerk, the greatest of all joints and of the flange, as fractions of their limits.
    pub parts: [f64; 3],
    /// Number of cycles.
    pub cycles: usize,
}

impl WorstCase {
    /// Combines two results: the worse of each.
    pub fn and(&mut self, other: WorstCase) {
        self.off_m = self.off_m.max(other.off_m);
        for (part, other) in self.parts.iter_mut().zip(other.parts) {
            *part = part.max(other);
        }
        self.cycles += other.cycles;
    }
}

/// The expected path, computed independently of the tested code.
pub enum ExpectedPath {
    /// A line from pose to pose.
    Line(Pose, Pose),
    /// An arc from a pose through a point to a pose.
    Circle(Pose, [f64; 3], Pose, ArcOrientation),
    /// A line in joint space.
    Joints(Joints, Joints),
    /// An undisturbed run of the same motion.
    ReferenceRun(Box<ReferenceRun>),
}

/// Position and orientation; the sign of the quaternion is continuous.
type Values = [f64; 7];

/// Points of an undisturbed, slow run by s: one list per section from rest to rest, where the path may have a corner.
pub struct ReferenceRun(Vec<Vec<(f64, Values)>>);

/// Resolution of a reference.
#[derive(Debug, Clone, Copy)]
pub struct ReferenceResolution {
    /// Speed override, for cycles of 1 ms.
    pub speed: f64,
    /// Least step in s.
    pub step: f64,
}

impl ReferenceResolution {
    /// Adapts the speed for the same number of points with longer cycles.
    pub fn in_cycles_of(self, dt_s: f64) -> Self {
        Self {
            speed: self.speed * 1e-3 / dt_s,
            ..self
        }
    }
}

impl ReferenceRun {
    /// Runs a motion slowly; `None` if it does not end.
    pub fn run(mut motion: MotionSet, resolution: ReferenceResolution) -> Option<Self> {
        let speed_override = SpeedOverride {
            speed: resolution.speed,
            ..SpeedOverride::RUN
        };
        let mut parts: Vec<Vec<(f64, Values)>> = vec![Vec::new()];
        let mut orientation = [0.0, 0.0, 0.0, 1.0];
        for _ in 0..200 * CYCLES_MAX {
            let state = motion.step(0, speed_override)?;
            orientation = nearest(state.pose.orientation, orientation);
            let ([x, y, z], [a, b, c, d]) = (state.pose.position, orientation);
            let here = (state.path.s, [x, y, z, a, b, c, d]);
            let places = parts.last_mut()?;
            let rests = state.path.velocity == 0.0 && !places.is_empty();
            if rests {
                // With points closer than this, rounding would dominate the polynomial.
                places.retain(|(s, _)| here.0 - s > resolution.step / 20.0);
            }
            let far = places.last().is_none_or(|(s, [px, py, pz, ..])| {
                let way = norm(subtract([x, y, z], [*px, *py, *pz]));
                here.0 - s > resolution.step || way > WAY * resolution.step
            });
            if rests || far {
                places.push(here);
            }
            if state.path.done {
                return Some(Self(parts));
            }
            if rests {
                parts.push(vec![here]);
            }
        }
        None
    }

    /// Deviation of a pose from the curve at s, by the polynomial through the six nearest points.
    fn off(&self, s: f64, pose: &Pose) -> f64 {
        let begun = |part: &Vec<(f64, Values)>| part.first().is_none_or(|(at, _)| *at <= s);
        let part = self.0.partition_point(begun).saturating_sub(1);
        let places = &self.0[part];
        let first = places.partition_point(|(at, _)| *at < s).saturating_sub(3);
        let near = &places[first.min(places.len().saturating_sub(6))..];
        let near = &near[..near.len().min(6)];
        let mut want = [0.0; 7];
        for (index, (at, place)) in near.iter().enumerate() {
            let others = near.iter().enumerate().filter(|(other, _)| *other != index);
            let weight: f64 = others.map(|(_, (x, _))| (s - x) / (at - x)).product();
            for (want, place) in want.iter_mut().zip(place) {
                *want += weight * place;
            }
        }
        let [x, y, z, a, b, c, d] = want;
        let off = norm(subtract([x, y, z], pose.position));
        off.max(turned([a, b, c, d], pose.orientation))
    }

    fn length(&self) -> f64 {
        let last = self.0.last().and_then(|part| part.last());
        last.map_or(0.0, |(s, _)| *s)
    }
}

/// The quaternion of the same orientation with the sign that is closer to `to`.
fn nearest(orientation: Quaternion, to: Quaternion) -> Quaternion {
    let product: f64 = orientation.iter().zip(to).map(|(a, b)| a * b).sum();
    orientation.map(|x| if product < 0.0 { -x } else { x })
}

/// The angle between two nearly equal orientations, rad.
fn turned(a: Quaternion, b: Quaternion) -> f64 {
    let b = nearest(b, a);
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    2.0 * squares.sqrt()
}

impl ExpectedPath {
    fn off(&self, state: &MotionState) -> f64 {
        let place = state.pose.position;
        match self {
            ExpectedPath::Line(from, to) => {
                let way = subtract(to.position, from.position);
                let length = norm(way);
                if length < 1e-6 {
                    return 0.0;
                }
                let since = subtract(place, from.position);
                let fraction = (dot(since, way) / (length * length)).clamp(0.0, 1.0);
                let off = norm(subtract(since, scale(way, fraction)));
                let want = from.slerp(to, fraction).unwrap_or(Pose::NULL);
                off.max(turned(want.orientation, state.pose.orientation))
            }
            ExpectedPath::Circle(from, via, to, orientation) => {
                let (a, c) = (from.position, to.position);
                let (u, v) = (subtract(*via, a), subtract(c, a));
                let normal = cross(u, v);
                let twice = 2.0 * dot(normal, normal);
                let to_centre = scale(
                    add(
                        scale(cross(normal, u), dot(v, v)),
                        scale(cross(v, normal), dot(u, u)),
                    ),
                    1.0 / twice,
                );
                let axis = scale(normal, 1.0 / norm(normal));
                let out = scale(to_centre, -1.0);
                let around = |place| {
                    let since = subtract(place, add(a, to_centre));
                    let angle = dot(cross(out, since), axis).atan2(dot(out, since));
                    (since, angle)
                };
                let (since, angle) = around(place);
                let radial = norm(since) - norm(to_centre);
                let axial = dot(since, axis);
                let whole = around(c).1.rem_euclid(TAU);
                // Rounding may put the start slightly before 0.
                let angle = if angle < -1e-6 { angle + TAU } else { angle };
                let want = match orientation {
                    ArcOrientation::Even => from.slerp(to, angle / whole).unwrap_or(Pose::NULL),
                    ArcOrientation::Constant => *from,
                    ArcOrientation::Path => Pose {
                        orientation: rotation::product(
                            rotation::exp(scale(axis, angle)),
                            from.orientation,
                        ),
                        ..*from
                    },
                };
                let turned = turned(want.orientation, state.pose.orientation);
                radial.hypot(axial).max(turned)
            }
            ExpectedPath::Joints(from, to) => {
                let (mut off, mut way) = (0.0_f64, 0.0);
                let mut along = 0.0;
                for ((q, from), to) in state.joints.iter().zip(from).zip(to).take(7) {
                    if to.is_finite() {
                        along += (q - from) * (to - from);
                        way += (to - from) * (to - from);
                    }
                }
                let fraction = (along / way).clamp(0.0, 1.0);
                for ((q, from), to) in state.joints.iter().zip(from).zip(to).take(7) {
                    if to.is_finite() {
                        off = off.max((q - from - fraction * (to - from)).abs());
                    }
                }
                off
            }
            ExpectedPath::ReferenceRun(reference) => reference.off(state.path.s, &state.pose),
        }
    }
}

/// Checks one motion.
pub struct MotionJudge<'a> {
    /// The arm whose joints are checked.
    model: &'a DeviceModel,
    scale: f64,
    line: MotionLimits,
    turn: MotionLimits,
    dt_s: f64,
    /// Per leg: the limits of the flange do not apply.
    unbound: Vec<bool>,
    /// Number of consecutive cycles in which they apply.
    bound: usize,
    geometry: ExpectedPath,
    joints: [Joints; WINDOW],
    poses: [Pose; WINDOW],
    s: f64,
    worst: WorstCase,
}

impl<'a> MotionJudge<'a> {
    pub fn new(
        model: &'a DeviceModel,
        (drawn, legs): (&DrawnMotion, &[Leg<'_>]),
        geometry: ExpectedPath,
    ) -> Self {
        let of_joints = |leg: &Leg<'_>| matches!(leg.segment, PathSegment::Joints { .. });
        Self {
            model,
            scale: drawn.scale,
            line: drawn.line,
            turn: drawn.turn,
            dt_s: drawn.dt_s,
            unbound: legs.iter().map(of_joints).collect(),
            bound: WINDOW,
            geometry,
            joints: [drawn.start; WINDOW],
            poses: [drawn.from; WINDOW],
            s: 0.0,
            worst: WorstCase::default(),
        }
    }

    /// Checks the set-points of one cycle.
    pub fn see(&mut self, state: &MotionState) -> Result<(), String> {
        self.worst.cycles += 1;
        if !state.pose.is_finite() || !state.path.s.is_finite() {
            return Err(format!("not finite: {state:?}"));
        }
        if state.path.s < self.s || state.path.velocity < 0.0 {
            return Err(format!("backwards from {}: {:?}", self.s, state.path));
        }
        self.s = state.path.s;
        let off = self.geometry.off(state);
        self.worst.off_m = self.worst.off_m.max(off);
        if off.is_nan() || off > OFF_MAX {
            return Err(format!("{off} m off the path: {:?}", state.path));
        }
        self.poses.rotate_left(1);
        self.poses[3] = state.pose;
        self.joints.rotate_left(1);
        self.joints[3] = state.joints;
        let leg = state.leg as usize;
        // The blend from a leg into the next one belongs to the leg.
        let unbound = self.unbound.get(leg..).unwrap_or(&[]);
        self.bound = match unbound.iter().take(2).any(|unbound| *unbound) {
            true => 0,
            false => self.bound + 1,
        };
        if self.bound >= WINDOW && self.line.velocity.is_finite() {
            self.flange()?;
        }
        self.joints(self.model, state)
    }

    fn part(&mut self, order: usize, value: f64, limit: f64) -> Result<(), String> {
        // Rounding errors relative to small limits are not violations.
        let part = (value - 1e-3).max(0.0) / limit;
        self.worst.parts[order] = self.worst.parts[order].max(part);
        if value <= limit * 1.001 + 1e-3 {
            Ok(())
        } else {
            Err(format!("derivative {}: {value} of {limit}", order + 1))
        }
    }

    /// Checks the flange's own limits, of translation and rotation.
    fn flange(&mut self) -> Result<(), String> {
        let pairs = [[0, 1], [1, 2], [2, 3]].map(|pair| pair.map(|at| self.poses[at]));
        let dt = self.dt_s;
        let lines = pairs.map(|[a, b]| scale(subtract(b.position, a.position), 1.0 / dt));
        let turns = pairs.map(|[a, b]| {
            let to = nearest(b.orientation, a.orientation);
            scale(rotation::error(a.orientation, to), 1.0 / dt)
        });
        for (what, rates, limits) in [("line", lines, self.line), ("turn", turns, self.turn)] {
            let [a, b, c] = rates;
            let (before, now) = (subtract(b, a), subtract(c, b));
            let orders = [
                (norm(c), limits.velocity),
                (norm(now) / dt, limits.acceleration),
                (norm(subtract(now, before)) / (dt * dt), limits.jerk),
            ];
            for (order, (value, limit)) in orders.into_iter().enumerate() {
                let judged = self.part(order, value, limit);
                judged.map_err(|fault| format!("{what}: {fault}"))?;
            }
        }
        Ok(())
    }

    /// Checks range, velocity, acceleration and jerk of every joint, and that joints and pose agree.
    fn joints(&mut self, model: &DeviceModel, state: &MotionState) -> Result<(), String> {
        let limits = &model.limits;
        let dt = self.dt_s;
        let arm = model.arm.ok_or("no arm")?;
        let apart = arm.forward(&state.joints).distance_to(&state.pose);
        if apart.is_nan() || apart > OFF_MAX {
            return Err(format!("joints are {apart} m off the pose"));
        }
        for joint in 0..limits.joints {
            let [a, b, c, d] = self.joints.map(|joints| joints[joint]);
            if !(d >= limits.lower[joint] && d <= limits.upper[joint]) {
                return Err(format!("joint {joint} at {d}"));
            }
            let orders = [
                ((d - c) / dt, limits.velocity_max[joint]),
                (
                    (d - 2.0 * c + b) / (dt * dt),
                    limits.acceleration_max[joint],
                ),
                (
                    (d - 3.0 * c + 3.0 * b - a) / (dt * dt * dt),
                    limits.jerk_max[joint],
                ),
            ];
            for (order, (value, limit)) in orders.into_iter().enumerate() {
                let judged = self.part(order, value.abs(), limit * self.scale);
                judged.map_err(|fault| format!("joint {joint}: {fault}, {:?}", state.path))?;
            }
        }
        Ok(())
    }

    /// Checks the end of the motion.
    pub fn at_end(self, state: &MotionState, stopped: bool) -> Result<WorstCase, String> {
        let path = state.path;
        if path.stopping != stopped || path.velocity != 0.0 || path.acceleration != 0.0 {
            return Err(format!("done, but {path:?}"));
        }
        let arrived = match &self.geometry {
            ExpectedPath::Line(_, to) => state.pose.distance_to(to) <= OFF_MAX,
            ExpectedPath::Circle(_, _, to, _) => to.distance_to(&state.pose) <= OFF_MAX,
            ExpectedPath::Joints(_, to) => {
                let pairs = state.joints.iter().zip(to);
                let mut apart = pairs.map(|(q, to)| (q - to).abs());
                !apart.any(|apart| apart > OFF_MAX)
            }
            ExpectedPath::ReferenceRun(reference) => (path.s - reference.length()).abs() <= OFF_MAX,
        };
        if stopped || arrived {
            Ok(self.worst)
        } else {
            Err(format!("done, but not at the end: {path:?}"))
        }
    }
}
