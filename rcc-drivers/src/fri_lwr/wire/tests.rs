//! The codec against a captured datagram in each direction, and its errors.
//! Runs in the test harness.

use super::*;

const MSR: &[u8] = include_bytes!(concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../tests/data/fri/cap_lwr.msr"
));
const CMD: &[u8] = include_bytes!(concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../tests/data/fri/cap_lwr.cmd"
));

#[test]
fn a_captured_measurement_survives_decode_and_encode() {
    let datagram = MeasurementDatagram::decode(MSR).unwrap();
    assert_eq!(datagram.encode(), MSR);
}

#[test]
fn a_captured_command_survives_decode_and_encode() {
    let datagram = CommandDatagram::decode(CMD).unwrap();
    assert_eq!(datagram.encode(), CMD);
}

#[test]
fn a_captured_measurement_has_plausible_values() {
    let datagram = MeasurementDatagram::decode(MSR).unwrap();
    assert_eq!(
        (datagram.send_sequence, datagram.reflected_sequence),
        (100, 101)
    );
    assert_eq!(datagram.state, SessionState::Command);
    assert_eq!(datagram.quality, Quality::Perfect);
    assert_eq!(datagram.control, FriControlStrategy::Position);
    assert_eq!(datagram.power, 0x7f);
    assert_eq!(datagram.measurement_period, 0.005);
    assert_eq!(datagram.temperature, [30.0; 7]);
    assert_eq!(datagram.measured_pose[0], 1.0);
    assert!(datagram.measured_position.iter().all(|q| q.abs() < 3.0));
}

#[test]
fn a_captured_command_reflects_the_measurement_and_commands_joints() {
    let measurement = MeasurementDatagram::decode(MSR).unwrap();
    let command = CommandDatagram::decode(CMD).unwrap();
    assert_eq!(command.reflected_sequence, measurement.send_sequence);
    assert_eq!(command.flags, flags::JOINT_POSITION);
    assert_eq!(command.krl.integers[0], 10);
    for joint in 0..JOINTS {
        assert!(
            (command.joint_position[joint] - measurement.measured_position[joint]).abs() < 1e-3
        );
    }
}

#[test]
fn a_wrong_size_is_refused_with_both_sizes() {
    assert_eq!(
        CommandDatagram::decode(&CMD[..375]),
        Err(WireError::Size {
            datagram: "command datagram (CMD)",
            want: 376,
            have: 375
        })
    );
    assert!(matches!(
        MeasurementDatagram::decode(&[]),
        Err(WireError::Size {
            want: 916,
            have: 0,
            ..
        })
    ));
}

#[test]
fn a_wrong_identity_is_refused_with_both_identities() {
    let mut bytes = CMD.to_vec();
    bytes[6] = 6;
    assert!(matches!(
        CommandDatagram::decode(&bytes),
        Err(WireError::Identity {
            want: 0x1005,
            have: 0x1006,
            ..
        })
    ));
}

#[test]
fn a_wrong_packet_size_field_is_refused_with_both_values() {
    let mut bytes = MSR.to_vec();
    bytes[4] = 0;
    assert!(matches!(
        MeasurementDatagram::decode(&bytes),
        Err(WireError::PacketSize {
            want: 916,
            have: 768,
            ..
        })
    ));
}

#[test]
fn an_enumeration_without_a_name_is_a_typed_error() {
    for (offset, field) in [(144, "state"), (146, "quality"), (182, "control")] {
        let mut bytes = MSR.to_vec();
        bytes[offset] = 9;
        assert_eq!(
            MeasurementDatagram::decode(&bytes),
            Err(WireError::UnknownValue { field, value: 9 })
        );
    }
}

#[test]
fn every_byte_belongs_to_exactly_one_field() {
    for (layout, size) in [(MSR_LAYOUT, MSR_SIZE), (CMD_LAYOUT, CMD_SIZE)] {
        let mut owners = vec![0; size];
        for field in layout {
            owners[field.offset..field.offset + field.size]
                .iter_mut()
                .for_each(|owner| *owner += 1);
        }
        assert!(owners.iter().all(|&owner| owner == 1));
    }
}

#[test]
fn krl_booleans_are_counted_from_one() {
    let mut block = KrlBlock::default();
    assert!(block.set_boolean(1, true) && block.set_boolean(16, true));
    assert_eq!(block.booleans, 0x8001);
    assert_eq!(
        (
            block.boolean(16),
            block.boolean(2),
            block.boolean(0),
            block.boolean(17)
        ),
        (Some(true), Some(false), None, None)
    );
    assert!(!block.set_boolean(0, true) && !block.set_boolean(17, true));
    assert!(block.set_boolean(16, false));
    assert_eq!(block.booleans, 1);
}
