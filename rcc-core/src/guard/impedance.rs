//! The guard's rules for impedance set-points: control strategy, ranges, rate of the stiffness. Run by the real-time
//! thread and by the drivers, after the position has been checked.

use super::{Guard, RELATIVE_TOLERANCE, Violation, ViolationKind};
use crate::impedance::{ControlMode, ElementLimits, Impedance, ImpedanceLimits};
use crate::joints::JOINTS_MAX;

impl Guard {
    /// Checks the impedance of a set-point whose position has been accepted, for a device that runs `strategy` (a
    /// [`ControlMode`] as a number), `dt_s` of logical time after the last one. The first one after a
    /// [`Guard::first`] may have any allowed stiffness, because the driver ramps to it.
    ///
    /// # Errors
    /// Returns the first axis or joint that violates a rule; the history then stays at the last accepted set-point.
    pub fn check_impedance(
        &mut self,
        requested: &Impedance,
        strategy: u64,
        dt_s: f64,
    ) -> Result<(), Violation> {
        let known = ControlMode::from_number(requested.strategy);
        let limits = match (known, self.impedance) {
            (Some(ControlMode::Position), _) if strategy == requested.strategy => return Ok(()),
            (Some(known), Some(limits)) if strategy == requested.strategy => Some((known, limits)),
            _ => None,
        };
        let Some((known, limits)) = limits else {
            return Err(Violation {
                kind: ViolationKind::Strategy,
                joint: 0,
                value: requested.strategy as f64,
                limit: strategy as f64,
            });
        };
        let last = self.last_impedance;
        let count = ImpedanceLimits::elements(known, self.limits.joints);
        let first = match known {
            ControlMode::CartesianImpedance => JOINTS_MAX,
            _ => 0,
        };
        for element in 0..count {
            let of = |values: &[f64]| values.get(element).copied().unwrap_or(f64::NAN);
            let row = ElementCheck {
                place: (first + element) as u8,
                limits: limits.of(known, element),
            };
            row.check_range(
                ViolationKind::Stiffness,
                of(&requested.stiffness),
                row.limits.stiffness,
            )?;
            row.check_range(
                ViolationKind::Damping,
                of(&requested.damping),
                row.limits.damping,
            )?;
            let most = row.limits.added;
            row.check_range(ViolationKind::Added, of(&requested.added), [-most, most])?;
            if let Some(last) = &last {
                let rate = (of(&requested.stiffness) - of(&last.stiffness)) / dt_s;
                // The difference contains the rounding errors of both.
                let most = row.limits.rate * (1.0 + 1e-6);
                row.check_range(ViolationKind::StiffnessRate, rate, [-most, most])?;
            }
        }
        self.last_impedance = Some(*requested);
        Ok(())
    }
}

/// The limits of one axis or joint.
struct ElementCheck {
    place: u8,
    limits: ElementLimits,
}

impl ElementCheck {
    /// Checks least ≤ value ≤ greatest; a NaN anywhere refuses.
    fn check_range(
        &self,
        kind: ViolationKind,
        value: f64,
        [least, greatest]: [f64; 2],
    ) -> Result<(), Violation> {
        let room = |bound: f64| RELATIVE_TOLERANCE * libm::fabs(bound);
        let limit = match () {
            () if value >= least - room(least) && value <= greatest + room(greatest) => {
                return Ok(());
            }
            () if value < least => least,
            () => greatest,
        };
        Err(Violation {
            kind,
            joint: self.place,
            value,
            limit,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{IMPEDANCE, lwr};
    use std::string::ToString;

    const CARTESIAN: u64 = ControlMode::CartesianImpedance as u64;
    const JOINT: u64 = ControlMode::JointImpedance as u64;

    fn guard() -> Guard {
        let mut guard = Guard::new(lwr().limits, 1e-3).with_impedance(Some(IMPEDANCE));
        guard.first(&[0.0; 7], &[0.0; 7]).expect("at rest");
        guard
    }

    fn soft() -> Impedance {
        IMPEDANCE.default_hold(ControlMode::CartesianImpedance, 7)
    }

    fn refused(change: impl Fn(&mut Impedance)) -> Violation {
        let mut requested = soft();
        change(&mut requested);
        guard()
            .check_impedance(&requested, CARTESIAN, 1e-3)
            .expect_err("out of range")
    }

    #[test]
    fn allowed_set_points_are_accepted() {
        let mut guard = guard();
        assert_eq!(guard.check_impedance(&soft(), CARTESIAN, 1e-3), Ok(()));
        let stiff = IMPEDANCE.default_hold(ControlMode::JointImpedance, 7);
        let mut other = super::tests::guard();
        assert_eq!(other.check_impedance(&stiff, JOINT, 1e-3), Ok(()));
    }

    #[test]
    fn each_element_out_of_its_range_is_refused_with_axis_value_limit_and_unit() {
        for (element, axis) in crate::impedance::AXES.into_iter().enumerate() {
            let most = if element < 3 { 5000.0 } else { 300.0 };
            let unit = if element < 3 { "N/m" } else { "N·m/rad" };
            let violation = refused(|requested| requested.stiffness[element] = most + 1.0);
            assert_eq!(
                (violation.kind, violation.limit, violation.unit()),
                (ViolationKind::Stiffness, most, unit)
            );
            let words = violation.to_string();
            assert!(words.starts_with(&std::format!("axis {axis}: ")), "{words}");
            for wrong in [f64::NAN, 0.0, -1.0] {
                let violation = refused(|requested| requested.stiffness[element] = wrong);
                assert_eq!(violation.kind, ViolationKind::Stiffness);
            }
            for wrong in [0.05, 1.01, f64::INFINITY] {
                let violation = refused(|requested| requested.damping[element] = wrong);
                assert_eq!(violation.kind, ViolationKind::Damping);
            }
            for wrong in [-30.1, 30.1, f64::NAN] {
                let violation = refused(|requested| requested.added[element] = wrong);
                assert_eq!(violation.kind, ViolationKind::Added);
            }
        }
        let mut requested = IMPEDANCE.default_hold(ControlMode::JointImpedance, 7);
        requested.stiffness[6] = 2001.0;
        let violation = guard().check_impedance(&requested, JOINT, 1e-3);
        let words = violation.expect_err("too stiff").to_string();
        assert_eq!(
            words,
            "joint 7: stiffness 2001 N·m/rad is beyond the limit 2000 N·m/rad"
        );
    }

    #[test]
    fn a_stiffness_may_start_anywhere_but_changes_no_faster_than_its_rate() {
        let mut guard = guard();
        let mut requested = soft();
        requested.stiffness[2] = 50.0;
        assert_eq!(guard.check_impedance(&requested, CARTESIAN, 1e-3), Ok(()));
        // At most twice 5000 N/m per second: 10 N/m per millisecond.
        requested.stiffness[2] = 60.0;
        assert_eq!(guard.check_impedance(&requested, CARTESIAN, 1e-3), Ok(()));
        requested.stiffness[2] = 70.1;
        let violation = guard
            .check_impedance(&requested, CARTESIAN, 1e-3)
            .unwrap_err();
        assert_eq!(
            (violation.kind, violation.joint),
            (ViolationKind::StiffnessRate, 10)
        );
        // A refused set-point does not become the reference for the next one.
        requested.stiffness[2] = 50.0;
        assert_eq!(guard.check_impedance(&requested, CARTESIAN, 1e-3), Ok(()));
        guard.first(&[0.0; 7], &[0.0; 7]).unwrap();
        requested.stiffness[2] = 3000.0;
        assert_eq!(guard.check_impedance(&requested, CARTESIAN, 1e-3), Ok(()));
    }

    #[test]
    fn any_strategy_other_than_the_controllers_is_refused() {
        let held = |strategy| IMPEDANCE.default_hold(strategy, 7);
        for (requested, _) in ControlMode::ALL {
            for runs in 0..5 {
                let checked = guard().check_impedance(&held(requested), runs, 1e-3);
                assert_eq!(
                    checked.is_ok(),
                    runs == requested as u64,
                    "{requested:?} {runs}"
                );
            }
        }
        let unknown = Impedance {
            strategy: 4,
            ..soft()
        };
        assert!(guard().check_impedance(&unknown, 4, 1e-3).is_err());
        let violation = guard().check_impedance(&soft(), 0, 1e-3).unwrap_err();
        let words = violation.to_string();
        assert_eq!(
            words,
            "the set-point is for Cartesian impedance control, but the controller runs position control"
        );
    }

    #[test]
    fn an_arm_without_limits_of_impedance_is_commanded_in_position_only() {
        let mut plain = Guard::new(lwr().limits, 1e-3);
        assert_eq!(plain.check_impedance(&Impedance::NONE, 0, 1e-3), Ok(()));
        let violation = plain.check_impedance(&soft(), CARTESIAN, 1e-3).unwrap_err();
        assert_eq!(violation.kind, ViolationKind::Strategy);
    }
}
