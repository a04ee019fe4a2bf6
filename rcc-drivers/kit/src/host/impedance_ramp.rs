//! Impedance set-points of an arm, exchange by exchange: those of the followed net, with smooth transitions when a net
//! starts or ends.
//! Pure; run by the host's thread.
//!
//! Within a net, the guard bounds the rate of change of the stiffness. When a net starts or ends, this ramp does: each
//! element moves towards its required value, which may change meanwhile, by at most the configured rate, until all have
//! reached it. When released, an arm keeps its stiffness and damping, which hold it where it is, and loses
//! the added force.

use rcc_core::impedance::{ControlMode, Impedance, ImpedanceLimits};

/// Relative tolerance of one step: steps are added up with rounding errors.
const STEP_TOLERANCE: f64 = 1e-9;

/// Ramp between the impedances of successive nets, for one arm.
#[derive(Clone, Debug)]
pub struct ImpedanceRamp {
    /// `None`: the arm is commanded in position only.
    limits: Option<ImpedanceLimits>,
    joints: usize,
    /// Owner of the set-points; 0 = none.
    owner: u64,
    /// Impedance of the last exchange.
    sent: Impedance,
    /// Last impedance of the last net, without its added force.
    hold_target: Impedance,
    /// The impedance has not reached that of the net yet.
    is_ramping: bool,
}

impl ImpedanceRamp {
    /// An arm in position control.
    #[must_use]
    pub fn new(limits: Option<ImpedanceLimits>, joints: usize) -> Self {
        Self {
            limits,
            joints,
            owner: 0,
            sent: Impedance::NONE,
            hold_target: Impedance::NONE,
            is_ramping: false,
        }
    }

    /// Resets the ramp while the device is not commandable: the arm is held with the default impedance of this mode.
    pub fn reset(&mut self, strategy: ControlMode) {
        let holding = self
            .limits
            .map(|limits| limits.default_hold(strategy, self.joints));
        let holding = holding.unwrap_or(Impedance::NONE);
        (self.owner, self.sent, self.hold_target) = (0, holding, holding);
        self.is_ramping = false;
    }

    /// Returns the impedance of one exchange, `dt_s` (s) after the last, with a device in mode `strategy`; `commanded`
    /// holds the owner and the impedance of the followed net.
    pub fn next(
        &mut self,
        strategy: ControlMode,
        commanded: Option<(u64, &Impedance)>,
        dt_s: f64,
    ) -> Impedance {
        if self.sent.strategy != strategy as u64 {
            self.reset(strategy);
        }
        let fits = commanded.filter(|(_, asked)| asked.strategy == strategy as u64);
        let (owner, goal) = match fits {
            Some((owner, asked)) => (owner, *asked),
            None => (0, self.hold_target),
        };
        if owner != self.owner {
            (self.owner, self.is_ramping) = (owner, true);
        }
        self.hold_target = Impedance {
            added: Impedance::NONE.added,
            ..goal
        };
        self.sent = match self.limits {
            Some(limits) if self.is_ramping => self.towards(&goal, &limits, dt_s),
            _ => goal,
        };
        self.is_ramping &= self.sent != goal;
        self.sent
    }

    /// Returns the impedance after one step of `dt_s` (s) towards `goal`. Both are within the limits, and so is every value
    /// between them.
    fn towards(&self, goal: &Impedance, limits: &ImpedanceLimits, dt_s: f64) -> Impedance {
        let mut next = *goal;
        let part = limits.rate * dt_s;
        let strategy = ControlMode::from_number(goal.strategy).unwrap_or(ControlMode::Position);
        for element in 0..ImpedanceLimits::elements(strategy, self.joints) {
            let of = limits.of(strategy, element);
            for (place, from, most) in [
                (&mut next.stiffness, &self.sent.stiffness, of.stiffness[1]),
                (&mut next.damping, &self.sent.damping, of.damping[1]),
                (&mut next.added, &self.sent.added, of.added),
            ] {
                place[element] = stepped(from[element], place[element], part * most);
            }
        }
        next
    }
}

/// Moves from `from` towards `to` by at most `most`.
fn stepped(from: f64, to: f64, most: f64) -> f64 {
    let way = to - from;
    if way.abs() <= most * (1.0 + STEP_TOLERANCE) {
        to
    } else {
        from + most.copysign(way)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CARTESIAN: ControlMode = ControlMode::CartesianImpedance;
    const DT_S: f64 = 1e-3;

    const LIMITS: ImpedanceLimits = ImpedanceLimits {
        translation: [0.01, 5000.0],
        rotation: [0.01, 300.0],
        joint: [0.01, 2000.0],
        damping: [0.1, 1.0],
        rate: 2.0,
        force: 50.0,
        torque: 10.0,
        joint_torque: 15.0,
    };

    fn soft() -> Impedance {
        let mut soft = LIMITS.default_hold(CARTESIAN, 7);
        soft.stiffness[2] = 100.0;
        soft.added[2] = -20.0;
        soft
    }

    fn holding() -> ImpedanceRamp {
        let mut impedance_ramp = ImpedanceRamp::new(Some(LIMITS), 7);
        impedance_ramp.reset(CARTESIAN);
        impedance_ramp
    }

    #[test]
    fn a_net_starts_and_ends_within_the_rate_and_is_sent_exactly_in_between() {
        let (mut impedance_ramp, soft) = (holding(), soft());
        let mut last = LIMITS.default_hold(CARTESIAN, 7);
        let mut step = |asked: Option<(u64, &Impedance)>| {
            let sent = impedance_ramp.next(CARTESIAN, asked, DT_S);
            assert!((sent.stiffness[2] - last.stiffness[2]).abs() <= 5000.0 * 2.0 * DT_S + 1e-9);
            assert!((sent.added[2] - last.added[2]).abs() <= 50.0 * 2.0 * DT_S + 1e-9);
            last = sent;
            sent
        };
        // 20 N of 50 N are 0.4; 1900 N/m of 5000 N/m are 0.38; at a rate of 2/s the ramp takes 200 ms.
        let sent: Vec<Impedance> = (0..200).map(|_| step(Some((1, &soft)))).collect();
        assert!(sent[198] != soft && sent[199] == soft);
        // During the net, the impedance is exactly the commanded one.
        let mut other = soft;
        other.stiffness[2] = 105.0;
        assert_eq!(step(Some((1, &other))), other);
        // After release: the force is 0 after 200 ms, and the stiffness stays.
        let sent: Vec<Impedance> = (0..200).map(|_| step(None)).collect();
        assert!(sent[0].added[2] < -19.0 && sent[198].added[2] < 0.0);
        assert_eq!(
            (sent[199].added, sent[199].stiffness),
            ([0.0; 8], other.stiffness)
        );
    }

    /// The guard permits a net to change its stiffness by 10 N/m in each step.
    #[test]
    fn a_net_that_changes_its_stiffness_while_it_begins_or_ends_stays_within_the_rate() {
        for change in [10.0, -10.0] {
            let (mut impedance_ramp, mut asked) = (holding(), soft());
            asked.stiffness[2] = if change > 0.0 { 100.0 } else { 4900.0 };
            let mut last = LIMITS.default_hold(CARTESIAN, 7);
            for step in 0..600 {
                let owner = if step < 300 { 1 } else { 2 };
                let sent = impedance_ramp.next(CARTESIAN, Some((owner, &asked)), DT_S);
                let stiffness = sent.stiffness[2] - last.stiffness[2];
                let added = sent.added[2] - last.added[2];
                assert!(stiffness.abs() <= 10.0 + 1e-6, "{step}: {stiffness}");
                assert!(added.abs() <= 0.1 + 1e-9, "{step}: {added}");
                last = sent;
                // At last the stiffness is constant.
                if step < 400 {
                    asked.stiffness[2] += change;
                }
                if step == 299 {
                    // Another net begins somewhere else.
                    asked.stiffness[2] = 2500.0;
                }
            }
            (0..500).for_each(|_| {
                last = impedance_ramp.next(CARTESIAN, Some((2, &asked)), DT_S);
            });
            assert_eq!(last, asked);
        }
    }

    #[test]
    fn a_net_of_another_owner_starts_a_new_ramp() {
        let (mut impedance_ramp, soft) = (holding(), soft());
        (0..300).for_each(|_| {
            impedance_ramp.next(CARTESIAN, Some((1, &soft)), DT_S);
        });
        let stiff = LIMITS.default_hold(CARTESIAN, 7);
        let sent = impedance_ramp.next(CARTESIAN, Some((2, &stiff)), DT_S);
        assert!(sent.stiffness[2] < 120.0, "{sent:?}");
    }

    #[test]
    fn a_device_that_left_command_mode_has_the_default_impedance() {
        let (mut impedance_ramp, soft) = (holding(), soft());
        (0..300).for_each(|_| {
            impedance_ramp.next(CARTESIAN, Some((1, &soft)), DT_S);
        });
        impedance_ramp.reset(CARTESIAN);
        let sent = impedance_ramp.next(CARTESIAN, None, DT_S);
        assert_eq!(sent, LIMITS.default_hold(CARTESIAN, 7));
        // A set-point for another mode is ignored.
        let sent = impedance_ramp.next(ControlMode::JointImpedance, Some((1, &soft)), DT_S);
        assert_eq!(sent, LIMITS.default_hold(ControlMode::JointImpedance, 7));
        let mut plain = ImpedanceRamp::new(None, 7);
        assert_eq!(
            plain.next(ControlMode::Position, None, DT_S),
            Impedance::NONE
        );
    }
}
