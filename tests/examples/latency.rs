//! Measures the latency of the whole chain: from a packet of the robot through driver, boards and executor to the first
//! answer that contains the effect of that packet. A transparent relay between `lwr-sim` and the driver numbers the
//! packets in a KRL variable that a net copies to an output, and takes the times. Prints `docs/latency.md`. Runs on the
//! main thread and one thread for the relay.

use std::fmt::Write as _;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use rcc_core::message::{ClockState, ClockStatus};
use rcc_drivers::fri_lwr::wire::{CMD_SIZE, MSR_SIZE};
use rcc_os::clock::monotonic_ns;
use rcc_testing::quantile;
use rcc_tests::reference::promote;
use rcc_tests::{TestCell, await_some};
use serde_json::Value;

/// Real-time priority of the relay: above the executor's (80), so that the relay does not delay the packets.
const PRIORITY: i32 = 90;
/// Bytes of `$FRI_TO_REA[1]` and of `$FRI_FRM_REA[1]` in their datagrams; the offset is the same in both.
const REAL_1: std::ops::Range<usize> = 8..12;
/// Count of packet numbers; scaled to an output of 0 to 0.5 m/s, each is exact in binary32.
const NUMBERS: u64 = 1 << 12;
/// Packets before the measurement begins, so that every process has touched its memory.
const WARM_UP: u64 = 500;
const PACKET_MAX: usize = 2048;

/// Copies the numbered input to an output and commands the driver's hold position.
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

/// A relay between the controller and the driver that numbers the packets and measures the latencies.
struct Relay {
    /// Socket towards the controller: receives packets, sends answers.
    controller: UdpSocket,
    /// Socket towards the driver: sends packets, receives answers.
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

    /// Waits at most 100 ms for a packet from either side and forwards all that have arrived.
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
            // Fails while the driver has not started; the controller sends again.
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

    /// Records the latency of the newest packet number in an answer, at its first occurrence; skipped numbers are not
    /// measured.
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
        // Without a net the output is 0, which is also a valid number: only an increase counts.
        if number > 0 && which > self.answered {
            self.answered = which;
            if which > WARM_UP {
                self.latencies_ns
                    .push(now_ns - self.sent_ns[number as usize]);
            }
        }
    }
}

/// Configuration of the cell's clocks.
#[derive(Clone, Copy)]
enum Mode {
    /// The executor's clock follows the robot with this offset.
    Clock(&'static str),
    /// Two independent clocks; set-points wait in the driver for this delay.
    Delay(&'static str),
}

impl Mode {
    fn name(self) -> String {
        match self {
            Mode::Clock(offset) => format!("`clock`, offset {offset}"),
            Mode::Delay(delay) => format!("`delay: {delay}`"),
        }
    }

    fn configure(self, text: &str) -> String {
        match self {
            Mode::Clock(offset) => {
                // The `#` turns the rest of the line into a comment.
                let text = text.replace("    delay: 80 ms", "    #");
                format!("{text}\nclock: {{device: lwr, offset: {offset}}}\n")
            }
            Mode::Delay(delay) => text.replace("delay: 80 ms", &format!("delay: {delay}")),
        }
    }
}

/// Measurements of one mode.
struct Figures {
    mode: Mode,
    latencies_ns: Vec<u64>,
    late_cycles: u64,
    clock: ClockStatus,
    state: String,
}

fn measure(mode: Mode, seconds: u64) -> io::Result<Figures> {
    let controller = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    let relay_port = controller.local_addr()?.port();
    // The relay starts before the cell, because `await_ready` needs packets.
    let (driver_told, driver_tell) = std::sync::mpsc::channel();
    let (stop, stopped) = std::sync::mpsc::channel::<()>();
    let relay = std::thread::spawn(move || -> io::Result<Relay> {
        let port = driver_tell.recv().map_err(io::Error::other)?;
        let mut relay = Relay::bind(controller, port)?;
        if !promote(None, PRIORITY) {
            eprintln!(
                "real-time priority not permitted: the latencies include delays of the relay"
            );
        }
        // Ends on a message or when the sender is dropped.
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
        let text = text
            .replace(
                "--driver=127.0.0.1:${fri}",
                &format!("--driver=127.0.0.1:{relay_port}"),
            )
            .replace(
                "listen: 127.0.0.1:${fri}",
                &format!("listen: 127.0.0.1:{driver_port}"),
            );
        mode.configure(&text)
    });
    let watch = cell.watch();
    if matches!(mode, Mode::Clock(_)) {
        let locked = ClockState::Locked as u32;
        await_some("the clock to be locked", || {
            (watch.status().clock.state == locked).then_some(())
        });
    }
    let id = cell.run(NET);
    let late_before = watch.status().late;
    std::thread::sleep(Duration::from_secs(seconds));
    let late_cycles = watch.status().late - late_before;
    let clock = watch.status().clock;
    let row = cell.state(id);
    let state = match &row["reason"] {
        Value::String(reason) => reason.clone(),
        _ => row["state"].as_str().unwrap_or("?").to_owned(),
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
        mode,
        latencies_ns,
        late_cycles,
        clock,
        state,
    })
}

fn free_udp_port() -> io::Result<u16> {
    Ok(UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?
        .local_addr()?
        .port())
}

impl Figures {
    /// Returns the latency at this quantile (0 to 1), ms.
    fn part(&self, part: f64) -> f64 {
        quantile(&self.latencies_ns, part).unwrap_or(0) as f64 * 1e-6
    }

    /// Returns the share of the packets answered within 1 ms, before the next packet, %.
    fn within_a_period(&self) -> f64 {
        let count = self.latencies_ns.iter().filter(|ns| **ns < 1_000_000);
        100.0 * count.count() as f64 / self.latencies_ns.len().max(1) as f64
    }

    fn row(&self) -> String {
        let mut text = format!("| {} ", self.mode.name());
        for part in [0.0, 0.5, 0.9, 0.99, 0.999, 1.0] {
            let _ = write!(text, "| {:.2} ", self.part(part));
        }
        let (count, late, state) = (self.latencies_ns.len(), self.late_cycles, &self.state);
        let within = self.within_a_period();
        let _ = write!(text, "| {within:.1} % | {count} | {late} | {state} |");
        text
    }
}

const HEAD: &str = "# Latency

The time from a packet of the robot to the first answer that contains the effect of that packet, through the whole chain:
driver, measurement board, the executor's cycle with a net, command board, driver.

A relay between the simulated controller and the driver writes a number into each packet (`$FRI_TO_REA[1]`); a net copies
it to an output (`$FRI_FRM_REA[1]`) while it commands the arm; the relay waits for its return. There is one packet and one cycle
per millisecond. A program prints this page:

```console
$ cargo build{profile} --workspace --bins && cargo run{profile} -p rcc-tests --example latency -- {seconds}
```
";

const TAIL: &str = "
**With `clock: {device: lwr}`** in the cell's configuration the executor's cycles begin a fixed time (`offset`) after the
robot's packets. The driver publishes a measurement as soon as it arrives, waits for the set-point that was computed from
it, at most 60 % of the robot's period, and answers: the effect leaves within the same period of the robot. There is no other
waiting, so `offset` is most of the latency; it must be longer than the time from the packet to the board, and a shorter one
gains little.

- Deadlines are moved by at most 1 % of a period in a cycle; logical time has one period for each cycle, as always.
- A late executor is bridged: the arm goes on as it moved, for at most 10 ms, and then returns
  to the newest set-point within its limits; no delay remains. A longer pause brings the arm to rest and
  ends its net. With `delay: 10 ms` pauses of up to 10 ms are bridged by playing slower.
- Without the robot (or before it is found) the executor runs on its own clock, and `rcc-cli status` says so.
- The robot's period must be the cell's or a multiple of it.

**Without it** there are two clocks, and set-points wait in the driver for `delay`, so that neither clock starves the other.
The rest, about a period, is the wait for the next cycle and for the next packet. Set-points that accumulate during a stall of
the machine are caught up: at rest at once, unless outputs change with them; in motion at up to 1.05 times the speed, within the
limits of velocity and acceleration, which takes 20 ms for each millisecond.

On a machine that does not stall, `delay: 2 ms` is enough. `rcc-cli doctor` measures whether a machine stalls.
";

fn main() -> io::Result<()> {
    let seconds = std::env::args()
        .nth(1)
        .map_or(Ok(10_u64), |text| text.parse())
        .map_err(|error| io::Error::other(format!("latency [SECONDS]: {error}")))?;
    let cores = std::thread::available_parallelism()?;
    let date = rcc_protocol::events::wall_time();
    let date = date.split('T').next().unwrap_or_default();
    let profile = if cfg!(debug_assertions) {
        ""
    } else {
        " --release"
    };
    let head = HEAD.replace("{profile}", profile);
    println!("{}", head.replace("{seconds}", &seconds.to_string()));
    println!(
        "Milliseconds, {seconds} s each, on {date}, on a machine with {cores} cores whose own stalls (the late cycles)"
    );
    println!(
        "are part of it. The column `< 1 ms` is the part that was answered before the robot's next packet."
    );
    println!();
    println!("| | min | p50 | p90 | p99 | p99.9 | max | < 1 ms | packets | late cycles | net |");
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    let modes = [
        Mode::Clock("200 us"),
        Mode::Clock("100 us"),
        Mode::Delay("10 ms"),
        Mode::Delay("5 ms"),
        Mode::Delay("2 ms"),
        Mode::Delay("1 ms"),
        Mode::Delay("0 ms"),
    ];
    let mut clocks = Vec::new();
    for mode in modes {
        let figures = measure(mode, seconds)?;
        println!("{}", figures.row());
        if matches!(mode, Mode::Clock(_)) {
            clocks.push((figures.mode.name(), figures.clock));
        }
    }
    println!();
    for (name, clock) in clocks {
        println!(
            "- {name}: {}, its lock lost {} times; packets ± {:.0} µs, cycles {:+.1} µs from where they should begin",
            ClockState::from_number(clock.state).name(),
            clock.losses,
            clock.jitter_ns * 1e-3,
            clock.error_ns * 1e-3
        );
    }
    println!("{TAIL}");
    Ok(())
}
