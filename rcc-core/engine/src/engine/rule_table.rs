//! The table of installed rules. Real-time thread; all of its memory is allocated with the engine.

use rcc_protocol::rules::{
    DisarmReason, RULE_TERMS_MAX, RULES_MAX, Rule, RuleFault, RuleState, RuleStatus,
};

use crate::rows::RowIndex;

/// One row of the table; `status.id` 0: never used.
#[derive(Clone, Copy, Debug)]
pub(super) struct InstalledRule {
    pub(super) rule: Rule,
    pub(super) status: RuleStatus,
    /// For each term of the condition that names a command, its row when the rule was installed.
    pub(super) rows: [RowIndex; RULE_TERMS_MAX],
    /// The condition held in this cycle for the first time.
    pub(super) since_cycle: u64,
    /// For a rule that records: the condition held at its last judgement. Initially true with `edge`, so that a condition
    /// that is already true is not recorded.
    pub(super) held: bool,
}

/// All rows. Ended rules stay in it until their rows are needed.
#[derive(Debug)]
pub(super) struct RuleTable {
    rules: [InstalledRule; RULES_MAX],
    /// Number of rules that can still fire.
    pending: usize,
    next_id: u64,
    /// A command has changed its state since the last check for rules that can never fire.
    pub(super) commands_changed: bool,
}

impl RuleTable {
    pub(super) fn new(first_id: u64) -> Box<RuleTable> {
        let none = InstalledRule {
            rule: Rule::EMPTY,
            status: RuleStatus::NONE,
            rows: [RowIndex::FIRST; RULE_TERMS_MAX],
            since_cycle: 0,
            held: false,
        };
        Box::new(RuleTable {
            rules: [none; RULES_MAX],
            pending: 0,
            next_id: first_id,
            commands_changed: false,
        })
    }

    /// Returns true if no rule can fire.
    pub(super) fn is_quiet(&self) -> bool {
        self.pending == 0
    }

    pub(super) fn get(&self, slot: usize) -> Option<&InstalledRule> {
        self.rules.get(slot)
    }

    pub(super) fn get_mut(&mut self, slot: usize) -> Option<&mut InstalledRule> {
        self.rules.get_mut(slot)
    }

    /// The row of a rule.
    pub(super) fn find(&self, id: u64) -> Option<usize> {
        let is = |installed: &InstalledRule| id != 0 && installed.status.id == id;
        self.rules.iter().position(is)
    }

    /// The rule with the lowest id above `after` among those that `wanted` accepts.
    pub(super) fn next_after(
        &self,
        after: u64,
        wanted: impl Fn(&InstalledRule) -> bool,
    ) -> Option<usize> {
        let rules = self.rules.iter().enumerate();
        let rules = rules.filter(|(_, installed)| installed.status.id > after && wanted(installed));
        let first = rules.min_by_key(|(_, installed)| installed.status.id);
        first.map(|(slot, _)| slot)
    }

    /// Checks that there is room for so many more rules.
    pub(super) fn check_room(&self, count: usize) -> Result<(), RuleFault> {
        match self.pending + count <= RULES_MAX {
            true => Ok(()),
            false => Err(RuleFault::TableFull {
                max: RULES_MAX as u32,
            }),
        }
    }

    /// Installs a rule in a free row, or in that of the oldest ended rule; returns row and id. There is room.
    pub(super) fn install(
        &mut self,
        rule: &Rule,
        rows: [RowIndex; RULE_TERMS_MAX],
        cycle: u64,
    ) -> Option<(usize, u64)> {
        let rules = self.rules.iter().enumerate();
        let free = rules.filter(|(_, installed)| {
            installed.status.id == 0 || !installed.status.state.is_pending()
        });
        let (slot, _) = free.min_by_key(|(_, installed)| installed.status.id)?;
        let id = self.next_id;
        *self.rules.get_mut(slot)? = InstalledRule {
            rule: *rule,
            status: RuleStatus {
                id,
                state: RuleState::Armed,
                cycle,
                lease: rule.lease,
                goes_on: rule.goes_on,
                ..RuleStatus::NONE
            },
            rows,
            since_cycle: 0,
            held: rule.record.is_some_and(|recording| recording.edge),
        };
        self.next_id += 1;
        self.pending += 1;
        Some((slot, id))
    }

    /// The id of the next rule that is installed.
    pub(super) fn next_id(&self) -> u64 {
        self.next_id
    }

    /// Ends a rule that could still fire; returns its new status.
    pub(super) fn end(
        &mut self,
        slot: usize,
        ending: impl FnOnce(&mut RuleStatus),
    ) -> Option<RuleStatus> {
        let installed = self.rules.get_mut(slot)?;
        if installed.status.id == 0 || !installed.status.state.is_pending() {
            return None;
        }
        ending(&mut installed.status);
        self.pending = self.pending.saturating_sub(1);
        Some(installed.status)
    }

    /// Frees the row of an ended rule.
    pub(super) fn free(&mut self, slot: usize) {
        if let Some(installed) = self.rules.get_mut(slot) {
            installed.status = RuleStatus::NONE;
        }
    }
}

/// Ends a rule as disarmed.
pub(super) fn disarmed(cycle: u64, reason: DisarmReason) -> impl FnOnce(&mut RuleStatus) {
    move |status| {
        (status.state, status.cycle) = (RuleState::Disarmed, cycle);
        status.disarmed = Some(reason);
    }
}
