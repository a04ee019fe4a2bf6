//! The core of the cycle: power saving, isolation, siblings, interrupts; and its activity during the measurement. Run
//! by the main thread, before and after the measurement.

use super::system::{SystemRoot, list};

/// Idle states with a longer exit latency show in the wake-ups, µs.
const LATENCY_SEEN_US: i64 = 10;
/// Tick of `/proc/stat`, ms (USER_HZ is 100 on all current Linux systems).
const TICK_MS: u64 = 10;

/// Facts about the configured core, or about all cores if none is configured.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CpuFacts {
    /// Online cores.
    pub online: Vec<usize>,
    /// Cores that this process may use.
    pub allowed: Vec<usize>,
    /// Cores isolated from ordinary threads (isolcpus).
    pub isolated: Vec<usize>,
    /// Cores without a clock tick while a single thread runs (nohz_full).
    pub nohz_full: Vec<usize>,
    /// SMT siblings of the configured core.
    pub siblings: Vec<usize>,
    /// Frequency governors, without duplicates.
    pub governors: Vec<String>,
    /// Enabled idle states with a long exit latency: name and latency, µs.
    pub deep_idle: Vec<(String, i64)>,
    /// Longest exit latency requested through /dev/cpu_dma_latency, µs; `None` if unreadable.
    pub dma_latency_us: Option<i64>,
}

/// Activity of the machine during the measurement.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MachineActivity {
    /// Processor time taken by the host, ms.
    pub steal_ms: u64,
    /// Device interrupts on the core, most frequent first.
    pub interrupts: Vec<(String, u64)>,
    /// System management interrupts (MSR 0x34); `None` if unreadable.
    pub smi: Option<u64>,
}

/// Counters at one moment; two of them give a [`MachineActivity`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CpuCounters {
    steal_ticks: u64,
    interrupts: Vec<(String, u64)>,
    smi: Option<u64>,
}

/// Reads the static facts.
#[must_use]
pub fn read(system: &SystemRoot, core: Option<usize>) -> CpuFacts {
    let folder = "sys/devices/system/cpu";
    let listed = |path: String| {
        system
            .text(&path)
            .map(|text| list(&text))
            .unwrap_or_default()
    };
    let online = listed(format!("{folder}/online"));
    let cores = core.map_or_else(|| online.clone(), |core| vec![core]);
    let allowed = system.value("proc/self/status", "Cpus_allowed_list");
    let mut governors: Vec<String> = cores
        .iter()
        .filter_map(|core| system.text(&format!("{folder}/cpu{core}/cpufreq/scaling_governor")))
        .collect();
    governors.sort();
    governors.dedup();
    let siblings = core.map(|core| {
        let all = listed(format!("{folder}/cpu{core}/topology/thread_siblings_list"));
        all.into_iter().filter(|other| *other != core).collect()
    });
    CpuFacts {
        allowed: allowed.map(|text| list(&text)).unwrap_or_default(),
        isolated: listed(format!("{folder}/isolated")),
        nohz_full: listed(format!("{folder}/nohz_full")),
        siblings: siblings.unwrap_or_default(),
        governors,
        deep_idle: cores
            .first()
            .map(|core| deep_idle(system, *core))
            .unwrap_or_default(),
        dma_latency_us: dma_latency(system),
        online,
    }
}

fn deep_idle(system: &SystemRoot, core: usize) -> Vec<(String, i64)> {
    let folder = format!("sys/devices/system/cpu/cpu{core}/cpuidle");
    let states = system
        .names(&folder)
        .into_iter()
        .filter(|name| name.starts_with("state"));
    states
        .filter_map(|state| {
            let number = |file: &str| system.number(&format!("{folder}/{state}/{file}"));
            let latency_us = number("latency")?;
            let used = number("disable").unwrap_or(0) == 0 && latency_us > LATENCY_SEEN_US;
            used.then(|| {
                let name = system.text(&format!("{folder}/{state}/name"));
                (name.unwrap_or(state), latency_us)
            })
        })
        .collect()
}

/// The file contains a 32-bit number in native byte order.
fn dma_latency(system: &SystemRoot) -> Option<i64> {
    let bytes = std::fs::read(system.path("dev/cpu_dma_latency")).ok()?;
    let bytes: [u8; 4] = bytes.get(..4)?.try_into().ok()?;
    Some(i64::from(i32::from_ne_bytes(bytes)))
}

/// Reads the counters.
#[must_use]
pub fn counters(system: &SystemRoot, core: Option<usize>) -> CpuCounters {
    CpuCounters {
        steal_ticks: steal(&system.text("proc/stat").unwrap_or_default(), core),
        interrupts: interrupts(&system.text("proc/interrupts").unwrap_or_default(), core),
        smi: smi(system, core.unwrap_or(0)),
    }
}

/// Returns the difference of two sets of counters.
#[must_use]
pub fn between(before: &CpuCounters, after: &CpuCounters) -> MachineActivity {
    let mut interrupts: Vec<(String, u64)> = after
        .interrupts
        .iter()
        .map(|(name, count)| {
            let earlier = before.interrupts.iter().find(|(other, _)| other == name);
            (
                name.clone(),
                count.saturating_sub(earlier.map_or(0, |row| row.1)),
            )
        })
        .filter(|(_, count)| *count > 0)
        .collect();
    interrupts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    MachineActivity {
        steal_ms: after.steal_ticks.saturating_sub(before.steal_ticks) * TICK_MS,
        interrupts,
        smi: after
            .smi
            .zip(before.smi)
            .map(|(after, before)| after.saturating_sub(before)),
    }
}

/// Reads the steal time, in ticks; proc(5): `cpuN user nice system idle iowait irq softirq steal …`.
fn steal(text: &str, core: Option<usize>) -> u64 {
    let name = core.map_or_else(|| "cpu".to_owned(), |core| format!("cpu{core}"));
    let line = text
        .lines()
        .find(|line| line.split_whitespace().next() == Some(&name));
    let ticks = line.and_then(|line| line.split_whitespace().nth(8)?.parse().ok());
    ticks.unwrap_or(0)
}

/// Reads the interrupts with a number, which belong to devices; named ones (clock, other cores) exist on every core.
fn interrupts(text: &str, core: Option<usize>) -> Vec<(String, u64)> {
    let mut lines = text.lines();
    let heads: Vec<&str> = lines
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .collect();
    let Some(core) = core else { return Vec::new() };
    let Some(column) = heads.iter().position(|head| *head == format!("CPU{core}")) else {
        return Vec::new();
    };
    lines
        .filter_map(|line| {
            let mut words = line.split_whitespace();
            let number: u32 = words.next()?.trim_end_matches(':').parse().ok()?;
            let count = words.clone().nth(column)?.parse().ok()?;
            let name = words.next_back()?;
            Some((format!("{number} {name}"), count))
        })
        .collect()
}

/// Reads MSR_SMI_COUNT of Intel processors.
fn smi(system: &SystemRoot, core: usize) -> Option<u64> {
    use std::os::unix::fs::FileExt;
    let file = std::fs::File::open(system.path(&format!("dev/cpu/{core}/msr"))).ok()?;
    let mut bytes = [0; 8];
    file.read_exact_at(&mut bytes, 0x34).ok()?;
    Some(u64::from_ne_bytes(bytes) & 0xffff_ffff)
}

#[cfg(test)]
mod tests {
    use super::super::system::tests::FixtureRoot;
    use super::*;

    #[test]
    fn power_saving_and_isolation_of_a_core_are_read() {
        let folder = "sys/devices/system/cpu";
        let path = |name: &str| format!("{folder}/{name}");
        let paths = [
            (path("online"), "0-3"),
            (path("isolated"), "3"),
            (path("nohz_full"), "(null)"),
            (path("cpu3/cpufreq/scaling_governor"), "powersave"),
            (path("cpu3/topology/thread_siblings_list"), "1,3"),
            (path("cpu3/cpuidle/state1/name"), "C1"),
            (path("cpu3/cpuidle/state1/latency"), "2"),
            (path("cpu3/cpuidle/state2/name"), "C6"),
            (path("cpu3/cpuidle/state2/latency"), "133"),
            (path("cpu3/cpuidle/state3/name"), "C8"),
            (path("cpu3/cpuidle/state3/latency"), "200"),
            (path("cpu3/cpuidle/state3/disable"), "1"),
        ];
        let files: Vec<(&str, &str)> = paths
            .iter()
            .map(|(path, text)| (path.as_str(), *text))
            .collect();
        let recorded = FixtureRoot::new(&files);
        let cpu = read(&recorded.system(), Some(3));
        assert_eq!(cpu.online, [0, 1, 2, 3]);
        assert_eq!((cpu.isolated, cpu.nohz_full), (vec![3], vec![]));
        assert_eq!(cpu.siblings, [1]);
        assert_eq!(cpu.governors, ["powersave"]);
        assert_eq!(cpu.deep_idle, [("C6".to_owned(), 133)]);
        assert_eq!(cpu.dma_latency_us, None);
    }

    #[test]
    fn activity_is_the_difference_of_the_counters() {
        let stat =
            |steal: u32| format!("cpu 1 1 1 1 1 1 1 99 0 0\ncpu1 1 2 3 4 5 6 7 {steal} 0 0\n");
        let table = |count: u32| {
            format!(
                "      CPU0   CPU1\n 24:  7  {count}  PCI-MSIX 0-edge  enp3s0-rx\nLOC:  9  {count}  Local\n"
            )
        };
        let at = |steal, count| CpuCounters {
            steal_ticks: super::steal(&stat(steal), Some(1)),
            interrupts: super::interrupts(&table(count), Some(1)),
            smi: None,
        };
        let during = between(&at(3, 100), &at(15, 142));
        assert_eq!(during.steal_ms, 120);
        assert_eq!(during.interrupts, [("24 enp3s0-rx".to_owned(), 42)]);
    }
}
