//! The control port of a simulator: one JSON object a line, each way.
//! Run by the threads of the test harness.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use crate::waiting::await_some;

/// A resting joint is slower than this, rad/s: the simulated arm counts as resting within 0.1 mrad of its set-point, and
/// creeps up to it at a bandwidth of 80 rad/s.
pub const STILL: f64 = 4e-3;
/// A moving joint is faster than this, rad/s: well above the creep of a resting one.
pub const MOVING: f64 = 0.02;
/// More than the `delay` of the cells, s: set-points of a net that has ended are still played for so long.
const PLAYED_S: f64 = 0.2;

/// A connection to the control port of `lwr-sim` or `io-sim`.
#[derive(Debug)]
pub struct Simulator {
    stream: BufReader<UnixStream>,
}

impl Simulator {
    /// Connects once the simulator listens at its socket.
    pub fn connect(path: &Path) -> Simulator {
        let stream = await_some("a simulator's control port", || {
            UnixStream::connect(path).ok()
        });
        stream
            .set_read_timeout(Some(Duration::from_secs(20)))
            .expect("a time-out can be set");
        Simulator {
            stream: BufReader::new(stream),
        }
    }

    /// Sends one request and returns its answer.
    pub fn ask(&mut self, request: &Value) -> Value {
        let mut line = request.to_string();
        line.push('\n');
        self.stream
            .get_mut()
            .write_all(line.as_bytes())
            .expect("the simulator reads");
        let mut answer = String::new();
        self.stream
            .read_line(&mut answer)
            .expect("the simulator answers");
        serde_json::from_str(&answer)
            .unwrap_or_else(|error| panic!("{request}: {answer:?}: {error}"))
    }

    /// Everything at this moment.
    pub fn state(&mut self) -> Value {
        self.ask(&json!("state"))
    }

    /// Counters, faults and extremes begin anew.
    pub fn reset_statistics(&mut self) {
        let done = self.ask(&json!("reset_statistics"));
        assert_eq!(done["ok"], true, "{done}");
    }

    /// No joint has moved since the last reset of the statistics, which must have been at rest.
    pub fn assert_not_moved(&mut self) {
        let state = self.state();
        let fastest = joints_of(&state["velocity_max"]);
        assert!(
            fastest.iter().all(|velocity| *velocity <= STILL),
            "moved although nobody asked for it: {state}"
        );
    }

    /// Joint positions, rad.
    pub fn joints(&mut self) -> [f64; 7] {
        joints_of(&self.state()["q"])
    }

    /// Returns true if a joint has moved faster than [`MOVING`] since the last reset.
    pub fn has_moved(&mut self) -> bool {
        let fastest = joints_of(&self.state()["velocity_max"]);
        fastest.iter().any(|velocity| *velocity > MOVING)
    }

    /// Waits until a joint moves faster than [`MOVING`].
    pub fn await_motion(&mut self) {
        await_some("the arm to move", || {
            let velocity = joints_of(&self.state()["velocity"]);
            velocity.iter().any(|v| v.abs() > MOVING).then_some(())
        });
    }

    /// Waits until neither set-point nor arm moves, and every set-point that was sent before this call has been played;
    /// returns the state then.
    pub fn await_rest(&mut self) -> Value {
        let time_s = |state: &Value| state["time_s"].as_f64().expect("a time");
        let played_s = time_s(&self.state()) + PLAYED_S;
        await_some("the arm to rest", || {
            let state = self.state();
            (state["at_rest"] == true && time_s(&state) > played_s).then_some(state)
        })
    }

    /// Watches the arm for `ticks` of the controller's own time: no joint may move by more than 10 µrad.
    pub fn assert_still(&mut self, ticks: u64) {
        let first = self.state();
        let (begun, held) = (
            first["tick"].as_u64().expect("a tick"),
            joints_of(&first["q"]),
        );
        loop {
            let state = self.state();
            for (now, before) in joints_of(&state["q"]).iter().zip(held) {
                assert!((now - before).abs() < 1e-5, "moved from {held:?}: {state}");
            }
            if state["tick"].as_u64().expect("a tick") >= begun + ticks {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// Seven numbers of a state.
pub fn joints_of(value: &Value) -> [f64; 7] {
    let number = |index: usize| value[index].as_f64();
    std::array::from_fn(|index| {
        number(index).unwrap_or_else(|| panic!("seven numbers expected, not {value}"))
    })
}

/// Largest velocity (rad/s) and acceleration (rad/s²) that each joint may have, from the shipped configuration.
pub fn limits() -> ([f64; 7], [f64; 7]) {
    let path = crate::repository().join("configs/cells/lwr.yaml");
    let config = rcc_config::CellConfig::load(&path, &Default::default())
        .unwrap_or_else(|faults| panic!("{faults}"));
    let limits = config.models()[0].limits;
    let seven = |values: [f64; 8]| std::array::from_fn(|index| values[index]);
    (seven(limits.velocity_max), seven(limits.acceleration_max))
}

/// True if the controller had no answer for some periods and then another one: it went on at the last velocity meanwhile,
/// and is where it was told to be one period later. That step is of the machine that slept, not of what was commanded.
fn has_caught_up(state: &Value) -> bool {
    let count = |key: &str| state["counts"][key].as_u64().expect("a count");
    let faults = state["faults"].as_array().expect("a list of faults");
    // After the last ones of these it stopped.
    let stopped_after = if faults.is_empty() {
        0
    } else {
        count("missed_in_a_row_max")
    };
    count("stalls") > 0 || count("missed") > stopped_after
}

/// Values of `$FRI_TO_INT[2]` if the controller stopped because answers were missing: more in a row than it bridges, or,
/// if the driver before had died just now, so few of the last 100 that the quality is below BAD.
pub const ANSWERS_LOST: [i64; 2] = [1, 2];

/// Asserts that the arm was never commanded beyond its limits since the last reset, never exceeded them, and that the controller stopped it for no other
/// reason than one of `causes` (numbers of `$FRI_TO_INT[2]`).
pub fn assert_within_limits(state: &Value, causes: &[i64]) {
    let (velocity_max, acceleration_max) = limits();
    let within = |key: &str, limits: [f64; 7]| {
        for (joint, (value, limit)) in joints_of(&state[key]).iter().zip(limits).enumerate() {
            assert!(
                *value <= limit,
                "{key} of J{}: {value} > {limit}\n{state}",
                joint + 1
            );
        }
    };
    within("commanded_velocity_max", velocity_max);
    within("commanded_acceleration_max", acceleration_max);
    if !has_caught_up(state) {
        within("velocity_max", velocity_max);
        within("acceleration_max", acceleration_max);
    }
    for fault in state["faults"].as_array().expect("a list of faults") {
        let code = fault["code"].as_i64().expect("a number");
        assert!(
            causes.contains(&code),
            "the controller stopped the arm: {fault}\n{state}"
        );
    }
}
