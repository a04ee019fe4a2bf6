//! Captured messages byte for byte, frames, and whatever else may arrive.

use super::schema::{CommandData, Connection, Header};
use super::*;

const MONITORING_1_15: &[u8] = include_bytes!("../../../../tests/data/fri/cap_v1_15.mon");
const COMMAND_1_15: &[u8] = include_bytes!("../../../../tests/data/fri/cap_v1_15.cmd");
const MONITORING_2_7: &[u8] = include_bytes!("../../../../tests/data/fri/cap_v2_7.mon");
const COMMAND_2_7: &[u8] = include_bytes!("../../../../tests/data/fri/cap_v2_7.cmd");

fn again<M: FriMessage>(version: Version, bytes: &[u8]) -> Vec<u8> {
    let message: M = decode(version, bytes).expect("a captured message");
    encode(version, &message).expect("it fits")
}

#[test]
fn captured_messages_are_written_as_they_were_read() {
    let (first, second) = (Version::V1_14, Version::V2_7);
    assert_eq!(again::<Monitoring>(first, MONITORING_1_15), MONITORING_1_15);
    assert_eq!(again::<Command>(first, COMMAND_1_15), COMMAND_1_15);
    assert_eq!(again::<Monitoring>(second, MONITORING_2_7), MONITORING_2_7);
    assert_eq!(again::<Command>(second, COMMAND_2_7), COMMAND_2_7);
}

/// The expected values were read from the bytes by hand, with the table of the protocol.
#[test]
fn a_captured_message_has_the_values_of_its_bytes() {
    let message: Monitoring = decode(Version::V1_14, MONITORING_1_15).expect("a captured message");
    let header = message.header.expect("required");
    assert_eq!((header.sequence, header.reflected), (Some(100), Some(99)));
    let robot = message.robot.expect("sent");
    assert_eq!(
        (robot.joints, robot.drives.as_slice()),
        (Some(7), [2; 7].as_slice())
    );
    assert_eq!((robot.operation, robot.control), (Some(2), Some(0)));
    let connection = message.connection.expect("required");
    let session = connection.session.and_then(SessionState::from_wire);
    assert_eq!(session, Some(SessionState::CommandingActive));
    let quality = connection.quality.and_then(Quality::from_wire);
    assert_eq!(quality, Some(Quality::Excellent));
    assert_eq!(
        (connection.send_period_ms, connection.receive_multiplier),
        (Some(5), Some(1))
    );
    let data = message.data.expect("sent");
    let positions = data.measured_position.expect("sent").value;
    let quarter = std::f64::consts::FRAC_PI_2;
    assert_eq!(
        (positions[0], positions[1], positions[5]),
        (quarter, 0.0, -quarter)
    );
    let torques = data.measured_torque.expect("sent").value;
    assert_eq!((torques[1], torques[5]), (0.1, 0.5));
    let interpolator = message.interpolator.expect("sent while commanding");
    let mode = interpolator
        .command_mode
        .and_then(ClientCommandMode::from_wire);
    assert_eq!(mode, Some(ClientCommandMode::JointPosition));
    let overlay = interpolator.overlay.and_then(Overlay::from_wire);
    assert_eq!(overlay, Some(Overlay::Joint));
    assert_eq!(interpolator.tracking_performance, Some(1.0));
}

fn header_only(sequence: u32) -> Command {
    Command {
        header: Some(Header {
            identifier: Some(COMMAND_ID),
            sequence: Some(sequence),
            reflected: Some(100),
        }),
        ..Command::default()
    }
}

/// The expected bytes are those of KUKA's client SDK.
#[test]
fn a_command_without_data_is_its_header_and_from_2_7_on_its_frame() {
    let body = [0x0a, 8, 8, 0x81, 0x80, 0x0d, 0x10, 0x64, 0x18, 0x64];
    for version in [Version::V1_11, Version::V1_14, Version::V2_5] {
        assert_eq!(encode(version, &header_only(100)).expect("it fits"), body);
    }
    let framed = encode(Version::V2_7, &header_only(100)).expect("it fits");
    let crc = [0x46, 0x79, 0xd7, 0x83];
    assert_eq!(framed, [[10, 0, 0, 0].as_slice(), &body, &crc].concat());
}

#[test]
fn a_counter_of_0_is_written_and_a_missing_one_is_refused() {
    let bytes = encode(Version::V1_14, &header_only(0)).expect("it fits");
    let read: Command = decode(Version::V1_14, &bytes).expect("its own bytes");
    assert_eq!(read.header.and_then(|header| header.sequence), Some(0));
    let mut without = header_only(0);
    without.header.as_mut().expect("set above").sequence = None;
    let bytes = encode(Version::V1_14, &without).expect("it fits");
    let error = decode::<Command>(Version::V1_14, &bytes);
    assert_eq!(error, Err(WireError::Missing("sequence")));
}

#[test]
fn the_other_frame_and_the_other_message_are_told() {
    let bare = decode::<Monitoring>(Version::V2_7, MONITORING_1_15).expect_err("no frame");
    assert!(bare.to_string().contains("speaks FRI 1.x or 2.5"), "{bare}");
    let framed = decode::<Monitoring>(Version::V1_14, MONITORING_2_7).expect_err("a frame");
    assert!(framed.to_string().contains("speaks FRI 2.7"), "{framed}");
    let error = decode::<Monitoring>(Version::V1_14, COMMAND_1_15);
    let (want, have) = (MONITORING_ID, COMMAND_ID);
    assert_eq!(error, Err(WireError::Identity { want, have }));
}

#[test]
fn a_frame_with_a_wrong_length_or_checksum_is_refused_whichever_bit_is_wrong() {
    for bit in 0..COMMAND_2_7.len() * 8 {
        let mut bytes = COMMAND_2_7.to_vec();
        bytes[bit / 8] ^= 1 << (bit % 8);
        let error = decode::<Command>(Version::V2_7, &bytes).expect_err("one bit is wrong");
        let known = matches!(error, WireError::Length { .. } | WireError::Checksum { .. });
        assert!(known, "bit {bit}: {error}");
    }
}

#[test]
fn a_truncated_frame_is_refused_at_every_length() {
    for length in 0..MONITORING_2_7.len() {
        let cut = &MONITORING_2_7[..length];
        assert!(
            decode::<Monitoring>(Version::V2_7, cut).is_err(),
            "{length}"
        );
    }
}

#[test]
fn lists_of_a_wrong_length_are_refused_by_name() {
    let joints = |count| {
        Some(JointValues {
            value: vec![0.5; count],
        })
    };
    let io = |count| vec![named("FRI.Out"); count];
    let rows = [
        (
            CommandData {
                position: joints(6),
                ..CommandData::default()
            },
            "position",
        ),
        (
            CommandData {
                torque: joints(8),
                ..CommandData::default()
            },
            "torque",
        ),
        (
            CommandData {
                io: io(11),
                ..CommandData::default()
            },
            "io",
        ),
        (
            CommandData {
                io: vec![named(&"x".repeat(64))],
                ..CommandData::default()
            },
            "io.name",
        ),
        (
            CommandData {
                wrench: Some(schema::CartesianVector {
                    element: vec![0.0; 5],
                }),
                ..CommandData::default()
            },
            "wrench",
        ),
        (
            CommandData {
                transformations: vec![Transformation::default(); 6],
                ..CommandData::default()
            },
            "transformations",
        ),
    ];
    for (data, name) in rows {
        let command = Command {
            data: Some(data),
            ..header_only(1)
        };
        let bytes = encode(Version::V2_5, &command).expect("it fits");
        let error = decode::<Command>(Version::V2_5, &bytes).expect_err(name);
        assert!(
            matches!(error, WireError::Count { field, .. } if field == name),
            "{error}"
        );
    }
}

fn named(name: &str) -> IoValue {
    IoValue {
        name: Some(name.to_owned()),
        kind: Some(IoKind::Boolean as i32),
        direction: Some(IoDirection::Output as i32),
        digital: Some(1),
        analog: None,
    }
}

#[test]
fn a_session_without_state_is_refused() {
    let mut message: Monitoring = decode(Version::V1_14, MONITORING_1_15).expect("captured");
    message.connection = Some(Connection {
        session: None,
        ..message.connection.expect("sent")
    });
    let bytes = encode(Version::V1_14, &message).expect("it fits");
    let error = decode::<Monitoring>(Version::V1_14, &bytes);
    assert_eq!(error, Err(WireError::Missing("session")));
}

#[test]
fn any_bytes_are_refused_or_read_but_never_a_panic() {
    let mut random = fastrand::Rng::with_seed(1);
    let originals = [MONITORING_1_15, COMMAND_1_15, MONITORING_2_7, COMMAND_2_7];
    let mut refused = 0;
    for _ in 0..100_000 {
        let mut bytes = originals[random.usize(..4)].to_vec();
        bytes.truncate(random.usize(1..=bytes.len()));
        for _ in 0..random.usize(..4) {
            let place = random.usize(..bytes.len());
            bytes[place] = random.u8(..);
        }
        for version in [Version::V1_14, Version::V2_7] {
            refused += usize::from(decode::<Monitoring>(version, &bytes).is_err());
            refused += usize::from(decode::<Command>(version, &bytes).is_err());
        }
    }
    assert!((100_000..400_000).contains(&refused), "{refused}");
    assert_eq!(
        decode::<Command>(Version::V2_7, &[0; DATAGRAM_MAX + 1]),
        Err(WireError::Size(DATAGRAM_MAX + 1))
    );
}

#[test]
fn versions_have_the_names_of_configurations() {
    assert_eq!("1.16".parse(), Ok(Version::V1_14));
    assert_eq!("2.7".parse(), Ok(Version::V2_7));
    assert_eq!("3.0".parse::<Version>(), Err(()));
}
