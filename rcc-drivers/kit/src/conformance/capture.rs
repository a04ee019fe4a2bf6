//! Replay of captured bytes: the same bytes give the same inputs, and the values known from another source.
//! Test code only.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, UdpSocket};
use std::thread::JoinHandle;
use std::time::Duration;

use rcc_config::DeviceConfig;

use super::fault_path::{FaultPath, PacketSource};
use super::{Subject, TIMEOUT, Transport};
use crate::driver::{Driver, Inputs, Outputs};

/// Most receives until the capture must have been replayed.
const PATIENCE: usize = 500;
/// Number of exchanges in a recording, and number of attempts.
const RECORDED: usize = 20;
const ATTEMPTS: usize = 10;
/// How long a replayed device waits for the driver's bytes.
const WAIT: Duration = Duration::from_secs(10);

/// A capture of a real exchange.
pub struct Capture {
    /// Returns the driver's configuration for a device (or, if that sends first, for a driver) at an address.
    pub device: fn(SocketAddr) -> DeviceConfig,
    /// Packets in order. The driver's packets are compared if it sends first.
    pub packets: Vec<(PacketSource, Vec<u8>)>,
    /// Number of exchanges in the capture.
    pub exchanges: usize,
    /// Checks the inputs that the driver decoded, one row per exchange.
    pub check: fn(&[Inputs]),
}

impl Capture {
    /// Parses packets from text, one per line: `>` for the driver's and `<` for the device's, followed by hexadecimal
    /// digits; other lines are comments on the origin.
    pub fn packets(text: &str) -> Vec<(PacketSource, Vec<u8>)> {
        let packet = |line: &str| {
            let (from, hex) = match line.split_at_checked(1)? {
                (">", hex) => (PacketSource::Driver, hex),
                ("<", hex) => (PacketSource::Device, hex),
                _ => return None,
            };
            let digits: Vec<u8> = hex
                .chars()
                .filter_map(|digit| digit.to_digit(16).map(|digit| digit as u8))
                .collect();
            let bytes = digits.chunks(2).map(|pair| pair[0] << 4 | pair[1]);
            Some((from, bytes.collect()))
        };
        text.lines().filter_map(packet).collect()
    }
}

/// Replays a stored capture twice, each time with a new driver.
pub fn replays_its_capture<S: Subject>() {
    let Some(capture) = S::capture() else {
        return eprintln!("skipped: replays_its_capture (there is no stored capture)");
    };
    let first = replays(&capture, replay::<S>);
    (capture.check)(&first);
}

/// Records an exchange with the subject and replays it; `RCC_RECORD=FILE` stores the recording.
pub fn replays_a_recording<S: Subject>() {
    if !S::CAN_BE_REPLAYED {
        return eprintln!("skipped: replays_a_recording (its packets depend on the time)");
    }
    let (packets, recorded) = (0..ATTEMPTS)
        .find_map(|_| record::<S>())
        .expect("one recording without a pause");
    if let Some(file) = std::env::var_os("RCC_RECORD") {
        std::fs::write(file, text(&packets)).expect("RCC_RECORD names a file");
    }
    let capture = Capture {
        device: S::device,
        exchanges: recorded.len(),
        packets: Capture::packets(&text(&packets)),
        check: |_| {},
    };
    let replayed = replays(&capture, replay::<S>);
    assert_eq!(format!("{recorded:?}"), format!("{replayed:?}"));
}

fn replays(capture: &Capture, replay: fn(&Capture) -> Vec<Inputs>) -> Vec<Inputs> {
    assert!(capture.exchanges > 0);
    let (first, second) = (replay(capture), replay(capture));
    assert_eq!(first.len(), capture.exchanges);
    // Compared as text, in which NaN equals NaN.
    let (one, other) = (format!("{first:?}"), format!("{second:?}"));
    assert_eq!(one, other, "the same bytes, other inputs");
    first
}

fn text(packets: &[(PacketSource, Vec<u8>)]) -> String {
    let mut text = String::new();
    for (from, bytes) in packets {
        text.push(if *from == PacketSource::Driver {
            '>'
        } else {
            '<'
        });
        bytes
            .iter()
            .for_each(|byte| text += &format!(" {byte:02x}"));
        text.push('\n');
    }
    text
}

/// The packets and the decoded inputs of a recording.
type Recording = (Vec<(PacketSource, Vec<u8>)>, Vec<Inputs>);

/// Records some exchanges; returns `None` if one of them failed because the machine was too busy.
fn record<S: Subject>() -> Option<Recording> {
    let mut subject = S::start();
    let (path, address) = FaultPath::of(&mut subject, 1);
    drop(path.take_recording());
    let device = S::device(address);
    let mut driver = S::Driver::open(&device).unwrap_or_else(|error| panic!("{error}"));
    let mut packets = Vec::new();
    let mut seen = Vec::new();
    for _ in 0..PATIENCE {
        subject.before_receive();
        path.step();
        let inputs = exchange(&mut driver);
        packets.extend(path.take_recording());
        subject.after_exchange();
        match inputs {
            Some(inputs) => seen.push(inputs),
            None if packets.is_empty() => {}
            None => return None,
        }
        if seen.len() == RECORDED {
            return Some((packets, seen));
        }
    }
    None
}

fn exchange(driver: &mut impl Driver) -> Option<Inputs> {
    let mut inputs = Inputs::NONE;
    let exchange = driver.receive(TIMEOUT, &mut inputs).ok()?;
    let outputs = Outputs {
        position: exchange.mirror,
        ..Outputs::NONE
    };
    driver.send(&outputs).ok()?;
    Some(inputs)
}

fn replay<S: Subject>(capture: &Capture) -> Vec<Inputs> {
    match S::TRANSPORT {
        Transport::UdpFromDevice => from_device::<S>(capture),
        Transport::UdpFromDriver => {
            let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback");
            let address = socket.local_addr().expect("an address");
            let packets = capture.packets.clone();
            let device = std::thread::spawn(move || answer_datagrams(&socket, &packets));
            from_driver::<S>(capture, address, device)
        }
        Transport::TcpFromDriver => {
            let listener = TcpListener::bind("127.0.0.1:0").expect("loopback");
            let address = listener.local_addr().expect("an address");
            let packets = capture.packets.clone();
            let device = std::thread::spawn(move || answer_stream(&listener, &packets));
            from_driver::<S>(capture, address, device)
        }
    }
}

fn from_device<S: Subject>(capture: &Capture) -> Vec<Inputs> {
    let address = super::fault_path::free_udp();
    let device = (capture.device)(address);
    let mut driver = S::Driver::open(&device).unwrap_or_else(|error| panic!("{error}"));
    let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback");
    let mut seen = Vec::new();
    for (_, bytes) in capture
        .packets
        .iter()
        .filter(|row| row.0 == PacketSource::Device)
    {
        socket.send_to(bytes, address).expect("loopback");
        seen.extend(exchange(&mut driver));
    }
    seen
}

fn from_driver<S: Subject>(
    capture: &Capture,
    address: SocketAddr,
    device: JoinHandle<()>,
) -> Vec<Inputs> {
    let config = (capture.device)(address);
    let mut driver = S::Driver::open(&config).unwrap_or_else(|error| panic!("{error}"));
    let mut seen = Vec::new();
    for _ in 0..PATIENCE {
        seen.extend(exchange(&mut driver));
        if seen.len() == capture.exchanges {
            break;
        }
    }
    drop(driver);
    if let Err(panic) = device.join() {
        std::panic::resume_unwind(panic);
    }
    seen
}

fn answer_datagrams(socket: &UdpSocket, packets: &[(PacketSource, Vec<u8>)]) {
    socket.set_read_timeout(Some(WAIT)).expect("a socket");
    let mut peer = None;
    let mut bytes = [0; 65536];
    for (from, packet) in packets {
        match (from, peer) {
            (PacketSource::Driver, _) => {
                let (size, source) = socket.recv_from(&mut bytes).expect("the driver's packet");
                assert_eq!(&bytes[..size], packet, "the driver sends something else");
                peer = Some(source);
            }
            (PacketSource::Device, Some(peer)) => {
                socket.send_to(packet, peer).expect("loopback");
            }
            (PacketSource::Device, None) => panic!("the driver is the first to send"),
        }
    }
}

fn answer_stream(listener: &TcpListener, packets: &[(PacketSource, Vec<u8>)]) {
    let (mut stream, _) = listener.accept().expect("the driver connects");
    stream.set_read_timeout(Some(WAIT)).expect("a socket");
    for (from, packet) in packets {
        match from {
            PacketSource::Driver => {
                let mut bytes = vec![0; packet.len()];
                stream.read_exact(&mut bytes).expect("the driver's bytes");
                assert_eq!(bytes, *packet, "the driver sends something else");
            }
            PacketSource::Device => stream.write_all(packet).expect("the driver reads"),
        }
    }
    // The driver closes first: closing here would discard bytes that it has not read yet.
    while matches!(stream.read(&mut [0; 64]), Ok(1..)) {}
}
