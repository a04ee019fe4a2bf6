//! Handshakes, sparse headers, and the channels of KRL variables and of the controller's model.
//! Runs in the test harness.

use rcc_core::impedance::ControlMode;
use rcc_core::primitive::ChannelKind;
use serde_json::{Value, json};

use super::*;
use crate::drivers::fri_lwr::plausibility::Implausibility;
use crate::sim::arm::impedance::ControlLaw;
use crate::sim::lwr::settings::KrlProgram;

/// Returns the LWR of the demo with this one analog channel.
fn with_channel(kind: ChannelKind, address: Value) -> DeviceConfig {
    let mut device = lwr();
    let output = |channel: &&rcc_config::ChannelConfig| channel.kind == ChannelKind::AnalogOutput;
    let mut channel = device.channels.iter().find(output).expect("one").clone();
    (channel.kind, channel.address, channel.index) = (kind, address, 0);
    (channel.scale, channel.offset, channel.range) = (1.0, 0.0, Some([-1e6, 1e6]));
    device.channels = vec![channel];
    device
}

fn session_with(device: &DeviceConfig, settings: SessionSettings) -> FriSession {
    FriSession::new(device, settings).expect("a good configuration")
}

/// Returns the first analog input after one datagram.
fn first_input(address: Value, measured: &MeasurementDatagram) -> f64 {
    let device = with_channel(ChannelKind::AnalogInput, address);
    let mut session = session_with(&device, SessionSettings::default());
    assert!(session.accept(&measured.encode()));
    let mut inputs = Inputs::NONE;
    session.exchange(&mut inputs);
    inputs.analog[0]
}

#[test]
fn driver_and_program_agree_by_each_convention_and_the_strategy_is_the_one_asked_for() {
    let rows = [
        (KrlConvention::FirstApp, KrlProgram::FirstApp),
        (KrlConvention::Stanford, KrlProgram::Stanford),
        (KrlConvention::Centro, KrlProgram::Centro),
    ];
    let modes = [
        (ControlMode::Position, ControlLaw::JointImpedance),
        (ControlMode::JointImpedance, ControlLaw::Position),
        (ControlMode::CartesianImpedance, ControlLaw::Position),
    ];
    for (krl, script) in rows {
        for (strategy, before) in modes {
            let mut bench = FriFixture::new();
            bench.krc = Krc::new(KrcSettings {
                script,
                strategy: before,
                ..KrcSettings::default()
            });
            let settings = SessionSettings {
                krl,
                strategy: Some(strategy),
                ..SessionSettings::default()
            };
            bench.fri = session_with(&lwr(), settings);
            bench.wait_for(DeviceState::Ready);
            assert_eq!(bench.measured().strategy, strategy as u64, "{krl:?}");
            bench.fri.release();
            for _ in 0..10 {
                bench.cycle(SetPoint::NONE);
            }
            assert_ne!(bench.state(), DeviceState::Ready, "{krl:?}");
            assert_eq!(bench.faults(), 0);
        }
    }
}

/// For `centro` the integer of `Present` is that of `Stop`.
#[test]
fn a_connection_that_becomes_poor_does_not_end_command_mode() {
    for (krl, start) in [
        (KrlConvention::FirstApp, 10),
        (KrlConvention::Stanford, 10),
        (KrlConvention::Centro, 1),
    ] {
        let settings = SessionSettings {
            krl,
            ..SessionSettings::default()
        };
        let mut session = session_with(&lwr(), settings);
        let place = krl.handshake().expect("it has requests").request - 1;
        let mut request_after = |sequence, quality, state| {
            let datagram = MeasurementDatagram {
                quality,
                state,
                ..measurement(sequence)
            };
            session.accept(&datagram.encode());
            let answer = session.answer(&Outputs::NONE);
            CommandDatagram::decode(&answer)
                .expect("our own bytes")
                .krl
                .integers[place]
        };
        for sequence in 1..=5 {
            request_after(sequence, Quality::Perfect, SessionState::Command);
        }
        let qualities = [Quality::Bad, Quality::Unacceptable, Quality::Perfect];
        for (quality, sequence) in qualities.into_iter().zip(6..) {
            let request = request_after(sequence, quality, SessionState::Command);
            assert_eq!(request, start, "{krl:?} {quality:?}");
        }
        // The second datagram confirms that the controller has left command state.
        request_after(10, Quality::Bad, SessionState::Monitor);
        let request = request_after(11, Quality::Bad, SessionState::Monitor);
        assert_ne!(request, start, "{krl:?}");
    }
}

#[test]
fn a_header_that_is_not_filled_in_is_accepted_only_if_the_settings_say_so() {
    let mut bytes = measurement(1).encode();
    bytes[4..8].fill(0);
    assert!(!session().accept(&bytes));
    let settings = SessionSettings {
        header: HeaderRule::Sparse,
        ..SessionSettings::default()
    };
    let mut sparse = session_with(&lwr(), settings);
    assert!(sparse.accept(&bytes));
    assert!(sparse.accept(&measurement(2).encode()), "a filled one too");
    let mut other = measurement(3).encode();
    other[6] = 9;
    assert!(
        !sparse.accept(&other),
        "another identity is another version"
    );
}

#[test]
fn a_sample_time_that_varies_around_its_mean_does_not_disturb_command_mode() {
    let mut session = session();
    for sequence in 1..=2000_u16 {
        let varying = MeasurementDatagram {
            measurement_period: 0.001 + 0.000_08 * (f32::from(sequence % 3) - 1.0),
            ..measurement(sequence)
        };
        assert!(session.accept(&varying.encode()), "{sequence}");
    }
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    assert!(exchange.commandable);
    assert_eq!((exchange.period_ns, exchange.refused), (MS, 0));
}

#[test]
fn a_doubt_is_told_by_its_cause() {
    let good = measurement(6);
    let rows = [
        (
            MeasurementDatagram { power: 0, ..good },
            Implausibility::Power,
        ),
        (
            MeasurementDatagram {
                state: SessionState::Monitor,
                ..good
            },
            Implausibility::State,
        ),
        (
            MeasurementDatagram {
                measurement_period: 0.0013,
                ..good
            },
            Implausibility::Period,
        ),
        (
            MeasurementDatagram {
                send_sequence: 40,
                ..good
            },
            Implausibility::Gap,
        ),
    ];
    for (doubtful, implausibility) in rows {
        let mut session = commanding();
        assert_eq!(session.implausibility(), None);
        assert!(!session.accept(&doubtful.encode()));
        assert_eq!(session.implausibility(), Some(implausibility));
        assert!(session.accept(&measurement(7).encode()));
        assert_eq!(session.implausibility(), None);
    }
}

/// With other steps of time the set-points of a motion would break its limits.
#[test]
fn another_sample_time_is_refused_for_as_long_as_the_controller_commands() {
    let other = |sequence, state| MeasurementDatagram {
        measurement_period: 0.0151,
        state,
        ..measurement(sequence)
    };
    let mut session = commanding();
    for sequence in 6..20 {
        let datagram = other(sequence, SessionState::Command);
        assert!(!session.accept(&datagram.encode()), "{sequence}");
    }
    assert_eq!(session.implausibility(), Some(Implausibility::Period));
    // Once it has left command state, it is believed.
    assert!(!session.accept(&other(20, SessionState::Monitor).encode()));
    assert!(session.accept(&other(21, SessionState::Monitor).encode()));
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    assert_eq!(
        (exchange.commandable, exchange.period_ns),
        (false, 15_100_000)
    );
}

#[test]
fn krl_integers_are_channels_both_ways() {
    let mut measured = measurement(1);
    measured.krl.integers[2] = -1_000_000;
    assert_eq!(first_input(json!("int 3"), &measured), -1e6);
    // Outside of the channel's range it is unknown.
    measured.krl.integers[2] = -2_000_000_000;
    assert!(first_input(json!("int 3"), &measured).is_nan());
    let device = with_channel(ChannelKind::AnalogOutput, json!("int 4"));
    let mut session = session_with(&device, SessionSettings::default());
    assert!(session.accept(&measured.encode()));
    let mut outputs = Outputs::NONE;
    for (value, written) in [(-41.6, -42), (1e6, 1_000_000)] {
        outputs.analog[0] = value;
        let answer = CommandDatagram::decode(&session.answer(&outputs)).expect("our own bytes");
        assert_eq!(answer.krl.integers[3], written);
    }
}

#[test]
fn an_integer_output_must_fit_and_must_not_be_the_handshakes() {
    let mut wide = with_channel(ChannelKind::AnalogOutput, json!("int 4"));
    wide.channels[0].range = Some([0.0, 3e9]);
    let fault = FriLwr::open(&wide).expect_err("too wide").to_string();
    assert!(fault.contains("does not fit into a KRL integer"), "{fault}");
    for (krl, taken, free) in [("first-app", 1, 16), ("stanford", 16, 1), ("centro", 2, 3)] {
        for (number, refused) in [(taken, true), (free, false)] {
            let address = json!(format!("int {number}"));
            let mut device = with_channel(ChannelKind::AnalogOutput, address);
            device.settings["krl"] = krl.into();
            let opened = FriLwr::open(&device);
            assert_eq!(opened.is_err(), refused, "{krl} {number}");
        }
    }
}

#[test]
fn fields_of_the_model_are_channels_with_our_order_of_rows() {
    let mut measured = measurement(1);
    for (index, place) in measured.jacobian.iter_mut().enumerate() {
        *place = index as f32;
    }
    for (index, place) in measured.mass_matrix.iter_mut().enumerate() {
        *place = 100.0 + index as f32;
    }
    measured.gravity = [0.0, -41.5, 0.0, 0.0, 0.0, 0.0, 3.0];
    measured.temperature[6] = f32::NAN;
    let rows = [
        ("jacobian x 1", 0.0),
        ("jacobian z 7", 20.0),
        // KUKA sends Rz before Ry before Rx.
        ("jacobian rz 1", 21.0),
        ("jacobian ry 2", 29.0),
        ("jacobian rx 7", 41.0),
        ("mass 1 2", 101.0),
        ("mass 7 7", 148.0),
        ("gravity 2", -41.5),
        ("gravity 7", 3.0),
    ];
    for (address, expected) in rows {
        assert_eq!(
            first_input(json!(address), &measured),
            expected,
            "{address}"
        );
    }
    let unknown = first_input(json!("temperature 7"), &measured);
    assert!(unknown.is_nan(), "what is no number is null");
}

#[test]
fn gravity_and_masses_of_the_simulated_controller_reach_the_channels() {
    let mut krc = krc();
    let bytes = krc.tick(1).expect("it sends");
    let measured = MeasurementDatagram::decode(&bytes).expect("valid");
    for (address, expected) in [
        ("gravity 2", measured.gravity[1]),
        ("mass 2 2", measured.mass_matrix[8]),
    ] {
        let value = first_input(json!(address), &measured);
        assert!(value == f64::from(expected) && value != 0.0, "{address}");
    }
}
