//! The driver against the simulated controller: in virtual time without a socket, and over a socket.

use std::net::UdpSocket;

mod dialogue;
mod impedance;

use rcc_core::message::{CommandImage, DeviceState, JOINTS_MAX, Joints, Measurement, SetPoint};

use super::conforms::krc;
use super::*;
use crate::drivers::fri_socket::ROBOT_TIMEOUT;
use crate::fri_lwr::wire::{
    CommandDatagram, FriControlStrategy, MeasurementDatagram, SessionState,
};
use crate::sim::lwr::krc::Krc;
use crate::sim::lwr::settings::Settings as KrcSettings;
use rcc_driver_kit::host::command_mode_exit::CommandModeExit;
use rcc_driver_kit::host::device_session::DeviceSession;
use rcc_driver_kit::host::reason;

const MS: u64 = 1_000_000;
const DELAY: usize = 10;

/// Returns the LWR of the demo cell.
fn lwr() -> DeviceConfig {
    conforms::lwr(([127, 0, 0, 1], 0).into())
}

/// Controller, driver and executor in one virtual time, with steps of 1 ms.
struct FriFixture {
    krc: Krc,
    fri: FriSession,
    session: DeviceSession,
    image: CommandImage,
    now_ns: u64,
    /// The driver's answers reach the controller.
    connected: bool,
    answers: Vec<CommandDatagram>,
}

impl FriFixture {
    fn new() -> Self {
        let device = lwr();
        Self {
            krc: krc(),
            fri: FriSession::new(&device, SessionSettings::default()).expect("7 joints"),
            session: DeviceSession::new(&device, 0),
            image: CommandImage::new(1, MS),
            now_ns: 0,
            connected: true,
            answers: Vec::new(),
        }
    }

    fn ready() -> Self {
        let mut bench = Self::new();
        bench.wait_for(DeviceState::Ready);
        bench.answers.clear();
        bench
    }

    fn wait_for(&mut self, state: DeviceState) {
        for _ in 0..5000 {
            if self.state() == state {
                return;
            }
            self.cycle(SetPoint::NONE);
        }
        panic!("never {}", state.name());
    }

    fn state(&self) -> DeviceState {
        DeviceState::from_number(self.measured().state)
    }

    fn measured(&self) -> &Measurement {
        self.session.measurement()
    }

    fn cycle(&mut self, entry: SetPoint) {
        self.now_ns += MS;
        let next = self.image.head.sequence + 1;
        self.image.push(next, self.now_ns, entry);
        self.exchange();
    }

    fn exchange(&mut self) {
        let Some(bytes) = self.krc.tick(1) else {
            return;
        };
        if !self.fri.accept(&bytes) {
            // The controller has left command state, and no second datagram has confirmed it yet.
            return;
        }
        let mut inputs = Inputs::NONE;
        let exchange = self.fri.exchange(&mut inputs);
        self.session.observe(self.now_ns, Some(&self.image));
        let outputs = self.session.exchange(self.now_ns, &inputs, &exchange);
        let answer = self.fri.answer(&outputs);
        if self.connected {
            let taken = self.krc.receive(&answer, 1e-4);
            assert_eq!(taken, Ok(()), "the driver's own answer");
        }
        self.answers
            .push(CommandDatagram::decode(&answer).expect("our own bytes"));
    }

    /// Moves joint 1 by `way` (rad) in `cycles`; the torch is on in the second half.
    fn run(&mut self, owner: u64, way: f64, cycles: u64) {
        let hold = self.measured().hold;
        for cycle in 0..=cycles {
            let part = part(cycle, cycles);
            let mut position = hold;
            position[0] += way * part;
            self.cycle(command(owner, position, part > 0.5));
        }
    }

    fn faults(&self) -> u64 {
        self.krc.snapshot().counts.faults
    }
}

fn part(cycle: u64, cycles: u64) -> f64 {
    let x = cycle as f64 / cycles as f64;
    x * x * x * (10.0 - x * (15.0 - 6.0 * x))
}

fn command(owner: u64, position: Joints, torch: bool) -> SetPoint {
    SetPoint {
        owner,
        has_position: 1,
        position,
        digital: u64::from(torch),
        digital_commanded: 1,
        ..SetPoint::NONE
    }
}

#[test]
fn command_mode_is_entered_by_the_handshake_without_a_fault() {
    let bench = FriFixture::ready();
    assert_eq!(bench.faults(), 0);
    assert_eq!(bench.measured().reason, 0);
    let start = KrcSettings::default().robot.start;
    for (hold, start) in bench.measured().hold.iter().zip(start) {
        assert!((hold - start).abs() < 1e-6);
    }
}

#[test]
fn a_motion_goes_out_set_point_by_set_point_and_the_torch_with_its_own() {
    let mut bench = FriFixture::ready();
    let hold = bench.measured().hold;
    bench.run(1, 0.3, 500);
    bench.wait_for(DeviceState::Ready);
    assert_eq!(bench.faults(), 0);
    let sent = &bench.answers[DELAY..];
    for cycle in 0..=500 {
        let part = part(cycle, 500);
        let answer = &sent[cycle as usize];
        assert_eq!(
            answer.joint_position[0],
            (hold[0] + 0.3 * part) as f32,
            "cycle {cycle}"
        );
        assert_eq!(answer.krl.boolean(1), Some(part > 0.5), "cycle {cycle}");
    }
    assert_eq!(bench.measured().hold[0], hold[0] + 0.3);
}

#[test]
fn without_an_executor_the_arm_comes_to_rest_without_a_fault_of_the_controller() {
    let mut bench = FriFixture::ready();
    let hold = bench.measured().hold;
    for cycle in 0..250 {
        let mut position = hold;
        position[0] += 0.3 * part(cycle, 500);
        bench.cycle(command(1, position, true));
    }
    for _ in 0..300 {
        bench.now_ns += MS;
        bench.exchange();
    }
    assert_eq!((bench.faults(), bench.measured().starved), (0, 1));
    assert_eq!(bench.state(), DeviceState::Online);
    let last = &bench.answers[bench.answers.len() - 50..];
    assert!(
        last.iter()
            .all(|answer| answer.joint_position == last[0].joint_position)
    );
    assert_eq!(last[0].krl.boolean(1), Some(false), "the torch is off");
}

#[test]
fn after_a_fault_of_the_controller_nothing_moves_by_itself() {
    let mut bench = FriFixture::ready();
    let hold = bench.measured().hold;
    for cycle in 0..=2000 {
        bench.connected = !(250..280).contains(&cycle);
        let mut position = hold;
        position[0] += 0.3 * part(cycle.min(500), 500);
        bench.cycle(command(1, position, false));
    }
    assert_eq!(bench.faults(), 1);
    assert_eq!(bench.measured().reason, reason::DEVICE_STOPPED);
    assert_eq!(
        bench.state(),
        DeviceState::Online,
        "in command mode again, its net is refused"
    );
    let last = &bench.answers[bench.answers.len() - 500..];
    assert!(
        last.iter()
            .all(|answer| answer.joint_position == last[0].joint_position)
    );
    bench.wait_for(DeviceState::Ready);
    bench.run(2, 0.1, 500);
    bench.wait_for(DeviceState::Ready);
    assert_eq!(bench.faults(), 1, "a new net moves it");
}

#[test]
fn a_driver_that_ends_at_any_moment_leaves_the_controller_in_monitor_state_without_a_fault() {
    // Entry into command state is at about cycle 130.
    for moment in 1..400 {
        let mut bench = FriFixture::new();
        (0..moment).for_each(|_| bench.cycle(SetPoint::NONE));
        let mut exit = None;
        for _ in 0..100 {
            bench.session.terminate();
            if bench.session.is_at_rest() {
                bench.fri.release();
                exit.get_or_insert(CommandModeExit::requested(bench.now_ns));
            }
            let is_over = |exit: &CommandModeExit| exit.is_over(bench.now_ns);
            if exit.as_ref().is_some_and(is_over) {
                break;
            }
            bench.cycle(SetPoint::NONE);
            if let Some(exit) = &mut exit {
                exit.observe(bench.fri.exchange(&mut { Inputs::NONE }).commandable);
            }
        }
        assert!(exit.is_some_and(|exit| exit.is_over(bench.now_ns)));
        // The process is gone.
        for _ in 0..200 {
            bench.krc.tick(1);
        }
        assert_eq!(bench.faults(), 0, "ended in cycle {moment}");
        let last = MeasurementDatagram::decode(&bench.krc.tick(1).expect("sends"));
        assert_eq!(last.expect("valid").state, SessionState::Monitor);
    }
}

fn session() -> FriSession {
    FriSession::new(&lwr(), SessionSettings::default()).expect("7 joints")
}

fn measurement(sequence: u16) -> MeasurementDatagram {
    MeasurementDatagram {
        send_sequence: sequence,
        state: SessionState::Command,
        quality: Quality::Perfect,
        control: FriControlStrategy::Position,
        measurement_period: 0.001,
        power: 0x7f,
        commanded_position: [0.25; 7],
        commanded_position_offset: [0.5; 7],
        ..MeasurementDatagram::default()
    }
}

fn ticks(session: &mut FriSession, sequence: u16) -> Option<u64> {
    session
        .accept(&measurement(sequence).encode())
        .then(|| session.exchange(&mut Inputs::NONE.clone()).ticks)
}

#[test]
fn time_is_counted_by_sequence_numbers_over_their_end() {
    let mut session = session();
    let seen = [65533, 65534, 65535, 1, 1, 0, 3].map(|sequence| ticks(&mut session, sequence));
    assert_eq!(
        seen,
        [Some(1), Some(1), Some(1), Some(2), None, None, Some(2)]
    );
    assert_eq!(session.exchange(&mut Inputs::NONE.clone()).refused, 2);
}

#[test]
fn a_restarted_sequence_counter_is_accepted_after_a_while() {
    let mut session = session();
    assert_eq!(ticks(&mut session, 1000), Some(1));
    let seen: Vec<_> = (1..=11)
        .map(|sequence| ticks(&mut session, sequence))
        .collect();
    assert_eq!(seen[..9], [None; 9]);
    assert_eq!(seen[9..], [Some(1), Some(1)]);
}

#[test]
fn datagrams_of_another_size_or_identity_or_without_numbers_are_refused() {
    let mut session = session();
    let good = measurement(1).encode();
    let mut identity = good;
    identity[6] ^= 1;
    let nan = MeasurementDatagram {
        commanded_position: [f32::NAN; 7],
        ..measurement(1)
    };
    assert!(!session.accept(&good[..915]));
    assert!(!session.accept(&identity));
    assert!(!session.accept(&nan.encode()));
    assert!(session.accept(&good));
    assert_eq!(session.exchange(&mut Inputs::NONE.clone()).refused, 3);
}

/// Returns a session in command state.
fn commanding() -> FriSession {
    let mut session = session();
    for sequence in 1..=5 {
        assert!(session.accept(&measurement(sequence).encode()));
    }
    session
}

#[test]
fn a_single_datagram_does_not_end_or_change_command_mode() {
    let good = measurement(6);
    let is_implausible = [
        MeasurementDatagram { power: 0, ..good },
        MeasurementDatagram { error: 4, ..good },
        MeasurementDatagram {
            state: SessionState::Monitor,
            ..good
        },
        MeasurementDatagram {
            control: FriControlStrategy::Other,
            ..good
        },
        MeasurementDatagram {
            measurement_period: 0.1,
            ..good
        },
        MeasurementDatagram {
            send_sequence: 40,
            ..good
        },
        MeasurementDatagram {
            state: SessionState::Off,
            ..good
        },
    ];
    for surprise in is_implausible {
        let mut session = commanding();
        assert!(!session.accept(&surprise.encode()), "{surprise:?}");
        assert!(session.accept(&measurement(7).encode()));
        let exchange = session.exchange(&mut Inputs::NONE.clone());
        assert!(exchange.commandable && exchange.startable, "{exchange:?}");
        assert_eq!((exchange.period_ns, exchange.refused), (MS, 1));
    }
}

#[test]
fn a_change_that_the_next_datagram_confirms_is_accepted() {
    let mut session = commanding();
    for (sequence, believed) in [(6, false), (7, true), (8, true)] {
        let monitoring = MeasurementDatagram {
            state: SessionState::Monitor,
            ..measurement(sequence)
        };
        assert_eq!(session.accept(&monitoring.encode()), believed, "{sequence}");
    }
    let exchange = session.exchange(&mut Inputs::NONE.clone());
    assert_eq!((exchange.commandable, exchange.reason), (false, MONITORING));
}

#[test]
fn while_command_mode_begins_a_position_that_jumps_is_not_mirrored() {
    let mut session = session();
    assert!(session.accept(&measurement(1).encode()));
    let mut jumped = measurement(2);
    jumped.commanded_position[3] = 0.26;
    assert!(!session.accept(&jumped.encode()));
    assert!(session.accept(&measurement(3).encode()));
    let answer = CommandDatagram::decode(&session.answer(&Outputs::NONE)).expect("our own bytes");
    assert_eq!(answer.joint_position[3], 0.75);
}

#[test]
fn the_first_cycles_of_command_mode_are_mirrored_whatever_is_asked_for() {
    let mut session = session();
    let asked = Outputs {
        position: [0.7; JOINTS_MAX],
        ..Outputs::NONE
    };
    let mut sent = Vec::new();
    for sequence in 1..=5 {
        assert!(session.accept(&measurement(sequence).encode()));
        let answer = CommandDatagram::decode(&session.answer(&asked)).expect("our own bytes");
        assert_eq!(answer.reflected_sequence, sequence);
        sent.push(answer.joint_position[3]);
    }
    assert_eq!(sent, [0.75, 0.75, 0.75, 0.7, 0.7]);
}

#[test]
fn torques_of_the_wire_are_turned_round() {
    let mut session = session();
    let measured = MeasurementDatagram {
        external_tcp_wrench: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        ..measurement(1)
    };
    assert!(session.accept(&measured.encode()));
    let mut inputs = Inputs::NONE;
    session.exchange(&mut inputs);
    assert_eq!(inputs.wrench, [1.0, 2.0, 3.0, 6.0, 5.0, 4.0]);
}

#[test]
fn drives_strategy_and_quality_say_why_nothing_may_begin() {
    let good = measurement(1);
    let rows = [
        (MeasurementDatagram { power: 0, ..good }, DRIVES_OFF),
        (MeasurementDatagram { error: 1, ..good }, DRIVES_OFF),
        (
            MeasurementDatagram {
                control: FriControlStrategy::Other,
                ..good
            },
            STRATEGY,
        ),
        (
            MeasurementDatagram {
                quality: Quality::Bad,
                ..good
            },
            QUALITY,
        ),
        (
            MeasurementDatagram {
                state: SessionState::Monitor,
                ..good
            },
            MONITORING,
        ),
        (good, ENTERING),
    ];
    for (measured, expected) in rows {
        let mut session = session();
        assert!(session.accept(&measured.encode()));
        let exchange = session.exchange(&mut Inputs::NONE.clone());
        assert_eq!((exchange.reason, exchange.startable), (expected, false));
    }
}

/// Returns a driver in command mode and the socket of its controller.
fn commanding_over_a_socket() -> (FriLwr, UdpSocket) {
    let mut driver = FriLwr::open(&lwr()).expect("a good configuration");
    let controller = UdpSocket::bind("127.0.0.1:0").expect("loopback");
    for sequence in 1..=5 {
        assert!(receives(&mut driver, &controller, sequence).is_ok());
    }
    (driver, controller)
}

fn receives(
    driver: &mut FriLwr,
    controller: &UdpSocket,
    sequence: u16,
) -> Result<Exchange, LinkError> {
    let address = driver.address().expect("a socket");
    let bytes = measurement(sequence).encode();
    controller.send_to(&bytes, address).expect("loopback");
    driver.receive(Duration::from_secs(10), &mut Inputs::NONE.clone())
}

#[test]
fn a_stall_of_the_driver_is_not_silence_of_the_controller() {
    let (mut driver, controller) = commanding_over_a_socket();
    std::thread::sleep(ROBOT_TIMEOUT + Duration::from_millis(10));
    let nothing = driver.receive(Duration::from_millis(1), &mut Inputs::NONE.clone());
    assert_eq!(nothing, Err(LinkError::Silent));
    let exchange = receives(&mut driver, &controller, 6).expect("it sends");
    assert!(
        exchange.commandable,
        "it must not mirror in the middle of a motion"
    );
}

#[test]
fn after_a_silence_another_controller_may_come() {
    let (mut driver, _) = commanding_over_a_socket();
    let nothing = driver.receive(ROBOT_TIMEOUT * 2, &mut Inputs::NONE.clone());
    assert_eq!(nothing, Err(LinkError::Silent));
    let other = UdpSocket::bind("127.0.0.1:0").expect("loopback");
    let exchange = receives(&mut driver, &other, 3).expect("another one");
    assert!(!exchange.commandable);
}

/// Sends a datagram from this address, which is not waited for.
fn is_foreign(driver: &mut FriLwr, sender: &UdpSocket, sequence: u16) -> bool {
    let address = driver.address().expect("a socket");
    let foreign = |driver: &FriLwr| {
        driver.dialogue.counters.link()["foreign"]
            .as_u64()
            .expect("counted")
    };
    let before = foreign(driver);
    sender
        .send_to(&measurement(sequence).encode(), address)
        .expect("loopback");
    let wait = Duration::from_millis(1);
    let answer = driver.receive(wait, &mut Inputs::NONE.clone());
    answer == Err(LinkError::Silent) && foreign(driver) == before + 1
}

#[test]
fn a_peer_without_a_port_pins_the_robot_and_nobody_else_is_ever_adopted() {
    let mut device = lwr();
    device.settings["listen"] = "0.0.0.0:0".into();
    device.settings["peer"] = "127.0.0.2".into();
    let mut driver = FriLwr::open(&device).expect("an address alone pins the robot");
    let port = driver.address().expect("a socket").port();
    let bind = |at: &str| {
        let socket = UdpSocket::bind(at).expect("loopback");
        socket.connect(("127.0.0.1", port)).expect("loopback");
        socket
    };
    let (stranger, robot) = (bind("127.0.0.1:0"), bind("127.0.0.2:0"));
    assert!(is_foreign(&mut driver, &stranger, 1), "before the robot");
    assert!(receives(&mut driver, &robot, 1).is_ok(), "from any port");
    assert!(is_foreign(&mut driver, &stranger, 2), "beside the robot");
    let nothing = driver.receive(ROBOT_TIMEOUT * 2, &mut Inputs::NONE.clone());
    assert_eq!(nothing, Err(LinkError::Silent));
    assert!(is_foreign(&mut driver, &stranger, 3), "after a silence");
    let restarted = bind("127.0.0.2:0");
    assert!(receives(&mut driver, &restarted, 7).is_ok(), "a new port");
}

#[test]
fn datagrams_of_another_version_are_the_reason_of_a_device_without_a_controller() {
    let mut driver = FriLwr::open(&lwr()).expect("a good configuration");
    let address = driver.address().expect("a socket");
    let wait = Duration::from_millis(5);
    let receive = |driver: &mut FriLwr| driver.receive(wait, &mut Inputs::NONE.clone());
    assert!(matches!(receive(&mut driver), Err(LinkError::Silent)));
    let controller = UdpSocket::bind("127.0.0.1:0").expect("loopback");
    controller.send_to(&[8; 100], address).expect("loopback");
    let other_version = |answer: &Result<Exchange, LinkError>| matches!(answer, Err(LinkError::Lost { reason }) if *reason == OTHER_VERSION);
    // On loopback a datagram that was sent has arrived.
    let answer = receive(&mut driver);
    assert!(other_version(&answer), "{answer:?}");
    // Beside a controller that is answered, it means nothing.
    let (mut driver, controller) = commanding_over_a_socket();
    let address = driver.address().expect("a socket");
    controller.send_to(&[8; 100], address).expect("loopback");
    let answer = receive(&mut driver);
    assert!(matches!(answer, Err(LinkError::Silent)), "{answer:?}");
}

#[test]
fn a_channel_that_is_not_a_krl_variable_is_refused_by_name() {
    for (address, words) in [
        (
            serde_json::json!(17),
            "devices.lwr.channels.torch: KRL variable 17 does not exist",
        ),
        (serde_json::json!(2), "number 2 is already used by 'torch'"),
    ] {
        let mut device = lwr();
        device.channels[0].address = address;
        let fault = FriLwr::open(&device)
            .expect_err("a bad address")
            .to_string();
        assert!(fault.contains(words), "{fault}");
    }
}
