//! Derives the checks of one motion from its recorded data. Pure; called by the demo's main thread when a motion has
//! ended.

use rcc_api::bodies::{CommandDetail, CommandView};
use rcc_core::frame::joints_from;
use rcc_core::kinematics::Arm;
use rcc_core::message::MonitorRecord;
use rcc_core::path::PathLimits;
use rcc_core::pose::Pose;

use super::facts::MotionFacts;
use super::simulator::DatagramExchange;
use super::verify::{
    self, ARM_TOLERANCE_M, DistanceTrack, LineSegment, MotionCheck, SET_POINT_TOLERANCE_M,
    SentDatagram,
};
use crate::follow;

/// Event during a motion of the demo, which selects the checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionEvent {
    /// No event.
    None,
    /// The arm touches a floor.
    Contact,
    /// The torch is switched on and off during the motion.
    Weld,
    /// The motion is canceled while the torch burns.
    Cancel,
}

/// Everything recorded of one motion.
pub struct RecordedMotion<'a> {
    /// The command after its end.
    pub command: &'a CommandDetail,
    /// Parameters from its text.
    pub facts: MotionFacts,
    /// Its monitor records, in order.
    pub records: Vec<MonitorRecord>,
    /// Datagrams on the wire.
    pub exchanges: Vec<DatagramExchange>,
    /// Kinematics of the arm.
    pub arm: Arm,
    /// Bit of the torch in `$FRI_FRM_BOOL`.
    pub torch_bit: u16,
    /// Period, s.
    pub dt_s: f64,
}

/// Values of a monitor: cycle and elements.
type Series<'a> = Vec<(u64, &'a [f64])>;

impl RecordedMotion<'_> {
    fn series(&self, source: &str) -> Series<'_> {
        let monitor = monitor_index(self.command, source);
        let records = self.records.iter();
        records
            .filter(|record| Some(record.monitor) == monitor)
            .filter_map(|record| Some((record.cycle, record.values.get(..record.width as usize)?)))
            .collect()
    }

    fn points(&self, source: &str) -> Vec<[f64; 3]> {
        let series = self.series(source);
        let xyz = |values: &[f64]| values.first_chunk().copied().unwrap_or([f64::NAN; 3]);
        series.iter().map(|(_, values)| xyz(values)).collect()
    }

    fn flange(&self, joints: &[f64]) -> [f64; 3] {
        match joints_from(joints) {
            Some(joints) => position(&self.arm.forward(&joints)),
            None => [f64::NAN; 3],
        }
    }

    /// Returns the first cycle in which a Bool becomes `value`.
    fn switched(&self, source: &str, value: bool) -> Option<u64> {
        let wanted = f64::from(u8::from(value));
        let series = self.series(source);
        let is = |(_, values): &(u64, &[f64])| values.first() == Some(&wanted);
        let mut pairs = series
            .windows(2)
            .filter(|pair| !is(&pair[0]) && is(&pair[1]));
        pairs.next().map(|pair| pair[1].0)
    }

    /// Returns the first cycle in which a Bool is true.
    fn first_true(&self, source: &str) -> Option<u64> {
        let series = self.series(source);
        let mut cycles = series
            .iter()
            .filter(|(_, values)| values.first() == Some(&1.0));
        cycles.next().map(|(cycle, _)| *cycle)
    }
}

/// Returns the index of the monitor that watches `source`.
#[must_use]
pub fn monitor_index(command: &CommandDetail, source: &str) -> Option<u32> {
    let monitors = command.names.get("monitors")?.as_array()?;
    let watches = |monitor: &serde_json::Value| {
        monitor.get("source").and_then(serde_json::Value::as_str) == Some(source)
    };
    u32::try_from(monitors.iter().position(watches)?).ok()
}

/// Returns all checks of a motion.
#[must_use]
pub fn checks(recorded: &RecordedMotion<'_>, event: MotionEvent) -> Vec<MotionCheck> {
    let set_points = recorded.points("move.pose");
    let joints = recorded.series("ik.joints");
    let from_joints: Vec<[f64; 3]> = joints
        .iter()
        .map(|(_, values)| recorded.flange(values))
        .collect();
    let line = LineSegment {
        start: set_points.first().copied().unwrap_or([f64::NAN; 3]),
        end: recorded.facts.goal,
    };
    let limits = PathLimits {
        length: line.length(),
        ..recorded.facts.limits
    };
    let distance = recorded.series("move.distance");
    let distances: Vec<f64> = distance
        .iter()
        .map(|(_, values)| values.first().copied().unwrap_or(f64::NAN))
        .collect();
    let cycles: Vec<u64> = distance.iter().map(|(cycle, _)| *cycle).collect();
    let track = DistanceTrack {
        first_cycle: cycles.first().copied().unwrap_or(0),
        distances: &distances,
        limits,
        dt_s: recorded.dt_s,
    };
    let flanges: Vec<[f64; 3]> = recorded.exchanges.iter().map(|one| one.flange).collect();
    let on_line = |what: &str, points: &[[f64; 3]], tolerance| {
        verify::on_the_line(what, points, &line, tolerance)
    };
    let mut checks = vec![
        end_reason_check(&recorded.command.command, event),
        verify::without_gaps("every cycle evaluated and recorded", &cycles),
        on_line("set-points on the line", &set_points, SET_POINT_TOLERANCE_M),
        on_line(
            "joint set-points on the line (FK)",
            &from_joints,
            SET_POINT_TOLERANCE_M,
        ),
        on_line("simulated arm on the line", &flanges, ARM_TOLERANCE_M),
        verify::within_limits("speed, acceleration, jerk within limits", &track),
    ];
    checks.extend(event_checks(recorded, event, &track, &line));
    checks
}

fn event_checks(
    recorded: &RecordedMotion<'_>,
    event: MotionEvent,
    track: &DistanceTrack<'_>,
    line: &LineSegment,
) -> Vec<MotionCheck> {
    let sent: Vec<SentDatagram> = recorded
        .exchanges
        .iter()
        .map(|exchange| SentDatagram {
            along: line.along(recorded.flange(&exchange.commanded)),
            on: exchange.booleans & recorded.torch_bit != 0,
        })
        .collect();
    match event {
        MotionEvent::None => Vec::new(),
        MotionEvent::Contact => {
            let asked = recorded.first_true("stop.out");
            let mut checks = vec![floor_contact(recorded)];
            checks.extend(verify::soft_stop("contact", track, asked));
            checks
        }
        MotionEvent::Weld => weld(recorded, track, &sent),
        MotionEvent::Cancel => cancel(recorded, track, &sent),
    }
}

fn weld(
    recorded: &RecordedMotion<'_>,
    track: &DistanceTrack<'_>,
    sent: &[SentDatagram],
) -> Vec<MotionCheck> {
    let (on, off) = (recorded.facts.torch_on, recorded.facts.torch_off);
    let switching = |(word, value, position): (&str, bool, Option<f64>)| {
        let switched = recorded.switched("burn.out", value);
        let pair = switched.and_then(|cycle| Some((track.at(cycle - 1)?, track.at(cycle)?)));
        let along = pair.map_or(f64::NAN, |(_, after)| after);
        let position = position.unwrap_or(f64::NAN);
        let crossing = format!("torch {word} in the crossing cycle");
        let datagram = format!("torch {word} in the datagram of that set-point");
        [
            verify::crosses(&crossing, position, pair),
            verify::switches_with(&datagram, sent, value, along),
        ]
    };
    [("on", true, on), ("off", false, off)]
        .into_iter()
        .flat_map(switching)
        .collect()
}

fn cancel(
    recorded: &RecordedMotion<'_>,
    track: &DistanceTrack<'_>,
    sent: &[SentDatagram],
) -> Vec<MotionCheck> {
    let asked = recorded.first_true("cancel.requested");
    let off = recorded.switched("burn.out", false);
    let along = asked.and_then(|cycle| track.at(cycle)).unwrap_or(f64::NAN);
    let mut checks = verify::soft_stop("cancel", track, asked);
    checks.push(MotionCheck::new(
        "torch off in the cycle of the cancel",
        off.is_some() && off == asked,
        in_cycle(asked),
        in_cycle(off),
    ));
    let datagram = "torch off in the datagram of that set-point";
    checks.push(verify::switches_with(datagram, sent, false, along));
    checks
}

fn in_cycle(cycle: Option<u64>) -> String {
    cycle.map_or_else(|| "never".to_owned(), |cycle| format!("cycle {cycle}"))
}

/// Checks that the arm really touched the floor.
fn floor_contact(recorded: &RecordedMotion<'_>) -> MotionCheck {
    let force = recorded
        .exchanges
        .iter()
        .fold(0.0_f64, |most, exchange| most.max(exchange.force[2].abs()));
    MotionCheck::new(
        "the simulated arm touched the floor",
        force > 0.0,
        "a force",
        format!("{force:.1} N at most"),
    )
}

fn end_reason_check(command: &CommandView, event: MotionEvent) -> MotionCheck {
    let expected = if event == MotionEvent::Cancel {
        "canceled"
    } else {
        "finished"
    };
    let cause = command
        .fault
        .as_ref()
        .map(|fault| format!(": {}", fault.words));
    MotionCheck::new(
        "the net ended as expected",
        command.reason.as_deref() == Some(expected),
        format!("terminated ({expected})"),
        format!(
            "{}{}",
            follow::state_text(command),
            cause.unwrap_or_default()
        ),
    )
}

fn position(pose: &Pose) -> [f64; 3] {
    let [x, y, z, ..] = pose.to_slots();
    [x, y, z]
}
