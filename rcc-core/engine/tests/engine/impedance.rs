//! Impedance set-points in virtual time: which ones reach the device, and which ones the guard refuses, with which
//! fault.

use crate::common::{EngineFixture, HOLD, TestPlan, drift_net, model};
use rcc_core::frame::DeviceModel;
use rcc_core::guard::{ViolationKind, axis};
use rcc_core::impedance::{ControlMode, Impedance, ImpedanceLimits};
use rcc_core::message::{CommandState, EndReason, FaultCode};
use rcc_engine::net::Net;
use rcc_engine::rehearsal::{RehearsalScene, rehearse};
use rcc_protocol::control::{Answer, PlanData, Refusal};
use rcc_protocol::rehearsal::RehearsalRule;

const CARTESIAN: u64 = ControlMode::CartesianImpedance as u64;

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

/// An arm in Cartesian impedance.
fn fixture() -> EngineFixture {
    let mut fixture = EngineFixture::with(DeviceModel {
        impedance: Some(LIMITS),
        ..model()
    });
    fixture.driver.measurement.strategy = CARTESIAN;
    fixture
}

/// A net that holds the arm with a stiffness of `from` (N/m) along z that changes by `rate` (N/m/s), and a wrench of
/// `fz` (N) along z.
fn soft_net(from: f64, rate: f64, fz: f64) -> PlanData {
    let mut plan = TestPlan::new();
    let no = plan.bool(0);
    let [from, rate, time, way] =
        [from, rate, f64::NAN, f64::NAN].map(|value| plan.reals(&[value]));
    let joints = plan.reals(&HOLD[..7]);
    let stiffness = plan.reals(&[1000.0, 1000.0, f64::NAN]);
    let about = plan.reals(&[100.0; 3]);
    let ratio = plan.reals(&[0.7; 3]);
    let wrench = plan.reals(&[0.0, 0.0, fz, 0.0, 0.0, 0.0]);
    plan.add("Time", &[time]);
    plan.add("Multiply", &[time, rate, way]);
    plan.add("Add", &[from, way, stiffness + 2]);
    let inputs = [joints, stiffness, about, ratio, ratio, wrench, 0, 7];
    plan.add("CartesianImpedanceCommand", &inputs);
    plan.add("Termination", &[no]);
    plan.data
}

fn refused(answer: Answer) -> (u32, f64, f64, ViolationKind) {
    match answer {
        Answer::Refused(Refusal::FirstSetPoint {
            device: 0,
            joint,
            value,
            limit,
            violation,
        }) => {
            let kind = ViolationKind::from_number(violation).expect("a rule");
            (joint, value, limit, kind)
        }
        answer => panic!("not refused: {answer:?}"),
    }
}

#[test]
fn stiffness_and_wrench_are_sent_with_the_position() {
    let mut fixture = fixture();
    let id = fixture.load(soft_net(500.0, 1000.0, -5.0));
    assert!(matches!(fixture.start(id), Answer::Done { .. }));
    fixture.steps(100);
    let told = fixture.told();
    assert_eq!((told.has_position, told.impedance.strategy), (1, CARTESIAN));
    assert_eq!(told.impedance.added[2], -5.0);
    // 1000 N/m/s for 100 ms.
    assert!(
        (told.impedance.stiffness[2] - 600.0).abs() < 1e-6,
        "{told:?}"
    );
    assert_eq!(fixture.state(id), CommandState::Running);
}

#[test]
fn a_net_for_another_strategy_is_refused_and_no_set_point_is_sent() {
    let mut soft = fixture();
    let id = soft.load(drift_net(HOLD[0], 0.0));
    let (joint, value, limit, kind) = refused(soft.start(id));
    assert_eq!((joint, kind), (0, ViolationKind::Strategy));
    assert_eq!((value, limit), (0.0, 1.0));
    assert_eq!(soft.state(id), CommandState::Ready);
    assert_eq!(soft.told().has_position, 0);
    let mut stiff = fixture();
    stiff.driver.measurement.strategy = 0;
    let id = stiff.load(soft_net(500.0, 0.0, 0.0));
    let (_, value, limit, kind) = refused(stiff.start(id));
    assert_eq!((value, limit, kind), (1.0, 0.0, ViolationKind::Strategy));
    assert_eq!(stiff.told().has_position, 0);
    // After the strategy is switched manually, the same net starts.
    stiff.driver.measurement.strategy = CARTESIAN;
    assert!(matches!(stiff.start(id), Answer::Done { .. }));
}

#[test]
fn a_controller_that_changes_its_strategy_ends_the_net() {
    let mut fixture = fixture();
    let id = fixture.load(soft_net(500.0, 0.0, 0.0));
    fixture.start(id);
    fixture.steps(20);
    fixture.driver.measurement.strategy = 2;
    assert_eq!(fixture.until_terminated(id, 2), EndReason::Fault);
    let fault = fixture.entry(id).fault;
    assert_eq!(fault.code, FaultCode::Limit as u32);
    assert_eq!(fault.violation, ViolationKind::Strategy.number());
    assert_eq!((fixture.told().has_position, fault.joint), (0, 0));
}

#[test]
fn an_impedance_out_of_range_is_refused_with_its_axis() {
    for (from, fz, kind, limit) in [
        (5001.0, 0.0, ViolationKind::Stiffness, 5000.0),
        (0.0, 0.0, ViolationKind::Stiffness, 0.01),
        (500.0, -50.5, ViolationKind::Added, -50.0),
    ] {
        let mut fixture = fixture();
        let id = fixture.load(soft_net(from, 0.0, fz));
        let (joint, value, allowed, broken) = refused(fixture.start(id));
        assert_eq!((broken, allowed), (kind, limit));
        assert_eq!(value, if fz == 0.0 { from } else { fz });
        assert_eq!(axis(joint as usize - 1), Some("z"));
    }
}

#[test]
fn a_stiffness_that_changes_faster_than_its_rate_ends_the_net() {
    // The limit is twice the whole range of 5000 N/m per second.
    for (rate, ends) in [(9_990.0, false), (10_010.0, true), (-10_010.0, true)] {
        let mut fixture = fixture();
        let id = fixture.load(soft_net(1000.0, rate, 0.0));
        assert!(matches!(fixture.start(id), Answer::Done { .. }));
        fixture.steps(10);
        assert_eq!(
            fixture.state(id) == CommandState::Terminated,
            ends,
            "{rate}"
        );
        let fault = fixture.entry(id).fault;
        if ends {
            assert_eq!(fault.violation, ViolationKind::StiffnessRate.number());
            assert!((fault.value - rate).abs() < 1e-3, "{fault:?}");
            assert_eq!(axis(fault.joint as usize - 1), Some("z"));
        }
    }
}

#[test]
fn a_hand_over_continues_the_stiffness_too() {
    let mut fixture = fixture();
    let old = fixture.load(soft_net(500.0, 0.0, 0.0));
    fixture.start(old);
    fixture.steps(20);
    let jumps = fixture.load(soft_net(600.0, 0.0, 0.0));
    let Answer::RefusedFor { refusal, .. } = fixture.switch(&[old], &[jumps]) else {
        panic!("not refused")
    };
    let Refusal::Continuation { violation, .. } = refusal else {
        panic!("{refusal:?}")
    };
    assert_eq!(violation, ViolationKind::StiffnessRate.number());
    assert_eq!(fixture.state(old), CommandState::Running);
    let goes_on = fixture.load(soft_net(505.0, 0.0, 0.0));
    let handed = fixture.switch(&[old], &[goes_on]);
    assert!(matches!(handed, Answer::Done { .. }), "{handed:?}");
    assert_eq!(fixture.told().impedance.stiffness[2], 505.0);
}

#[test]
fn a_null_wrench_releases_the_arm() {
    let mut fixture = fixture();
    let id = fixture.load(soft_net(500.0, 0.0, f64::NAN));
    fixture.start(id);
    fixture.steps(5);
    assert_eq!(fixture.state(id), CommandState::Running);
    let told = fixture.told();
    assert_eq!((told.has_position, told.impedance), (0, Impedance::NONE));
}

/// The violation that a rehearsal predicts for a net: kind, axis, value and time (s).
fn foreseen(plan: PlanData) -> Option<(ViolationKind, &'static str, f64, f64)> {
    let models = [DeviceModel {
        impedance: Some(LIMITS),
        ..model()
    }];
    let mut net = Net::build(plan, &models, 5, &[Some(HOLD)], 1e-3).expect("a good plan");
    let scene = RehearsalScene {
        models: &models,
        devices: &[],
        holds: &[Some(HOLD)],
        values: &[],
        dt_s: 1e-3,
    };
    match rehearse(&mut net, &scene) {
        Ok(_) => None,
        Err(Refusal::Foreseen(foreseen)) => {
            let RehearsalRule::Impedance { kind } = foreseen.rule else {
                panic!("{foreseen:?}");
            };
            let axis = axis(foreseen.joint as usize - 1).expect("an axis");
            let kind = ViolationKind::from_number(kind).expect("a rule");
            Some((kind, axis, foreseen.value, foreseen.time_s))
        }
        Err(other) => panic!("{other:?}"),
    }
}

#[test]
fn a_rehearsal_predicts_the_violations_that_the_guard_would_refuse() {
    assert_eq!(foreseen(soft_net(500.0, 0.0, -5.0)), None);
    let (kind, axis, value, time_s) = foreseen(soft_net(500.0, 0.0, 60.0)).expect("a refusal");
    assert_eq!(
        (kind, axis, value, time_s),
        (ViolationKind::Added, "z", 60.0, 0.0)
    );
    let (kind, axis, value, time_s) = foreseen(soft_net(9000.0, 0.0, 0.0)).expect("a refusal");
    assert_eq!(
        (kind, axis, value, time_s),
        (ViolationKind::Stiffness, "z", 9000.0, 0.0)
    );
    // The limit is twice the greatest stiffness per second, 10,000 N/m/s.
    let (kind, axis, value, time_s) = foreseen(soft_net(500.0, 20_000.0, 0.0)).expect("a refusal");
    assert_eq!(
        (kind, axis, time_s),
        (ViolationKind::StiffnessRate, "z", 1e-3)
    );
    assert!((value - 20_000.0).abs() < 1e-3, "{value}");
    // 5000 N/m is the greatest stiffness.
    let (kind, axis, value, time_s) = foreseen(soft_net(4500.0, 5000.0, 0.0)).expect("a refusal");
    assert_eq!((kind, axis), (ViolationKind::Stiffness, "z"));
    assert!(
        (0.1..0.102).contains(&time_s) && value > 5000.0,
        "{time_s} s, {value}"
    );
}
