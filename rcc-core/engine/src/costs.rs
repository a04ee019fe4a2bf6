//! Cost of primitives on this machine: measured before the first cycle, stored in a file, and summed to the expected
//! duration of a net. Never run by the real-time thread.
//!
//! Each kernel is measured alone, with warm caches, in a long run: the expectation is the typical duration, not the
//! longest.

use std::fmt::Write as _;

use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::plan::{Delay, KernelRun, MonitorPoint, Plan};
use rcc_core::primitive::{CatalogueEntry, Kernel, Size, Sizes};
use rcc_core::primitives::{self, CATALOGUE, KERNELS_MAX};
use rcc_core::types::Store;
use rcc_os::clock::monotonic_ns;
use rcc_protocol::control::PlanData;

use crate::kernel_nets;
use crate::net::{Net, monitor_record};

pub mod cache;

/// Rounds per median.
const ROUNDS: usize = 5;
/// Approximate duration of a round, ns.
const ROUND_NS: u64 = 40_000;
/// Most evaluations per round.
const EVALUATIONS_MAX: u64 = 256;
const PERIOD_S: f64 = 1e-3;
/// Number of runs, delayed links or monitors in the nets with which these are measured.
const MANY: u32 = 64;

/// Cost of one primitive of a kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct KernelCost {
    ns: f64,
    /// Width of its values when it was measured; 0: it has no width.
    width: u32,
}

/// Cost of everything that a plan consists of, ns.
#[derive(Clone, Debug, PartialEq)]
pub struct Costs {
    /// A net with nothing but its `Termination`.
    net_ns: f64,
    /// One more run of equal primitives.
    run_ns: f64,
    /// One element of a delayed link.
    delay_ns: f64,
    /// One monitor that is due.
    monitor_ns: f64,
    /// By number of the kernel.
    kernels: Vec<KernelCost>,
}

/// Cost of the primitives of one type in a net.
#[derive(Clone, Debug, PartialEq)]
pub struct CostShare {
    /// Type of the primitive, or the name of another cost.
    pub name: &'static str,
    /// Number of primitives.
    pub count: u64,
    /// Cost of all of them together, ns.
    pub ns: f64,
}

impl Costs {
    /// Measures everything; takes about 10 to 200 ms.
    #[must_use]
    pub fn measure() -> Costs {
        let cost_bench = CostBench {
            models: kernel_nets::models(),
            devices: kernel_nets::devices(),
        };
        let plain = cost_bench.time(many(|_, _| ()));
        let runs = cost_bench.time(many(not));
        let delays = cost_bench.time(many(|data, number| {
            let (from, to) = (number, number + MANY);
            data.delays.push(Delay {
                store: Store::Bool,
                from,
                to,
                width: 1,
            });
        }));
        let mut costs = Costs {
            net_ns: plain,
            run_ns: 0.0,
            delay_ns: each(delays - plain),
            monitor_ns: cost_bench.monitor(),
            kernels: vec![KernelCost::default(); CATALOGUE.len() * KERNELS_MAX],
        };
        for row in kernel_nets::rows() {
            let count = kernel_nets::count(&row.entry.spec);
            let (Ok(full), Ok(empty)) = (kernel_nets::net(&row, count), kernel_nets::net(&row, 0))
            else {
                // A test proves that there is no such kernel; it would cost nothing.
                continue;
            };
            let width = full
                .plan()
                .runs
                .first()
                .and_then(|run| width(&full.plan(), run));
            let ns =
                (cost_bench.time_of(full) - cost_bench.time_of(empty)).max(0.0) / f64::from(count);
            if let Some(place) = costs.kernels.get_mut(usize::from(row.number)) {
                let width = width.unwrap_or(0);
                *place = KernelCost { ns, width };
            }
        }
        let not = primitives::find("Not").map_or(0, |(row, _)| primitives::kernel_number(row, 0));
        costs.run_ns = (each(runs - plain) - costs.kernel(not).ns).max(0.0);
        costs
    }

    fn kernel(&self, number: u16) -> KernelCost {
        self.kernels
            .get(usize::from(number))
            .copied()
            .unwrap_or_default()
    }

    /// Expected duration of one evaluation of a plan with all monitors due, ns; at least 1.
    #[must_use]
    pub fn expected_ns(&self, plan: &Plan<'_>) -> u64 {
        let sum: f64 = self.shares(plan).iter().map(|share| share.ns).sum();
        // The cast saturates; the sum of finite numbers is not NaN.
        (sum.ceil() as u64).max(1)
    }

    /// Expected cost of a plan by type of primitive, the most expensive first.
    #[must_use]
    pub fn shares(&self, plan: &Plan<'_>) -> Vec<CostShare> {
        let mut types = vec![(0_u64, 0.0_f64); CATALOGUE.len()];
        for run in plan.runs {
            let Some((count, ns)) = self.of_run(plan, run) else {
                continue;
            };
            if let Some(sum) = types.get_mut(usize::from(run.kernel) / KERNELS_MAX) {
                *sum = (sum.0 + count, sum.1 + ns);
            }
        }
        let copied: u64 = plan.delays.iter().map(|delay| u64::from(delay.width)).sum();
        let monitors = plan.monitors.len() as u64;
        let others = [
            ("(net)", 1, self.net_ns),
            ("(delayed links)", copied, copied as f64 * self.delay_ns),
            ("Monitor", monitors, monitors as f64 * self.monitor_ns),
        ];
        let types = CATALOGUE.iter().zip(types);
        let mut shares: Vec<CostShare> = types
            .map(|(entry, (count, ns))| (entry.spec.name, count, ns))
            .chain(others)
            .filter(|(_, count, _)| *count > 0)
            .map(|(name, count, ns)| CostShare { name, count, ns })
            .collect();
        shares.sort_by(|a, b| b.ns.total_cmp(&a.ns));
        shares
    }

    /// Number of primitives in a run, and their cost, ns.
    fn of_run(&self, plan: &Plan<'_>, run: &KernelRun) -> Option<(u64, f64)> {
        let each = self.of_primitives(plan, run)?;
        Some((each.len() as u64, self.run_ns + each.iter().sum::<f64>()))
    }

    /// Cost of each primitive of a run, in order, ns; without the cost of the run itself. `None` if the plan is not
    /// valid.
    #[must_use]
    pub fn of_primitives(&self, plan: &Plan<'_>, run: &KernelRun) -> Option<Vec<f64>> {
        let (entry, kernel) = primitives::kernel(run.kernel)?;
        let group = entry.spec.operands(kernel).count().max(1);
        let operands = plan.operands_of(run)?.chunks_exact(group);
        let cost = self.kernel(run.kernel);
        // A part of the cost does not depend on the sizes.
        let scale = |size: u32| (f64::from(size) / f64::from(cost.width)).max(0.25);
        let each = operands.map(|operands| match size_of(entry, kernel, operands) {
            Some(size) if cost.width > 0 => cost.ns * scale(size),
            _ => cost.ns,
        });
        Some(each.collect())
    }

    /// Cost of one primitive of each kernel (ns), with the kernel's name.
    pub fn kernels(&self) -> impl Iterator<Item = (String, f64)> + '_ {
        kernel_nets::rows().map(|row| (row.name(), self.kernel(row.number).ns))
    }

    /// Serializes to text, one line each: `net 12.5`, `kernel NUMBER WIDTH NS`.
    fn text(&self) -> String {
        let mut text = String::new();
        let (net, run, delay, monitor) = (self.net_ns, self.run_ns, self.delay_ns, self.monitor_ns);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "net {net}\nrun {run}\ndelay {delay}\nmonitor {monitor}"
        );
        for (number, kernel) in self.kernels.iter().enumerate() {
            let _ = writeln!(text, "kernel {number} {} {}", kernel.width, kernel.ns);
        }
        text
    }

    /// Parses [`Costs::text`]; `None` if it is incomplete or has an invalid value.
    fn parse(text: &str) -> Option<Costs> {
        let mut lines = text.lines();
        let mut cost = |name: &str| {
            let value = lines.next()?.strip_prefix(name)?.strip_prefix(' ')?;
            nanoseconds(value)
        };
        let (net_ns, run_ns) = (cost("net")?, cost("run")?);
        let (delay_ns, monitor_ns) = (cost("delay")?, cost("monitor")?);
        let mut kernels = Vec::new();
        for line in lines {
            let mut words = line.strip_prefix("kernel ")?.split(' ');
            let number: usize = words.next()?.parse().ok()?;
            let width = words.next()?.parse().ok()?;
            let ns = nanoseconds(words.next()?)?;
            if number != kernels.len() {
                return None;
            }
            kernels.push(KernelCost { ns, width });
        }
        (kernels.len() == CATALOGUE.len() * KERNELS_MAX).then_some(Costs {
            net_ns,
            run_ns,
            delay_ns,
            monitor_ns,
            kernels,
        })
    }
}

/// Parses a duration; `None` if it is negative or longer than a second.
fn nanoseconds(text: &str) -> Option<f64> {
    let value = text.parse().ok()?;
    (0.0..=1e9).contains(&value).then_some(value)
}

fn each(many_ns: f64) -> f64 {
    (many_ns / f64::from(MANY)).max(0.0)
}

/// Width of the first primitive of a run, if its kernel has a size.
fn width(plan: &Plan<'_>, run: &KernelRun) -> Option<u32> {
    let (entry, kernel) = primitives::kernel(run.kernel)?;
    let group = entry.spec.operands(kernel).count();
    size_of(entry, kernel, plan.operands_of(run)?.get(..group)?)
}

/// The size that the duration of a primitive grows with, if its kernel has one.
fn size_of(entry: &CatalogueEntry, kernel: &Kernel, group: &[u32]) -> Option<u32> {
    let sizes = entry.spec.sizes(kernel);
    let work = Sizes::read(&sizes, group).work();
    let sized = sizes.iter().any(|size| size != Size::Cycles);
    sized.then(|| u32::try_from(work).unwrap_or(u32::MAX))
}

/// A net of a `Termination` that never ends it, and of what `add` adds [`MANY`] times.
fn many(add: impl Fn(&mut PlanData, u32)) -> PlanData {
    let mut data = PlanData {
        catalogue: primitives::fingerprint(),
        bools: vec![0; 2 * MANY as usize],
        ..PlanData::default()
    };
    (0..MANY).for_each(|number| add(&mut data, number));
    let termination = primitives::find("Termination").map_or(0, |(row, _)| row);
    data.runs.push(KernelRun {
        kernel: primitives::kernel_number(termination, 0),
        first: data.operands.len() as u32,
        operands: 1,
    });
    data.operands.push(0);
    data
}

/// A run of one `Not` that does not make the first slot true.
fn not(data: &mut PlanData, number: u32) {
    let row = primitives::find("Not").map_or(0, |(row, _)| row);
    data.runs.push(KernelRun {
        kernel: primitives::kernel_number(row, 0),
        first: data.operands.len() as u32,
        operands: 2,
    });
    data.operands.extend([number, number + MANY]);
}

/// Devices for measuring nets.
struct CostBench {
    models: Vec<DeviceModel>,
    devices: Vec<DeviceInput>,
}

impl CostBench {
    /// Duration of one evaluation, ns; 0 if the plan is not valid (a test proves that it is).
    fn time(&self, data: PlanData) -> f64 {
        let holds = vec![None; self.models.len()];
        Net::build(data, &self.models, 0, &holds, PERIOD_S).map_or(0.0, |net| self.time_of(net))
    }

    fn time_of(&self, mut net: Box<Net>) -> f64 {
        median(|| {
            net.evaluate(&self.models, &self.devices, PERIOD_S);
        })
    }

    /// Cost of one monitor: making a record and pushing it into a ring, ns.
    fn monitor(&self) -> f64 {
        let data = many(|data, number| {
            data.monitors.push(MonitorPoint {
                store: Store::Bool,
                slot: number,
                width: 1,
                every: 1,
            });
        });
        let holds = vec![None; self.models.len()];
        let Ok(net) = Net::build(data, &self.models, 0, &holds, PERIOD_S) else {
            return 0.0;
        };
        let (mut records, mut taken) = rtrb::RingBuffer::new(2 * MANY as usize);
        let all_ns = median(|| {
            net.monitors(|monitor, values| {
                // There is room: the ring is emptied each time.
                let _ = records.push(monitor_record(1, 1, 1, monitor, values));
            });
            while taken.pop().is_ok() {}
        });
        each(all_ns)
    }
}

/// The median over some rounds of the duration of `work`, ns.
fn median(mut work: impl FnMut()) -> f64 {
    // The first call warms the caches, the second determines how often a round repeats it.
    work();
    let begun_ns = monotonic_ns();
    work();
    let once_ns = (monotonic_ns() - begun_ns).max(1);
    let count = (ROUND_NS / once_ns).clamp(1, EVALUATIONS_MAX);
    let mut rounds = [0.0; ROUNDS];
    for round in &mut rounds {
        let begun_ns = monotonic_ns();
        (0..count).for_each(|_| work());
        *round = (monotonic_ns() - begun_ns) as f64 / count as f64;
    }
    rounds.sort_by(f64::total_cmp);
    rounds[ROUNDS / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn costs() -> Costs {
        let mut costs = Costs {
            net_ns: 100.0,
            run_ns: 10.0,
            delay_ns: 2.0,
            monitor_ns: 30.0,
            kernels: vec![KernelCost::default(); CATALOGUE.len() * KERNELS_MAX],
        };
        let (not, _) = primitives::find("Not").unwrap();
        costs.kernels[usize::from(primitives::kernel_number(not, 0))].ns = 1.5;
        costs
    }

    #[test]
    fn a_net_is_expected_to_need_the_sum_of_its_parts() {
        let mut data = many(not);
        data.delays.push(Delay {
            store: Store::Bool,
            from: 0,
            to: 1,
            width: 3,
        });
        data.monitors.push(MonitorPoint {
            store: Store::Bool,
            slot: 0,
            width: 1,
            every: 1,
        });
        // 64 runs of one `Not`, a run of `Termination`, the net, three elements of delayed links, one monitor.
        let wanted = 64.0 * 11.5 + 10.0 + 100.0 + 6.0 + 30.0;
        assert_eq!(costs().expected_ns(&data.plan()), wanted as u64);
        let shares = costs().shares(&data.plan());
        assert_eq!((shares[0].name, shares[0].count), ("Not", 64));
        assert!(shares.windows(2).all(|pair| pair[0].ns >= pair[1].ns));
    }

    #[test]
    fn what_is_measured_is_a_time_of_every_kernel_and_can_be_read_back() {
        let measured = Costs::measure();
        assert!(measured.net_ns > 0.0);
        for row in kernel_nets::rows() {
            let cost = measured.kernel(row.number);
            assert!(cost.ns.is_finite() && cost.ns >= 0.0, "{}", row.name());
        }
        let arm = primitives::find("InverseKinematics").unwrap().0;
        let arm = measured.kernel(primitives::kernel_number(arm, 0));
        assert!(arm.ns > 0.0 && arm.width == 7);
        assert_eq!(Costs::parse(&measured.text()), Some(measured));
    }

    #[test]
    fn half_a_text_is_no_costs() {
        let text = costs().text();
        let half = &text[..text.len() / 2];
        let negative = text.replacen("net 100", "net -1", 1);
        for bad in [
            half,
            "",
            "net x",
            &negative,
            &text.replacen("net 100", "net NaN", 1),
        ] {
            assert_eq!(Costs::parse(bad), None);
        }
    }
}
