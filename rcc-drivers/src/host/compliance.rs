//! How softly an arm is held, exchange by exchange: what the followed net commands, and a smooth way there and back.
//! Pure; run by the host's thread.
//!
//! Within a net the guard bounds how fast a stiffness changes. Where a net begins or ends this does: from what the arm has
//! to what it is to have, along a straight line, in the time that the configured rate needs for the largest change.
//! Released, an arm keeps its springs, which hold it where it is, and loses what it presses with on top.

use rcc_core::impedance::{Impedance, ImpedanceLimits, Strategy};

/// The impedance of one arm.
#[derive(Clone, Debug)]
pub struct Compliance {
    /// `None`: the arm is commanded in position only.
    limits: Option<ImpedanceLimits>,
    joints: usize,
    /// Owner of the set-points, 0 = nobody.
    owner: u64,
    /// What was told last.
    told: Impedance,
    /// What the last net commanded last, without what it pressed with on top.
    kept: Impedance,
    /// Where the way to what is commanded began.
    from: Impedance,
    duration_s: f64,
    t_s: f64,
}

impl Compliance {
    /// An arm in position control.
    #[must_use]
    pub fn new(limits: Option<ImpedanceLimits>, joints: usize) -> Self {
        Self {
            limits,
            joints,
            owner: 0,
            told: Impedance::NONE,
            kept: Impedance::NONE,
            from: Impedance::NONE,
            duration_s: 0.0,
            t_s: 0.0,
        }
    }

    /// The device does not follow, and runs this strategy: whatever was told is over.
    pub fn reset(&mut self, strategy: Strategy) {
        let held = self.limits.map(|limits| limits.held(strategy, self.joints));
        let held = held.unwrap_or(Impedance::NONE);
        (self.owner, self.told, self.kept) = (0, held, held);
        (self.duration_s, self.t_s) = (0.0, 0.0);
    }

    /// One exchange, `dt_s` (s) after the last, with a device that runs `strategy`; `commanded` is what the followed net
    /// commands, and its owner.
    pub fn next(
        &mut self,
        strategy: Strategy,
        commanded: Option<(u64, &Impedance)>,
        dt_s: f64,
    ) -> Impedance {
        if self.told.strategy != strategy as u64 {
            self.reset(strategy);
        }
        let fits = commanded.filter(|(_, asked)| asked.strategy == strategy as u64);
        let (owner, goal) = match fits {
            Some((owner, asked)) => (owner, *asked),
            None => (0, self.kept),
        };
        if owner != self.owner {
            (self.owner, self.from, self.t_s) = (owner, self.told, 0.0);
            self.duration_s = self.duration(strategy, &goal);
        }
        self.t_s += dt_s;
        self.kept = Impedance {
            added: Impedance::NONE.added,
            ..goal
        };
        self.told = if self.t_s < self.duration_s {
            mixed(&self.from, &goal, self.t_s / self.duration_s)
        } else {
            goal
        };
        self.told
    }

    /// How long it takes from what was told to `goal`, s.
    fn duration(&self, strategy: Strategy, goal: &Impedance) -> f64 {
        let Some(limits) = self.limits else {
            return 0.0;
        };
        let mut part = 0.0_f64;
        for element in 0..ImpedanceLimits::elements(strategy, self.joints) {
            let of = limits.of(strategy, element);
            for (from, to, most) in [
                (&self.told.stiffness, &goal.stiffness, of.stiffness[1]),
                (&self.told.damping, &goal.damping, of.damping[1]),
                (&self.told.added, &goal.added, of.added),
            ] {
                part = part.max((to[element] - from[element]).abs() / most);
            }
        }
        part / limits.rate
    }
}

/// From one (part 0) to the other (part 1); both are within the limits, and so is what lies between.
fn mixed(from: &Impedance, to: &Impedance, part: f64) -> Impedance {
    let mix = |from: &[f64; 8], to: &[f64; 8]| {
        let mut mix = *to;
        for (place, from) in mix.iter_mut().zip(from) {
            *place = from + part * (*place - from);
        }
        mix
    };
    Impedance {
        strategy: to.strategy,
        stiffness: mix(&from.stiffness, &to.stiffness),
        damping: mix(&from.damping, &to.damping),
        added: mix(&from.added, &to.added),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CARTESIAN: Strategy = Strategy::CartesianImpedance;
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
        let mut soft = LIMITS.held(CARTESIAN, 7);
        soft.stiffness[2] = 100.0;
        soft.added[2] = -20.0;
        soft
    }

    fn held() -> Compliance {
        let mut compliance = Compliance::new(Some(LIMITS), 7);
        compliance.reset(CARTESIAN);
        compliance
    }

    #[test]
    fn a_net_begins_and_ends_within_the_rate_and_is_told_exactly_in_between() {
        let (mut compliance, soft) = (held(), soft());
        let mut last = LIMITS.held(CARTESIAN, 7);
        let mut step = |asked: Option<(u64, &Impedance)>| {
            let told = compliance.next(CARTESIAN, asked, DT_S);
            assert!((told.stiffness[2] - last.stiffness[2]).abs() <= 5000.0 * 2.0 * DT_S + 1e-9);
            assert!((told.added[2] - last.added[2]).abs() <= 50.0 * 2.0 * DT_S + 1e-9);
            last = told;
            told
        };
        // 20 N of 50 N are 0.4, of 5000 N/m the 1900 N/m are 0.38: 200 ms.
        let told: Vec<Impedance> = (0..200).map(|_| step(Some((1, &soft)))).collect();
        assert!(told[198] != soft && told[199] == soft);
        // While it commands, exactly what it commands.
        let mut other = soft;
        other.stiffness[2] = 105.0;
        assert_eq!(step(Some((1, &other))), other);
        // Released: no force after 200 ms, and the springs stay.
        let told: Vec<Impedance> = (0..200).map(|_| step(None)).collect();
        assert!(told[0].added[2] < -19.0 && told[198].added[2] < 0.0);
        assert_eq!(
            (told[199].added, told[199].stiffness),
            ([0.0; 8], other.stiffness)
        );
    }

    #[test]
    fn the_net_of_another_owner_begins_anew() {
        let (mut compliance, soft) = (held(), soft());
        (0..300).for_each(|_| {
            compliance.next(CARTESIAN, Some((1, &soft)), DT_S);
        });
        let stiff = LIMITS.held(CARTESIAN, 7);
        let told = compliance.next(CARTESIAN, Some((2, &stiff)), DT_S);
        assert!(told.stiffness[2] < 120.0, "{told:?}");
    }

    #[test]
    fn a_device_that_left_command_mode_is_held_as_before() {
        let (mut compliance, soft) = (held(), soft());
        (0..300).for_each(|_| {
            compliance.next(CARTESIAN, Some((1, &soft)), DT_S);
        });
        compliance.reset(CARTESIAN);
        let told = compliance.next(CARTESIAN, None, DT_S);
        assert_eq!(told, LIMITS.held(CARTESIAN, 7));
        // And a set-point for another strategy is none.
        let told = compliance.next(Strategy::JointImpedance, Some((1, &soft)), DT_S);
        assert_eq!(told, LIMITS.held(Strategy::JointImpedance, 7));
        let mut plain = Compliance::new(None, 7);
        assert_eq!(plain.next(Strategy::Position, None, DT_S), Impedance::NONE);
    }
}
