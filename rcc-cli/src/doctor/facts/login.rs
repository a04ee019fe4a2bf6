//! The user: groups, capabilities, control group, and logind's handling of the user's shared memory at logout. Run by
//! the main thread.

use super::system::{SystemRoot, value_in};

/// From linux/capability.h.
const CAP_SYS_NICE: u32 = 23;

/// The user of this process.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UserFacts {
    /// User id.
    pub uid: u32,
    /// Name, or the id if it has none.
    pub name: String,
    /// Names of its groups.
    pub groups: Vec<String>,
    /// True with CAP_SYS_NICE: any thread priority is allowed.
    pub has_cap_sys_nice: bool,
    /// True for a system user, whose shared memory logind leaves alone.
    pub is_system: bool,
    /// Path of the control group.
    pub cgroup: String,
    /// Kind of container, if this is one.
    pub container: Option<String>,
}

impl UserFacts {
    /// Returns the system service that this process belongs to; `None` in a user session.
    #[must_use]
    pub fn service(&self) -> Option<&str> {
        let last = self.cgroup.rsplit('/').next()?;
        (last.ends_with(".service") && !last.starts_with("user@")).then_some(last)
    }

    /// Returns true if a pam_limits line for `whom` applies to this user.
    #[must_use]
    pub fn is_matched_by(&self, whom: &str) -> bool {
        match whom.strip_prefix('@') {
            Some(group) => self.groups.iter().any(|own| own == group),
            // The wildcard does not apply to root (limits.conf(5)).
            None => whom == self.name || (whom == "*" && self.uid != 0),
        }
    }
}

/// Reads `/proc/self` and the user tables.
#[must_use]
pub fn read(system: &SystemRoot) -> UserFacts {
    let status = system.text("proc/self/status").unwrap_or_default();
    let field = |key| value_in(&status, key).unwrap_or_default().to_owned();
    let second = |text: &str| {
        text.split_whitespace()
            .nth(1)
            .and_then(|word| word.parse::<u32>().ok())
    };
    // Fields: real, effective, saved, file system.
    let uid = second(&field("Uid")).unwrap_or(u32::MAX);
    let mut gids: Vec<u32> = field("Groups")
        .split_whitespace()
        .filter_map(|word| word.parse().ok())
        .collect();
    gids.extend(second(&field("Gid")));
    let capabilities = u64::from_str_radix(&field("CapEff"), 16).unwrap_or(0);
    let system_max = system
        .text("etc/login.defs")
        .as_deref()
        .and_then(|text| word_after(text, "SYS_UID_MAX"))
        .unwrap_or(999);
    UserFacts {
        uid,
        name: name_of(system, "etc/passwd", uid).unwrap_or_else(|| uid.to_string()),
        groups: gids
            .iter()
            .map(|gid| name_of(system, "etc/group", *gid).unwrap_or_else(|| gid.to_string()))
            .collect(),
        has_cap_sys_nice: capabilities >> CAP_SYS_NICE & 1 == 1,
        // `nobody` counts as well (systemd's uid_is_system, uid_is_dynamic and 65534).
        is_system: uid <= system_max || uid == 65_534,
        cgroup: cgroup(system),
        container: container(system),
    }
}

/// Returns whether logind deletes a user's shared memory when the last session ends; `None` without systemd.
#[must_use]
pub fn remove_ipc(system: &SystemRoot) -> Option<bool> {
    // The check of sd_booted(3).
    if !system.has("run/systemd/system") {
        return None;
    }
    let mut paths = vec!["etc/systemd/logind.conf".to_owned()];
    for folder in ["usr/lib", "lib", "run", "etc"] {
        let folder = format!("{folder}/systemd/logind.conf.d");
        let names = system.names(&folder).into_iter();
        paths.extend(names.map(|name| format!("{folder}/{name}")));
    }
    // The default of logind.conf(5); the last setting applies.
    let mut found = true;
    for path in paths {
        match system.value(&path, "RemoveIPC").as_deref() {
            Some("no" | "false" | "off" | "0") => found = false,
            Some(_) => found = true,
            None => {}
        }
    }
    Some(found)
}

fn word_after(text: &str, key: &str) -> Option<u32> {
    text.lines().find_map(|line| {
        let mut words = line.split_whitespace();
        (words.next() == Some(key)).then(|| words.next()?.parse().ok())?
    })
}

/// Returns the name of an id in a table such as `/etc/passwd`.
fn name_of(system: &SystemRoot, path: &str, id: u32) -> Option<String> {
    let text = system.text(path)?;
    text.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)?.parse() == Ok(id)).then(|| name.to_owned())
    })
}

/// Returns the control group: of the version 1 cpu controller, or else of version 2.
fn cgroup(system: &SystemRoot) -> String {
    let text = system.text("proc/self/cgroup").unwrap_or_default();
    let of = |wanted: &dyn Fn(&str) -> bool| {
        text.lines().find_map(|line| {
            let mut fields = line.splitn(3, ':').skip(1);
            let (controllers, path) = (fields.next()?, fields.next()?);
            wanted(controllers).then(|| path.to_owned())
        })
    };
    of(&|controllers| controllers.split(',').any(|one| one == "cpu"))
        .or_else(|| of(&str::is_empty))
        .unwrap_or_default()
}

fn container(system: &SystemRoot) -> Option<String> {
    if let Some(name) = system.text("run/systemd/container") {
        return Some(name);
    }
    let kinds = [(".dockerenv", "docker"), ("run/.containerenv", "podman")];
    let found = kinds.iter().find(|(path, _)| system.has(path));
    found.map(|(_, name)| (*name).to_owned())
}

#[cfg(test)]
mod tests {
    use super::super::system::tests::FixtureRoot;
    use super::*;

    const STATUS: &str = "Name:\tx\nUid:\t1000\t1000\t1000\t1000\nGid:\t1000\t1000\t1000\t1000\n\
                          Groups:\t29 1000 \nCapEff:\t0000000000804000\n";

    #[test]
    fn a_person_at_a_terminal_is_recognised() {
        let files = [
            ("proc/self/status", STATUS),
            (
                "proc/self/cgroup",
                "0::/user.slice/user-1000.slice/session-2.scope\n",
            ),
            (
                "etc/passwd",
                "root:x:0:0::/root:/bin/sh\nanna:x:1000:1000::/home/anna:/bin/sh\n",
            ),
            ("etc/group", "audio:x:29:anna\nanna:x:1000:\n"),
        ];
        let recorded = FixtureRoot::new(&files);
        let user = read(&recorded.system());
        assert_eq!((user.uid, user.name.as_str()), (1000, "anna"));
        assert_eq!(user.groups, ["audio", "anna", "anna"]);
        assert!(user.has_cap_sys_nice && !user.is_system);
        assert_eq!(user.service(), None);
        assert!(
            user.is_matched_by("@audio") && user.is_matched_by("*") && user.is_matched_by("anna")
        );
        assert!(!user.is_matched_by("@rcc") && !user.is_matched_by("bert"));
    }

    #[test]
    fn a_service_and_a_container_are_recognised() {
        let files = [
            (
                "proc/self/cgroup",
                "3:cpu,cpuacct:/system.slice/rcc-executor.service\n0::/x\n",
            ),
            (".dockerenv", ""),
        ];
        let recorded = FixtureRoot::new(&files);
        let user = read(&recorded.system());
        assert_eq!(user.service(), Some("rcc-executor.service"));
        assert_eq!(user.container.as_deref(), Some("docker"));
    }

    #[test]
    fn the_last_remove_ipc_setting_applies_and_the_default_is_yes() {
        let without = FixtureRoot::new(&[("etc/systemd/logind.conf", "")]);
        assert_eq!(remove_ipc(&without.system()), None);
        let default = [
            ("run/systemd/system/x", ""),
            ("etc/systemd/logind.conf", "#RemoveIPC=no\n"),
        ];
        let default = FixtureRoot::new(&default);
        assert_eq!(remove_ipc(&default.system()), Some(true));
        let off = [
            ("run/systemd/system/x", ""),
            ("etc/systemd/logind.conf", "RemoveIPC=yes\n"),
            (
                "etc/systemd/logind.conf.d/rcc.conf",
                "[Login]\nRemoveIPC=no\n",
            ),
        ];
        let off = FixtureRoot::new(&off);
        assert_eq!(remove_ipc(&off.system()), Some(false));
    }
}
