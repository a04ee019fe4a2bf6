//! Servers that execute requests but answer badly: late, as another unit, incompletely, never.
//! Whatever they answer, every safe value is sent to them, each once before any is sent again.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rcc_config::{DeviceConfig, OnRelease};
use rcc_core::primitive::ChannelKind::{AnalogOutput, DigitalInput, DigitalOutput};

use super::super::Modbus;
use rcc_driver_kit::conformance::{self, ChannelRow};
use rcc_driver_kit::driver::{Driver, Inputs, LinkError, Outputs};

/// The behaviour of the server; it executes requests at once.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Misbehavior {
    Well,
    /// After this delay, each response by itself.
    Late(Duration),
    OtherUnit,
    Half,
    Never,
    /// With another function code than in the request.
    Nonsense,
    /// With bytes that are not Modbus.
    Garbage,
    /// With this exception, although it executes the request.
    Exception(u8),
    /// Answers, then closes the connection.
    Closes,
    /// Closes the connection without an answer.
    Hangs,
    /// Drops requests while it is busy, for this time per request.
    OneAtATime(Duration),
}

struct State {
    misbehavior: Misbehavior,
    /// Coils and holding registers.
    points: [[u16; 32]; 2],
    /// Written points in order: table, number.
    written: Vec<(usize, usize)>,
}

/// A server with 32 coils and 32 holding registers; discrete inputs are off.
#[derive(Clone)]
struct MisbehavingServer {
    address: SocketAddr,
    state: Arc<Mutex<State>>,
}

impl MisbehavingServer {
    fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("loopback");
        let server = Self {
            address: listener.local_addr().expect("an address"),
            state: Arc::new(Mutex::new(State {
                misbehavior: Misbehavior::Well,
                points: [[0; 32]; 2],
                written: Vec::new(),
            })),
        };
        let own = server.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let own = own.clone();
                std::thread::spawn(move || own.serve(stream));
            }
        });
        server
    }

    fn behave(&self, misbehavior: Misbehavior) {
        let mut state = self.state.lock().expect("no panic");
        state.misbehavior = misbehavior;
        state.written.clear();
    }

    /// Serves one connection until it ends.
    fn serve(&self, mut stream: TcpStream) {
        stream.set_nodelay(true).expect("a socket");
        loop {
            let mut head = [0; 6];
            if stream.read_exact(&mut head).is_err() {
                return;
            }
            let mut rest = vec![0; usize::from(u16::from_be_bytes([head[4], head[5]]))];
            if stream.read_exact(&mut rest).is_err() {
                return;
            }
            let misbehavior = self.state.lock().expect("no panic").misbehavior;
            let body = self.act(&rest[1..]);
            let mut answer = head[..4].to_vec();
            answer.extend((body.len() as u16 + 1).to_be_bytes());
            answer.push(rest[0]);
            answer.extend(body);
            match misbehavior {
                Misbehavior::Well | Misbehavior::Closes => {}
                Misbehavior::Late(time) => {
                    let mut own = stream.try_clone().expect("a socket");
                    std::thread::spawn(move || {
                        std::thread::sleep(time);
                        // The driver may be gone.
                        let _ = own.write_all(&answer);
                    });
                    continue;
                }
                Misbehavior::OtherUnit => answer[6] ^= 1,
                Misbehavior::Half => answer.truncate(answer.len() / 2),
                Misbehavior::Never => continue,
                Misbehavior::Nonsense => answer[7] = 43,
                Misbehavior::Garbage => answer.fill(0x55),
                Misbehavior::Exception(code) => {
                    answer.truncate(7);
                    answer[5] = 3;
                    answer.extend([rest[1] | 0x80, code]);
                }
                Misbehavior::Hangs => return,
                Misbehavior::OneAtATime(time) => {
                    std::thread::sleep(time);
                    stream.set_nonblocking(true).expect("a socket");
                    // Requests that arrived meanwhile.
                    while stream.read(&mut [0; 1000]).is_ok_and(|count| count > 0) {}
                    stream.set_nonblocking(false).expect("a socket");
                }
            }
            if stream.write_all(&answer).is_err() || misbehavior == Misbehavior::Closes {
                return;
            }
        }
    }

    /// Executes a request; returns function code and data.
    fn act(&self, request: &[u8]) -> Vec<u8> {
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let (function, first, second) = (request[0], usize::from(word(1)), word(3));
        let mut state = self.state.lock().expect("no panic");
        match function {
            1 | 2 => return vec![function, 1, 0],
            3 => {
                let value = state.points[1][first].to_be_bytes();
                return vec![3, 2, value[0], value[1]];
            }
            5 => state.points[0][first] = u16::from(second != 0),
            6 => state.points[1][first] = second,
            _ => panic!("function {function} is not asked for here"),
        }
        state.written.push((usize::from(function) - 5, first));
        request[..5].to_vec()
    }

    fn all_are(&self, outputs: &[(usize, usize)], value: u16) -> bool {
        let state = self.state.lock().expect("no panic");
        outputs
            .iter()
            .all(|&(table, number)| state.points[table][number] == value)
    }

    /// Returns how often each output has been written since [`MisbehavingServer::behave`].
    fn tries(&self, outputs: &[(usize, usize)]) -> Vec<usize> {
        let state = self.state.lock().expect("no panic");
        let count = |output| state.written.iter().filter(|one| *one == output).count();
        outputs.iter().map(count).collect()
    }
}

/// Addresses of the outputs: each needs a request of its own.
const OUTPUTS: [(usize, usize); 8] = [
    (0, 0),
    (0, 2),
    (0, 4),
    (0, 6),
    (1, 10),
    (1, 12),
    (1, 14),
    (1, 16),
];

fn device(server: SocketAddr, settings: &serde_json::Value) -> DeviceConfig {
    let names: Vec<String> = (0..8).map(|number| format!("o{number}")).collect();
    let mut rows: Vec<ChannelRow<'_>> = Vec::new();
    for (name, (table, number)) in names.iter().zip(OUTPUTS) {
        rows.push(match table {
            0 => (
                name,
                DigitalOutput,
                format!("coil {number}").into(),
                Some(OnRelease::Safe(0.0)),
                None,
            ),
            _ => (
                name,
                AnalogOutput,
                format!("holding {number}").into(),
                Some(OnRelease::Safe(0.0)),
                Some([0.0, 1.0]),
            ),
        });
    }
    rows.push(("in", DigitalInput, "discrete 0".into(), None, None));
    let mut settings = settings.clone();
    settings["server"] = server.to_string().into();
    conformance::device("modbus", settings, &rows)
}

fn all(on: bool) -> Outputs {
    let mut outputs = Outputs {
        digital: if on { 0b1111 } else { 0 },
        digital_set: 0b1111,
        ..Outputs::NONE
    };
    outputs.analog[..4].fill(f64::from(u8::from(on)));
    outputs
}

/// Performs one exchange as the host does.
fn exchange(driver: &mut Modbus, outputs: &Outputs) -> Result<(), LinkError> {
    driver.receive(Duration::from_millis(10), &mut Inputs::NONE.clone())?;
    driver.send(outputs)
}

/// Returns a driver with all outputs on.
fn running(server: &MisbehavingServer, settings: &serde_json::Value) -> Modbus {
    let mut driver = Modbus::open(&device(server.address, settings)).expect("a configuration");
    until(|| {
        // Not connected yet, or not read yet.
        let _ = exchange(&mut driver, &all(true));
        server.all_are(&OUTPUTS, 1)
    });
    driver
}

/// Waits without a time limit, which a slow machine could miss.
fn until(mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < Duration::from_secs(60), "never");
    }
}

const TIMEOUT: Duration = Duration::from_millis(80);

fn settings() -> serde_json::Value {
    serde_json::json!({"timeout": "80 ms", "period": "5 ms"})
}

/// Most writes of an output until all have been written: the write in progress may be one.
const TRIES_MAX: usize = 3;

const MANNERS: [Misbehavior; 12] = [
    Misbehavior::Late(Duration::from_millis(200)),
    Misbehavior::Late(Duration::from_millis(75)),
    Misbehavior::OtherUnit,
    Misbehavior::Half,
    Misbehavior::Never,
    Misbehavior::Nonsense,
    Misbehavior::Garbage,
    Misbehavior::Exception(4),
    Misbehavior::Exception(6),
    Misbehavior::Closes,
    Misbehavior::Hangs,
    Misbehavior::OneAtATime(Duration::from_millis(120)),
];

/// Returns true for a server that executes one request per connection or round: some outputs are then written again
/// before the last one.
fn takes_rounds(misbehavior: Misbehavior) -> bool {
    matches!(
        misbehavior,
        Misbehavior::OneAtATime(_) | Misbehavior::Closes | Misbehavior::Hangs
    )
}

#[test]
fn every_safe_value_is_sent_whatever_the_server_answers() {
    for misbehavior in MANNERS {
        let server = MisbehavingServer::start();
        let mut driver = running(&server, &settings());
        server.behave(misbehavior);
        until(|| {
            // The server is lost, sooner or later.
            let _ = exchange(&mut driver, &all(false));
            let tries = server.tries(&OUTPUTS);
            let most = tries.iter().max().copied().unwrap_or(0);
            let done = server.all_are(&OUTPUTS, 0);
            assert!(
                done || most <= TRIES_MAX || takes_rounds(misbehavior),
                "{misbehavior:?}: {tries:?}"
            );
            done
        });
    }
}

#[test]
fn every_safe_value_is_sent_before_the_driver_ends() {
    for misbehavior in MANNERS {
        if takes_rounds(misbehavior) {
            // At the end, the driver waits for such servers no longer than a supervisor does.
            continue;
        }
        let server = MisbehavingServer::start();
        let settings = serde_json::json!({"timeout": "400 ms", "period": "5 ms"});
        let mut driver = running(&server, &settings);
        server.behave(misbehavior);
        // The last outputs of the host.
        let _ = driver.send(&all(false));
        drop(driver);
        until(|| server.all_are(&OUTPUTS, 0));
        let tries = server.tries(&OUTPUTS);
        assert!(
            tries.iter().all(|tries| *tries > 0),
            "{misbehavior:?}: {tries:?}"
        );
    }
}

#[test]
fn a_driver_ends_though_its_server_never_answers() {
    let server = MisbehavingServer::start();
    let driver = running(&server, &settings());
    server.behave(Misbehavior::Never);
    let begun = Instant::now();
    drop(driver);
    // The supervisor kills after 2 s; a loaded machine may be late, but not by this much.
    assert!(begun.elapsed() < 100 * TIMEOUT);
}
