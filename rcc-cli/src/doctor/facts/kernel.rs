//! The kernel: preemption, real-time throttling and groups, clock source. Run by the main thread.

use super::system::{SystemRoot, value_in};

/// The running kernel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KernelFacts {
    /// Release, such as `6.1.0-13-rt-amd64`.
    pub release: String,
    /// True for PREEMPT_RT.
    pub preempt_rt: bool,
    /// Other preemption model: `PREEMPT_DYNAMIC`, `PREEMPT`, or empty.
    pub preemption: String,
    /// Time that real-time threads may run in each [`KernelFacts::rt_period_us`], µs; -1 is unlimited.
    pub rt_runtime_us: Option<i64>,
    /// Period of real-time throttling, µs.
    pub rt_period_us: Option<i64>,
    /// CONFIG_RT_GROUP_SCHED; `None` if the kernel's configuration is unreadable.
    pub rt_group_sched: Option<bool>,
    /// Real-time share of our control group (version 1), µs.
    pub group_rt_runtime_us: Option<i64>,
    /// Clock source: `tsc`, `hpet`, …
    pub clock_source: Option<String>,
    /// Vendor of the virtual machine; `None` on physical machines.
    pub virtual_machine: Option<String>,
}

/// Reads the facts about the kernel; `cgroup` is the path of our control group.
#[must_use]
pub fn read(system: &SystemRoot, cgroup: &str) -> KernelFacts {
    let version = system.text("proc/version").unwrap_or_default();
    let release = system.text("proc/sys/kernel/osrelease").unwrap_or_default();
    let in_version = version.split([' ', '_']).any(|word| word == "RT");
    let flagged = system.number("sys/kernel/realtime") == Some(1);
    let preemption = version.split(' ').find(|word| word.starts_with("PREEMPT"));
    KernelFacts {
        preempt_rt: flagged || in_version,
        preemption: preemption.unwrap_or_default().to_owned(),
        rt_runtime_us: system.number("proc/sys/kernel/sched_rt_runtime_us"),
        rt_period_us: system.number("proc/sys/kernel/sched_rt_period_us"),
        rt_group_sched: configured(system, &release, "CONFIG_RT_GROUP_SCHED"),
        group_rt_runtime_us: group_runtime(system, cgroup),
        clock_source: system
            .text("sys/devices/system/clocksource/clocksource0/current_clocksource"),
        virtual_machine: virtual_machine(system),
        release,
    }
}

fn configured(system: &SystemRoot, release: &str, key: &str) -> Option<bool> {
    let text = system
        .text(&format!("boot/config-{release}"))
        .or_else(|| system.text(&format!("lib/modules/{release}/config")))?;
    Some(value_in(&text, key) == Some("y"))
}

fn group_runtime(system: &SystemRoot, cgroup: &str) -> Option<i64> {
    let folders = ["sys/fs/cgroup/cpu", "sys/fs/cgroup/cpu,cpuacct"];
    folders
        .iter()
        .find_map(|folder| system.number(&format!("{folder}{cgroup}/cpu.rt_runtime_us")))
}

/// Detects a hypervisor by the processor flag; names it by the machine's vendor, if given.
fn virtual_machine(system: &SystemRoot) -> Option<String> {
    let processor = system.text("proc/cpuinfo")?;
    let flags = value_in(&processor, "flags")?;
    if !flags.split_whitespace().any(|flag| flag == "hypervisor") {
        return None;
    }
    let named = |path: &str| system.text(path).filter(|text| !text.is_empty());
    let name = named("sys/class/dmi/id/sys_vendor").or_else(|| named("sys/hypervisor/type"));
    Some(name.unwrap_or_else(|| "vendor unknown".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::super::system::tests::FixtureRoot;
    use super::*;

    #[test]
    fn a_real_time_kernel_is_recognised_by_either_sign() {
        let by_version = [(
            "proc/version",
            "Linux version 6.12.1 (x) #1 SMP PREEMPT_RT Debian",
        )];
        let by_version = FixtureRoot::new(&by_version);
        assert!(read(&by_version.system(), "/").preempt_rt);
        let by_flag = [
            ("proc/version", "Linux version 5.10"),
            ("sys/kernel/realtime", "1\n"),
        ];
        let by_flag = FixtureRoot::new(&by_flag);
        assert!(read(&by_flag.system(), "/").preempt_rt);
        let plain = [(
            "proc/version",
            "Linux version 6.18 (x) #1 SMP PREEMPT_DYNAMIC @0",
        )];
        let plain = FixtureRoot::new(&plain);
        let kernel = read(&plain.system(), "/");
        assert!(!kernel.preempt_rt);
        assert_eq!(kernel.preemption, "PREEMPT_DYNAMIC");
    }

    #[test]
    fn groups_of_real_time_threads_are_recognised() {
        let files = [
            ("proc/sys/kernel/osrelease", "6.1\n"),
            ("boot/config-6.1", "CONFIG_RT_GROUP_SCHED=y\nCONFIG_X=n\n"),
            ("sys/fs/cgroup/cpu/user.slice/cpu.rt_runtime_us", "0\n"),
        ];
        let recorded = FixtureRoot::new(&files);
        let kernel = read(&recorded.system(), "/user.slice");
        assert_eq!(kernel.rt_group_sched, Some(true));
        assert_eq!(kernel.group_rt_runtime_us, Some(0));
    }

    #[test]
    fn a_virtual_machine_is_named() {
        let files = [
            (
                "proc/cpuinfo",
                "processor\t: 0\nflags\t\t: fpu hypervisor\n",
            ),
            ("sys/class/dmi/id/sys_vendor", "QEMU\n"),
        ];
        let recorded = FixtureRoot::new(&files);
        assert_eq!(
            read(&recorded.system(), "/").virtual_machine.as_deref(),
            Some("QEMU")
        );
    }
}
