//! Rehearsal of a net: before it commands an arm, it is evaluated in virtual time, with arms that follow exactly and
//! sensors that stay constant, and its commands are checked against the limits of the arms. Off the real-time thread;
//! the state of the net is restored afterwards.
//!
//! The net itself is evaluated, so geometry, kinematics, blends and corrections are checked together, on the set-points
//! that an arm would receive: positions, and their first, second and third differences. Effects of sensors and of
//! values that are set later are left to the guard, which checks every set-point before it is sent.

use std::time::Instant;

use bytemuck::Zeroable;
use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::message::{DeviceState, Joints, MAGIC, Measurement};
use rcc_core::path::MotionState;
use rcc_core::primitive::{Role, Spec};
use rcc_core::primitives;
use rcc_protocol::control::{InputValue, Refusal};
use rcc_protocol::rehearsal::{
    LegPosition, LimitPeak, PredictedViolation, RehearsalEnd, RehearsalReport, ShortenedBlend,
    SlowMotion,
};

use crate::net::{Evaluation, Net};

mod arm_monitor;
mod slower;

use arm_monitor::ArmMonitor;

/// Longest virtual time of a rehearsal, s.
pub const TIME_MAX_S: f64 = 20.0;
/// Most evaluations of primitives in one rehearsal: about a fifth of a second of work.
pub const WORK_MAX: u64 = 40_000_000;
/// If nothing has moved for this time, the net is assumed to wait for an external event, s.
pub const WAITS_S: f64 = 3.0;

/// Initial conditions of a rehearsal.
#[derive(Clone, Copy, Debug)]
pub struct RehearsalScene<'a> {
    /// Devices of the cell.
    pub models: &'a [DeviceModel],
    /// Their current measurements; one that is not present is replaced by an idle device.
    pub devices: &'a [DeviceInput],
    /// Hold set-point of each arm, rad; `None` if it is not known, or the arm moves.
    pub holds: &'a [Option<Joints>],
    /// Values that are set before START.
    pub values: &'a [InputValue],
    /// The executor's period, s.
    pub dt_s: f64,
}

/// Rehearses a net that was not started yet. Returns `None` if it commands no arm.
///
/// # Errors
/// Returns [`Refusal::Foreseen`] with the first limit that it would violate.
pub fn rehearse(
    net: &mut Net,
    scene: &RehearsalScene<'_>,
) -> Result<Option<RehearsalReport>, Refusal> {
    let arms = net.resources().arms;
    if arms == 0 {
        return Ok(None);
    }
    let started = Instant::now();
    let (shortened, most_shortened) = shortened(net);
    let slowest = slowest(net);
    let virtual_devices = VirtualDevices::new(arms, scene);
    let mut result = match virtual_devices {
        Some(mut virtual_devices) => {
            // Values that are refused here were also refused when they were set.
            let _ = net.set(scene.values);
            let result = virtual_devices.run(net, scene, 1.0);
            net.reset();
            net.inputs_mut().discard_staged();
            let peaks = virtual_devices.peaks();
            result.map_err(|violation| slower::tried(net, scene, peaks, violation))
        }
        None => Ok(elsewhere_report()),
    };
    if let Ok(rehearsed) = &mut result {
        (rehearsed.shortened, rehearsed.most_shortened) = (shortened, most_shortened);
        rehearsed.slowest = slowest;
        rehearsed.took_ns = started.elapsed().as_nanos().try_into().unwrap_or(u64::MAX);
    }
    result.map(Some).map_err(Refusal::Foreseen)
}

/// Number of blends that are smaller than requested, and the one with the largest shortfall, m.
fn shortened(net: &Net) -> (u32, Option<ShortenedBlend>) {
    let roundings = net
        .motions()
        .shortened()
        .map(|(motion, shortened)| ShortenedBlend {
            motion: motion as u32,
            leg: shortened.leg,
            asked_m: shortened.asked_m,
            made_m: shortened.made_m,
        });
    let shortfall = |rounding: &ShortenedBlend| rounding.asked_m - rounding.made_m;
    roundings.fold((0, None), |(count, most), next| match most {
        Some(most) if shortfall(&most) >= shortfall(&next) => (count + 1, Some(most)),
        _ => (count + 1, Some(next)),
    })
}

/// The motion whose duration exceeds the possible one by the most, s.
fn slowest(net: &Net) -> Option<SlowMotion> {
    let slow = net.motions().slow().map(|(motion, slow)| SlowMotion {
        motion: motion as u32,
        leg: slow.leg,
        fraction: slow.fraction,
        quantity: slow.quantity,
        order: slow.order,
        takes_s: slow.takes_s,
        possible_s: slow.possible_s,
    });
    let excess_s = |slow: &SlowMotion| slow.takes_s - slow.possible_s;
    slow.max_by(|a, b| excess_s(a).total_cmp(&excess_s(b)))
}

fn elsewhere_report() -> RehearsalReport {
    RehearsalReport {
        time_s: 0.0,
        end: RehearsalEnd::Elsewhere,
        evaluations: 0,
        outcome: 0,
        peaks: arm_monitor::NO_PEAKS,
        singularity: f64::NAN,
        shortened: 0,
        most_shortened: None,
        slowest: None,
        uncommanded: 0,
        took_ns: 0,
    }
}

/// Primitives that compute joints from poses, besides the motions along a path.
const INVERSE: [&str; 3] = [
    "InverseKinematics",
    "InverseKinematicsNear",
    "InverseVelocityKinematics",
];

/// Returns true if a singular position can make the joints of a net fast.
fn computes_joints_from_poses(net: &Net) -> bool {
    net.plan().runs.iter().any(|run| {
        primitives::kernel(run.kernel).is_some_and(|(entry, _)| {
            let Spec { name, role, .. } = entry.spec;
            INVERSE.contains(&name) || role == Role::Motion && name != "JointMotion"
        })
    })
}

/// The devices in virtual time, the monitors of the arms, and the positions of the motions.
struct VirtualDevices {
    inputs: Vec<DeviceInput>,
    monitors: Vec<ArmMonitor>,
    /// Last path parameter of each motion, by index.
    last_path_parameters: Vec<f64>,
}

/// Position of the active motion at the first violation, and its path parameter.
type ActiveMotion = Option<(LegPosition, f64)>;

impl VirtualDevices {
    /// Returns `None` if the rest position of an arm is not known.
    fn new(arms: u64, scene: &RehearsalScene<'_>) -> Option<VirtualDevices> {
        let mut inputs = Vec::with_capacity(scene.models.len());
        let mut monitors = Vec::new();
        for (index, model) in scene.models.iter().enumerate() {
            let input = scene.devices.get(index).filter(|input| input.present);
            let mut measurement =
                input.map_or_else(|| idle_measurement(model), |input| input.measurement);
            if arms >> index & 1 == 1 {
                let hold = scene.holds.get(index).copied().flatten()?;
                (measurement.hold, measurement.position) = (hold, hold);
                measurement.state = DeviceState::Ready as u32;
                monitors.push(ArmMonitor::new(index, *model, hold));
            }
            inputs.push(DeviceInput {
                present: true,
                measurement,
            });
        }
        Some(VirtualDevices {
            inputs,
            monitors,
            last_path_parameters: Vec::new(),
        })
    }

    /// Runs the net from its start. `speed` scales time, 0 to 1: the net's time advances by `speed` periods in each
    /// cycle, so the motion is slower on the same path.
    fn run(
        &mut self,
        net: &mut Net,
        scene: &RehearsalScene<'_>,
        speed: f64,
    ) -> Result<RehearsalReport, PredictedViolation> {
        let net_dt_s = speed * scene.dt_s;
        let steps = steps_max(net, net_dt_s);
        let waits = (WAITS_S / net_dt_s) as u64;
        let (mut end, mut step, mut still) = (RehearsalEnd::TooLong, 0, 0);
        let mut first: Option<(PredictedViolation, ActiveMotion)> = None;
        while step < steps {
            let time_s = step as f64 * scene.dt_s;
            let (evaluation, at) = self.evaluate(net, scene.models, net_dt_s);
            if let Evaluation::Fault(code) = evaluation {
                first = first.or(Some((arm_monitor::fault(code, time_s), at)));
                break;
            }
            let mut moved = false;
            for monitor in &mut self.monitors {
                let Some(output) = net.outputs().get(monitor.device()) else {
                    continue;
                };
                let seen = monitor.check_set_point(output, step == 0, scene.dt_s);
                if seen.is_elsewhere {
                    return Ok(elsewhere_report());
                }
                moved |= seen.moves;
                let broken = seen
                    .violation
                    .map(|broken| arm_monitor::foreseen(broken, time_s));
                first = first.or(broken.map(|broken| (broken, at)));
            }
            self.follow(net, net_dt_s);
            step += 1;
            still = if moved { 0 } else { still + 1 };
            if evaluation == Evaluation::Terminated {
                end = RehearsalEnd::Finished;
                break;
            }
            if still >= waits {
                end = RehearsalEnd::Waits;
                break;
            }
        }
        let peaks = self.peaks();
        match first {
            Some((foreseen, at)) => Err(PredictedViolation {
                near: arm_monitor::near(&self.monitors).filter(|_| computes_joints_from_poses(net)),
                place: at.map(|(place, s)| self.with_fraction(place, s)),
                ..foreseen
            }),
            None => Ok(RehearsalReport {
                // Exclude the time spent waiting at the end: it was not checked.
                time_s: (step - still.min(step)) as f64 * scene.dt_s,
                end,
                evaluations: step,
                outcome: match end {
                    RehearsalEnd::Finished => net.outcome + 1,
                    _ => 0,
                },
                peaks,
                singularity: arm_monitor::near(&self.monitors)
                    .map_or(f64::NAN, |near| near.distance),
                shortened: 0,
                most_shortened: None,
                slowest: None,
                uncommanded: self
                    .monitors
                    .iter()
                    .filter(|monitor| !monitor.has_been_commanded())
                    .fold(0, |bits, monitor| bits | 1 << monitor.device()),
                took_ns: 0,
            }),
        }
    }

    /// The greatest use of each limit so far.
    fn peaks(&self) -> [LimitPeak; 3] {
        arm_monitor::peaks(&self.monitors)
    }

    /// Evaluates one cycle; also returns the position of the active motion.
    fn evaluate(
        &mut self,
        net: &mut Net,
        models: &[DeviceModel],
        dt_s: f64,
    ) -> (Evaluation, ActiveMotion) {
        let mut at: ActiveMotion = None;
        let (inputs, last_path_parameters) = (&self.inputs, &mut self.last_path_parameters);
        let seen = |index: usize, state: &MotionState| {
            if last_path_parameters.len() <= index {
                last_path_parameters.resize(index + 1, 0.0);
            }
            last_path_parameters[index] = state.path.s;
            let moves = state.path.velocity > 0.0;
            if moves || at.is_none() {
                let place = LegPosition {
                    motion: index as u32,
                    leg: state.leg,
                    fraction: f64::NAN,
                    distance_m: state.distance,
                };
                at = Some((place, state.path.s));
            }
        };
        let evaluation = net.evaluate_observed(models, inputs, dt_s, seen);
        (evaluation, at)
    }

    /// Adds the fraction of the distance that the motion covered until the rehearsal ended.
    fn with_fraction(&self, place: LegPosition, s: f64) -> LegPosition {
        let whole = self
            .last_path_parameters
            .get(place.motion as usize)
            .copied();
        let whole = whole.filter(|whole| *whole > 0.0);
        LegPosition {
            fraction: whole.map_or(f64::NAN, |whole| s / whole),
            ..place
        }
    }

    /// Moves arms to their set-points; every device has exchanged once more.
    fn follow(&mut self, net: &Net, dt_s: f64) {
        let period_ns = (dt_s * 1e9).round() as u64;
        for (input, output) in self.inputs.iter_mut().zip(net.outputs()) {
            let measurement = &mut input.measurement;
            measurement.sequence += 1;
            measurement.stamp_ns += period_ns;
            if output.has_position {
                measurement.state = DeviceState::Commanded as u32;
                (measurement.hold, measurement.position) = (output.position, output.position);
            }
        }
    }
}

/// Measurement of an idle device.
fn idle_measurement(model: &DeviceModel) -> Measurement {
    let mut measurement = Measurement::zeroed();
    measurement.magic = MAGIC;
    measurement.state = DeviceState::Ready as u32;
    measurement.joints = model.joints;
    measurement.digital_known = u64::MAX;
    measurement
}

/// Number of cycles within the limits of time and work.
fn steps_max(net: &Net, dt_s: f64) -> u64 {
    let work = WORK_MAX / net.primitives().max(1);
    ((TIME_MAX_S / dt_s) as u64).min(work).max(1)
}
