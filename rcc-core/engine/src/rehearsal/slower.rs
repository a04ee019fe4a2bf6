//! Finds out whether a net that violates a limit of velocity, acceleration or jerk would keep it at a lower speed: by
//! further rehearsals, because a set-point that jumps violates it at every speed. Off the real-time thread.

use rcc_protocol::rehearsal::{
    LimitPeak, PredictedViolation, RehearsalEnd, RehearsalRule, SlowerMotion,
};

use super::arm_monitor::{abrupt_speed, smooth_speed};
use super::{RehearsalScene, VirtualDevices};
use crate::net::Net;

/// Lowest speed factor that is proposed as a remedy.
const SPEED_MIN: f64 = 0.05;
/// Most speeds that are tried.
const TRIALS_MAX: usize = 3;
/// Factor on each computed speed: at another speed, the cycles sample other positions of the path.
const MARGIN: f64 = 0.98;

/// Adds the effect of going slower to a violation; `peaks` are those of the rehearsal that found it.
pub fn tried(
    net: &Net,
    scene: &RehearsalScene<'_>,
    peaks: [LimitPeak; 3],
    violation: PredictedViolation,
) -> PredictedViolation {
    let concerns_speed = matches!(
        violation.rule,
        RehearsalRule::Velocity | RehearsalRule::Acceleration | RehearsalRule::Jerk
    );
    if !concerns_speed {
        return violation;
    }
    let mut speed = MARGIN * smooth_speed(&peaks);
    for _ in 0..TRIALS_MAX {
        if speed < SPEED_MIN {
            break;
        }
        speed = match trial(net, scene, speed, violation.time_s) {
            Trial::KeepsLimits => {
                let slower = SlowerMotion::KeepsLimits { speed };
                return PredictedViolation {
                    slower,
                    ..violation
                };
            }
            Trial::Violates(peaks) => speed * MARGIN * abrupt_speed(&peaks),
            Trial::Inconclusive => return violation,
        };
    }
    PredictedViolation {
        slower: SlowerMotion::Jumps,
        ..violation
    }
}

/// Result of a rehearsal at a lower speed.
enum Trial {
    KeepsLimits,
    /// It violates a limit of velocity, acceleration or jerk; with the greatest use of each.
    Violates([LimitPeak; 3]),
    /// It cannot be built, violates another limit, or was not rehearsed to the end.
    Inconclusive,
}

/// Rehearses the net at this speed; it must get past `time_s` (s, for the net), where the limit was violated.
fn trial(net: &Net, scene: &RehearsalScene<'_>, speed: f64, time_s: f64) -> Trial {
    let origin = net.origin();
    let conditions = &origin.start_conditions;
    let configuration = origin.data.configuration;
    let built = Net::build(
        (*origin.data).clone(),
        scene.models,
        configuration,
        &conditions.holds,
        speed * conditions.dt_s,
    );
    let devices = VirtualDevices::new(net.resources().arms, scene);
    let (Ok(mut net), Some(mut devices)) = (built, devices) else {
        return Trial::Inconclusive;
    };
    // Values that are refused here were also refused when they were set.
    let _ = net.set(scene.values);
    match devices.run(&mut net, scene, speed) {
        Ok(report) => match report.end {
            RehearsalEnd::Finished | RehearsalEnd::Waits => Trial::KeepsLimits,
            RehearsalEnd::TooLong if report.time_s * speed > time_s => Trial::KeepsLimits,
            RehearsalEnd::TooLong | RehearsalEnd::Elsewhere => Trial::Inconclusive,
        },
        Err(violation) => match violation.rule {
            RehearsalRule::Velocity | RehearsalRule::Acceleration | RehearsalRule::Jerk => {
                Trial::Violates(devices.peaks())
            }
            _ => Trial::Inconclusive,
        },
    }
}
