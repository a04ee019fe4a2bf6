//! Memory: locking, swap, `/dev/shm`, and its removal at logout. Pure.

use super::bytes;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Memory locking: a page fault in a cycle can cost milliseconds.
pub(super) fn memory_lock(facts: &MachineFacts) -> Vec<HealthFinding> {
    let limit = facts.limits.memlock.soft;
    // Like the executor: under a finite limit only root locks memory.
    let privileged = facts.user.uid == 0;
    match (facts.trial.lock, limit) {
        (Ok(()), _) if privileged => vec![HealthFinding::ok("memory can be locked (root)")],
        (Ok(()), None) => vec![HealthFinding::ok(
            "memory can be locked (the memlock limit is unlimited)",
        )],
        (Ok(()), Some(limit)) => {
            let what = format!("memory can be locked only up to {}", bytes(limit));
            vec![HealthFinding::warn(what, memory_lock_remedy(facts)).required(facts.requirements.required).cause(
                "the executor does not lock memory under a finite limit: a later allocation would fail while it runs",
            )]
        }
        (Err(errno), limit) => {
            let limit = limit.map_or_else(|| "unlimited".to_owned(), bytes);
            let what = format!("cannot lock memory: {}", errno.desc());
            vec![
                HealthFinding::warn(what, memory_lock_remedy(facts))
                    .required(facts.requirements.required)
                    .cause(format!("the memlock limit is {limit}")),
            ]
        }
    }
}

fn memory_lock_remedy(facts: &MachineFacts) -> String {
    if facts.user.container.is_some() {
        return "start the container with --ulimit memlock=-1".to_owned();
    }
    match facts.user.service() {
        Some(service) => format!("LimitMEMLOCK=infinity in {service}, then restart it"),
        None if facts.limits.memlock.hard.is_none() => "ulimit -S -l unlimited   in this shell".to_owned(),
        None => "add `@rcc - memlock unlimited` to /etc/security/limits.d/rcc.conf, join the group rcc, then log out of \
                 all sessions and in again"
            .to_owned(),
    }
}

/// Below this, the kernel starts to reclaim memory.
const AVAILABLE_MIN: u64 = 256 << 20;

/// Memory and swap: a swapped-out page takes milliseconds to return.
pub(super) fn swap(facts: &MachineFacts) -> Vec<HealthFinding> {
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

/// Approximate need of a small cell, bytes; every client of the executor's requests adds 5 MB.
const NEEDED: u64 = 64 << 20;

/// `/dev/shm`: in memory, large enough, writable.
pub(super) fn shared_memory(facts: &MachineFacts) -> Vec<HealthFinding> {
    let shared = &facts.shared;
    if !shared.writable {
        return vec![HealthFinding::fail(
            "/dev/shm is not writable",
            "sudo mount -o remount,mode=1777 /dev/shm",
        )];
    }
    let mut found = Vec::new();
    match shared.kind.as_deref() {
        Some("tmpfs" | "ramfs") => {}
        Some(other) => found.push(
            HealthFinding::warn(
                format!("/dev/shm is on {other}, not in memory"),
                "sudo mount -t tmpfs -o mode=1777 tmpfs /dev/shm, and in /etc/fstab",
            )
            .cause("every write in the cycle may wait for a disk"),
        ),
        None => found.push(
            HealthFinding::warn(
                "nothing is mounted at /dev/shm",
                "sudo mount -t tmpfs -o mode=1777 tmpfs /dev/shm; in a container: --shm-size=256m",
            )
            .cause("every write in the cycle may wait for a disk"),
        ),
    }
    if shared.options.iter().any(|option| option == "ro") {
        found.push(HealthFinding::fail(
            "/dev/shm is mounted read-only",
            "sudo mount -o remount,rw /dev/shm",
        ));
    }
    if shared.free < NEEDED {
        let what = format!(
            "/dev/shm has {} free of {}",
            bytes(shared.free),
            bytes(shared.size)
        );
        let fix = "run `rcc-cli doctor --clean` to remove leftovers of dead cells, or enlarge it: \
                   sudo mount -o remount,size=512m /dev/shm (in a container: --shm-size=256m)";
        found.push(
            HealthFinding::fail(what, fix).cause(format!("a cell needs about {}", bytes(NEEDED))),
        );
    }
    if found.is_empty() {
        found.push(HealthFinding::ok(format!(
            "/dev/shm is in memory, {} free of {}",
            bytes(shared.free),
            bytes(shared.size)
        )));
    }
    found
}

/// logind's RemoveIPC: deletes a person's shared memory when the last session ends, even under a running cell.
pub(super) fn session(facts: &MachineFacts) -> Vec<HealthFinding> {
    let name = &facts.user.name;
    match facts.remove_ipc {
        None => Vec::new(),
        Some(false) => vec![HealthFinding::ok(
            "logind keeps shared memory (RemoveIPC=no)",
        )],
        Some(true) if facts.user.is_system => vec![HealthFinding::ok(format!(
            "logind keeps shared memory of system users, and {name} is one"
        ))],
        Some(true) => {
            let what = format!(
                "logind deletes the shared memory of {name} when the last session ends (RemoveIPC=yes)"
            );
            let fix = format!(
                "run cells as services of a system user (rcc-cli install-units); or: loginctl enable-linger {name}; or \
                 RemoveIPC=no in /etc/systemd/logind.conf.d/rcc.conf and systemctl restart systemd-logind"
            );
            vec![
                HealthFinding::warn(what, fix)
                    .cause("a cell that keeps running after you log out loses its shared memory"),
            ]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::facts::limits::ResourceLimit;
    use crate::doctor::facts::memory::SharedMemoryMount;
    use nix::errno::Errno;

    #[test]
    fn root_and_unlimited_are_fine_and_a_finite_limit_is_not() {
        let mut facts = MachineFacts::default();
        facts.user.uid = 1000;
        assert_eq!(memory_lock(&facts)[0].level, FindingLevel::Ok);
        facts.limits.memlock = ResourceLimit {
            soft: Some(8 << 20),
            hard: Some(8 << 20),
        };
        let found = memory_lock(&facts);
        assert_eq!(found[0].level, FindingLevel::Warn);
        assert!(found[0].what.contains("8 MB"), "{found:?}");
        facts.user.uid = 0;
        assert_eq!(memory_lock(&facts)[0].level, FindingLevel::Ok);
    }

    #[test]
    fn a_refusal_names_the_limit_and_the_remedy_that_suits_the_place() {
        let mut facts = MachineFacts::default();
        facts.user.uid = 1000;
        facts.trial.lock = Err(Errno::ENOMEM);
        facts.limits.memlock = ResourceLimit {
            soft: Some(65_536),
            hard: None,
        };
        let fix = |facts: &MachineFacts| memory_lock(facts)[0].fix.clone().unwrap_or_default();
        assert!(fix(&facts).starts_with("ulimit -S -l"));
        facts.limits.memlock.hard = Some(65_536);
        assert!(fix(&facts).contains("limits.d/rcc.conf"));
        facts.user.cgroup = "/system.slice/rcc-executor.service".to_owned();
        assert!(fix(&facts).contains("LimitMEMLOCK"));
    }

    #[test]
    fn swap_matters_only_where_memory_is_not_locked() {
        let mut facts = MachineFacts::default();
        facts.user.uid = 1000;
        facts.memory.swap = 1 << 30;
        facts.memory.swap_used = 1 << 20;
        assert_eq!(swap(&facts), []);
        facts.limits.memlock = ResourceLimit {
            soft: Some(65_536),
            hard: Some(65_536),
        };
        assert_eq!(swap(&facts)[0].level, FindingLevel::Warn);
        facts.memory.swap_used = 0;
        assert_eq!(swap(&facts)[0].level, FindingLevel::Note);
    }

    #[test]
    fn little_memory_warns() {
        let mut facts = MachineFacts::default();
        facts.memory.available = Some(100 << 20);
        assert_eq!(swap(&facts)[0].level, FindingLevel::Warn);
    }

    #[test]
    fn memory_with_room_is_fine_and_everything_else_is_not() {
        let good = SharedMemoryMount {
            kind: Some("tmpfs".to_owned()),
            options: vec!["rw".to_owned()],
            size: 1 << 30,
            free: 1 << 29,
            writable: true,
        };
        let level = |shared: SharedMemoryMount| {
            let facts = MachineFacts {
                shared,
                ..MachineFacts::default()
            };
            shared_memory(&facts)[0].level
        };
        assert_eq!(level(good.clone()), FindingLevel::Ok);
        assert_eq!(
            level(SharedMemoryMount {
                kind: Some("ext4".to_owned()),
                ..good.clone()
            }),
            FindingLevel::Warn
        );
        assert_eq!(
            level(SharedMemoryMount {
                kind: None,
                ..good.clone()
            }),
            FindingLevel::Warn
        );
        assert_eq!(
            level(SharedMemoryMount {
                options: vec!["ro".to_owned()],
                ..good.clone()
            }),
            FindingLevel::Fail
        );
        assert_eq!(
            level(SharedMemoryMount {
                free: 1 << 20,
                ..good.clone()
            }),
            FindingLevel::Fail
        );
        assert_eq!(
            level(SharedMemoryMount {
                writable: false,
                ..good
            }),
            FindingLevel::Fail
        );
    }

    #[test]
    fn only_persons_are_warned() {
        let mut facts = MachineFacts::default();
        assert_eq!(session(&facts), []);
        facts.remove_ipc = Some(true);
        assert_eq!(session(&facts)[0].level, FindingLevel::Warn);
        facts.user.is_system = true;
        assert_eq!(session(&facts)[0].level, FindingLevel::Ok);
        facts.remove_ipc = Some(false);
        assert_eq!(session(&facts)[0].level, FindingLevel::Ok);
    }
}
