//! Who watches one arm in a rehearsal: what it would be told, against its limits. Off the real-time thread.

use rcc_core::frame::{DeviceModel, DeviceOutput};
use rcc_core::guard::Guard;
use rcc_core::impedance::Impedance;
use rcc_core::message::{FaultCode, JOINTS_MAX, Joints};
use rcc_core::workspace::{Leaves, Stay};
use rcc_ipc::rehearsal::{Foreseen, Near, Peak, Rule};

/// A velocity or an acceleration may exceed its limit by this part of it, as for the guard.
const RELATIVE_TOLERANCE: f64 = 1e-9;
/// A jerk may exceed its limit by this part of it: it is the third difference of positions that were computed.
const JERK_TOLERANCE: f64 = 1e-2;
/// Slower than this part of its velocity limit a joint does not move.
const STILL: f64 = 1e-9;

/// No joint moved.
pub const NO_PEAKS: [Peak; 3] = [Peak::NONE; 3];

/// One arm.
#[derive(Debug)]
pub struct Watch {
    device: usize,
    model: DeviceModel,
    hold: Joints,
    /// The last three set-points, newest first; `None` while nobody commands the arm.
    history: Option<[Joints; 3]>,
    peaks: [Peak; 3],
    /// The nearest singular position of all set-points; `None` = not known.
    near: Option<Near>,
    /// As the guard will keep it; `None` = it may be anywhere.
    stay: Option<Stay>,
    /// Of it only what it says of impedance: it knows nothing of jerk, and tells the first fault alone.
    guard: Guard,
}

/// A rule that a set-point breaks.
#[derive(Clone, Copy, Debug)]
pub struct Broken {
    /// The rule.
    pub rule: Rule,
    /// Device index.
    pub device: u32,
    /// As in [`Foreseen::joint`].
    pub joint: u32,
    /// What it would be.
    pub value: f64,
    /// What is allowed.
    pub limit: f64,
}

/// What a set-point came to.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// The arm moves.
    pub moves: bool,
    /// The first set-point is not where the arm rests.
    pub is_elsewhere: bool,
    /// The first rule that it breaks.
    pub broken: Option<Broken>,
}

impl Watch {
    /// For an arm that rests at `hold`.
    pub fn new(device: usize, model: DeviceModel, hold: Joints) -> Watch {
        Watch {
            device,
            model,
            hold,
            history: None,
            peaks: NO_PEAKS,
            near: None,
            guard: fresh(&model),
            stay: (model.arm.zip(model.workspace)).map(|(arm, space)| Stay::new(arm, space)),
        }
    }

    /// Index of its device.
    pub fn device(&self) -> usize {
        self.device
    }

    /// Takes what the arm is told in one cycle.
    pub fn see(&mut self, output: &DeviceOutput, first: bool, dt_s: f64) -> Seen {
        let Some(history) = self.history else {
            return self.engage(output, first);
        };
        if !output.has_position {
            self.history = None;
            self.hold = history[0];
            let broken = self
                .is_moving(&history, dt_s)
                .then(|| self.broken(Rule::LetsGo, 0, 0.0, 0.0));
            return Seen {
                broken,
                ..Seen::default()
            };
        }
        let broken = self.check(&output.position, &history, dt_s);
        let broken = broken.or_else(|| self.check_impedance(&output.impedance, dt_s));
        let [last, before, _] = history;
        self.history = Some([output.position, last, before]);
        Seen {
            moves: output.position != last,
            broken,
            ..Seen::default()
        }
    }

    /// The first set-point of a stretch must be where the arm rests.
    fn engage(&mut self, output: &DeviceOutput, first: bool) -> Seen {
        if !output.has_position {
            return Seen::default();
        }
        let tolerance = self.model.first_tolerance_rad;
        let pairs = output.position.iter().zip(&self.hold);
        let there = pairs
            .take(self.model.limits.joints)
            .all(|(asked, hold)| (asked - hold).abs() <= tolerance);
        self.history = Some([output.position; 3]);
        if let Some(stay) = &mut self.stay {
            stay.begin(&output.position);
        }
        let broken = self.check(&output.position, &[output.position; 3], 1.0);
        self.guard = fresh(&self.model);
        let broken = broken.or_else(|| self.check_impedance(&output.impedance, 1.0));
        Seen {
            moves: false,
            // Later it is a jump, which the guard tells; where the arm rests then, the rehearsal only supposes.
            is_elsewhere: first && !there,
            broken,
        }
    }

    fn is_moving(&self, [now, last, _]: &[Joints; 3], dt_s: f64) -> bool {
        let limits = &self.model.limits;
        let steps = now.iter().zip(last).zip(&limits.velocity_max);
        steps
            .take(limits.joints)
            .any(|((now, last), limit)| (now - last).abs() > STILL * limit * dt_s)
    }

    /// Which strategy the controller runs is known at START.
    fn check_impedance(&mut self, asked: &Impedance, dt_s: f64) -> Option<Broken> {
        let checked = self.guard.check_impedance(asked, asked.strategy, dt_s);
        let violation = checked.err()?;
        let rule = Rule::Impedance {
            kind: violation.kind.number(),
        };
        let joint = u32::from(violation.joint) + 1;
        Some(self.broken(rule, joint, violation.value, violation.limit))
    }

    fn broken(&self, rule: Rule, joint: u32, value: f64, limit: f64) -> Broken {
        Broken {
            rule,
            device: self.device as u32,
            joint,
            value,
            limit,
        }
    }

    fn check(&mut self, asked: &Joints, history: &[Joints; 3], dt_s: f64) -> Option<Broken> {
        let mut broken = None;
        for joint in 0..self.model.limits.joints.min(JOINTS_MAX) {
            let found = self.check_joint(joint, asked, history, dt_s);
            broken = broken.or(found);
        }
        if asked.iter().all(|value| value.is_finite()) {
            self.come_near(asked);
            broken = broken.or_else(|| self.check_place(asked));
        }
        broken
    }

    /// Keeps the nearest singular position.
    fn come_near(&mut self, asked: &Joints) {
        let Some(arm) = self.model.arm else { return };
        let singularity = arm.singularity(asked);
        if self
            .near
            .is_none_or(|near| singularity.distance < near.distance)
        {
            self.near = Some(Near {
                kind: singularity.kind.number(),
                distance: singularity.distance,
            });
        }
    }

    fn check_joint(
        &mut self,
        index: usize,
        asked: &Joints,
        [last, before, oldest]: &[Joints; 3],
        dt_s: f64,
    ) -> Option<Broken> {
        let limits = self.model.limits;
        let joint = index as u32 + 1;
        let [p, p1, p2, p3] = [asked, last, before, oldest].map(|row| row[index]);
        if !p.is_finite() {
            return Some(self.broken(Rule::NotFinite, joint, p, 0.0));
        }
        let (lower, upper) = (limits.lower[index], limits.upper[index]);
        if p < lower || p > upper {
            let limit = if p < lower { lower } else { upper };
            return Some(self.broken(Rule::Position, joint, p, limit));
        }
        let rounding = 16.0 * f64::EPSILON * (1.0 + p.abs());
        let (dt2, dt3) = (dt_s * dt_s, dt_s * dt_s * dt_s);
        let rows = [
            (
                Rule::Velocity,
                (p - p1) / dt_s,
                limits.velocity_max[index],
                RELATIVE_TOLERANCE,
                dt_s,
            ),
            (
                Rule::Acceleration,
                (p - 2.0 * p1 + p2) / dt2,
                limits.acceleration_max[index],
                RELATIVE_TOLERANCE,
                dt2,
            ),
            (
                Rule::Jerk,
                (p - 3.0 * p1 + 3.0 * p2 - p3) / dt3,
                limits.jerk_max[index],
                JERK_TOLERANCE,
                dt3,
            ),
        ];
        let mut broken = None;
        for (place, (rule, value, limit, tolerance, per)) in rows.into_iter().enumerate() {
            let share = (value.abs() - rounding / per).max(0.0) / limit;
            if share > self.peaks[place].share {
                self.peaks[place] = Peak {
                    device: self.device as u32,
                    joint,
                    share,
                };
            }
            if share > 1.0 + tolerance && broken.is_none() {
                broken = Some(self.broken(rule, joint, value, limit));
            }
        }
        broken
    }

    /// Where the flange would be.
    fn check_place(&mut self, asked: &Joints) -> Option<Broken> {
        match self.stay.as_mut()?.check(asked).err()? {
            Leaves::Box { axis, value, limit } => {
                Some(self.broken(Rule::Workspace, u32::from(axis) + 1, value, limit))
            }
            Leaves::Singular { near, limit } => {
                let kind = near.kind.number();
                Some(self.broken(Rule::Singularity, kind, near.distance, limit))
            }
        }
    }
}

/// A guard that has seen nothing yet.
fn fresh(model: &DeviceModel) -> Guard {
    Guard::new(model.limits, model.first_tolerance_rad).with_impedance(model.impedance)
}

/// The net ends by itself.
pub fn fault(code: FaultCode, time_s: f64) -> Foreseen {
    Foreseen {
        rule: Rule::Fault,
        device: u32::MAX,
        joint: 0,
        value: f64::from(code as u32),
        limit: 0.0,
        time_s,
        place: None,
        speed: 1.0,
        near: None,
    }
}

/// A broken rule with its time.
pub fn foreseen(broken: Broken, time_s: f64) -> Foreseen {
    let Broken {
        rule,
        device,
        joint,
        value,
        limit,
    } = broken;
    Foreseen {
        rule,
        device,
        joint,
        value,
        limit,
        time_s,
        place: None,
        speed: 1.0,
        near: None,
    }
}

/// The greatest share of each limit.
pub fn peaks(watches: &[Watch]) -> [Peak; 3] {
    let mut peaks = NO_PEAKS;
    for watch in watches {
        for (peak, own) in peaks.iter_mut().zip(watch.peaks) {
            if own.share > peak.share {
                *peak = own;
            }
        }
    }
    peaks
}

/// The singular position that an arm came nearest to; `None` if none is known.
pub fn near(watches: &[Watch]) -> Option<Near> {
    let all = watches.iter().filter_map(|watch| watch.near);
    all.min_by(|a, b| a.distance.total_cmp(&b.distance))
}

/// The part of its speed at which a motion on the same path would keep the limits: velocity goes with it, acceleration
/// with its square, jerk with its cube. Somewhat less, because other cycles of the path are seen then.
pub fn speed(peaks: &[Peak; 3]) -> f64 {
    let [v, a, j] = peaks.map(|peak| peak.share.max(1.0));
    let part = (1.0 / v).min(1.0 / a.sqrt()).min(1.0 / j.cbrt());
    if part < 1.0 { 0.98 * part } else { 1.0 }
}
