//! Checks the set-points of one arm in a rehearsal against its limits. Off the real-time thread.

use rcc_core::frame::{DeviceModel, DeviceOutput};
use rcc_core::guard::{Guard, JERK_TOLERANCE, RELATIVE_TOLERANCE};
use rcc_core::impedance::Impedance;
use rcc_core::message::{FaultCode, JOINTS_MAX, Joints};
use rcc_core::workspace::{WorkspaceGuard, WorkspaceViolation};
use rcc_protocol::rehearsal::{
    LimitPeak, NearestSingularity, PredictedViolation, RehearsalRule, SlowerMotion,
};

/// Fraction of its velocity limit below which a joint counts as not moving.
const STILL: f64 = 1e-9;

/// No joint moved.
pub const NO_PEAKS: [LimitPeak; 3] = [LimitPeak::NONE; 3];

/// Monitor of one arm.
#[derive(Debug)]
pub struct ArmMonitor {
    device: usize,
    model: DeviceModel,
    hold: Joints,
    /// The last three set-points, newest first, rad; `None` while the arm is not commanded.
    history: Option<[Joints; 3]>,
    /// The net has given it a set-point.
    has_been_commanded: bool,
    peaks: [LimitPeak; 3],
    /// The nearest singular position of all set-points; `None` if it is not known.
    near: Option<NearestSingularity>,
    /// The workspace check as the guard will apply it; `None`: no workspace is configured.
    stay: Option<WorkspaceGuard>,
    /// Used for its impedance checks only: it does not check jerk, and reports only the first violation.
    guard: Guard,
}

/// A rule that a set-point violates.
#[derive(Clone, Copy, Debug)]
pub struct RuleViolation {
    /// The rule.
    pub rule: RehearsalRule,
    /// Device index.
    pub device: u32,
    /// As in [`PredictedViolation::joint`].
    pub joint: u32,
    /// Value that it would reach.
    pub value: f64,
    /// Limit.
    pub limit: f64,
}

/// Result of the check of one set-point.
#[derive(Clone, Copy, Debug, Default)]
pub struct CheckedSetPoint {
    /// The arm moves.
    pub moves: bool,
    /// The first set-point is not at the hold set-point.
    pub is_elsewhere: bool,
    /// The first violated rule.
    pub violation: Option<RuleViolation>,
}

impl ArmMonitor {
    /// A monitor for an arm at rest at `hold` (rad).
    pub fn new(device: usize, model: DeviceModel, hold: Joints) -> ArmMonitor {
        ArmMonitor {
            device,
            model,
            hold,
            history: None,
            has_been_commanded: false,
            peaks: NO_PEAKS,
            near: None,
            guard: fresh(&model),
            stay: (model.arm.zip(model.workspace))
                .map(|(arm, space)| WorkspaceGuard::new(arm, space)),
        }
    }

    /// Index of its device.
    pub fn device(&self) -> usize {
        self.device
    }

    /// Returns true if it got a set-point in any cycle.
    pub fn has_been_commanded(&self) -> bool {
        self.has_been_commanded
    }

    /// Checks the output of one cycle.
    pub fn check_set_point(
        &mut self,
        output: &DeviceOutput,
        first: bool,
        dt_s: f64,
    ) -> CheckedSetPoint {
        let Some(history) = self.history else {
            return self.engage(output, first);
        };
        if !output.has_position {
            self.history = None;
            self.hold = history[0];
            let violation = self
                .is_moving(&history, dt_s)
                .then(|| self.violation(RehearsalRule::LetsGo, 0, 0.0, 0.0));
            return CheckedSetPoint {
                violation,
                ..CheckedSetPoint::default()
            };
        }
        let violation = self.check(&output.position, &history, dt_s);
        let violation = violation.or_else(|| self.check_impedance(&output.impedance, dt_s));
        let [last, before, _] = history;
        self.history = Some([output.position, last, before]);
        CheckedSetPoint {
            moves: output.position != last,
            violation,
            ..CheckedSetPoint::default()
        }
    }

    /// The first set-point of an engagement must be at the hold set-point.
    fn engage(&mut self, output: &DeviceOutput, first: bool) -> CheckedSetPoint {
        if !output.has_position {
            return CheckedSetPoint::default();
        }
        self.has_been_commanded = true;
        let tolerance = self.model.first_tolerance_rad;
        let pairs = output.position.iter().zip(&self.hold);
        let there = pairs
            .take(self.model.limits.joints)
            .all(|(asked, hold)| (asked - hold).abs() <= tolerance);
        self.history = Some([output.position; 3]);
        if let Some(stay) = &mut self.stay {
            stay.begin(&output.position);
        }
        let violation = self.check(&output.position, &[output.position; 3], 1.0);
        self.guard = fresh(&self.model);
        let violation = violation.or_else(|| self.check_impedance(&output.impedance, 1.0));
        CheckedSetPoint {
            moves: false,
            // Later in a net this is a jump, which the guard reports; the rehearsal does not know where the arm rests
            // then.
            is_elsewhere: first && !there,
            violation,
        }
    }

    fn is_moving(&self, [now, last, _]: &[Joints; 3], dt_s: f64) -> bool {
        let limits = &self.model.limits;
        let steps = now.iter().zip(last).zip(&limits.velocity_max);
        steps
            .take(limits.joints)
            .any(|((now, last), limit)| (now - last).abs() > STILL * limit * dt_s)
    }

    /// The strategy of the controller is known only at START, so the requested one is assumed.
    fn check_impedance(&mut self, asked: &Impedance, dt_s: f64) -> Option<RuleViolation> {
        let checked = self.guard.check_impedance(asked, asked.strategy, dt_s);
        let violation = checked.err()?;
        let rule = RehearsalRule::Impedance {
            kind: violation.kind.number(),
        };
        let joint = u32::from(violation.joint) + 1;
        Some(self.violation(rule, joint, violation.value, violation.limit))
    }

    fn violation(&self, rule: RehearsalRule, joint: u32, value: f64, limit: f64) -> RuleViolation {
        RuleViolation {
            rule,
            device: self.device as u32,
            joint,
            value,
            limit,
        }
    }

    fn check(&mut self, asked: &Joints, history: &[Joints; 3], dt_s: f64) -> Option<RuleViolation> {
        let mut violation = None;
        for joint in 0..self.model.limits.joints.min(JOINTS_MAX) {
            let found = self.check_joint(joint, asked, history, dt_s);
            violation = violation.or(found);
        }
        if asked.iter().all(|value| value.is_finite()) {
            self.update_nearest_singularity(asked);
            violation = violation.or_else(|| self.check_workspace(asked));
        }
        violation
    }

    /// Keeps the nearest singular position.
    fn update_nearest_singularity(&mut self, asked: &Joints) {
        let Some(arm) = self.model.arm else { return };
        let singularity = arm.singularity(asked);
        if self
            .near
            .is_none_or(|near| singularity.distance < near.distance)
        {
            self.near = Some(NearestSingularity {
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
    ) -> Option<RuleViolation> {
        let limits = self.model.limits;
        let joint = index as u32 + 1;
        let [p, p1, p2, p3] = [asked, last, before, oldest].map(|row| row[index]);
        if !p.is_finite() {
            return Some(self.violation(RehearsalRule::NotFinite, joint, p, 0.0));
        }
        let (lower, upper) = (limits.lower[index], limits.upper[index]);
        if p < lower || p > upper {
            let limit = if p < lower { lower } else { upper };
            return Some(self.violation(RehearsalRule::Position, joint, p, limit));
        }
        let rounding = 16.0 * f64::EPSILON * (1.0 + p.abs());
        let (dt2, dt3) = (dt_s * dt_s, dt_s * dt_s * dt_s);
        let rows = [
            (
                RehearsalRule::Velocity,
                (p - p1) / dt_s,
                limits.velocity_max[index],
                RELATIVE_TOLERANCE,
                dt_s,
            ),
            (
                RehearsalRule::Acceleration,
                (p - 2.0 * p1 + p2) / dt2,
                limits.acceleration_max[index],
                RELATIVE_TOLERANCE,
                dt2,
            ),
            (
                RehearsalRule::Jerk,
                (p - 3.0 * p1 + 3.0 * p2 - p3) / dt3,
                limits.jerk_max[index],
                JERK_TOLERANCE,
                dt3,
            ),
        ];
        let mut violation = None;
        for (place, (rule, value, limit, tolerance, per)) in rows.into_iter().enumerate() {
            let share = (value.abs() - rounding / per).max(0.0) / limit;
            if share > self.peaks[place].share {
                self.peaks[place] = LimitPeak {
                    device: self.device as u32,
                    joint,
                    share,
                };
            }
            if share > 1.0 + tolerance && violation.is_none() {
                violation = Some(self.violation(rule, joint, value, limit));
            }
        }
        violation
    }

    /// Checks the position of the flange and the distance to singular positions.
    fn check_workspace(&mut self, asked: &Joints) -> Option<RuleViolation> {
        match self.stay.as_mut()?.check(asked).err()? {
            WorkspaceViolation::Box { axis, value, limit } => {
                Some(self.violation(RehearsalRule::Workspace, u32::from(axis) + 1, value, limit))
            }
            WorkspaceViolation::Singular { near, limit } => {
                let kind = near.kind.number();
                Some(self.violation(RehearsalRule::Singularity, kind, near.distance, limit))
            }
        }
    }
}

/// A guard without history.
fn fresh(model: &DeviceModel) -> Guard {
    Guard::new(model.limits, model.first_tolerance_rad).with_impedance(model.impedance)
}

/// A fault that the net itself would end with.
pub fn fault(code: FaultCode, time_s: f64) -> PredictedViolation {
    PredictedViolation {
        rule: RehearsalRule::Fault,
        device: u32::MAX,
        joint: 0,
        value: f64::from(code as u32),
        limit: 0.0,
        time_s,
        place: None,
        slower: SlowerMotion::Unknown,
        near: None,
    }
}

/// A violation with its time (s).
pub fn foreseen(violation: RuleViolation, time_s: f64) -> PredictedViolation {
    let RuleViolation {
        rule,
        device,
        joint,
        value,
        limit,
    } = violation;
    PredictedViolation {
        rule,
        device,
        joint,
        value,
        limit,
        time_s,
        place: None,
        slower: SlowerMotion::Unknown,
        near: None,
    }
}

/// The greatest use of each limit by any arm.
pub fn peaks(monitors: &[ArmMonitor]) -> [LimitPeak; 3] {
    let mut peaks = NO_PEAKS;
    for monitor in monitors {
        for (peak, own) in peaks.iter_mut().zip(monitor.peaks) {
            if own.share > peak.share {
                *peak = own;
            }
        }
    }
    peaks
}

/// The singular position that any arm came nearest to; `None` if it is not known.
pub fn near(monitors: &[ArmMonitor]) -> Option<NearestSingularity> {
    let all = monitors.iter().filter_map(|monitor| monitor.near);
    all.min_by(|a, b| a.distance.total_cmp(&b.distance))
}

/// The speed factor at which a smooth motion on the same path would keep the limits: velocity scales with it,
/// acceleration with its square, jerk with its cube.
pub fn smooth_speed(peaks: &[LimitPeak; 3]) -> f64 {
    let [v, a, j] = peaks.map(|peak| peak.share.max(1.0));
    (1.0 / v).min(1.0 / a.sqrt()).min(1.0 / j.cbrt())
}

/// The speed factor at which a motion whose velocity jumps would keep the limits: after a step in velocity, the differences
/// of all orders are proportional to the speed.
pub fn abrupt_speed(peaks: &[LimitPeak; 3]) -> f64 {
    let highest = peaks
        .iter()
        .fold(1.0_f64, |most, peak| most.max(peak.share));
    1.0 / highest
}
