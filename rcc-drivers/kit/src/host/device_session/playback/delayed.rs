//! Playback after a delay, while executor and device have clocks of their own: one step of the pointer along the
//! set-points, and the position that is sent for it.
//! Pure; run by the host's thread while a net is followed.

use rcc_core::message::{ANALOG_MAX, Joints};

use super::{FollowedNet, PlayEnd, PlaybackContext, PlaybackPointer};
use crate::host::playback_rate::{JointMotion, PlaybackRate};
use crate::host::set_point_buffer::{BUFFER_LENGTH, SetPointBuffer};

/// State of a delayed playback.
#[derive(Clone, Copy, Debug)]
pub(super) struct DelayedPlayback {
    rate: PlaybackRate,
    /// Waits on a set-point at rest until the margin is restored.
    dwelling: bool,
}

impl DelayedPlayback {
    /// The beginning of a net.
    pub(super) const NEW: DelayedPlayback = DelayedPlayback {
        rate: PlaybackRate::NOMINAL,
        dwelling: false,
    };

    /// Advances by one exchange; returns the position to send, rad.
    pub(super) fn step(
        &mut self,
        net: &mut FollowedNet,
        context: &mut PlaybackContext<'_>,
    ) -> Result<Joints, PlayEnd> {
        let old = net.pointer.cycle;
        if !self.dwells(net, context) {
            self.advance(net, context);
        }
        context.check_commanded(old + 1..=net.pointer.cycle)?;
        let buffer = context.buffer;
        if is_beyond_the_newest(&net.pointer, buffer) {
            if !net.sent.is_slow(&context.settings.limits) {
                return Err(PlayEnd::Starved);
            }
            net.pointer = PlaybackPointer {
                cycle: buffer.newest(),
                fraction: 0.0,
            };
        }
        if is_too_late(&net.pointer, context) {
            return Err(PlayEnd::Lost);
        }
        let entry = buffer.commanded(net.pointer.cycle).ok_or(PlayEnd::Lost)?;
        let mut position = entry.position;
        if net.pointer.fraction > 0.0 {
            let next = net.pointer.cycle + 1;
            let towards = buffer
                .commanded(next)
                .ok_or(PlayEnd::Released { entry: next })?;
            for (from, to) in position.iter_mut().zip(towards.position) {
                *from += net.pointer.fraction * (to - *from);
            }
        }
        let limits = &context.settings.limits;
        let position = net.with_offset(&position, context.exchange.dt_s(), limits);
        net.check(&position, &entry.impedance, old, context)?;
        *context.outputs = *entry;
        Ok(position)
    }

    /// Decides whether the pointer stays: at rest, waiting until the full delay is restored has no effect on the
    /// motion.
    fn dwells(&mut self, net: &FollowedNet, context: &PlaybackContext<'_>) -> bool {
        // The margin after one step.
        let newest = context.buffer.newest();
        let margin = newest.saturating_sub(net.pointer.cycle + 1);
        let delay = context.settings.delay(context.buffer, context.exchange);
        let few = 4 * margin < 3 * delay || (self.dwelling && margin < delay);
        self.dwelling = few && net.pointer.fraction == 0.0 && net.sent.is_stationary();
        self.dwelling
    }

    fn advance(&mut self, net: &mut FollowedNet, context: &PlaybackContext<'_>) {
        let (buffer, exchange) = (context.buffer, context.exchange);
        let pointer = &mut net.pointer;
        let delay = context.settings.delay(buffer, exchange);
        let newest = buffer.newest();
        if net.sent.is_stationary() && commands_same(buffer, pointer.cycle, pointer.cycle + 1) {
            // At rest the pointer may also step onto a whole set-point, or skip equal ones: a backlog is removed.
            if pointer.fraction > 0.0 {
                pointer.cycle += 1;
                pointer.fraction = 0.0;
                return;
            }
            if newest.saturating_sub(pointer.cycle) > delay + 2 {
                for _ in 0..BUFFER_LENGTH {
                    let many = newest.saturating_sub(pointer.cycle) > delay + 1;
                    if !many || !commands_same(buffer, pointer.cycle + 1, pointer.cycle + 2) {
                        break;
                    }
                    pointer.cycle += 1;
                }
            }
        }
        let ratio = exchange.period_ns as f64 / buffer.period_ns() as f64;
        let ahead = ratio * exchange.ticks as f64;
        let margin = newest as f64 - pointer.cycle as f64 - pointer.fraction - ahead;
        let rate = self.rate.next(
            (margin, delay as f64),
            &motion_at(pointer.cycle, context),
            &context.settings.limits,
            exchange.dt_s(),
        );
        let place = pointer.fraction + rate * ahead;
        // Far beyond the newest set-point, the exact distance does not matter.
        let whole = place.floor().min(1e6);
        pointer.cycle += whole as u64;
        pointer.fraction = (place - whole).min(1.0 - f64::EPSILON);
    }
}

fn is_beyond_the_newest(pointer: &PlaybackPointer, buffer: &SetPointBuffer) -> bool {
    let newest = buffer.newest();
    pointer.cycle > newest || (pointer.cycle == newest && pointer.fraction > 0.0)
}

/// Returns true if the set-point is older than the delay by more than the time-out: its command is outdated.
fn is_too_late(pointer: &PlaybackPointer, context: &PlaybackContext<'_>) -> bool {
    let behind = context.buffer.newest().saturating_sub(pointer.cycle);
    let settings = context.settings;
    let most_ns = settings
        .delay_ns
        .saturating_add(settings.command_timeout_ns);
    behind.saturating_mul(context.buffer.period_ns()) > most_ns
}

/// Returns true if two cycles command the same values, including outputs.
fn commands_same(buffer: &SetPointBuffer, one: u64, other: u64) -> bool {
    match (buffer.commanded(one), buffer.commanded(other)) {
        (Some(one), Some(other)) => {
            let bits = |values: &[f64; ANALOG_MAX]| values.map(f64::to_bits);
            one.position == other.position
                && one.digital == other.digital
                && one.digital_commanded == other.digital_commanded
                && one.impedance == other.impedance
                && bits(&one.analog) == bits(&other.analog)
        }
        _ => false,
    }
}

/// Returns the motion of the set-points at cycle `entry`; a missing set-point counts as rest.
fn motion_at(entry: u64, context: &PlaybackContext<'_>) -> JointMotion {
    let dt_s = context.executor_period_s();
    let mut motion = JointMotion::default();
    let Some(here) = context.position(entry) else {
        return motion;
    };
    let next = context.position(entry + 1).unwrap_or(here);
    let before = context.position(entry.wrapping_sub(1)).unwrap_or(here);
    for joint in 0..here.len() {
        let (in_, out) = (here[joint] - before[joint], next[joint] - here[joint]);
        motion.velocity[joint] = out / dt_s;
        motion.acceleration[joint] = (out - in_) / (dt_s * dt_s);
    }
    motion
}
