//! The simulated controller of an arm as a pure state machine: it makes the line of each period and takes the answer. Its
//! joints are where the last set-point was; a real arm follows with a lag.
//!
//! It follows set-points (`go=1`) after ten answers in a row that repeat its own position, and until it misses twenty, or the
//! driver asks it to stop. Output 1 of each type is looped back to input 1.

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use crate::text_line::{LINE_MAX, is_pause, parse, push, seal, unseal};

/// Answers in a row after which the controller follows.
const ANSWERS_TO_GO: u32 = 10;
/// Periods without an answer after which it does not follow any more.
const MISSED_MAX: u32 = 20;
/// Most datagrams that are read in one period.
const BURST_MAX: usize = 64;
/// Largest difference of an answer that repeats the position, rad.
const REPEATED_RAD: f64 = 1e-6;

/// The controller and its arm.
#[derive(Clone, Debug)]
pub struct SimulatedArm {
    position: Vec<f64>,
    outputs: BTreeMap<String, f64>,
    /// Number of the line of this period.
    number: u64,
    follows: bool,
    is_answered: bool,
    answers: u32,
    missed: u32,
}

impl SimulatedArm {
    /// An arm at this position, rad, that follows nobody.
    #[must_use]
    pub fn new(position: &[f64]) -> Self {
        Self {
            position: position.to_owned(),
            outputs: BTreeMap::new(),
            number: 0,
            follows: false,
            is_answered: false,
            answers: 0,
            missed: 0,
        }
    }

    /// Returns true if the controller follows set-points.
    #[must_use]
    pub fn follows(&self) -> bool {
        self.follows
    }

    /// Returns the joint positions, rad.
    #[must_use]
    pub fn position(&self) -> &[f64] {
        &self.position
    }

    /// Returns the newest outputs by their name on the wire, such as `d1` and `a1`, without those never received.
    #[must_use]
    pub fn outputs(&self) -> &BTreeMap<String, f64> {
        &self.outputs
    }

    /// Begins the next period; returns its line with the checksum.
    pub fn tick(&mut self) -> String {
        if self.is_answered {
            self.missed = 0;
        } else {
            self.missed += 1;
            self.answers = 0;
            self.follows &= self.missed < MISSED_MAX;
        }
        self.is_answered = false;
        self.number += 1;
        let mut line = format!("is {}", self.number);
        line += if self.follows { " go=1" } else { " go=0" };
        for (position, joint) in self.position.iter().zip(1..) {
            push(&mut line, 'q', joint, position);
        }
        for (kind, name) in [('d', "d1"), ('a', "a1")] {
            push(&mut line, kind, 1, self.outputs.get(name).unwrap_or(&0.0));
        }
        seal(&line)
    }

    /// Returns the set-points in an answer to the line of this period, rad; `None` for every other line.
    #[must_use]
    pub fn set_points(&self, bytes: &[u8]) -> Option<Vec<f64>> {
        let (word, number, values) = parse(unseal(bytes)?)?;
        let joints = 1..=self.position.len();
        let set_points: Option<Vec<f64>> = joints
            .map(|joint| values.get(&format!("q{joint}")).copied())
            .collect();
        set_points.filter(|_| word == "set" && number == self.number && !self.is_answered)
    }

    /// Takes an answer to the line of this period; ignores every other line.
    pub fn take(&mut self, bytes: &[u8]) {
        let Some(set_points) = self.set_points(bytes) else {
            return;
        };
        let Some((_, _, mut values)) = unseal(bytes).and_then(parse) else {
            return;
        };
        self.is_answered = true;
        let stops = values.remove("stop").is_some();
        values.retain(|name, _| !name.starts_with('q'));
        self.outputs.extend(values);
        let repeats = |(own, told): (&f64, &f64)| (own - told).abs() <= REPEATED_RAD;
        if stops {
            (self.follows, self.answers) = (false, 0);
        } else if self.follows {
            self.position = set_points;
        } else if self.position.iter().zip(&set_points).all(repeats) {
            self.answers += 1;
            self.follows = self.answers >= ANSWERS_TO_GO;
        } else {
            self.answers = 0;
        }
    }

    /// Runs this arm in real time, for a driver at this address; never returns without an error.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses the socket.
    pub fn run(mut self, driver: SocketAddr, period: Duration) -> io::Result<()> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        let mut next = Instant::now();
        loop {
            // Periods in which this process slept are counted: the driver plays set-points by this number.
            let behind = Instant::now().saturating_duration_since(next);
            let skipped = behind.as_nanos() / period.as_nanos().max(1);
            let skipped = u32::try_from(skipped).unwrap_or(u32::MAX - 1);
            self.number += u64::from(skipped);
            next += period.saturating_mul(skipped + 1);
            // Nobody may listen yet.
            drop(socket.send_to(self.tick().as_bytes(), driver));
            self.take_answers(&socket, driver, next)?;
        }
    }

    /// Takes answers until `end`, and after it those that have arrived while this process slept.
    fn take_answers(
        &mut self,
        socket: &UdpSocket,
        driver: SocketAddr,
        end: Instant,
    ) -> io::Result<()> {
        let mut bytes = [0; LINE_MAX];
        for _ in 0..BURST_MAX {
            let left = end.saturating_duration_since(Instant::now());
            // 0 would wait for ever.
            socket.set_read_timeout(Some(left.max(Duration::from_micros(1))))?;
            match socket.recv_from(&mut bytes) {
                Ok((size, from)) if from == driver => {
                    self.take(bytes.get(..size).unwrap_or_default());
                }
                Ok(_) => {}
                Err(error) if is_pause(&error) => return Ok(()),
                // The driver's socket does not exist yet.
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(number: u64, further: &str) -> String {
        seal(&format!("set {number} {further}"))
    }

    #[test]
    fn it_follows_whoever_repeats_its_position_and_nobody_who_does_not_answer() {
        let mut arm = SimulatedArm::new(&[0.5]);
        for number in 1..=10 {
            assert!(arm.tick().contains("go=0 q1=0.5"));
            arm.take(answer(number, "q1=0.6").as_bytes());
        }
        assert!(!arm.follows());
        for number in 11..=20 {
            arm.tick();
            arm.take(answer(number, "q1=0.5").as_bytes());
        }
        assert!(arm.tick().contains("go=1"));
        arm.take(answer(20, "q1=0.7").as_bytes());
        assert_eq!(arm.position(), [0.5], "an answer to another period");
        arm.take(answer(21, "q1=0.6 d1=1").as_bytes());
        assert_eq!((arm.position(), arm.outputs()["d1"]), (&[0.6][..], 1.0));
        for _ in 0..20 {
            assert!(arm.follows());
            arm.tick();
        }
        arm.tick();
        assert!(!arm.follows());
    }

    #[test]
    fn it_stops_following_when_it_is_asked_to() {
        let mut arm = SimulatedArm::new(&[0.0]);
        for number in 1..=10 {
            arm.tick();
            arm.take(answer(number, "q1=0").as_bytes());
        }
        assert!(arm.follows());
        arm.tick();
        arm.take(answer(11, "q1=0.1 stop=1").as_bytes());
        assert_eq!((arm.follows(), arm.position()), (false, &[0.0][..]));
    }
}
