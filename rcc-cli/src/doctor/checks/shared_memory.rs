//! `/dev/shm`: in memory, large enough, writable. Pure.

use super::bytes;
use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;

/// Approximate need of a small cell, bytes; every client of the executor's requests adds 5 MB.
const NEEDED: u64 = 64 << 20;

pub(super) fn check(facts: &MachineFacts) -> Vec<HealthFinding> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::facts::shared_memory::SharedMemoryMount;

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
            check(&facts)[0].level
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
}
