//! Leases: for how long a client that installed rules or started commands counts as present. A lease that is not renewed
//! grows old, as a value of an `Input` with `expires` does; its age is counted in cycles, so that no clock is read.
//! Real-time thread.

use rcc_core::message::{CommandState, EndReason, FaultRecord};
use rcc_protocol::control::{Refusal, SWITCH_MAX};
use rcc_protocol::rules::{DisarmReason, LEASE_MAX_NS, LEASE_MIN_NS, LEASES_MAX, RuleFault};

use super::Engine;
use super::command_table::PendingTransition;
use super::handover::{Handover, HandoverRefusal};
use crate::boards::DeviceBoards;
use crate::queue::EngineEvent;
use crate::rows::RowIndex;

#[derive(Clone, Copy, Debug)]
struct Lease {
    /// 0: free.
    id: u64,
    expires_ns: u64,
    renewed_cycle: u64,
}

/// All leases.
#[derive(Debug)]
pub(super) struct LeaseTable {
    leases: [Lease; LEASES_MAX],
    next_id: u64,
    count: usize,
}

impl LeaseTable {
    pub(super) fn new(first_id: u64) -> LeaseTable {
        let none = Lease {
            id: 0,
            expires_ns: 0,
            renewed_cycle: 0,
        };
        LeaseTable {
            leases: [none; LEASES_MAX],
            next_id: first_id,
            count: 0,
        }
    }

    fn find(&mut self, id: u64) -> Result<&mut Lease, Refusal> {
        let mut leases = self.leases.iter_mut();
        let found = leases.find(|lease| id != 0 && lease.id == id);
        let (index, fault) = (0, RuleFault::LeaseUnknown);
        found.ok_or(Refusal::Rule { index, fault })
    }

    /// Returns true if the lease has been granted and has not expired.
    pub(super) fn is_valid(&self, id: u64) -> bool {
        id != 0 && self.leases.iter().any(|lease| lease.id == id)
    }

    /// The first lease that has expired.
    fn expired(&self, cycle: u64, period_ns: u64) -> Option<u64> {
        let old = |lease: &&Lease| {
            let age_ns = cycle
                .saturating_sub(lease.renewed_cycle)
                .saturating_mul(period_ns);
            lease.id != 0 && age_ns > lease.expires_ns
        };
        self.leases.iter().find(old).map(|lease| lease.id)
    }
}

impl<B: DeviceBoards> Engine<B> {
    pub(super) fn grant_lease(&mut self, expires_ns: u64) -> Result<u64, Refusal> {
        if !(LEASE_MIN_NS..=LEASE_MAX_NS).contains(&expires_ns) {
            return Err(Refusal::LeaseTime {
                min_ns: LEASE_MIN_NS,
                max_ns: LEASE_MAX_NS,
            });
        }
        let mut free = self.leases.leases.iter_mut();
        let max = LEASES_MAX as u32;
        let place = free.find(|lease| lease.id == 0);
        let place = place.ok_or(Refusal::LeasesFull { max })?;
        let id = self.leases.next_id;
        *place = Lease {
            id,
            expires_ns,
            renewed_cycle: self.status.cycle,
        };
        self.leases.next_id += 1;
        self.leases.count += 1;
        Ok(id)
    }

    pub(super) fn renew_lease(&mut self, id: u64) -> Result<(), Refusal> {
        let cycle = self.status.cycle;
        self.leases.find(id)?.renewed_cycle = cycle;
        Ok(())
    }

    /// Ends a lease as if it had expired.
    pub(super) fn end_lease(&mut self, id: u64) -> Result<(), Refusal> {
        self.leases.find(id)?;
        self.lose_lease(id);
        Ok(())
    }

    /// Checks that the client is present for which this command is to run: that of `lease`, or, if it is 0, that to which
    /// the command is bound, if any.
    pub(super) fn check_lease(&self, row: RowIndex, lease: u64) -> Result<(), Refusal> {
        let lease = match lease {
            0 => self.commands[row].lease,
            lease => lease,
        };
        match lease == 0 || self.leases.is_valid(lease) {
            true => Ok(()),
            false => Err(Refusal::LeaseEnded { lease }),
        }
    }

    /// As [`Engine::check_lease`], for all commands that a hand-over starts.
    pub(super) fn check_leases(&self, handover: &Handover) -> Result<(), HandoverRefusal> {
        for &id in handover.start.iter().filter(|id| **id != 0) {
            if let Ok(row) = self.commands.find(id, |_| true) {
                let checked = self.check_lease(row, handover.lease);
                checked.map_err(|refusal| (id, refusal))?;
            }
        }
        Ok(())
    }

    /// A command has started for the client of this lease; 0: it stays bound as it is.
    pub(super) fn bind_started(&mut self, row: RowIndex, lease: u64) {
        if lease != 0 {
            self.commands[row].lease = lease;
        }
    }

    /// Binds all of these commands to a lease, or none; an id of 0 is skipped.
    pub(super) fn bind_lease(
        &mut self,
        id: u64,
        commands: &[u64; SWITCH_MAX],
    ) -> Result<(), Refusal> {
        self.leases.find(id)?;
        let allowed = |state: CommandState| state == CommandState::Ready || state.is_active();
        let ids = || commands.iter().filter(|command| **command != 0);
        for command in ids() {
            self.commands.find(*command, allowed)?;
        }
        for command in ids() {
            if let Ok(row) = self.commands.find(*command, allowed) {
                let row = &mut self.commands[row];
                row.lease = id;
                if let PendingTransition::Start { lease, .. } = &mut row.pending {
                    *lease = 0;
                }
            }
        }
        Ok(())
    }

    /// Ends the leases that were not renewed in time.
    pub(super) fn expire_leases(&mut self) {
        if self.leases.count == 0 {
            return;
        }
        for _ in 0..LEASES_MAX {
            match self.leases.expired(self.status.cycle, self.period_ns) {
                Some(id) => self.lose_lease(id),
                None => return,
            }
        }
    }

    /// The client is gone: its rules are disarmed unless they go on, and its active commands are canceled, or aborted if
    /// they cannot be. Its ready commands stay bound to the lease, so that none of them starts without it.
    fn lose_lease(&mut self, id: u64) {
        if let Ok(lease) = self.leases.find(id) {
            lease.id = 0;
            self.leases.count = self.leases.count.saturating_sub(1);
        }
        let reason = DisarmReason::ClientLost { lease: id };
        let rules = self.disarm_where(reason, |rule| rule.lease == id && !rule.goes_on);
        let mut commands = 0;
        for row in RowIndex::all() {
            let command = &self.commands[row];
            let (started, command) = (command.is_evaluated(), command.entry.id);
            if command == 0 || self.commands[row].runs_for() != id || !started {
                continue;
            }
            if self.withdraw_start(command) {
                commands += 1;
                continue;
            }
            self.commands[row].lease = 0;
            // One that is being canceled comes to its end by itself.
            if self.commands[row].state() != CommandState::Canceling {
                commands += 1;
                self.end_for_lost_client(row, command);
            }
        }
        self.log(EngineEvent::LeaseLost {
            cycle: self.status.cycle,
            lease: id,
            rules,
            commands,
        });
    }

    fn end_for_lost_client(&mut self, row: RowIndex, id: u64) {
        if self.cancel(id).is_err() {
            self.end(row, EndReason::Aborted, FaultRecord::NONE);
        }
    }
}
