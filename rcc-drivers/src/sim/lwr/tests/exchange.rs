//! Datagrams on the wire: counters, variables, forces, and their trace.
//! Runs in the test harness.

use super::*;
use crate::sim::arm::dynamics::{GRAVITY, gravity_torque};
use crate::sim::lwr::model::LWR_4_PLUS;

#[test]
fn wrong_datagrams_are_counted_and_change_nothing() {
    let mut pc = Pc::commanding(Settings::default());
    let good = pc.mirror();
    let good_bytes = good.encode();
    let receive = |pc: &mut Pc, bytes: &[u8]| pc.krc.receive(bytes, 1e-4).is_ok();
    assert!(!receive(&mut pc, &good_bytes[..375]));
    let mut other_id = good_bytes;
    other_id[6] ^= 1;
    assert!(!receive(&mut pc, &other_id));
    let late = CommandDatagram {
        reflected_sequence: good.reflected_sequence.wrapping_sub(1),
        ..good
    };
    assert!(!receive(&mut pc, &late.encode()));
    let backward = CommandDatagram {
        send_sequence: good.send_sequence.wrapping_sub(9),
        ..good
    };
    assert!(!receive(&mut pc, &backward.encode()));
    assert!(receive(&mut pc, &good_bytes) && !receive(&mut pc, &good_bytes));
    pc.krc.receive_foreign();
    pc.continue_through_stall(1);
    let counts = pc.krc.counts;
    assert_eq!(
        (
            counts.wrong_size,
            counts.wrong_identity,
            counts.late,
            counts.duplicate,
            counts.foreign
        ),
        (1, 1, 1, 2, 1)
    );
    assert_eq!(
        (pc.state(), pc.krc.fault, counts.missed),
        (SessionState::Command, None, 0)
    );
}

#[test]
fn the_counters_wrap_without_a_miss() {
    let mut pc = Pc::new(Settings::default());
    pc.sequence = 65_000;
    pc.mirror_for(66_000);
    assert_eq!((pc.krc.counts.missed, pc.krc.counts.faults), (0, 0));
    assert_eq!(pc.state(), SessionState::Command);
    assert_eq!(pc.seen.send_sequence, 66_001_u32 as u16);
    assert_eq!(pc.seen.reflected_sequence, pc.sequence);
}

#[test]
fn a_wall_pushes_the_tool_and_is_sent_in_kukas_order() {
    let mut pc = Pc::new(Settings::default());
    let [x, y, z] = pc.krc.robot.geometry.position;
    pc.execute(&format!(
        r#"{{"wall":{{"point":[{x},{y},{}],"normal":[0,0,1],"stiffness":5000}}}}"#,
        z + 0.002
    ));
    pc.mirror_for(1);
    assert!((pc.seen.external_tcp_wrench[2] - 10.0).abs() < 1e-3);
    pc.execute(r#"{"wall":null}"#);
    pc.execute(r#"{"wrench":{"force":[1,2,3],"torque":[4,5,6]}}"#);
    pc.mirror_for(1);
    assert_eq!(pc.seen.external_tcp_wrench, [1.0, 2.0, 3.0, 6.0, 5.0, 4.0]);
    let power: f64 = pc
        .krc
        .robot
        .geometry
        .joint_torque(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])[0];
    assert!((f64::from(pc.seen.external_torque[0]) - power).abs() < 1e-5);
}

#[test]
fn torques_contain_the_weight_of_the_links_and_external_ones_that_of_a_load() {
    let mut pc = Pc::new(Settings::default());
    pc.mirror_for(1);
    assert_eq!(pc.seen.external_torque, [0.0; JOINTS]);
    let weight = gravity_torque(&LWR_4_PLUS, &pc.krc.robot.arm.position);
    assert!(weight[1].abs() > 5.0, "{weight:?}");
    for joint in 0..JOINTS {
        let torque = f64::from(pc.seen.measured_torque[joint]);
        assert!((torque - weight[joint]).abs() < 1e-4, "{torque} {weight:?}");
        assert!((f64::from(pc.seen.gravity[joint]) - weight[joint]).abs() < 1e-4);
    }
    pc.execute(r#"{"load":{"mass":2}}"#);
    pc.mirror_for(1);
    assert!((f64::from(pc.seen.external_tcp_wrench[2]) + 2.0 * GRAVITY).abs() < 1e-4);
    let external = pc.krc.robot.geometry.joint_torque(&pc.krc.robot.wrench);
    assert!((f64::from(pc.seen.external_torque[1]) - external[1]).abs() < 1e-4);
    let both = external[1] + weight[1];
    assert!((f64::from(pc.seen.measured_torque[1]) - both).abs() < 1e-4);
    pc.execute(r#"{"load":null}"#);
    pc.mirror_for(1);
    assert_eq!(pc.seen.external_torque, [0.0; JOINTS]);
}

#[test]
fn krl_variables_are_latched_and_wired_back() {
    let wires = Settings {
        boolean_wires: vec![KrlLoopback { from: 1, to: 3 }],
        real_wires: vec![KrlLoopback { from: 16, to: 2 }],
        ..Settings::default()
    };
    let mut pc = Pc::new(wires);
    let mut answer = pc.mirror();
    answer.krl.set_boolean(1, true);
    answer.krl.reals[15] = 2.5;
    pc.answer(&answer);
    pc.miss();
    assert_eq!(
        (pc.seen.krl.boolean(3), pc.seen.krl.reals[1]),
        (Some(true), 2.5)
    );
    assert_eq!(pc.krc.from_pc.boolean(1), Some(true));
    pc.execute(r#"{"set_bool":{"number":5,"value":true}}"#);
    pc.mirror_for(1);
    assert_eq!(
        (pc.seen.krl.boolean(5), pc.seen.krl.boolean(3)),
        (Some(true), Some(false))
    );
}

#[test]
fn a_withheld_datagram_is_not_sent_and_its_answer_is_missed() {
    let mut pc = Pc::moving(Settings::default(), 0.5);
    pc.execute(r#"{"freeze_ms":20}"#);
    let sent = pc.krc.counts.sent;
    (0..20).for_each(|_| pc.miss());
    assert_eq!((pc.krc.counts.sent, pc.krc.counts.withheld), (sent, 20));
    assert_eq!(pc.krc.fault, Some(KrcFault::Lost { misses: 6 }));
    pc.miss();
    assert_eq!(pc.krc.counts.sent, sent + 1);
}

#[test]
fn dropped_answers_count_as_missed() {
    let mut pc = Pc::new(Settings::default());
    pc.execute(r#"{"drop":{"percent":25}}"#);
    pc.mirror_for(4000);
    let counts = pc.krc.counts;
    assert_eq!(counts.dropped, counts.missed);
    assert!((800..1200).contains(&counts.dropped), "{}", counts.dropped);
}

#[test]
fn a_trace_record_pairs_a_measurement_with_its_answer() {
    let mut pc = Pc::commanding(Settings::default());
    let mut answer = pc.mirror();
    answer.krl.booleans = 0x21;
    let seen = pc.seen;
    pc.answer(&answer);
    let record = pc.krc.exchanged().unwrap();
    assert_eq!(
        (
            record.sequence,
            record.booleans,
            record.state,
            record.answered
        ),
        (u32::from(seen.send_sequence), 0x21, 2, true)
    );
    assert_eq!(record.commanded, answer.joint_position.map(f64::from));
    assert_eq!(record.measured.map(|q| q as f32), seen.measured_position);
    pc.miss();
    let record = pc.krc.exchanged().unwrap();
    assert!(!record.answered && record.commanded[0].is_nan() && record.booleans == 0x21);
}

#[test]
fn a_program_announces_its_end_and_closes() {
    let mut pc = Pc::commanding(Settings::default());
    pc.execute(r#"{"quit":null}"#);
    pc.mirror_for(1);
    assert_eq!(
        (pc.seen.krl.integers[0], pc.state()),
        (-1, SessionState::Monitor)
    );
    pc.mirror_for(30);
    assert!(pc.krc.is_closed());
}
