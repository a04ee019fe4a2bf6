//! Measures how long the whole chain takes: a robot's packet in, through driver, boards, executor and back, until an
//! answer with the effect of that very packet leaves. A transparent relay between `lwr-sim` and the driver numbers
//! the packets in a KRL variable that a net copies to an output, and notes the times. Run by hand: main, one thread.

use std::fmt::Write as _;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use rcc_drivers::fri_lwr::wire::{CMD_SIZE, MSR_SIZE};
use rcc_ipc::monotonic_ns;
use rcc_tests::TestCell;
use rcc_tests::reference::promote;
use serde_json::Value;

/// Above the executor (80): the relay must not be what is slow.
const PRIORITY: i32 = 90;
/// `$FRI_TO_REA[1]` and `$FRI_FRM_REA[1]` lie in the same place of their datagrams.
const REAL_1: std::ops::Range<usize> = 8..12;
/// Numbers that an output of 0 to 0.5 m/s carries exactly as binary32.
const NUMBERS: u64 = 1 << 12;
/// Packets before the figures count: every process has touched its memory.
const WARM_UP: u64 = 500;
const PACKET_MAX: usize = 2048;

/// Copies the numbered input to an output, and holds the arm where it is held.
const NET: &str = "net: latency
primitives:
  cancel: {type: Cancel}
  state: {type: JointState, parameters: {device: lwr}}
  robot: {type: JointPositionCommand, parameters: {device: lwr}, inputs: {position: state.hold}}
  in: {type: AnalogInput, parameters: {device: lwr, channel: wire_speed_measured}}
  out: {type: AnalogOutput, parameters: {device: lwr, channel: wire_speed}, inputs: {in: in.out}}
  end: {type: Termination, inputs: {done: cancel.requested}}
discard: [state.position]
";

/// The relay between the controller and the driver.
struct Relay {
    /// Where the controller's packets come in, and answers go out.
    controller: UdpSocket,
    /// Where packets go on to the driver.
    driver: UdpSocket,
    controller_address: Option<SocketAddr>,
    sent_ns: Vec<u64>,
    packets: u64,
    answers: u64,
    answered: u64,
    latencies_ns: Vec<u64>,
}

impl Relay {
    fn bind(controller: UdpSocket, driver_port: u16) -> io::Result<Relay> {
        let driver = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        driver.connect((Ipv4Addr::LOCALHOST, driver_port))?;
        driver.set_nonblocking(true)?;
        controller.set_nonblocking(true)?;
        Ok(Relay {
            controller,
            driver,
            controller_address: None,
            sent_ns: vec![0; NUMBERS as usize],
            packets: 0,
            answers: 0,
            answered: 0,
            latencies_ns: Vec::new(),
        })
    }

    /// Waits for a packet from either side, at most 100 ms, and passes on what there is.
    fn pass_on(&mut self) -> io::Result<()> {
        let readable = |socket| PollFd::new(socket, PollFlags::POLLIN);
        let mut sockets = [
            readable(self.controller.as_fd()),
            readable(self.driver.as_fd()),
        ];
        poll(&mut sockets, PollTimeout::from(100_u8))?;
        let mut packet = [0; PACKET_MAX];
        while let Ok((length, from)) = self.controller.recv_from(&mut packet) {
            self.controller_address = Some(from);
            self.number(&mut packet[..length]);
            // Nobody listens before the driver has started; the controller sends again.
            let _ = self.driver.send(&packet[..length]);
        }
        while let Ok(length) = self.driver.recv(&mut packet) {
            self.note(&packet[..length]);
            if let Some(controller) = self.controller_address {
                self.controller.send_to(&packet[..length], controller)?;
            }
        }
        Ok(())
    }

    fn number(&mut self, packet: &mut [u8]) {
        if packet.len() != MSR_SIZE {
            return;
        }
        self.packets += 1;
        let number = self.packets % NUMBERS;
        let value = number as f32 / (2 * NUMBERS) as f32;
        packet[REAL_1].copy_from_slice(&value.to_le_bytes());
        self.sent_ns[number as usize] = monotonic_ns();
    }

    /// The first answer that carries a number closes that packet's account; newer numbers close the older ones.
    fn note(&mut self, packet: &[u8]) {
        let now_ns = monotonic_ns();
        let Some(bytes) = packet
            .get(REAL_1)
            .filter(|_| packet.len() == CMD_SIZE)
            .and_then(|bytes| bytes.try_into().ok())
        else {
            return;
        };
        self.answers += 1;
        let number = (f32::from_le_bytes(bytes) * (2 * NUMBERS) as f32) as u64;
        let ago = (self.packets + NUMBERS - number) % NUMBERS;
        let which = self.packets.saturating_sub(ago);
        // Without a net the output is 0, which is a number as well: only an advance counts.
        if number > 0 && which > self.answered {
            self.answered = which;
            if which > WARM_UP {
                self.latencies_ns
                    .push(now_ns - self.sent_ns[number as usize]);
            }
        }
    }
}

/// What one delay gave.
struct Figures {
    delay: &'static str,
    latencies_ns: Vec<u64>,
    late_cycles: u64,
    state: String,
}

fn measure(delay: &'static str, seconds: u64) -> io::Result<Figures> {
    let controller = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    let relay_port = controller.local_addr()?.port();
    // The relay runs before the cell does: `await_ready` needs packets.
    let (driver_told, driver_tell) = std::sync::mpsc::channel();
    let (stop, stopped) = std::sync::mpsc::channel::<()>();
    let relay = std::thread::spawn(move || -> io::Result<Relay> {
        let port = driver_tell.recv().map_err(io::Error::other)?;
        let mut relay = Relay::bind(controller, port)?;
        if !promote(None, PRIORITY) {
            eprintln!("without real-time permission the relay is part of what is measured");
        }
        // Ends when it is told to, or when the other end is gone.
        while matches!(
            stopped.try_recv(),
            Err(std::sync::mpsc::TryRecvError::Empty)
        ) {
            relay.pass_on()?;
        }
        Ok(relay)
    });
    let driver_port = free_udp_port()?;
    driver_told.send(driver_port).map_err(io::Error::other)?;
    let cell = TestCell::changed(|text| {
        text.replace(
            "--driver=127.0.0.1:${fri}",
            &format!("--driver=127.0.0.1:{relay_port}"),
        )
        .replace(
            "listen: 127.0.0.1:${fri}",
            &format!("listen: 127.0.0.1:{driver_port}"),
        )
        .replace("delay: 10 ms", &format!("delay: {delay}"))
    });
    let watch = cell.watch();
    let id = cell.run(NET);
    let late_before = watch.status().late;
    std::thread::sleep(Duration::from_secs(seconds));
    let late_cycles = watch.status().late - late_before;
    let row = cell.state(id);
    let state = match &row["reason"] {
        Value::String(reason) => reason.clone(),
        _ => row["state"].to_string(),
    };
    drop(watch);
    if cell.operate(id, "cancel").status == 200 {
        cell.await_end(id);
    }
    drop(stop);
    let relay = relay
        .join()
        .map_err(|_| io::Error::other("the relay panicked"))??;
    drop(cell);
    let mut latencies_ns = relay.latencies_ns;
    latencies_ns.sort_unstable();
    Ok(Figures {
        delay,
        latencies_ns,
        late_cycles,
        state,
    })
}

fn free_udp_port() -> io::Result<u16> {
    Ok(UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?
        .local_addr()?
        .port())
}

fn row(figures: &Figures) -> String {
    let of = |part: f64| {
        let last = figures.latencies_ns.len().saturating_sub(1);
        let place = (part * last as f64).round() as usize;
        let value = figures.latencies_ns.get(place).copied().unwrap_or(0);
        format!("{:.2}", value as f64 * 1e-6)
    };
    let mut text = format!("| {} ", figures.delay);
    for part in [0.0, 0.5, 0.9, 0.99, 0.999, 1.0] {
        let _ = write!(text, "| {} ", of(part));
    }
    let (count, late) = (figures.latencies_ns.len(), figures.late_cycles);
    let _ = write!(text, "| {count} | {late} | {} |", figures.state);
    text
}

fn main() -> io::Result<()> {
    let seconds = std::env::args()
        .nth(1)
        .map_or(Ok(10), |text| text.parse())
        .map_err(|error| io::Error::other(format!("latency [SECONDS]: {error}")))?;
    println!("| `delay` | min | p50 | p90 | p99 | p99.9 | max | packets | late cycles | net |");
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for delay in ["10 ms", "5 ms", "3 ms", "2 ms", "1 ms", "0 ms"] {
        println!("{}", row(&measure(delay, seconds)?));
    }
    Ok(())
}
