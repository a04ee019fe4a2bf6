//! Logs each change of a device's state once, to the driver's log and to the cell's event log.
//! Run by the host's thread; a helper thread writes the event log.

use rcc_config::{ChannelConfig, DeviceConfig};
use rcc_core::guard::{LinearViolation, Violation, axis};
use rcc_core::message::{DeviceState, Measurement};
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;
use rcc_ipc::events::EventRecorder;
use rcc_protocol::events::{Event, EventKind, EventSeverity};

use super::device_session::DeviceSession;
use super::reason::{self, Reason};

/// Lower bounds of the quality grades, thousandths, best first; a quality below all of them is a further grade.
const GRADES: [u32; 3] = [950, 800, 500];
/// Shortest interval between two quality messages, ns: a connection may stay at a bound for hours.
const QUALITY_EVERY_NS: u64 = 5_000_000_000;
/// Hysteresis of a grade, thousandths.
const HYSTERESIS: u32 = 20;

/// The last logged state, so that each change is logged once.
#[derive(Debug)]
pub struct StateLog {
    recorder: EventRecorder,
    reasons: &'static [Reason],
    analog_outputs: Vec<ChannelConfig>,
    /// The joints are linear axes.
    linear: bool,
    state: DeviceState,
    reason: u32,
    out_of_range: u64,
    violations: u64,
    /// Last logged quality; `None` while the device is offline.
    quality: Option<u32>,
    /// Time of that message, ns.
    quality_ns: u64,
    /// Time at which the present stop started, ns.
    stopping_ns: Option<u64>,
}

impl StateLog {
    /// A log for a device that has not been reached yet.
    #[must_use]
    pub fn new(
        recorder: EventRecorder,
        device: &DeviceConfig,
        reasons: &'static [Reason],
    ) -> StateLog {
        let outputs = device.channels_of(ChannelKind::AnalogOutput);
        StateLog {
            recorder,
            reasons,
            analog_outputs: outputs.cloned().collect(),
            linear: device.model().is_linear(),
            state: DeviceState::Offline,
            reason: 0,
            out_of_range: 0,
            violations: 0,
            quality: None,
            quality_ns: 0,
            stopping_ns: None,
        }
    }

    /// Logs the changes since the last call; a device without changes is not mentioned.
    pub fn update(&mut self, session: &DeviceSession) {
        let measurement = session.measurement();
        self.update_state(measurement);
        self.update_quality(measurement);
        let violations = session.counts().violations;
        if violations != self.violations {
            self.violations = violations;
            if let Some(violation) = session.violation() {
                self.log(refused_event(violation, self.linear));
            }
        }
        let out_of_range = session.out_of_range();
        if out_of_range != self.out_of_range {
            self.out_of_range = out_of_range;
            if out_of_range != 0 {
                self.log(out_of_range_event(
                    &self.analog_outputs,
                    out_of_range,
                    session.commanded_analog(),
                ));
            }
        }
    }

    fn update_state(&mut self, measurement: &Measurement) {
        let state = DeviceState::from_number(measurement.state);
        if state == self.state && measurement.reason == self.reason {
            return;
        }
        let words = match measurement.reason {
            0 => String::new(),
            number => reason::meaning(number, self.reasons).to_owned(),
        };
        let was = std::mem::replace(&mut self.state, state);
        self.reason = measurement.reason;
        self.log(EventKind::DriverState {
            state: state.name().to_owned(),
            was: was.name().to_owned(),
            reason: words.clone(),
        });
        let stopping = state == DeviceState::Stopping;
        if stopping && was != DeviceState::Stopping {
            self.stopping_ns = Some(measurement.stamp_ns);
            self.log(EventKind::RestBegun { reason: words });
        } else if !stopping && let Some(begun_ns) = self.stopping_ns.take() {
            // An offline device may or may not be at rest.
            if state != DeviceState::Offline {
                let took_ns = measurement.stamp_ns.saturating_sub(begun_ns);
                self.log(EventKind::RestReached {
                    after_ms: took_ns / 1_000_000,
                });
            }
        }
    }

    fn update_quality(&mut self, measurement: &Measurement) {
        if self.state == DeviceState::Offline {
            self.quality = None;
            return;
        }
        let now = measurement.quality_permille;
        let Some(was) = self.quality else {
            self.quality = Some(now);
            return;
        };
        let young = measurement.stamp_ns.saturating_sub(self.quality_ns) < QUALITY_EVERY_NS;
        if has_changed(was, now) && !young {
            self.quality = Some(now);
            self.quality_ns = measurement.stamp_ns;
            self.log(EventKind::Quality { permille: now, was });
        }
    }

    /// Writes to both logs.
    fn log(&self, what: EventKind) {
        let event = Event::now(self.recorder.source().clone(), None, what);
        let words = event.sentence(&|_, id| format!("command {id}"));
        match event.severity {
            EventSeverity::Info => tracing::info!("{words}"),
            _ => tracing::warn!("{words}"),
        }
        self.recorder.record(event);
    }
}

/// Returns true if the grade has changed by more than the hysteresis.
fn has_changed(was: u32, now: u32) -> bool {
    let grade = |quality: u32| GRADES.iter().position(|least| quality >= *least);
    grade(was) != grade(now) && was.abs_diff(now) > HYSTERESIS
}

/// Describes the analog outputs whose bits are set, by the values (SI) that were commanded.
fn out_of_range_event(outputs: &[ChannelConfig], bits: u64, commanded: &[f64]) -> EventKind {
    let all = outputs.iter().zip(commanded).enumerate();
    let out = all.filter(|(index, _)| bits >> index & 1 == 1);
    let (mut channels, mut words) = (Vec::new(), Vec::new());
    for (_, (channel, value)) in out {
        let [lower, upper] = channel.range.unwrap_or([f64::MIN, f64::MAX]);
        let unit = match channel.unit {
            Unit::ONE => String::new(),
            unit => format!(" {unit}"),
        };
        channels.push(channel.name.clone());
        words.push(format!(
            "{} = {value}{unit}, allowed {lower} to {upper}{unit}",
            channel.name
        ));
    }
    EventKind::OutOfRange {
        channels,
        words: words.join("; "),
    }
}

fn refused_event(violation: &Violation, linear: bool) -> EventKind {
    let number = |value: f64| value.is_finite().then_some(value);
    let is_joint = !violation.kind.is_of_device() && axis(usize::from(violation.joint)).is_none();
    let joint = is_joint.then(|| u32::from(violation.joint) + 1);
    EventKind::Refused {
        joint: joint.unwrap_or(0),
        value: number(violation.value),
        limit: number(violation.limit),
        unit: violation.unit_of(linear).to_owned(),
        words: match linear {
            true => LinearViolation(*violation).to_string(),
            false => violation.to_string(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_out_of_range_is_told_with_channel_value_and_range() {
        let channel = |name: &str, index| ChannelConfig {
            name: name.to_owned(),
            kind: ChannelKind::AnalogOutput,
            index,
            address: serde_json::Value::Null,
            unit: Unit::METRE,
            scale: 1.0,
            offset: 0.0,
            range: Some([0.0, 0.5]),
            on_release: None,
        };
        let outputs = [channel("speed", 0), channel("feed", 1)];
        let event = out_of_range_event(&outputs, 0b10, &[0.1, 0.75]);
        let EventKind::OutOfRange { channels, words } = event else {
            panic!("{event:?}");
        };
        assert_eq!(channels, ["feed"]);
        assert_eq!(words, "feed = 0.75 m, allowed 0 to 0.5 m");
    }

    #[test]
    fn quality_is_logged_when_its_grade_has_clearly_changed() {
        for (was, now, told) in [
            (1000, 960, false),
            (1000, 940, true),
            (955, 945, false),
            (700, 400, true),
            (300, 100, false),
        ] {
            assert_eq!(has_changed(was, now), told, "{was} {now}");
        }
    }

    #[test]
    fn a_refused_set_point_is_logged_with_joint_value_limit_and_unit() {
        let violation = Violation {
            kind: rcc_core::guard::ViolationKind::Velocity,
            joint: 3,
            value: 2.5,
            limit: 2.0,
        };
        let EventKind::Refused {
            joint,
            value,
            limit,
            unit,
            words,
        } = refused_event(&violation, false)
        else {
            panic!("a refusal");
        };
        assert_eq!(
            (joint, value, limit, &*unit),
            (4, Some(2.5), Some(2.0), "rad/s")
        );
        assert!(words.contains("joint 4"), "{words}");
    }
}
