//! The phases of a device and every change from one to another.
//! Pure; run by the host's thread.
//!
//! | from | when | to |
//! |---|---|---|
//! | `Offline`, `Mirroring` | the device follows set-points | `Holding` |
//! | any | the device holds itself | `Mirroring` |
//! | any | the device is lost and does not move, or is silent for long | `Offline` |
//! | `Following` | the device is lost | `Stopping` |
//! | `Holding` | a net begins to command (`net_start`) | `Waiting` |
//! | `Waiting` | the delay has passed, and the first set-point is refused (`net_start`) | `Holding` |
//! | `Waiting` | the delay has passed, and the first set-point is accepted (`net_start`) | `Following` |
//! | `Waiting` | the executor is lost, or the driver is asked to stop | `Holding` |
//! | `Following` | the net stops commanding while the arm is slow | `Holding` |
//! | `Following` | playback ends otherwise, the executor is lost, or the driver is asked to stop | `Stopping` |
//! | `Stopping` | the arm is at rest | `Holding` |

use rcc_core::message::{Joints, SetPoint};

use super::DeviceSession;
use super::playback::{PlayEnd, Playback, PlaybackContext, comes_to_rest};
use super::stop::Stop;
use crate::driver::Exchange;
use crate::host::reason;

/// Present activity of a device.
#[derive(Clone, Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "one per device; a box would allocate in the exchange thread"
)]
pub(super) enum SessionPhase {
    /// Not reached yet, or lost: its position is unknown.
    Offline,
    /// Not commandable: holds itself.
    Mirroring,
    /// At rest; no net commands it.
    Holding,
    /// At rest, until the delay after the set-point of cycle `first` has passed.
    Waiting { first: u64 },
    /// Follows the set-points of a net.
    Following(Playback),
    /// Coming to rest.
    Stopping(Stop),
}

impl SessionPhase {
    /// Returns true if a net commands the device, or if it still moves after one.
    pub(super) fn is_engaged(&self) -> bool {
        matches!(
            self,
            Self::Waiting { .. } | Self::Following(_) | Self::Stopping(_)
        )
    }
}

impl DeviceSession {
    /// The device follows set-points. A driver may start while its device is still in command mode from an earlier
    /// driver: it then begins at `mirror` (rad), where the device holds itself.
    pub(super) fn enter_command_mode(&mut self, mirror: &Joints) {
        match self.phase {
            SessionPhase::Offline => {
                self.position = *mirror;
                self.phase = SessionPhase::Holding;
            }
            SessionPhase::Mirroring => self.phase = SessionPhase::Holding,
            _ => {}
        }
    }

    /// The device holds itself at `mirror`, rad.
    pub(super) fn mirror(&mut self, mirror: &Joints) {
        self.abandon_net();
        self.position = *mirror;
        self.phase = SessionPhase::Mirroring;
    }

    /// The device is lost: its position is no longer known.
    pub(super) fn lose_device(&mut self) {
        self.abandon_net();
        self.outputs = SetPoint::NONE;
        self.phase = SessionPhase::Offline;
    }

    /// The device is lost, but may answer again at once and be in motion: its net is not followed again.
    pub(super) fn lose_contact(&mut self) {
        match self.phase {
            SessionPhase::Following(_) => self.stop(reason::DEVICE_STOPPED),
            SessionPhase::Stopping(_) => {}
            _ => self.lose_device(),
        }
    }

    /// The device no longer follows: its net is not followed again, even if the device becomes commandable.
    fn abandon_net(&mut self) {
        if self.phase.is_engaged() {
            self.refuse_newest_owner(reason::DEVICE_STOPPED);
            self.reason = reason::DEVICE_STOPPED;
        }
    }

    /// Ends the playback and brings the arm to rest.
    pub(super) fn end_following(&mut self, why: u32) {
        match self.phase {
            SessionPhase::Following(_) => self.stop(why),
            SessionPhase::Waiting { .. } => {
                self.refuse_newest_owner(why);
                self.reason = why;
                self.phase = SessionPhase::Holding;
            }
            _ => {}
        }
    }

    /// Advances playback by one exchange.
    pub(super) fn follow(&mut self, exchange: &Exchange) {
        let SessionPhase::Following(playback) = &mut self.phase else {
            return;
        };
        let step = playback.step(&mut PlaybackContext {
            settings: &self.settings,
            buffer: &self.feed.buffer,
            exchange,
            outputs: &mut self.outputs,
            counts: &mut self.counts,
        });
        self.played = playback.pointer();
        match step {
            Ok(position) => return self.position = position,
            Err(PlayEnd::Released { entry }) => self.end_released(entry, exchange),
            Err(PlayEnd::Starved) => {
                self.counts.starved += 1;
                self.stop(reason::STARVED);
            }
            Err(PlayEnd::Lost) => self.stop(reason::SET_POINTS_LOST),
            Err(PlayEnd::Violated(violation)) => {
                self.count_violation(violation);
                self.stop(reason::LIMIT);
            }
        }
        // This exchange needs a set-point too.
        self.step_to_rest(exchange);
    }

    /// The net no longer commands, from cycle `entry` on: ends at its last set-point if the arm is slow, or if one exchange
    /// spans several set-points and the last two of the net are slow; otherwise starts a stop.
    fn end_released(&mut self, entry: u64, exchange: &Exchange) {
        let SessionPhase::Following(playback) = &mut self.phase else {
            return;
        };
        let (buffer, limits) = (&self.feed.buffer, &self.settings.limits);
        let is_slow = playback.is_slow(limits);
        if !is_slow && !comes_to_rest(buffer, entry, limits) {
            return self.stop(reason::RELEASED_MOVING);
        }
        let last = buffer.commanded(entry - 1);
        let last = last.filter(|last| playback.may_end_at(&last.position, exchange.dt_s()));
        match last {
            // A pointer between two set-points, or before several of them, has not quite reached the last one.
            Some(last) => self.position = last.position,
            None if is_slow => {}
            None => return self.stop(reason::RELEASED_MOVING),
        }
        self.phase = SessionPhase::Holding;
        self.feed.cursor = entry;
        let outputs = self.feed.buffer.at(entry);
        self.outputs = outputs.copied().unwrap_or(SetPoint::NONE);
    }

    /// Starts a stop from the motion of the last set-points.
    fn stop(&mut self, why: u32) {
        let SessionPhase::Following(playback) = &self.phase else {
            return;
        };
        let stop = playback.stop(&self.settings.limits, self.period_s);
        self.reason = why;
        self.refuse_newest_owner(why);
        // Only values that are not finite are refused, and those are never sent.
        self.phase = stop.map_or(SessionPhase::Holding, SessionPhase::Stopping);
    }

    /// Advances the stop by one exchange.
    pub(super) fn step_to_rest(&mut self, exchange: &Exchange) {
        let SessionPhase::Stopping(stop) = &mut self.phase else {
            return;
        };
        let (position, resting) = stop.advance(exchange);
        self.position = position;
        if resting {
            self.phase = SessionPhase::Holding;
        }
    }
}
