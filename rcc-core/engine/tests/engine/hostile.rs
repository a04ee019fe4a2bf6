//! A driver that writes arbitrary data to its board can end the nets of its own device, and do nothing else. In virtual
//! time; the engine receives the values as it would from a board.

use crate::common::{EngineFixture, HOLD, PERIOD_NS, TestPlan, line_net, model, output_net};
use bytemuck::Zeroable;
use rcc_core::message::{
    CommandState, DeviceState, EndReason, FaultCode, MAGIC, Measurement, SET_POINTS, SetPoint,
};
use rcc_core::types::Store;
use rcc_testing::Rng;

/// Corrupts a valid measurement.
type Corruption = fn(&mut Measurement);

/// Values that no correct driver writes.
const INVALID: [(&str, Corruption); 12] = [
    ("another layout", |m| m.magic ^= 1),
    ("never written", |m| *m = Measurement::zeroed()),
    ("all bits set", |m| bytemuck::bytes_of_mut(m).fill(0xff)),
    ("an old stamp", |m| m.stamp_ns -= 51_000_000),
    ("a stamp of 0", |m| m.stamp_ns = 0),
    ("a stamp in the future", |m| m.stamp_ns += 51_000_000),
    ("the greatest stamp", |m| m.stamp_ns = u64::MAX),
    ("an invalid state", |m| m.state = 99),
    ("no joints", |m| m.joints = 0),
    ("too many joints", |m| m.joints = u32::MAX),
    ("a sequence number that went back", |m| m.sequence -= 2),
    ("a hold set-point of NaN", |m| m.hold[3] = f64::NAN),
];

fn newest(fixture: &EngineFixture, device: usize) -> SetPoint {
    let image = fixture.engine.image(device).expect("a device");
    *image.at(image.head.sequence).expect("the newest")
}

/// Runs one cycle in which the arm's board holds `measurement`.
fn cycle_with(fixture: &mut EngineFixture, measurement: Measurement) {
    fixture.now_ns += PERIOD_NS;
    fixture
        .engine
        .latch(0, Some((1, measurement)), fixture.now_ns);
    for (index, other) in fixture.others.iter_mut().enumerate() {
        other.stamp_ns = fixture.now_ns;
        other.sequence += 1;
        fixture
            .engine
            .latch(index + 1, Some((2, *other)), fixture.now_ns);
    }
    fixture.engine.cycle(fixture.now_ns);
    fixture.engine.account(0, 1000, 0);
}

fn fresh(fixture: &EngineFixture) -> Measurement {
    let mut measurement = fixture.driver.measurement;
    measurement.stamp_ns = fixture.now_ns + PERIOD_NS;
    measurement.sequence += 1;
    measurement
}

#[test]
fn an_implausible_board_loses_its_device_and_nothing_else() {
    for (words, corrupt) in INVALID {
        let mut io = model();
        (io.joints, io.arm) = (0, None);
        let mut fixture = EngineFixture::of_cell(vec![model(), io], 5, HOLD);
        let arm = fixture.load(line_net());
        let mut other = output_net(1);
        // The same net on the second device.
        other.operands[2] = 1;
        let other = fixture.load(other);
        fixture.start(other);
        fixture.start(arm);
        fixture.steps(30);
        assert_eq!(fixture.state(arm), CommandState::Running, "{words}");
        let mut measurement = fresh(&fixture);
        corrupt(&mut measurement);
        cycle_with(&mut fixture, measurement);
        assert_eq!(
            fixture.engine.tables().devices[0].state,
            DeviceState::Offline as u32,
            "{words}"
        );
        assert_eq!(fixture.reason(arm), EndReason::Fault, "{words}");
        assert_eq!(
            fixture.entry(arm).fault.code,
            FaultCode::DeviceLost as u32,
            "{words}"
        );
        assert_eq!(newest(&fixture, 0).has_position, 0, "{words}");
        assert_eq!(fixture.state(other), CommandState::Running, "{words}");
        assert_eq!(newest(&fixture, 1).digital_commanded, 0b10, "{words}");
    }
}

#[test]
fn a_sequence_that_goes_backwards_loses_the_device_until_the_driver_restarts() {
    let mut fixture = EngineFixture::new();
    fixture.steps(10);
    let mut measurement = fresh(&fixture);
    measurement.sequence = 3;
    for _ in 0..3 {
        measurement.stamp_ns = fixture.now_ns + PERIOD_NS;
        measurement.sequence += 1;
        cycle_with(&mut fixture, measurement);
        assert_eq!(
            fixture.engine.tables().devices[0].state,
            DeviceState::Offline as u32
        );
    }
    fixture.driver.incarnation = 9;
    fixture.driver.measurement.sequence = 0;
    fixture.steps(2);
    assert_eq!(
        fixture.engine.tables().devices[0].state,
        DeviceState::Ready as u32
    );
}

#[test]
fn a_measured_value_that_is_not_finite_is_null() {
    for value in [f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
        let mut fixture = EngineFixture::new();
        let mut plan = TestPlan::new();
        let no = plan.bool(0);
        let [fx, fy, fz, tx, ty, tz] = [(); 6].map(|()| plan.reals(&[f64::NAN]));
        let wrench = plan.reals(&[f64::NAN; 6]);
        plan.add("ForceTorque", &[fx, fy, fz, tx, ty, tz, wrench, 0]);
        plan.add("Termination", &[no]);
        plan.monitor(Store::Real, fz, 1, 1);
        let id = fixture.load(plan.data);
        fixture.start(id);
        let mut measurement = fresh(&fixture);
        measurement.wrench = [1.0, value, 3.0, 4.0, 5.0, 6.0];
        fixture.records();
        cycle_with(&mut fixture, measurement);
        let record = fixture.records().pop().expect("a record");
        assert!(record.values[0].is_nan(), "{value}");
        assert_eq!(fixture.state(id), CommandState::Running);
    }
}

/// Random bytes, with valid values in some fields.
fn random_measurement(random: &mut Rng, honest: &Measurement) -> Measurement {
    let mut measurement = Measurement::zeroed();
    random.fill(bytemuck::bytes_of_mut(&mut measurement));
    let valid = random.u64(..);
    if valid & 63 != 0 {
        (measurement.magic, measurement.stamp_ns) = (MAGIC, honest.stamp_ns);
        (measurement.joints, measurement.sequence) = (honest.joints, honest.sequence);
    }
    measurement.state = honest.state;
    if valid & 0xf00 == 0 {
        measurement.state = random.u32(..6);
    }
    if valid & 0x1f_0000 != 0 {
        measurement.strategy = honest.strategy;
    }
    if valid & 0x7000 != 0 {
        measurement.hold = honest.hold;
    } else if valid & 0x8000 != 0 {
        measurement.hold = measurement
            .hold
            .map(|value| (value.to_bits() % 6283) as f64 * 1e-3 - std::f64::consts::PI);
    }
    measurement
}

#[test]
fn with_any_board_content_set_points_keep_the_limits_and_the_engine_continues() {
    let limits = model().limits;
    let (mut moved, mut random) = (0_u32, Rng::with_seed(20_261_121));
    for _ in 0..300 {
        let mut fixture = EngineFixture::new();
        let id = fixture.load(line_net());
        fixture.start(id);
        fixture.steps(1 + random.usize(..40));
        let mut before = newest(&fixture, 0);
        for _ in 0..100 {
            let mut honest = fresh(&fixture);
            // The arm seems to follow, so that the net continues while the rest of the board is random.
            honest.hold = before.position;
            let measurement = random_measurement(&mut random, &honest);
            fixture.driver.measurement.sequence = honest.sequence;
            cycle_with(&mut fixture, measurement);
            let now = newest(&fixture, 0);
            if now.has_position == 1 {
                moved += 1;
                for joint in 0..limits.joints {
                    let value = now.position[joint];
                    assert!(value.is_finite());
                    assert!((limits.lower[joint]..=limits.upper[joint]).contains(&value));
                    if before.has_position == 1 && before.owner == now.owner {
                        let step = (value - before.position[joint]).abs();
                        assert!(
                            step <= limits.velocity_max[joint] * 1e-3 * 1.000_001,
                            "{step}"
                        );
                    }
                }
            }
            before = now;
        }
        let image = fixture.engine.image(0).expect("the arm");
        assert_eq!(image.head.sequence, fixture.engine.status().cycle);
        assert_eq!(image.set_points.len(), SET_POINTS);
    }
    assert!(moved > 100, "too few random cycles moved the arm: {moved}");
}
