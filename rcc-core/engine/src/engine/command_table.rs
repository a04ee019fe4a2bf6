//! The command table: one row per command, with everything that the engine knows about it. Real-time thread.

use std::ops::{Index, IndexMut};

use bytemuck::Zeroable;
use rcc_core::message::{COMMANDS_MAX, CommandEntry, CommandState};
use rcc_core::plan::{Rate, Resources};
use rcc_protocol::control::Refusal;

use crate::net::Net;
use crate::rows::{RowIndex, RowSet};

/// A transition that a started or terminated row waits for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PendingTransition {
    Nothing,
    /// START was accepted; the first evaluation, in the net's next cycle, decides about it.
    Start {
        ticket: u64,
        /// The lease to which the command is bound when it has started; 0: as it is bound already.
        lease: u64,
    },
    /// The net has ended, but its arms still play the last set-points.
    Settle {
        since_cycle: u64,
    },
}

/// One row of the command table.
#[derive(Debug)]
pub(super) struct CommandRow {
    /// The row as published; id 0: free.
    pub(super) entry: CommandEntry,
    /// Present from `ready` until UNLOAD.
    pub(super) net: Option<Box<Net>>,
    pub(super) pending: PendingTransition,
    /// Index of the run of its net that is timed next.
    pub(super) next_timed_run: usize,
    /// The lease of the client for which it runs; 0: none.
    pub(super) lease: u64,
    /// Bit d is set if the arm of device d was lost while the net, which survives that, commanded it.
    pub(super) lost_arms: u64,
}

impl CommandRow {
    fn free() -> CommandRow {
        CommandRow {
            entry: CommandEntry::zeroed(),
            net: None,
            pending: PendingTransition::Nothing,
            next_timed_run: 0,
            lease: 0,
            lost_arms: 0,
        }
    }

    #[inline]
    pub(super) fn state(&self) -> CommandState {
        CommandState::from_number(self.entry.state)
    }

    #[inline]
    pub(super) fn is_active(&self) -> bool {
        self.state().is_active()
    }

    #[inline]
    pub(super) fn is_pending(&self) -> bool {
        self.pending != PendingTransition::Nothing
    }

    /// Returns true if the net is evaluated, or will be from its first cycle on.
    pub(super) fn is_evaluated(&self) -> bool {
        match self.pending {
            PendingTransition::Start { .. } => true,
            PendingTransition::Nothing => self.is_active(),
            PendingTransition::Settle { .. } => false,
        }
    }

    /// The lease of the client for which it runs, or is about to; 0: none.
    pub(super) fn runs_for(&self) -> u64 {
        match self.pending {
            PendingTransition::Start { lease, .. } if lease != 0 => lease,
            _ => self.lease,
        }
    }

    /// The resources that its net claims.
    #[inline]
    pub(super) fn claims(&self) -> &Resources {
        let net = self.net.as_ref();
        net.map_or(&Resources::NONE, |net| net.resources())
    }

    #[inline]
    pub(super) fn claims_arm(&self, device: usize) -> bool {
        self.claims().arms >> device & 1 == 1
    }

    #[inline]
    pub(super) fn survives_device_loss(&self) -> bool {
        let net = self.net.as_ref();
        net.is_some_and(|net| net.survives_device_loss())
    }

    /// The cycles in which its net is evaluated.
    #[inline]
    pub(super) fn rate(&self) -> Rate {
        let net = self.net.as_ref();
        net.map_or(Rate::EVERY_CYCLE, |net| net.rate())
    }

    pub(super) fn expected_ns(&self) -> u64 {
        self.net.as_ref().map_or(0, |net| net.expected_ns)
    }
}

/// All rows. Every [`RowIndex`] has one.
#[derive(Debug)]
pub(super) struct CommandTable {
    rows: [CommandRow; COMMANDS_MAX],
    /// Rows that are active or have a pending transition; all others have nothing to do in a cycle.
    pub(super) busy: RowSet,
    /// Rows whose net, ready or active, subscribes to values of other nets.
    pub(super) subscribers: RowSet,
}

// A remainder of the number of rows is always inside; the compiler leaves the check out.
#[allow(clippy::indexing_slicing)]
impl Index<RowIndex> for CommandTable {
    type Output = CommandRow;

    #[inline]
    fn index(&self, row: RowIndex) -> &CommandRow {
        &self.rows[row.number() % COMMANDS_MAX]
    }
}

#[allow(clippy::indexing_slicing)]
impl IndexMut<RowIndex> for CommandTable {
    #[inline]
    fn index_mut(&mut self, row: RowIndex) -> &mut CommandRow {
        &mut self.rows[row.number() % COMMANDS_MAX]
    }
}

impl CommandTable {
    pub(super) fn new() -> Box<CommandTable> {
        Box::new(CommandTable {
            rows: std::array::from_fn(|_| CommandRow::free()),
            busy: RowSet::EMPTY,
            subscribers: RowSet::EMPTY,
        })
    }

    pub(super) fn rows(&self) -> &[CommandRow; COMMANDS_MAX] {
        &self.rows
    }

    /// The row of a command that must be in an allowed state.
    pub(super) fn find(
        &self,
        id: u64,
        allowed: impl Fn(CommandState) -> bool,
    ) -> Result<RowIndex, Refusal> {
        let row = RowIndex::all()
            .find(|row| id != 0 && self[*row].entry.id == id)
            .ok_or(Refusal::UnknownCommand)?;
        if allowed(self[row].state()) {
            return Ok(row);
        }
        let state = self[row].entry.state;
        Err(Refusal::WrongState { state })
    }

    /// Forgets rows that have become idle.
    pub(super) fn remove_idle(&mut self) {
        for row in self.busy.rows() {
            if !self[row].is_active() && !self[row].is_pending() {
                self.busy.remove(row);
            }
        }
    }
}
