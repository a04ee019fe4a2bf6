//! Word format of plans, their start conditions and device models in incident files: written by the executor's helper
//! thread, read by replay. A reader never allocates more than the length of the file.

use std::sync::Arc;

use rcc_core::frame::DeviceModel;
use rcc_core::guard::JointLimits;
use rcc_core::impedance::ImpedanceLimits;
use rcc_core::kinematics::{Arm, PARAMETERS};
use rcc_core::message::{DEVICES_MAX, JOINTS_MAX};
use rcc_core::plan::{
    Delay, InputPoint, KernelRun, MonitorPoint, NullRange, PlanRegion, PublishPoint, Rate, RunBlock,
};
use rcc_core::pose::Pose;
use rcc_core::topic::Topic;
use rcc_core::types::Store;
use rcc_core::workspace::Workspace;
use rcc_protocol::control::PlanData;

use crate::hash::packed;
use crate::net::{NetOrigin, StartConditions};

/// A part that is truncated or has invalid content.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the file is damaged or from another build: cannot read {0}")]
pub struct DamagedFile(pub &'static str);

/// Reads words from front to back.
#[derive(Clone, Copy, Debug)]
pub struct WordReader<'a>(pub &'a [u64]);

impl<'a> WordReader<'a> {
    /// The next `count` words.
    pub fn take(&mut self, count: usize, what: &'static str) -> Result<&'a [u64], DamagedFile> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(DamagedFile(what))?;
        self.0 = rest;
        Ok(taken)
    }

    /// The next `N` words.
    pub fn some<const N: usize>(&mut self, what: &'static str) -> Result<[u64; N], DamagedFile> {
        let taken = self.take(N, what)?;
        taken.try_into().map_err(|_| DamagedFile(what))
    }

    /// The next word as a length.
    pub fn count(&mut self, what: &'static str) -> Result<usize, DamagedFile> {
        let [count] = self.some(what)?;
        usize::try_from(count).map_err(|_| DamagedFile(what))
    }

    /// A list: the number of words, then the words.
    pub fn list(&mut self, what: &'static str) -> Result<&'a [u64], DamagedFile> {
        let count = self.count(what)?;
        self.take(count, what)
    }
}

fn list(out: &mut Vec<u64>, words: impl ExactSizeIterator<Item = u64>) {
    out.push(words.len() as u64);
    out.extend(words);
}

fn pair(low: u32, high: u32) -> u64 {
    u64::from(low) | u64::from(high) << 32
}

fn parts(word: u64) -> [u32; 2] {
    [word as u32, (word >> 32) as u32]
}

/// Serializes the origin of a net.
pub fn of_origin(origin: &NetOrigin) -> Vec<u64> {
    let PlanData {
        catalogue,
        configuration,
        reals,
        bools,
        ints,
        runs,
        operands,
        blocks,
        regions,
        blanks,
        delays,
        monitors,
        inputs,
        publishes,
        clocks,
        survives_device_loss,
        rate,
    } = &*origin.data;
    let mut out = vec![
        *catalogue,
        *configuration,
        pair(*clocks, u32::from(*survives_device_loss)),
        pair(rate.every, rate.phase),
    ];
    list(&mut out, reals.iter().map(|value| value.to_bits()));
    out.push(bools.len() as u64);
    out.extend(bools.chunks(8).map(packed));
    list(&mut out, ints.iter().map(|value| value.cast_unsigned()));
    out.push(runs.len() as u64);
    for run in runs {
        out.push(pair(u32::from(run.kernel), run.first));
        out.push(u64::from(run.operands));
    }
    list(&mut out, operands.iter().map(|value| u64::from(*value)));
    list(
        &mut out,
        blocks.iter().map(|block| pair(block.region, block.runs)),
    );
    out.push(regions.len() as u64);
    for region in regions {
        out.push(pair(region.condition, region.within));
        out.push(pair(region.active, region.blanks));
    }
    out.push(blanks.len() as u64);
    for blank in blanks {
        out.push(pair(blank.store as u32, blank.slot));
        out.push(u64::from(blank.width));
    }
    out.push(delays.len() as u64);
    for delay in delays {
        out.push(pair(delay.store as u32, delay.from));
        out.push(pair(delay.to, delay.width));
    }
    out.push(monitors.len() as u64);
    for monitor in monitors {
        out.push(pair(monitor.store as u32, monitor.slot));
        out.push(pair(monitor.width, monitor.every));
    }
    out.push(inputs.len() as u64);
    for input in inputs {
        let none = u32::MAX;
        out.push(pair(input.store as u32, input.slot));
        out.push(pair(input.width, input.expires));
        out.push(pair(input.since, input.age));
        out.push(pair(
            input.at_least.unwrap_or(none),
            input.at_most.unwrap_or(none),
        ));
        // A topic's key is never 0.
        let topic = input.topic.map_or([0, 0], |topic| [topic.key, topic.kind]);
        out.extend(topic);
    }
    out.push(publishes.len() as u64);
    for point in publishes {
        out.push(pair(point.store as u32, point.slot));
        out.push(u64::from(point.width));
        out.extend([point.topic.key, point.topic.kind]);
    }
    let StartConditions {
        holds,
        dt_s,
        prepared_again,
    } = &origin.start_conditions;
    out.extend([u64::from(*prepared_again), dt_s.to_bits()]);
    out.push(holds.len() as u64);
    for hold in holds.iter() {
        // NaN in the first joint: not known.
        let hold = hold.unwrap_or([f64::NAN; JOINTS_MAX]);
        out.extend(hold.map(f64::to_bits));
    }
    out
}

fn store(number: u32) -> Result<Store, DamagedFile> {
    let all = [Store::Real, Store::Bool, Store::Int];
    let found = all.into_iter().find(|store| *store as u32 == number);
    found.ok_or(DamagedFile("the kind of a slot"))
}

/// A list of pairs of words: the number of pairs, then the pairs.
fn pairs<'a>(
    words: &mut WordReader<'a>,
    what: &'static str,
) -> Result<&'a [[u64; 2]], DamagedFile> {
    groups(words, what)
}

/// A list of groups of words: the number of groups, then the groups.
fn groups<'a, const N: usize>(
    words: &mut WordReader<'a>,
    what: &'static str,
) -> Result<&'a [[u64; N]], DamagedFile> {
    let count = words.count(what)?;
    let taken = words.take(count.checked_mul(N).ok_or(DamagedFile(what))?, what)?;
    Ok(taken.as_chunks().0)
}

/// The inputs of a plan.
fn inputs(words: &mut WordReader<'_>) -> Result<Vec<InputPoint>, DamagedFile> {
    let bound = |slot: u32| (slot != u32::MAX).then_some(slot);
    let groups = groups(words, "a plan's inputs")?.iter();
    let input = |[place, size, since, bounds, key, kind]: &[u64; 6]| {
        let ([number, slot], [width, expires]) = (parts(*place), parts(*size));
        let ([since, age], [at_least, at_most]) = (parts(*since), parts(*bounds));
        Ok(InputPoint {
            store: store(number)?,
            slot,
            width,
            since,
            age,
            expires,
            at_least: bound(at_least),
            at_most: bound(at_most),
            topic: (*key != 0).then_some(Topic {
                key: *key,
                kind: *kind,
            }),
        })
    };
    groups.map(input).collect()
}

/// The published values of a plan.
fn publishes(words: &mut WordReader<'_>) -> Result<Vec<PublishPoint>, DamagedFile> {
    let groups = groups(words, "what a plan publishes")?.iter();
    let point = |[place, width, key, kind]: &[u64; 4]| {
        let ([number, slot], [width, _]) = (parts(*place), parts(*width));
        Ok(PublishPoint {
            topic: Topic {
                key: *key,
                kind: *kind,
            },
            store: store(number)?,
            slot,
            width,
        })
    };
    groups.map(point).collect()
}

/// Parses [`of_origin`]; the plan itself is checked by `Plan::check`.
pub fn origin(words: &mut WordReader<'_>) -> Result<NetOrigin, DamagedFile> {
    let [catalogue, configuration, numbers, rate] = words.some("a plan")?;
    let ([clocks, survives], [every, phase]) = (parts(numbers), parts(rate));
    let reals = words.list("a plan's reals")?;
    let bools = words.count("a plan's bools")?;
    let packed = words.take(bools.div_ceil(8), "a plan's bools")?;
    let bools = packed
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .take(bools);
    let ints = words.list("a plan's ints")?;
    let runs = pairs(words, "a plan's runs")?.iter().map(|[first, count]| {
        let [kernel, first] = parts(*first);
        Ok(KernelRun {
            kernel: u16::try_from(kernel).map_err(|_| DamagedFile("a kernel's number"))?,
            first,
            operands: parts(*count)[0],
        })
    });
    let runs = runs.collect::<Result<_, _>>()?;
    let operands = words.list("a plan's operands")?;
    let blocks = words.list("a plan's blocks")?.iter().map(|word| {
        let [region, runs] = parts(*word);
        RunBlock { region, runs }
    });
    let blocks = blocks.collect();
    let regions = pairs(words, "a plan's regions")?.iter();
    let regions = regions.map(|[first, second]| {
        let ([condition, within], [active, blanks]) = (parts(*first), parts(*second));
        PlanRegion {
            condition,
            within,
            active,
            blanks,
        }
    });
    let regions = regions.collect();
    let blanks = pairs(words, "a plan's blanks")?
        .iter()
        .map(|[place, width]| {
            let ([number, slot], [width, _]) = (parts(*place), parts(*width));
            Ok(NullRange {
                store: store(number)?,
                slot,
                width,
            })
        });
    let blanks = blanks.collect::<Result<_, _>>()?;
    let delays = pairs(words, "a plan's delays")?.iter().map(|[from, to]| {
        let ([number, from], [to, width]) = (parts(*from), parts(*to));
        let store = store(number)?;
        Ok(Delay {
            store,
            from,
            to,
            width,
        })
    });
    let delays = delays.collect::<Result<_, _>>()?;
    let monitors = pairs(words, "a plan's monitors")?.iter();
    let monitors = monitors.map(|[place, rest]| {
        let ([number, slot], [width, every]) = (parts(*place), parts(*rest));
        let store = store(number)?;
        Ok(MonitorPoint {
            store,
            slot,
            width,
            every,
        })
    });
    let monitors = monitors.collect::<Result<_, _>>()?;
    let inputs = inputs(words)?;
    let publishes = publishes(words)?;
    let [prepared_again, dt_s] = words.some("a net's period")?;
    let holds = groups::<JOINTS_MAX>(words, "a net's hold set-points")?.iter();
    let holds = holds.map(|hold| Some(hold.map(f64::from_bits)).filter(|hold| !hold[0].is_nan()));
    let data = PlanData {
        catalogue,
        configuration,
        reals: reals.iter().map(|word| f64::from_bits(*word)).collect(),
        bools: bools.collect(),
        ints: ints.iter().map(|word| word.cast_signed()).collect(),
        runs,
        operands: operands.iter().map(|word| *word as u32).collect(),
        blocks,
        regions,
        blanks,
        delays,
        monitors,
        inputs,
        publishes,
        clocks,
        survives_device_loss: survives != 0,
        rate: Rate { every, phase },
    };
    Ok(NetOrigin {
        data: Arc::new(data),
        start_conditions: StartConditions {
            holds: holds.collect(),
            dt_s: f64::from_bits(dt_s),
            prepared_again: prepared_again as u8,
        },
    })
}

const LIMITS: usize = 5 * JOINTS_MAX + 1;

/// Serializes the devices of a cell.
pub fn of_models(models: &[DeviceModel]) -> Vec<u64> {
    let mut out = vec![models.len() as u64];
    for model in models {
        let arm = model.arm.map(|arm| arm.parameters());
        let kind = arm.map_or(0, |(kind, _)| kind);
        out.push(pair(model.joints, kind));
        if let Some((kind, parameters)) = arm {
            let used = parameters.iter().take(Arm::parameter_count(kind));
            out.extend(used.map(|value| value.to_bits()));
        }
        let JointLimits {
            lower,
            upper,
            velocity_max,
            acceleration_max,
            jerk_max,
            joints,
        } = &model.limits;
        let groups = [lower, upper, velocity_max, acceleration_max, jerk_max];
        out.extend(groups.into_iter().flatten().map(|value| value.to_bits()));
        out.push(*joints as u64);
        out.push(model.first_tolerance_rad.to_bits());
        out.extend(model.channels.map(u64::from));
        out.extend(model.base.to_slots().map(f64::to_bits));
        // Without a workspace: one without bounds.
        let space = model.workspace.unwrap_or(Workspace::ANYWHERE);
        out.push(u64::from(model.workspace.is_some()));
        let groups = [space.lower, space.upper, space.point];
        out.extend(groups.into_iter().flatten().map(f64::to_bits));
        out.push(space.singularity_min.to_bits());
        out.push(u64::from(model.impedance.is_some()));
        if let Some(limits) = &model.impedance {
            out.extend(limits.to_slots().map(f64::to_bits));
        }
    }
    out
}

/// Parses [`of_models`].
pub fn models(words: &mut WordReader<'_>) -> Result<Vec<DeviceModel>, DamagedFile> {
    let count = words.count("the devices")?;
    if count > DEVICES_MAX {
        return Err(DamagedFile("the number of devices"));
    }
    (0..count).map(|_| model(words)).collect()
}

fn model(words: &mut WordReader<'_>) -> Result<DeviceModel, DamagedFile> {
    let [head] = words.some("a device")?;
    let [joints, kind] = parts(head);
    let arm = match kind {
        0 => None,
        _ => {
            let mut parameters = [0.0; PARAMETERS];
            for place in parameters.iter_mut().take(Arm::parameter_count(kind)) {
                let [word] = words.some("an arm")?;
                *place = f64::from_bits(word);
            }
            let arm = Arm::from_parameters(kind, &parameters);
            Some(arm.ok_or(DamagedFile("the kind of an arm"))?)
        }
    };
    let limits = words.some::<LIMITS>("joint limits")?;
    let group = |index: usize| {
        let mut group = [0.0; JOINTS_MAX];
        for (place, word) in group.iter_mut().zip(limits.iter().skip(index * JOINTS_MAX)) {
            *place = f64::from_bits(*word);
        }
        group
    };
    let number = usize::try_from(limits[LIMITS - 1]).unwrap_or(usize::MAX);
    if joints as usize > JOINTS_MAX || number > JOINTS_MAX {
        return Err(DamagedFile("the number of joints"));
    }
    let [tolerance, channels @ ..] = words.some::<5>("a device's channels")?;
    let base = Pose::from_slots(words.some::<7>("a base")?.map(f64::from_bits));
    let [has_space] = words.some("a workspace")?;
    let mut corner = || Ok(words.some::<3>("a workspace")?.map(f64::from_bits));
    let space = Workspace {
        lower: corner()?,
        upper: corner()?,
        point: corner()?,
        singularity_min: f64::from_bits(words.some::<1>("a workspace")?[0]),
    };
    let [has_impedance] = words.some("impedance limits")?;
    let impedance = match has_impedance {
        0 => None,
        _ => {
            let slots = words.some::<{ ImpedanceLimits::SLOTS }>("impedance limits")?;
            Some(ImpedanceLimits::from_slots(slots.map(f64::from_bits)))
        }
    };
    Ok(DeviceModel {
        joints,
        arm,
        limits: JointLimits {
            lower: group(0),
            upper: group(1),
            velocity_max: group(2),
            acceleration_max: group(3),
            jerk_max: group(4),
            joints: number,
        },
        first_tolerance_rad: f64::from_bits(tolerance),
        base,
        workspace: (has_space != 0).then_some(space),
        channels: channels.map(|count| count as u32),
        impedance,
    })
}
