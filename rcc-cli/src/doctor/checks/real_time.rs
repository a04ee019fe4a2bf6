//! Real-time scheduling: SCHED_FIFO, the rttime limit, throttling. Pure.

use crate::doctor::HealthFinding;
use crate::doctor::facts::MachineFacts;
use crate::doctor::facts::limits::LimitGrant;
use nix::errno::Errno;

/// SCHED_FIFO at the configured priority: whether it was granted to a thread, and otherwise the reason.
pub(super) fn fifo(facts: &MachineFacts) -> Vec<HealthFinding> {
    let priority = facts.requirements.priority;
    match facts.trial.fifo {
        Ok(()) => vec![HealthFinding::ok(format!(
            "SCHED_FIFO {priority} obtained ({})",
            granting_right(facts)
        ))],
        Err(errno) => {
            let (cause, fix) = cause_and_fix(facts, errno);
            let what = format!("SCHED_FIFO {priority} refused: {}", errno.desc());
            vec![
                HealthFinding::warn(what, fix)
                    .required(facts.requirements.required)
                    .cause(cause),
            ]
        }
    }
}

fn granting_right(facts: &MachineFacts) -> String {
    if facts.user.has_cap_sys_nice {
        return "CAP_SYS_NICE".to_owned();
    }
    match facts.limits.rtprio.soft {
        Some(limit) => format!("the rtprio limit is {limit}"),
        None => "the rtprio limit is unlimited".to_owned(),
    }
}

fn cause_and_fix(facts: &MachineFacts, errno: Errno) -> (String, String) {
    let priority = u64::from(facts.requirements.priority);
    if !(1..=99).contains(&priority) {
        return (
            "SCHED_FIFO has the priorities 1 to 99".to_owned(),
            "set executor.priority to one of them in the cell's file".to_owned(),
        );
    }
    if facts.user.has_cap_sys_nice || facts.limits.rtprio.allows(priority) {
        return despite_the_right(facts, errno);
    }
    if let Some(container) = &facts.user.container {
        return (
            format!(
                "this container ({container}) has an rtprio limit of {}",
                limit(facts)
            ),
            "start the container with --cap-add=SYS_NICE --ulimit rtprio=90 --ulimit memlock=-1"
                .to_owned(),
        );
    }
    if let Some(service) = facts.user.service() {
        return (
            format!("the rtprio limit of {service} is {}", limit(facts)),
            format!(
                "LimitRTPRIO=90 in the section [Service] (systemctl edit {service}), then restart it"
            ),
        );
    }
    if facts.limits.rtprio.can_reach(priority) {
        return (
            format!(
                "the soft rtprio limit is {}; the hard limit suffices",
                limit(facts)
            ),
            format!("ulimit -S -r {priority}   in this shell"),
        );
    }
    from_pam_limits(facts, priority)
}

/// Derives cause and remedy from the pam_limits files.
fn from_pam_limits(facts: &MachineFacts, priority: u64) -> (String, String) {
    let lines = || {
        facts
            .limit_grants
            .iter()
            .filter(|line| line.item == "rtprio")
    };
    let enough = |line: &&LimitGrant| line.value.is_none_or(|value| value >= priority);
    let name = &facts.user.name;
    // The last matching line of pam_limits applies.
    let ours = lines().rfind(|line| facts.user.is_matched_by(&line.subject));
    if let Some(line) = ours.filter(enough) {
        return (
            format!(
                "{} grants {} to {}, but this session has {}: it started before the change, or does not read that file",
                line.location, limit_text(line.value), line.subject, limit(facts)
            ),
            "log out of all sessions and in again (a graphical session: restart the computer); over ssh: UsePAM yes"
                .to_owned(),
        );
    }
    if let Some(line) = ours {
        return (
            format!(
                "{} grants only {} to {}",
                line.location,
                limit_text(line.value),
                line.subject
            ),
            format!(
                "set it to 90, then log out and in again ({name} cannot change the file: ask root)"
            ),
        );
    }
    let group = lines()
        .filter(enough)
        .find_map(|line| line.subject.strip_prefix('@'));
    if let Some(group) = group {
        return (
            format!(
                "the rtprio limit is {}; the group {group} has a sufficient limit, but {name} is not a member",
                limit(facts)
            ),
            format!("sudo usermod -aG {group} {name}   then log out of all sessions and in again"),
        );
    }
    (
        format!(
            "the rtprio limit is {} and no pam_limits file raises it",
            limit(facts)
        ),
        format!(
            "as root: groupadd -f rcc; usermod -aG rcc {name}; \
             printf '@rcc - rtprio 90\\n@rcc - memlock unlimited\\n' > /etc/security/limits.d/rcc.conf   \
             then log out of all sessions and in again"
        ),
    )
}

/// Cause and remedy if the right exists and SCHED_FIFO was still refused.
fn despite_the_right(facts: &MachineFacts, errno: Errno) -> (String, String) {
    let kernel = &facts.kernel;
    let group = &facts.user.cgroup;
    if kernel.rt_runtime_us == Some(0) {
        return (
            "kernel.sched_rt_runtime_us is 0: real-time threads cannot run at all".to_owned(),
            "sudo sysctl -w kernel.sched_rt_runtime_us=950000".to_owned(),
        );
    }
    let grouped = kernel.rt_group_sched == Some(true) || kernel.group_rt_runtime_us == Some(0);
    let nested = !matches!(group.as_str(), "" | "/");
    if grouped || (errno == Errno::EPERM && nested && facts.user.container.is_none()) {
        let certain = if grouped { "has" } else { "probably has" };
        return (
            format!(
                "the kernel {certain} CONFIG_RT_GROUP_SCHED, and the control group {group} has no real-time share"
            ),
            format!(
                "run a kernel without CONFIG_RT_GROUP_SCHED; or give a share (control groups version 1): \
                 echo 950000 | sudo tee /sys/fs/cgroup/cpu{group}/cpu.rt_runtime_us"
            ),
        );
    }
    match &facts.user.container {
        Some(container) => (
            format!("the container ({container}) forbids it although the limit suffices"),
            "start the container with --cap-add=SYS_NICE and check its seccomp profile".to_owned(),
        ),
        None => (
            "limit and capabilities suffice, but something else forbids it (seccomp, AppArmor, SELinux)".to_owned(),
            "search `dmesg` and `journalctl -t audit` for a denied sched_setscheduler".to_owned(),
        ),
    }
}

fn limit(facts: &MachineFacts) -> String {
    limit_text(facts.limits.rtprio.soft)
}

fn limit_text(value: Option<u64>) -> String {
    value.map_or_else(|| "unlimited".to_owned(), |value| value.to_string())
}

/// One second; a healthy cell needs less, even when loading a plan under a debugger.
const SUFFICIENT_US: u64 = 1_000_000;

/// RLIMIT_RTTIME: the kernel kills a process whose real-time thread computes longer than this without sleeping.
pub(super) fn run_time(facts: &MachineFacts) -> Vec<HealthFinding> {
    match facts.limits.rttime.soft {
        None => Vec::new(),
        Some(limit) if limit >= SUFFICIENT_US => vec![HealthFinding::note(format!(
            "the rttime limit is {limit} µs: enough for the cycle"
        ))],
        Some(limit) => {
            let fix = match facts.user.service() {
                Some(service) => format!("LimitRTTIME=infinity in {service}"),
                None => "ulimit -S -R unlimited, or raise `rttime` where it is set (desktop sessions: rtkit)".to_owned(),
            };
            let what = format!("the rttime limit is {limit} µs");
            vec![
                HealthFinding::warn(what, fix)
                    .cause("the kernel kills the executor when one cycle takes longer"),
            ]
        }
    }
}

/// Linux's default share for real-time threads, percent.
const DEFAULT_PERCENT: i64 = 95;

/// Real-time throttling: the kernel's protection against real-time threads that never sleep.
pub(super) fn throttling(facts: &MachineFacts) -> Vec<HealthFinding> {
    let (Some(run), Some(period)) = (facts.kernel.rt_runtime_us, facts.kernel.rt_period_us) else {
        return Vec::new();
    };
    if run < 0 {
        return vec![
            HealthFinding::note(
                "real-time throttling is off: a thread that never sleeps would freeze the machine",
            )
            .fix("sudo sysctl -w kernel.sched_rt_runtime_us=950000, unless it is off on purpose"),
        ];
    }
    let percent = run.saturating_mul(100) / period.max(1);
    if percent < DEFAULT_PERCENT {
        let what = format!(
            "real-time threads may run only {percent} % of the time ({run} of {period} µs)"
        );
        return vec![
            HealthFinding::warn(what, "sudo sysctl -w kernel.sched_rt_runtime_us=950000")
                .cause("the kernel stops the executor for the rest of each period"),
        ];
    }
    vec![HealthFinding::ok(format!(
        "real-time throttling is on at {percent} %: it protects the machine, and the cycle needs less"
    ))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::FindingLevel;
    use crate::doctor::facts::limits::ResourceLimit;

    fn refused() -> MachineFacts {
        let mut facts = MachineFacts::default();
        facts.trial.fifo = Err(Errno::EPERM);
        facts.limits.rtprio = ResourceLimit {
            soft: Some(0),
            hard: Some(0),
        };
        facts.user.name = "anna".to_owned();
        facts.user.uid = 1000;
        facts.user.cgroup = "/user.slice/user-1000.slice/session-2.scope".to_owned();
        facts
    }

    fn granted(whom: &str, value: u64) -> LimitGrant {
        LimitGrant {
            location: "/etc/security/limits.d/rcc.conf:1".to_owned(),
            subject: whom.to_owned(),
            item: "rtprio".to_owned(),
            value: Some(value),
        }
    }

    fn only(facts: &MachineFacts) -> (String, String) {
        let [finding] = &fifo(facts)[..] else {
            panic!("one finding")
        };
        assert_eq!(finding.level, FindingLevel::Warn);
        (
            finding.cause.clone().unwrap_or_default(),
            finding.fix.clone().unwrap_or_default(),
        )
    }

    #[test]
    fn the_granting_right_is_named() {
        let mut facts = MachineFacts::default();
        facts.user.has_cap_sys_nice = true;
        assert_eq!(
            fifo(&facts),
            [HealthFinding::ok("SCHED_FIFO 80 obtained (CAP_SYS_NICE)")]
        );
        facts.user.has_cap_sys_nice = false;
        facts.limits.rtprio.soft = Some(90);
        assert_eq!(
            fifo(&facts),
            [HealthFinding::ok(
                "SCHED_FIFO 80 obtained (the rtprio limit is 90)"
            )]
        );
    }

    #[test]
    fn without_any_grant_the_file_to_write_is_named() {
        let (cause, fix) = only(&refused());
        assert!(cause.contains("no pam_limits file"), "{cause}");
        assert!(
            fix.contains("/etc/security/limits.d/rcc.conf") && fix.contains("usermod -aG rcc anna"),
            "{fix}"
        );
    }

    #[test]
    fn a_session_older_than_its_grant_needs_a_new_login() {
        let mut facts = refused();
        facts.user.groups = vec!["rcc".to_owned()];
        facts.limit_grants = vec![granted("@rcc", 90)];
        let (cause, fix) = only(&facts);
        assert!(
            cause.contains("limits.d/rcc.conf:1") && cause.contains("this session has 0"),
            "{cause}"
        );
        assert!(fix.starts_with("log out"), "{fix}");
    }

    #[test]
    fn a_grant_to_another_group_names_that_group() {
        let mut facts = refused();
        facts.limit_grants = vec![granted("@audio", 95)];
        let (_, fix) = only(&facts);
        assert!(fix.contains("usermod -aG audio anna"), "{fix}");
    }

    #[test]
    fn a_refused_requirement_is_a_failure() {
        let mut facts = refused();
        facts.requirements.required = true;
        assert_eq!(fifo(&facts)[0].level, FindingLevel::Fail);
    }

    #[test]
    fn a_grant_that_is_too_small_is_named() {
        let mut facts = refused();
        facts.limit_grants = vec![granted("anna", 50)];
        let (cause, _) = only(&facts);
        assert!(cause.contains("grants only 50"), "{cause}");
    }

    #[test]
    fn a_soft_limit_is_raised_in_the_shell() {
        let mut facts = refused();
        facts.limits.rtprio.hard = Some(90);
        assert!(only(&facts).1.starts_with("ulimit -S -r 80"));
    }

    #[test]
    fn remedies_suit_services_and_containers() {
        let mut facts = refused();
        facts.user.cgroup = "/system.slice/rcc-executor.service".to_owned();
        assert!(only(&facts).1.contains("LimitRTPRIO=90"));
        facts.user.container = Some("docker".to_owned());
        assert!(only(&facts).1.contains("--cap-add=SYS_NICE"));
    }

    #[test]
    fn a_refusal_despite_the_right_names_real_time_groups_or_throttling() {
        let mut facts = refused();
        facts.user.has_cap_sys_nice = true;
        facts.kernel.rt_group_sched = Some(true);
        let (cause, _) = only(&facts);
        assert!(cause.contains("has CONFIG_RT_GROUP_SCHED"), "{cause}");
        facts.kernel.rt_group_sched = None;
        let (cause, _) = only(&facts);
        assert!(
            cause.contains("probably has CONFIG_RT_GROUP_SCHED"),
            "{cause}"
        );
        facts.kernel.rt_runtime_us = Some(0);
        assert!(only(&facts).1.contains("sched_rt_runtime_us=950000"));
    }

    #[test]
    fn unlimited_says_nothing_and_a_short_time_warns() {
        let mut facts = MachineFacts::default();
        assert_eq!(run_time(&facts), []);
        facts.limits.rttime.soft = Some(200_000);
        assert_eq!(run_time(&facts)[0].level, FindingLevel::Warn);
        facts.limits.rttime.soft = Some(2_000_000);
        assert_eq!(run_time(&facts)[0].level, FindingLevel::Note);
    }

    #[test]
    fn the_usual_share_is_fine_none_is_a_note_and_less_warns() {
        let mut facts = MachineFacts::default();
        assert_eq!(throttling(&facts), []);
        facts.kernel.rt_period_us = Some(1_000_000);
        for (run, level) in [
            (950_000, FindingLevel::Ok),
            (-1, FindingLevel::Note),
            (500_000, FindingLevel::Warn),
            (0, FindingLevel::Warn),
        ] {
            facts.kernel.rt_runtime_us = Some(run);
            assert_eq!(throttling(&facts)[0].level, level, "{run}");
        }
    }
}
