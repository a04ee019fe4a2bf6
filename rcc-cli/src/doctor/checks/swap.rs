//! Memory and swap: a swapped-out page takes milliseconds to return. Pure.

use super::bytes;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Below this, the kernel starts to reclaim memory.
const AVAILABLE_MIN: u64 = 256 << 20;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
    let memory = &facts.memory;
    let locked =
        facts.trial.lock.is_ok() && (facts.user.uid == 0 || facts.limits.memlock.soft.is_none());
    let mut found = Vec::new();
    if let Some(available) = memory
        .available
        .filter(|available| *available < AVAILABLE_MIN)
    {
        let what = format!("only {} of memory are available", bytes(available));
        found.push(HealthFinding::warn(
            what,
            "close programs: the kernel may kill a process of the cell when memory runs out",
        ));
    }
    if memory.swap_used > 0 && !locked {
        let what = format!(
            "{} are swapped out, and memory cannot be locked",
            bytes(memory.swap_used)
        );
        found.push(HealthFinding::warn(
            what,
            "run `sudo swapoff -a`, or allow locked memory (above)",
        ));
    } else if memory.swap > 0 && !locked {
        found.push(
            HealthFinding::note(format!(
                "there are {} of swap, and memory cannot be locked",
                bytes(memory.swap)
            ))
            .fix("run `sudo swapoff -a`, or allow locked memory (above)"),
        );
    }
    if memory.overcommit == Some(2) {
        found.push(
            HealthFinding::note(
                "vm.overcommit_memory is 2: allocations fail when requested, not when used",
            )
            .fix("none, unless a process of the cell fails to start for lack of memory"),
        );
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::facts::limits::ResourceLimit;

    #[test]
    fn swap_matters_only_where_memory_is_not_locked() {
        let mut facts = MachineFacts::default();
        facts.user.uid = 1000;
        facts.memory.swap = 1 << 30;
        facts.memory.swap_used = 1 << 20;
        assert_eq!(check(&facts), []);
        facts.limits.memlock = ResourceLimit {
            soft: Some(65_536),
            hard: Some(65_536),
        };
        assert_eq!(check(&facts)[0].level, FindingLevel::Warn);
        facts.memory.swap_used = 0;
        assert_eq!(check(&facts)[0].level, FindingLevel::Note);
    }

    #[test]
    fn little_memory_warns() {
        let mut facts = MachineFacts::default();
        facts.memory.available = Some(100 << 20);
        assert_eq!(check(&facts)[0].level, FindingLevel::Warn);
    }
}
