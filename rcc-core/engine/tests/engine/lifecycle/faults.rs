//! Nets that end by a fault: of their device, or of a set-point that the guard refuses.

use super::*;
use crate::common::drift_net;

#[test]
fn a_lost_driver_ends_the_net_and_its_return_moves_nothing() {
    let mut fixture = EngineFixture::new();
    let id = fixture.load(line_net());
    fixture.start(id);
    fixture.steps(200);
    fixture.driver.alive = false;
    assert_eq!(fixture.until_terminated(id, 60), EndReason::Fault);
    assert_eq!(fixture.entry(id).fault.code, FaultCode::DeviceLost as u32);
    fixture.driver.alive = true;
    fixture.driver.measurement.state = DeviceState::Ready as u32;
    for _ in 0..100 {
        fixture.step();
        let image = fixture.engine.image(0).unwrap();
        assert_eq!(image.at(image.head.sequence).unwrap().has_position, 0);
    }
}

#[test]
fn a_net_that_survives_the_loss_of_its_arm_goes_on_without_it_until_it_is_canceled() {
    let mut io = model();
    (io.joints, io.arm) = (0, None);
    let mut fixture = EngineFixture::of_cell(vec![model(), io], 5, HOLD);
    let mut plan = TestPlan::new();
    let (requested, on) = (plan.bool(2), plan.bool(1));
    let joints = plan.reals(&HOLD[..7]);
    plan.add("Cancel", &[requested]);
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("DigitalOutput", &[on, 1, 3]);
    plan.add("Termination", &[requested]);
    plan.monitor(Store::Bool, requested, 1, 1);
    plan.data.survives_device_loss = true;
    let id = fixture.load(plan.data);
    fixture.start(id);
    fixture.steps(30);
    assert_eq!(fixture.told().has_position, 1);
    let records = fixture.records().len();
    for state in [
        DeviceState::Online,
        DeviceState::Ready,
        DeviceState::Offline,
    ] {
        // Lost, and then back where the net still commands it: it does not move by itself.
        fixture.driver.measurement.state = state as u32;
        for _ in 0..20 {
            fixture.step();
            assert_eq!(fixture.told().has_position, 0, "{state:?}");
            let image = fixture.engine.image(1).expect("device 1");
            let point = image.at(image.head.sequence).expect("the newest");
            assert_eq!(point.digital_commanded, 1 << 3, "{state:?}");
        }
    }
    assert_eq!(fixture.records().len(), 60, "after {records}");
    fixture.ask(|ticket| EngineRequest::Cancel { ticket, id });
    assert_eq!(fixture.until_terminated(id, 30), EndReason::Canceled);
}

#[test]
fn a_net_that_survives_does_not_command_an_arm_again_that_was_lost_while_it_commanded_null() {
    let mut fixture = EngineFixture::new();
    let mut plan = TestPlan::new();
    let no = plan.bool(0);
    let joints = plan.input(&HOLD[..7], 0).slot;
    plan.add("JointPositionCommand", &[joints, 0, 7]);
    plan.add("Termination", &[no]);
    plan.data.survives_device_loss = true;
    let id = fixture.load(plan.data);
    fixture.start(id);
    fixture.steps(30);
    assert_eq!(fixture.told().has_position, 1);
    fixture.set(id, &[(0, &[f64::NAN; 7])]);
    fixture.steps(20);
    assert_eq!(fixture.told().has_position, 0);
    for state in [DeviceState::Offline, DeviceState::Ready] {
        fixture.driver.measurement.state = state as u32;
        fixture.steps(5);
    }
    fixture.set(id, &[(0, &HOLD[..7])]);
    for _ in 0..20 {
        fixture.step();
        assert_eq!(fixture.told().has_position, 0);
    }
    assert_eq!(fixture.state(id), CommandState::Running);
}

#[test]
fn an_arm_that_a_surviving_net_has_lost_is_free_for_the_next_net() {
    // Its driver says so, or is silent: then the device is offline.
    for silent in [false, true] {
        let mut fixture = EngineFixture::new();
        let mut survivor = drift_net(HOLD[0], 0.0);
        survivor.survives_device_loss = true;
        let old = fixture.load(survivor);
        fixture.start(old);
        fixture.steps(30);
        fixture.driver.alive = !silent;
        fixture.driver.measurement.state = DeviceState::Online as u32;
        fixture.steps(60);
        assert_eq!(fixture.engine.tables().devices[0].holder, 0, "{silent}");
        fixture.driver.alive = true;
        fixture.driver.measurement.state = DeviceState::Ready as u32;
        fixture.steps(5);
        let next = fixture.load(drift_net(HOLD[0], 0.0));
        let taken = fixture.switch(&[old], &[next]);
        assert!(matches!(taken, Answer::Done { .. }), "{taken:?}");
        assert_eq!(fixture.told().has_position, 1, "{silent}");
    }
}

#[test]
fn a_command_does_not_inherit_what_the_one_before_in_its_row_has_lost() {
    let mut fixture = EngineFixture::new();
    let mut survivor = drift_net(HOLD[0], 0.0);
    survivor.survives_device_loss = true;
    let id = fixture.load(survivor);
    fixture.start(id);
    fixture.steps(30);
    fixture.driver.measurement.state = DeviceState::Online as u32;
    fixture.steps(5);
    fixture.ask(|ticket| EngineRequest::Abort { ticket, id });
    fixture.ask(|ticket| EngineRequest::Unload { ticket, id });
    fixture.driver.measurement.state = DeviceState::Ready as u32;
    fixture.steps(5);
    let elsewhere = fixture.load(drift_net(HOLD[0] + 0.1, 0.0));
    let answer = fixture.start(elsewhere);
    assert!(matches!(answer, Answer::Refused(_)), "{answer:?}");
    fixture.ask(|ticket| EngineRequest::Unload {
        ticket,
        id: elsewhere,
    });
    let next = fixture.load(drift_net(HOLD[0], 0.0));
    let answer = fixture.start(next);
    assert!(matches!(answer, Answer::Done { .. }), "{answer:?}");
    assert_eq!(fixture.told().has_position, 1);
}

#[test]
fn a_driver_that_is_replaced_at_once_ends_its_nets_and_nothing_is_commanded_again() {
    let mut fixture = EngineFixture::new();
    let output = fixture.load(output_net(2));
    let line = fixture.load(line_net());
    fixture.start(output);
    fixture.start(line);
    fixture.steps(200);
    fixture.driver.incarnation = 2;
    fixture.driver.measurement.state = DeviceState::Ready as u32;
    for id in [output, line] {
        assert!(fixture.until_terminated(id, 2) == EndReason::Fault);
        assert_eq!(fixture.entry(id).fault.code, FaultCode::DeviceLost as u32);
    }
    for _ in 0..100 {
        fixture.step();
        let image = fixture.engine.image(0).unwrap();
        let newest = image.at(image.head.sequence).unwrap();
        assert_eq!((newest.has_position, newest.digital_commanded), (0, 0));
    }
    assert_eq!(fixture.engine.tables().devices[0].incarnation, 2);
    assert_eq!(fixture.engine.tables().devices[0].losses, 1);
}

#[test]
fn the_tables_show_a_lost_device_in_the_cycle_that_sees_it() {
    let mut fixture = EngineFixture::new();
    fixture.steps(3);
    let mut cycles_until_due = || {
        let due = (1..100).find(|_| {
            fixture.step();
            fixture.engine.tables_due().is_some()
        });
        due.expect("the tables are written from time to time")
    };
    // Directly after a write that time made due, so that the next one is far.
    cycles_until_due();
    assert!(
        cycles_until_due() > 2,
        "unchanged tables are written rarely"
    );
    fixture.driver.alive = false;
    let lost = (0..100).find_map(|_| {
        fixture.step();
        let due = fixture.engine.tables_due().is_some();
        let entry = fixture.engine.tables().devices[0];
        (entry.losses > 0).then_some(due)
    });
    assert_eq!(lost, Some(true));
}

#[test]
fn a_board_with_wrong_magic_or_a_stamp_far_from_now_is_a_lost_device() {
    let mut fixture = EngineFixture::new();
    let good = fixture.driver.measurement;
    let offline = |fixture: &EngineFixture| {
        fixture.engine.tables().devices[0].state == DeviceState::Offline as u32
    };
    let year_ns = 31_557_600_000_000_000;
    for stamp_ns in [
        fixture.now_ns - 60_000_000,
        fixture.now_ns + 60_000_000,
        fixture.now_ns + year_ns,
        0,
        u64::MAX,
    ] {
        let measurement = rcc_core::message::Measurement { stamp_ns, ..good };
        fixture
            .engine
            .latch(0, Some((1, measurement)), fixture.now_ns);
        assert!(offline(&fixture), "stamp {stamp_ns}");
        fixture.step();
        assert!(!offline(&fixture));
    }
    let measurement = rcc_core::message::Measurement {
        magic: 1,
        stamp_ns: fixture.now_ns,
        ..good
    };
    fixture
        .engine
        .latch(0, Some((1, measurement)), fixture.now_ns);
    assert!(offline(&fixture));
}

#[test]
fn a_driver_that_stops_by_itself_ends_the_net() {
    for state in [DeviceState::Stopping, DeviceState::Online] {
        let mut fixture = EngineFixture::new();
        let id = fixture.load(line_net());
        fixture.start(id);
        fixture.steps(200);
        fixture.driver.measurement.state = state as u32;
        fixture.driver.alive = false;
        assert_eq!(fixture.until_terminated(id, 2), EndReason::Fault);
        assert_eq!(fixture.entry(id).fault.code, FaultCode::DeviceLost as u32);
    }
}

#[test]
fn a_set_point_outside_of_the_workspace_ends_the_net_with_axis_place_and_bound() {
    let y = model().arm.unwrap().forward(&HOLD).position[1];
    let mut space = Workspace::ANYWHERE;
    space.upper[1] = y + 0.05;
    let mut fixture = EngineFixture::with(DeviceModel {
        workspace: Some(space),
        ..model()
    });
    let id = fixture.load(line_net());
    fixture.start(id);
    assert_eq!(fixture.until_terminated(id, 5000), EndReason::Fault);
    let fault = fixture.entry(id).fault;
    assert_eq!(fault.code, FaultCode::Limit as u32);
    assert_eq!(fault.violation, ViolationKind::Workspace.number());
    assert_eq!(axis(fault.joint as usize - 1), Some("y"));
    assert_eq!(fault.limit, y + 0.05);
    assert!(
        fault.value > fault.limit && fault.value < fault.limit + 1e-3,
        "{fault:?}"
    );
    let told = fixture.told();
    let last = model().arm.unwrap().forward(&told.position);
    assert!(
        told.has_position == 0 || last.position[1] <= y + 0.05,
        "it never left: {last:?}"
    );
}

#[test]
fn a_set_point_too_near_to_a_singular_position_ends_the_net_with_the_distance() {
    let near = model().arm.unwrap().singularity(&HOLD);
    let mut space = Workspace::ANYWHERE;
    space.singularity_min = near.distance - 0.005;
    let mut fixture = EngineFixture::with(DeviceModel {
        workspace: Some(space),
        ..model()
    });
    let id = fixture.load(line_net());
    fixture.start(id);
    assert_eq!(fixture.until_terminated(id, 5000), EndReason::Fault);
    let fault = fixture.entry(id).fault;
    assert_eq!(fault.violation, ViolationKind::Singularity.number());
    assert_eq!((fault.joint, fault.limit), (0, space.singularity_min));
    assert!(
        fault.value < fault.limit && fault.value > fault.limit - 1e-3,
        "{fault:?}"
    );
}

#[test]
fn a_set_point_beyond_a_limit_ends_the_net_with_joint_value_and_limit() {
    let mut slow = model();
    slow.limits.velocity_max = [0.05; 8];
    let mut fixture = EngineFixture::with(slow);
    // Planned for a faster arm: the guard does not rely on the plan.
    fixture.models[0] = model();
    let id = fixture.load(line_net());
    fixture.start(id);
    assert_eq!(fixture.until_terminated(id, 5000), EndReason::Fault);
    let fault = fixture.entry(id).fault;
    assert_eq!(fault.code, FaultCode::Limit as u32);
    assert!(
        fault.joint >= 1 && fault.value.abs() > fault.limit && fault.limit == 0.05,
        "{fault:?}"
    );
    fixture.step();
    let image = fixture.engine.image(0).unwrap();
    assert_eq!(image.at(image.head.sequence).unwrap().has_position, 0);
}
