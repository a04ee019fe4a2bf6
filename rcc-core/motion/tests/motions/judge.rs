//! Judges the set-points of one motion: on its path, forward only, within the limits, finite, done once.

use super::*;

/// More than this off the path is off the path, m or rad.
const OFF_MAX: f64 = 1e-9;

/// How close a motion came to what it must keep.
#[derive(Debug, Clone, Copy, Default)]
pub struct Worst {
    /// Off the path, m.
    pub off_m: f64,
    /// Velocity, acceleration and jerk, the greatest of all joints or of the flange: parts of their limits.
    pub parts: [f64; 3],
    /// Cycles that it took.
    pub cycles: usize,
}

impl Worst {
    /// The worse of both.
    pub fn and(&mut self, other: Worst) {
        self.off_m = self.off_m.max(other.off_m);
        for (part, other) in self.parts.iter_mut().zip(other.parts) {
            *part = part.max(other);
        }
        self.cycles += other.cycles;
    }
}

/// Where the path is, computed without the code that went along it.
pub enum Geometry {
    /// From pose to pose.
    Line(Pose, Pose),
    /// Through three points.
    Circle([[f64; 3]; 3]),
    /// From joints to joints.
    Joints(Joints, Joints),
    /// As it is when nobody disturbs it.
    Reference(Box<Reference>),
}

/// Places of an undisturbed, slow run, by s: one list for each part from rest to rest, where the path may have a corner.
pub struct Reference(Vec<Vec<(f64, [f64; 3])>>);

impl Reference {
    /// Runs a motion; `None` if it does not end.
    pub fn run(mut motion: MotionSet) -> Option<Self> {
        let drive = Drive {
            speed: 0.25,
            ..Drive::RUN
        };
        let mut parts: Vec<Vec<(f64, [f64; 3])>> = vec![Vec::new()];
        for _ in 0..8 * CYCLES_MAX {
            let state = motion.step(0, drive)?;
            let here = (state.path.s, state.pose.position);
            let places = parts.last_mut()?;
            let rests = state.path.velocity == 0.0 && !places.is_empty();
            if rests {
                // A place nearer than this would make the polynomial one of rounding.
                places.retain(|(s, _)| here.0 - s > 1e-6);
            }
            if rests || places.last().is_none_or(|(last, _)| here.0 - last > 2e-5) {
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

    /// How far a place is off the curve at s: of the polynomial through the six nearest places.
    fn off(&self, s: f64, place: [f64; 3]) -> f64 {
        let begun = |part: &Vec<(f64, [f64; 3])>| part.first().is_none_or(|(at, _)| *at <= s);
        let part = self.0.partition_point(begun).saturating_sub(1);
        let places = &self.0[part];
        let first = places.partition_point(|(at, _)| *at < s).saturating_sub(3);
        let near = &places[first.min(places.len().saturating_sub(6))..];
        let near = &near[..near.len().min(6)];
        let mut want = [0.0; 3];
        for (index, (at, place)) in near.iter().enumerate() {
            let others = near.iter().enumerate().filter(|(other, _)| *other != index);
            let weight: f64 = others.map(|(_, (x, _))| (s - x) / (at - x)).product();
            want = add(want, scale(*place, weight));
        }
        norm(subtract(want, place))
    }

    fn length(&self) -> f64 {
        let last = self.0.last().and_then(|part| part.last());
        last.map_or(0.0, |(s, _)| *s)
    }
}

impl Geometry {
    fn off(&self, state: &MotionState) -> f64 {
        let place = state.pose.position;
        match self {
            Geometry::Line(from, to) => {
                let way = subtract(to.position, from.position);
                let length = norm(way);
                if length < 1e-6 {
                    return 0.0;
                }
                let since = subtract(place, from.position);
                let fraction = (dot(since, way) / (length * length)).clamp(0.0, 1.0);
                let off = norm(subtract(since, scale(way, fraction)));
                let turned = from.slerp(to, fraction);
                // The angle between nearly equal orientations is known to the root of an f64's rounding.
                let turned = turned.map_or(f64::INFINITY, |turned| turned.angle_to(&state.pose));
                if turned < 1e-7 { off } else { turned }
            }
            Geometry::Circle([a, b, c]) => {
                let (u, v) = (subtract(*b, *a), subtract(*c, *a));
                let normal = cross(u, v);
                let twice = 2.0 * dot(normal, normal);
                let to_centre = scale(
                    add(
                        scale(cross(normal, u), dot(v, v)),
                        scale(cross(v, normal), dot(u, u)),
                    ),
                    1.0 / twice,
                );
                let since = subtract(place, add(*a, to_centre));
                let radial = norm(since) - norm(to_centre);
                let axial = dot(since, normal) / norm(normal);
                radial.hypot(axial)
            }
            Geometry::Joints(from, to) => {
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
            Geometry::Reference(reference) => reference.off(state.path.s, place),
        }
    }
}

/// The judge of one motion.
pub struct Judge<'a> {
    /// The arm whose joints are judged, or none.
    model: Option<&'a DeviceModel>,
    scale: f64,
    line: Limits,
    turn: Limits,
    dt_s: f64,
    geometry: Geometry,
    joints: [Joints; 4],
    poses: [Pose; 4],
    s: f64,
    worst: Worst,
}

impl<'a> Judge<'a> {
    pub fn new(model: Option<&'a DeviceModel>, lot: &Lot, geometry: Geometry) -> Self {
        Self {
            model,
            scale: lot.scale,
            line: lot.line,
            turn: lot.turn,
            dt_s: lot.dt_s,
            geometry,
            joints: [lot.start; 4],
            poses: [lot.from; 4],
            s: 0.0,
            worst: Worst::default(),
        }
    }

    /// Judges the set-points of one cycle.
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
        self.flange()?;
        match self.model {
            Some(model) => self.joints(model, state),
            None => Ok(()),
        }
    }

    fn part(&mut self, order: usize, value: f64, limit: f64) -> Result<(), String> {
        // What rounding makes of small limits is not their breach.
        let part = (value - 1e-3).max(0.0) / limit;
        self.worst.parts[order] = self.worst.parts[order].max(part);
        if value <= limit * 1.001 + 1e-3 {
            Ok(())
        } else {
            Err(format!("derivative {}: {value} of {limit}", order + 1))
        }
    }

    /// The flange's own limits, as far as it has any.
    fn flange(&mut self) -> Result<(), String> {
        if !self.line.velocity.is_finite() || matches!(self.geometry, Geometry::Joints(..)) {
            return Ok(());
        }
        let [a, b, c, d] = self.poses.map(|pose| pose.position);
        let (first, second) = (subtract(d, c), subtract(subtract(d, c), subtract(c, b)));
        let before = subtract(subtract(c, b), subtract(b, a));
        let third = subtract(second, before);
        let dt = self.dt_s;
        let turned = self.poses[3].angle_to(&self.poses[2]) / dt;
        let Limits {
            velocity,
            acceleration,
            jerk,
        } = self.line;
        // Not in legs of joints, which limits of the flange do not bind in acceleration.
        self.part(0, norm(first) / dt, velocity)?;
        self.part(1, norm(second) / (dt * dt), acceleration)?;
        self.part(2, norm(third) / (dt * dt * dt), jerk)?;
        self.part(0, turned, self.turn.velocity)
    }

    /// Range, velocity, acceleration and jerk of every joint, and that they agree with the pose.
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

    /// Judges the end.
    pub fn at_end(self, state: &MotionState, stopped: bool) -> Result<Worst, String> {
        let path = state.path;
        if path.stopping != stopped || path.velocity != 0.0 || path.acceleration != 0.0 {
            return Err(format!("done, but {path:?}"));
        }
        let arrived = match &self.geometry {
            Geometry::Line(_, to) => state.pose.distance_to(to) <= OFF_MAX,
            Geometry::Circle([_, _, to]) => norm(subtract(*to, state.pose.position)) <= OFF_MAX,
            Geometry::Joints(_, to) => {
                let pairs = state.joints.iter().zip(to);
                let mut apart = pairs.map(|(q, to)| (q - to).abs());
                !apart.any(|apart| apart > OFF_MAX)
            }
            Geometry::Reference(reference) => (path.s - reference.length()).abs() <= OFF_MAX,
        };
        if stopped || arrived {
            Ok(self.worst)
        } else {
            Err(format!("done, but not at the end: {path:?}"))
        }
    }
}
