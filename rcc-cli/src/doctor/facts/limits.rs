//! Resource limits of this process, and limits that pam_limits grants to users at login. Run by the main thread.

use super::system::SystemRoot;

/// A resource limit; `None` is unlimited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResourceLimit {
    /// Soft limit, in force.
    pub soft: Option<u64>,
    /// Hard limit, up to which the process may raise the soft limit.
    pub hard: Option<u64>,
}

/// The relevant resource limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ResourceLimits {
    /// Highest SCHED_FIFO priority.
    pub rtprio: ResourceLimit,
    /// Locked memory, bytes.
    pub memlock: ResourceLimit,
    /// Time that a real-time thread may run without sleeping, µs.
    pub rttime: ResourceLimit,
    /// Open files.
    pub nofile: ResourceLimit,
}

/// A line of `/etc/security/limits.conf` or of a file in `limits.d`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LimitGrant {
    /// File and line.
    pub location: String,
    /// User, `@group`, or `*`.
    pub subject: String,
    /// `rtprio` or `memlock`.
    pub item: String,
    /// Granted value; `None` is unlimited.
    pub value: Option<u64>,
}

/// Reads `/proc/self/limits`.
#[must_use]
pub fn read(system: &SystemRoot) -> ResourceLimits {
    let text = system.text("proc/self/limits").unwrap_or_default();
    let of = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name));
        let mut words = line
            .unwrap_or_default()
            .split_whitespace()
            .map(|word| word.parse().ok());
        ResourceLimit {
            soft: words.next().flatten(),
            hard: words.next().flatten(),
        }
    };
    ResourceLimits {
        rtprio: of("Max realtime priority"),
        memlock: of("Max locked memory"),
        rttime: of("Max realtime timeout"),
        nofile: of("Max open files"),
    }
}

/// Returns every line that grants `rtprio` or `memlock`, in the order in which pam_limits reads them.
#[must_use]
pub fn limit_grants(system: &SystemRoot) -> Vec<LimitGrant> {
    let folder = "etc/security/limits.d";
    let files = system
        .names(folder)
        .into_iter()
        .filter(|name| name.ends_with(".conf"));
    let mut paths = vec!["etc/security/limits.conf".to_owned()];
    paths.extend(files.map(|name| format!("{folder}/{name}")));
    let mut all = Vec::new();
    for path in paths {
        let text = system.text(&path).unwrap_or_default();
        let lines = text.lines().enumerate();
        all.extend(lines.filter_map(|(index, line)| line_of(&path, index + 1, line)));
    }
    all
}

fn line_of(path: &str, number: usize, line: &str) -> Option<LimitGrant> {
    let line = line.split('#').next()?;
    let mut words = line.split_whitespace();
    let (whom, _kind, item, value) = (words.next()?, words.next()?, words.next()?, words.next()?);
    if !["rtprio", "memlock"].contains(&item) {
        return None;
    }
    // memlock is given in kB.
    let unit = if item == "memlock" { 1024 } else { 1 };
    let unlimited = ["unlimited", "infinity", "-1"].contains(&value);
    let value = if unlimited {
        None
    } else {
        Some(value.parse::<u64>().ok()?.saturating_mul(unit))
    };
    Some(LimitGrant {
        location: format!("/{path}:{number}"),
        subject: whom.to_owned(),
        item: item.to_owned(),
        value,
    })
}

impl ResourceLimit {
    /// Returns true if the soft limit allows this amount.
    #[must_use]
    pub fn allows(&self, amount: u64) -> bool {
        self.soft.is_none_or(|soft| soft >= amount)
    }

    /// Returns true if the hard limit allows this amount.
    #[must_use]
    pub fn can_reach(&self, amount: u64) -> bool {
        self.hard.is_none_or(|hard| hard >= amount)
    }
}

#[cfg(test)]
mod tests {
    use super::super::system::tests::FixtureRoot;
    use super::*;

    #[test]
    fn limits_are_read_as_the_kernel_writes_them() {
        let text = "Limit                     Soft Limit           Hard Limit           Units     \n\
                    Max open files            1024                 524288               files     \n\
                    Max locked memory         8388608              unlimited            bytes     \n\
                    Max realtime priority     0                    95                   \n\
                    Max realtime timeout      200000               unlimited            us        \n";
        let recorded = FixtureRoot::new(&[("proc/self/limits", text)]);
        let limits = read(&recorded.system());
        assert_eq!(
            limits.nofile,
            ResourceLimit {
                soft: Some(1024),
                hard: Some(524_288)
            }
        );
        assert_eq!(
            limits.memlock,
            ResourceLimit {
                soft: Some(8_388_608),
                hard: None
            }
        );
        assert!(!limits.rtprio.allows(80) && limits.rtprio.can_reach(80));
        assert_eq!(limits.rttime.soft, Some(200_000));
    }

    #[test]
    fn grants_are_found_with_file_and_line() {
        let files = [
            (
                "etc/security/limits.conf",
                "# comment\n* hard core 0\n@audio - rtprio 95\n",
            ),
            (
                "etc/security/limits.d/rcc.conf",
                "@rcc - memlock unlimited\nanna soft memlock 64 # kB\n",
            ),
            ("etc/security/limits.d/old.txt", "@x - rtprio 1\n"),
        ];
        let recorded = FixtureRoot::new(&files);
        let all = limit_grants(&recorded.system());
        let places: Vec<&str> = all
            .iter()
            .map(|granted| granted.location.as_str())
            .collect();
        assert_eq!(
            places,
            [
                "/etc/security/limits.conf:3",
                "/etc/security/limits.d/rcc.conf:1",
                "/etc/security/limits.d/rcc.conf:2"
            ]
        );
        assert_eq!(all[1].value, None);
        assert_eq!(all[2].value, Some(65_536));
    }
}
