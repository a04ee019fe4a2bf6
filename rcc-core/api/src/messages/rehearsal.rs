//! Messages about rehearsals: what a net did in virtual time, or which limit it would violate, where on its path, and
//! the remedy. Pure; used by the server's threads.

use rcc_core::kinematics::SingularityKind;
use rcc_core::message::FaultCode;
use rcc_core::path::Quantity;
use rcc_language::names::Names;
use rcc_protocol::ending::why_at_once;
use rcc_protocol::rehearsal::{
    LegPosition, PredictedViolation, RehearsalEnd, RehearsalReport, RehearsalRule, SlowerMotion,
};

use super::{NameResolver, impedance};
use crate::bodies::{PeakView, RehearsalView};
use crate::codes::{self, ErrorCode};

/// Distances to a singularity below this are mentioned in the summary (sine of the remaining angle).
const NEAR: f64 = 0.05;
/// Below this distance, joints are several times as fast as far from the singularity.
const SINGULAR: f64 = 0.2;
const QUANTITIES: [&str; 3] = ["speed", "acceleration", "jerk"];

impl NameResolver<'_> {
    /// Returns the result of the rehearsal of the net with these names.
    #[must_use]
    pub fn rehearsal(&self, rehearsed: &RehearsalReport, net: &Names) -> RehearsalView {
        let peaks = QUANTITIES.into_iter().zip(rehearsed.peaks);
        let moved = peaks.filter(|(_, peak)| peak.joint != 0);
        let peaks: Vec<PeakView> = moved
            .map(|(of, peak)| PeakView {
                of: of.to_owned(),
                device: self.device_name(peak.device),
                joint: self.joint_name(peak.device, peak.joint),
                share: peak.share,
            })
            .collect();
        let end = match rehearsed.end {
            RehearsalEnd::Finished => "finished",
            RehearsalEnd::Waits => "waits",
            RehearsalEnd::TooLong => "too long",
            RehearsalEnd::Elsewhere => "elsewhere",
        };
        RehearsalView {
            time_s: rehearsed.time_s,
            end: end.to_owned(),
            singularity: Some(rehearsed.singularity).filter(|distance| distance.is_finite()),
            outcome: net.outcome(rehearsed.outcome).map(str::to_owned),
            words: format!(
                "{}{}{}",
                summary(rehearsed, &peaks, net.outcome(rehearsed.outcome)),
                self.slowest(rehearsed, net),
                self.uncommanded(rehearsed)
            ),
            peaks,
            took_ns: rehearsed.took_ns,
        }
    }

    /// Says which motion is slow, what slows it down, where, and what would make it faster.
    fn slowest(&self, rehearsed: &RehearsalReport, net: &Names) -> String {
        let Some(slow) = rehearsed.slowest else {
            return String::new();
        };
        let motion = net.motions.get(slow.motion as usize).cloned();
        let motion = motion.unwrap_or_else(|| format!("motion {}", slow.motion));
        let what = match slow.quantity {
            Quantity::Line => "of the flange".to_owned(),
            Quantity::Turn => "of the rotation of the flange".to_owned(),
            Quantity::Joint(joint) => format!("of {}", self.joint_of_any(u32::from(joint) + 1)),
        };
        let limit = ["velocity", "acceleration", "jerk"][usize::from(slow.order.clamp(1, 3)) - 1];
        format!(
            "; `{motion}` takes {:.2} s where its limits allow {:.2} s, because its velocity is given and the {limit} {what} at {:.0} % of \
             leg {} bounds all of it: `time_optimal: true` uses what every place allows, up to that velocity",
            slow.takes_s,
            slow.possible_s,
            100.0 * slow.fraction,
            slow.leg + 1
        )
    }

    /// Names the arms that get no set-point.
    fn uncommanded(&self, rehearsed: &RehearsalReport) -> String {
        let arms: Vec<String> = (0..u64::BITS)
            .filter(|device| rehearsed.uncommanded >> device & 1 == 1)
            .map(|device| self.device_name(device))
            .collect();
        let until = match rehearsed.end {
            RehearsalEnd::Finished => "until the net ended",
            _ => "in the time that was checked",
        };
        match arms.as_slice() {
            [] => String::new(),
            arms => format!(
                "; {} got no set-point {until}, because every one was null: `rcc-cli explain` shows where null comes from",
                arms.join(", ")
            ),
        }
    }

    /// Returns the refusal of a net that would violate a limit.
    pub(super) fn foreseen(
        &self,
        id: u64,
        foreseen: &PredictedViolation,
    ) -> (ErrorCode, String, String) {
        let net = (self.net)(id);
        let what = self.broken(foreseen);
        let location = self.location(id, foreseen.place);
        let message = format!(
            "{net} would violate a limit {:.3} s after START{location}: {what}",
            foreseen.time_s
        );
        let names = (self.names)(id);
        let mut types = names.primitives.iter().map(|it| &it.type_name);
        let has_inverse = types.any(|name| name.starts_with("InverseKinematics"));
        (codes::FORESEEN, message, help(foreseen, has_inverse))
    }

    fn broken(&self, foreseen: &PredictedViolation) -> String {
        let PredictedViolation {
            rule,
            device,
            joint,
            value,
            limit,
            ..
        } = *foreseen;
        let of = format!(
            "{} joint {}",
            self.device_name(device),
            self.joint_name(device, joint)
        );
        let exceeds = |what: &str, per: &str| {
            format!(
                "{of}: {what} {} exceeds {}",
                self.joint_value(device, value, per),
                self.joint_value(device, limit, per)
            )
        };
        match rule {
            RehearsalRule::NotFinite => format!("{of}: the set-point is not a finite number"),
            RehearsalRule::Position => format!(
                "{of}: position {} is beyond the limit {}",
                self.joint_value(device, value, ""),
                self.joint_value(device, limit, "")
            ),
            RehearsalRule::Velocity => exceeds("velocity", "/s"),
            RehearsalRule::Acceleration => exceeds("acceleration", "/s²"),
            RehearsalRule::Jerk => exceeds("jerk", "/s³"),
            RehearsalRule::Workspace => {
                let axis = ["?", "x", "y", "z"].get(joint as usize).unwrap_or(&"?");
                format!(
                    "{} leaves its workspace: {axis} is {value:.4} m, the bound is {limit:.4} m",
                    self.device_name(device)
                )
            }
            RehearsalRule::Singularity => {
                let kind = SingularityKind::from_number(joint).map(|kind| kind.to_string());
                format!(
                    "{} comes too close to a singularity ({}): {value:.4}, its `workspace:` requires {limit:.4}",
                    self.device_name(device),
                    kind.unwrap_or_default()
                )
            }
            RehearsalRule::Impedance { kind } => self.violation(device, joint, value, limit, kind),
            RehearsalRule::LetsGo => format!(
                "{} gets no set-point any more while it moves",
                self.device_name(device)
            ),
            RehearsalRule::Fault => format!(
                "the net ends with a fault ({})",
                FaultCode::from_number(value as u32).name()
            ),
        }
    }

    fn location(&self, id: u64, location: Option<LegPosition>) -> String {
        let Some(location) = location else {
            return String::new();
        };
        let leg = match location.leg {
            0 => String::new(),
            leg => format!(", leg {}", leg + 1),
        };
        let metres = match location.distance_m {
            metres if metres.is_finite() => format!(" ({metres:.4} m)"),
            _ => String::new(),
        };
        let motion = self.motion(id, location.motion);
        let part = match 100.0 * location.fraction {
            part if part.is_finite() => format!(" at {part:.1} % of the path"),
            _ => String::new(),
        };
        format!(", in {motion}{leg}{part}{metres}")
    }
}

fn summary(rehearsed: &RehearsalReport, peaks: &[PeakView], outcome: Option<&str>) -> String {
    if rehearsed.end == RehearsalEnd::Elsewhere {
        return format!(
            "not checked yet: it does not start where the arm rests now; START checks it{}",
            roundings(rehearsed)
        );
    }
    let is_finished = rehearsed.end == RehearsalEnd::Finished;
    let at_once = why_at_once("finished", outcome, rehearsed.evaluations);
    if let Some(why) = at_once.filter(|_| is_finished) {
        return format!("checked: the net finishes in its first cycle; {why}");
    }
    let time = format!("{:.1} s of motion", rehearsed.time_s);
    let highest = match peaks {
        [] => "nothing moves".to_owned(),
        peaks => {
            let shares = peaks
                .iter()
                .map(|peak| format!("{} {:.0} % of {}", peak.of, 100.0 * peak.share, peak.joint));
            format!("highest joint {}", shares.collect::<Vec<_>>().join(", "))
        }
    };
    let rest = match rehearsed.end {
        RehearsalEnd::TooLong => "; the time after that was not checked".to_owned(),
        RehearsalEnd::Waits => "; then it waits".to_owned(),
        RehearsalEnd::Finished | RehearsalEnd::Elsewhere => outcome
            .map(|outcome| format!("; its outcome is `{outcome}`"))
            .unwrap_or_default(),
    };
    let near = match rehearsed.singularity {
        // This close, small changes of the path cause large joint motions.
        distance if distance < NEAR => format!(", near a singularity ({distance:.3})"),
        _ => String::new(),
    };
    let roundings = roundings(rehearsed);
    format!("checked: {time}, {highest}{near}{rest}{roundings}")
}

/// Describes roundings that are smaller than requested.
fn roundings(rehearsed: &RehearsalReport) -> String {
    let Some(most) = rehearsed.most_shortened else {
        return String::new();
    };
    let mm = |metres: f64| format!("{:.1} mm", 1e3 * metres);
    let others = match rehearsed.shortened {
        0 | 1 => String::new(),
        2 => "; 1 more is smaller than requested".to_owned(),
        count => format!("; {} more are smaller than requested", count - 1),
    };
    let (leg, asked) = (most.leg + 1, mm(most.asked_m));
    match most.made_m {
        0.0 => format!(
            "; no rounding behind leg {leg} ({asked} requested): a leg there has no length, or the flange turns too far on it; the motion stops there{others}"
        ),
        made => format!(
            "; the rounding behind leg {leg} is {} instead of {asked}: at most half of a leg{others}",
            mm(made)
        ),
    }
}

/// Describes the singularity that the path passes.
fn singular(foreseen: &PredictedViolation) -> Option<String> {
    let near = foreseen.near.filter(|near| near.distance < SINGULAR)?;
    let kind = SingularityKind::from_number(near.kind)?;
    Some(format!("{kind}: {:.3}", near.distance))
}

const JUMPS: &str = "going slower does not help: the set-point jumps from one cycle to the next; move to it with `JointGoal` (joints), \
                     `PoseGoal` or `ScalarGoal`, which limit velocity, acceleration and jerk, or with `RateLimit` if its velocity alone \
                     is the reason; `initial` of `ScalarGoal` and `RateLimit` is where the arm rests";

/// The remedy for a joint that exceeds a limit of velocity, acceleration or jerk.
fn too_fast(foreseen: &PredictedViolation) -> String {
    let slower = match foreseen.slower {
        SlowerMotion::KeepsLimits { speed } => Some(format!(
            "at {:.0} % of its speed it would stay within the limits",
            (100.0 * speed).floor()
        )),
        SlowerMotion::Jumps => return JUMPS.to_owned(),
        SlowerMotion::Unknown => None,
    };
    match (singular(foreseen), slower) {
        (Some(singular), slower) => format!(
            "the path passes close to a singularity ({singular}), where joints are fast and the flange is slow: use \
             another goal, branch or arm angle, or go around{}",
            slower.map_or(String::new(), |slower| format!("; {slower}"))
        ),
        // The joints of a motion are smooth: only a net that computes them itself can ask for a step.
        (None, Some(slower))
            if foreseen.rule == RehearsalRule::Jerk && foreseen.place.is_none() =>
        {
            format!(
                "the set-points have a step in velocity or acceleration: use JointMotion or JointGoal, smooth them \
                 (WindowMean, SecondOrderLowPass), or go slower: {slower}"
            )
        }
        (None, Some(slower)) => format!("go slower: {slower}"),
        (None, None) => {
            "`rcc-cli plot` shows the set-points of this net against the limits".to_owned()
        }
    }
}

/// The remedy; `has_inverse`: the net computes joint positions from poses.
fn help(foreseen: &PredictedViolation, has_inverse: bool) -> String {
    match foreseen.rule {
        RehearsalRule::Velocity | RehearsalRule::Acceleration | RehearsalRule::Jerk => {
            too_fast(foreseen)
        }
        RehearsalRule::Position => "start with another branch or arm angle, or split the motion and turn the joint back in between"
            .to_owned(),
        RehearsalRule::Workspace => "choose a goal and a path inside, or give the device another `workspace:`".to_owned(),
        RehearsalRule::Singularity => "start with another branch or arm angle, go around, or give the device a smaller `singularity` in its `workspace:`"
            .to_owned(),
        RehearsalRule::Impedance { .. } => impedance::STAY_WITHIN.to_owned(),
        RehearsalRule::LetsGo | RehearsalRule::NotFinite if !has_inverse => {
            "the set-point became null: `rcc-cli explain` shows which values can be null and why; replace null before the command \
             (`OrElse`, `LastKnown`), or let the arm come to rest first"
                .to_owned()
        }
        RehearsalRule::LetsGo | RehearsalRule::NotFinite => {
            "a pose on the path cannot be reached, or only with a joint beyond its limits (`reason` and `joint` of \
             InverseKinematics say which: monitor them and `rcc-cli simulate`): choose another start, goal or arm angle"
                .to_owned()
        }
        RehearsalRule::Fault => "correct the net or its parameters; `rcc-cli simulate` shows how the fault arises".to_owned(),
    }
}
