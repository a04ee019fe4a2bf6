//! Commands of the executor for this device: the buffered set-points, whether the command board is fresh, and which
//! nets are refused. An image older than `command_timeout` is stale and ends playback. Pure; run by the host's thread.

use rcc_core::message::{CommandImage, SetPoint};

use crate::host::reason;
use crate::host::set_point_buffer::{BufferUpdate, SetPointBuffer, commands_joints};

/// The set-points of the executor.
#[derive(Clone, Debug, Default)]
pub(super) struct CommandFeed {
    pub(super) buffer: SetPointBuffer,
    /// The command board is present and fresh.
    live: bool,
    /// Newest cycle that has been checked for the start of a net.
    pub(super) cursor: u64,
    /// The owner whose set-points are ignored; 0 = none.
    pub(super) refused_owner: u64,
}

/// Change of the executor that an update of the feed has detected.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExecutorChange {
    /// Why the executor that was followed is followed no longer.
    pub(super) lost: Option<u32>,
    /// An executor appeared, reappeared or replaced another one.
    pub(super) appeared: bool,
}

impl CommandFeed {
    /// Takes over new set-points from the command image (`None`: no executor). An image older than `timeout_ns` is
    /// stale.
    pub(super) fn update(
        &mut self,
        now_ns: u64,
        image: Option<&CommandImage>,
        timeout_ns: u64,
    ) -> ExecutorChange {
        let news = image.map_or(BufferUpdate::None, |image| self.buffer.update(image));
        // A stamp in the future counts as stale: its age could not be determined.
        let age_ns = now_ns.abs_diff(self.buffer.stamp_ns());
        let fresh = image.is_some() && self.buffer.newest() > 0 && age_ns <= timeout_ns;
        let replaced = news == BufferUpdate::NewExecutor;
        let was_live = std::mem::replace(&mut self.live, fresh);
        let why = match image {
            _ if replaced => reason::EXECUTOR_CHANGED,
            None => reason::NO_EXECUTOR,
            Some(_) => reason::STALE,
        };
        ExecutorChange {
            lost: (was_live && (!fresh || replaced)).then_some(why),
            appeared: fresh && (!was_live || replaced),
        }
    }

    /// Returns true if the executor's command board is present and fresh.
    pub(super) fn is_live(&self) -> bool {
        self.live
    }

    /// Returns the incarnation of the executor whose board is fresh; 0 = none.
    pub(super) fn executor(&self) -> u64 {
        if self.live { self.buffer.executor() } else { 0 }
    }

    /// Returns the newest set-point of an executor whose board is fresh.
    pub(super) fn live_set_point(&self) -> Option<&SetPoint> {
        let newest = self.buffer.at(self.buffer.newest());
        newest.filter(|_| self.live)
    }

    /// Returns the newest set-point of an executor whose board is fresh, if it does not command the joints.
    pub(super) fn idle_set_point(&self) -> Option<&SetPoint> {
        self.live_set_point()
            .filter(|newest| !commands_joints(newest))
    }

    /// Moves the cursor to the next set-point that commands the joints for an owner that is not refused; returns the
    /// owner.
    pub(super) fn next_owner(&mut self) -> Option<u64> {
        while self.cursor < self.buffer.newest() {
            self.cursor = (self.cursor + 1).max(self.buffer.oldest());
            let entry = self.buffer.commanded(self.cursor);
            if let Some(entry) = entry.filter(|entry| entry.owner != self.refused_owner) {
                return Some(entry.owner);
            }
        }
        None
    }

    /// Refuses the owner of the newest set-point and marks all present set-points as checked; returns false if no
    /// owner commands the joints.
    pub(super) fn refuse_newest_owner(&mut self) -> bool {
        self.cursor = self.buffer.newest();
        let owner = self.buffer.commanded(self.cursor).map(|entry| entry.owner);
        self.refused_owner = owner.unwrap_or(self.refused_owner);
        owner.is_some()
    }
}
