//! A plan: a net lowered to numbers. The loader checks it before sending it, and the executor checks it again before
//! accepting it; the cycle relies on nothing else.

mod regions;

use serde::{Deserialize, Serialize};

use crate::frame::DeviceModel;
use crate::joints::JOINTS_MAX;
use crate::message::{ANALOG_MAX, DEVICES_MAX, DIGITAL_MAX, MONITOR_WIDTH_MAX};
use crate::primitive::{
    CYCLES_MAX, ChannelKind, Kernel, Operand, Role, Size, SizeList, Sizes, Spec,
};
use crate::primitives;
use crate::topic::Topic;
use crate::types::Store;

pub use regions::{NO_REGION, NullRange, PlanRegion, REGIONS_MAX, RunBlock};

/// Maximum number of slots in one arena of a net.
pub const SLOTS_MAX: usize = 1 << 20;
/// Maximum number of operands of a net.
pub const OPERANDS_MAX: usize = 1 << 20;
/// Maximum number of elements that a net reads and writes in one cycle, delayed links included. Without it, a net
/// within all other limits could still take hours per cycle.
pub const WORK_MAX: u64 = 1 << 24;
/// Maximum number of path clocks of a net.
pub const CLOCKS_MAX: u32 = 64;
/// Maximum number of monitors of a net.
pub const MONITORS_MAX: usize = 256;
/// Maximum number of a net's inputs that are set from outside.
pub const INPUTS_MAX: usize = 256;
/// Maximum number of elements of these inputs together.
pub const INPUT_ELEMENTS_MAX: u32 = 4096;
/// Maximum number of topics that a net publishes, and that it subscribes to.
pub const TOPICS_MAX: usize = 32;
/// Maximum number of named outcomes of a net.
pub const OUTCOMES_MAX: u32 = 32;
/// Maximum number of cycles from one evaluation of a net to the next: one second at the shortest period.
pub const EVERY_MAX: u32 = 10_000;

/// The executor cycles in which a net is evaluated: those with `cycle % every == phase`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rate {
    /// Cycles from one evaluation to the next, 1 to [`EVERY_MAX`]; 1 for a net that commands joints.
    pub every: u32,
    /// Less than `every`.
    pub phase: u32,
}

impl Rate {
    /// Evaluated in every cycle.
    pub const EVERY_CYCLE: Rate = Rate { every: 1, phase: 0 };

    /// Returns true if a net with this rate is evaluated in executor cycle `cycle`.
    pub fn is_due(&self, cycle: u64) -> bool {
        let rest = cycle.checked_rem(u64::from(self.every)).unwrap_or(0);
        self.every <= 1 || rest == u64::from(self.phase)
    }

    fn is_good(&self) -> bool {
        (1..=EVERY_MAX).contains(&self.every) && self.phase < self.every
    }
}

impl Default for Rate {
    fn default() -> Rate {
        Rate::EVERY_CYCLE
    }
}

/// Consecutive primitives that share one kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KernelRun {
    /// Number of the kernel, see [`primitives::kernel`].
    pub kernel: u16,
    /// First operand.
    pub first: u32,
    /// Number of operands, a whole number of groups.
    pub operands: u32,
}

/// A delayed link: after the cycle, `from` is copied to `to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Delay {
    /// Arena.
    pub store: Store,
    /// Slot of the source.
    pub from: u32,
    /// Slot that the sink reads.
    pub to: u32,
    /// Number of elements.
    pub width: u32,
}

/// A value that is copied out after the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MonitorPoint {
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
    /// Number of cycles between two copies, at least 1.
    pub every: u32,
}

/// A published value: other nets can read it after the cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PublishPoint {
    /// The topic: its name and type.
    pub topic: Topic,
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
}

/// A value that is set from outside between two evaluations of the net: through the control interface, or by another
/// net.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputPoint {
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
    /// `Int` slot: evaluations since the value was set, 0 in the first evaluation that sees it; null if it was never
    /// set.
    pub since: u32,
    /// `Real` slot: the same as a time, s.
    pub age: u32,
    /// The value becomes null when it was set more than this many evaluations ago; 0 = never.
    pub expires: u32,
    /// First slot of the lower bounds of its elements, in the same arena.
    pub at_least: Option<u32>,
    /// First slot of the upper bounds of its elements, in the same arena.
    pub at_most: Option<u32>,
    /// The value is set only by the net that publishes this topic.
    pub topic: Option<Topic>,
}

/// Values in an arena, for display.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ValuePoint {
    /// Arena.
    pub store: Store,
    /// First slot.
    pub slot: u32,
    /// Number of elements.
    pub width: u32,
}

/// A net lowered to numbers; borrows its arrays from their owner.
#[derive(Clone, Copy, Debug)]
pub struct Plan<'a> {
    /// Fingerprint of the catalogue that the kernel numbers refer to.
    pub catalogue: u64,
    /// Fingerprint of the device table that the device indices refer to.
    pub configuration: u64,
    /// Initial arena of `Real`: constants, states, and null elsewhere.
    pub reals: &'a [f64],
    /// Initial arena of `Bool`.
    pub bools: &'a [u8],
    /// Initial arena of `Int`.
    pub ints: &'a [i64],
    /// Kernel runs, in evaluation order.
    pub runs: &'a [KernelRun],
    /// Operands of all runs.
    pub operands: &'a [u32],
    /// The division of the runs among regions; empty: all runs are always evaluated.
    pub blocks: &'a [RunBlock],
    /// Conditionally evaluated regions; an enclosing region comes before the regions inside it.
    pub regions: &'a [PlanRegion],
    /// Values that become null when a region is deactivated, in the order of the regions.
    pub blanks: &'a [NullRange],
    /// Delayed links.
    pub delays: &'a [Delay],
    /// Monitors.
    pub monitors: &'a [MonitorPoint],
    /// Values that are set from outside.
    pub inputs: &'a [InputPoint],
    /// Published values, by ascending topic key.
    pub publishes: &'a [PublishPoint],
    /// Number of path clocks.
    pub clocks: u32,
    /// The cycles in which the net is evaluated.
    pub rate: Rate,
    /// The net continues, with null, when a device that it commands is lost.
    pub survives_device_loss: bool,
}

/// The unique resources that a net claims.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resources {
    /// Bit d: the arm of device d.
    pub arms: u64,
    /// By device, bit c: digital output c.
    pub digital: [u64; DEVICES_MAX],
    /// By device, bit c: analog output c.
    pub analog: [u64; DEVICES_MAX],
    /// Keys of the published topics, ascending; 0 marks unused elements at the end.
    pub topics: [u64; TOPICS_MAX],
}

/// One unique resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Resource {
    /// The joints of a device.
    Arm {
        /// Device index.
        device: u32,
    },
    /// A digital output.
    Digital {
        /// Device index.
        device: u32,
        /// Channel index.
        channel: u32,
    },
    /// An analog output.
    Analog {
        /// Device index.
        device: u32,
        /// Channel index.
        channel: u32,
    },
    /// The right to publish a topic.
    Topic {
        /// [`Topic::key`].
        key: u64,
    },
}

impl Resources {
    /// No resources.
    pub const NONE: Resources = Resources {
        arms: 0,
        digital: [0; DEVICES_MAX],
        analog: [0; DEVICES_MAX],
        topics: [0; TOPICS_MAX],
    };

    /// Returns the first resource that both claim.
    pub fn common(&self, other: &Resources) -> Option<Resource> {
        let arms = self.arms & other.arms;
        if arms != 0 {
            return Some(Resource::Arm {
                device: arms.trailing_zeros(),
            });
        }
        let both = |mine: &[u64; DEVICES_MAX], theirs: &[u64; DEVICES_MAX]| {
            let pairs = mine.iter().zip(theirs).map(|(a, b)| a & b);
            pairs
                .zip(0u32..)
                .find(|(bits, _)| *bits != 0)
                .map(|(bits, device)| (device, bits.trailing_zeros()))
        };
        if let Some((device, channel)) = both(&self.digital, &other.digital) {
            return Some(Resource::Digital { device, channel });
        }
        if let Some((device, channel)) = both(&self.analog, &other.analog) {
            return Some(Resource::Analog { device, channel });
        }
        let mut topics = self.topics().iter();
        let key = topics.find(|key| other.publishes(**key))?;
        Some(Resource::Topic { key: *key })
    }

    /// Returns the keys of the published topics, ascending.
    fn topics(&self) -> &[u64] {
        let count = self.topics.partition_point(|key| *key != 0);
        self.topics.get(..count).unwrap_or(&[])
    }

    fn publishes(&self, key: u64) -> bool {
        self.topics().binary_search(&key).is_ok()
    }

    /// Returns true if any resource of the device is claimed.
    pub fn uses(&self, device: usize) -> bool {
        let channels =
            |table: &[u64; DEVICES_MAX]| table.get(device).is_some_and(|bits| *bits != 0);
        self.arms >> device & 1 == 1 || channels(&self.digital) || channels(&self.analog)
    }

    /// Claims a resource; returns false if it was claimed already.
    fn claim(&mut self, resource: Resource) -> bool {
        let (bits, bit) = match resource {
            Resource::Arm { device } => (Some(&mut self.arms), device),
            Resource::Digital { device, channel } => {
                (self.digital.get_mut(device as usize), channel)
            }
            Resource::Analog { device, channel } => (self.analog.get_mut(device as usize), channel),
            Resource::Topic { key } => return self.claim_topic(key),
        };
        match bits {
            Some(bits) if *bits >> bit & 1 == 0 => {
                *bits |= 1 << bit;
                true
            }
            _ => false,
        }
    }

    /// Claims a topic; keys must arrive in ascending order.
    fn claim_topic(&mut self, key: u64) -> bool {
        if self.publishes(key) {
            return false;
        }
        let free = self.topics.iter_mut().find(|place| **place == 0);
        free.map(|place| *place = key).is_some()
    }
}

/// Properties of a plan that passed the check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CheckedPlan {
    /// Resources that it claims.
    pub resources: Resources,
    /// The plan has a `Cancel` primitive.
    pub can_cancel: bool,
    /// Number of primitives with a kernel.
    pub primitives: u32,
    /// Elements that its primitives read and write in one cycle.
    pub work: u64,
}

/// Reason for refusing a plan. Numbers are indices into the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PlanError {
    /// The plan was made for another catalogue: loader and executor are different builds.
    OtherCatalogue,
    /// The plan was made for another device configuration.
    OtherConfiguration,
    /// An array is larger than allowed.
    TooLarge,
    /// No kernel has this number.
    UnknownKernel {
        /// Index of the run.
        run: u32,
    },
    /// The operands of a run are outside the operand array, or are not a whole number of groups.
    BadRun {
        /// Index of the run.
        run: u32,
    },
    /// An operand points outside its arena, or refers to a device, channel or clock that does not exist.
    BadOperand {
        /// Index of the operand.
        operand: u32,
    },
    /// Two primitives command the same resource.
    ClaimedTwice {
        /// The resource.
        resource: Resource,
    },
    /// The plan has no condition of `Termination`, or more than [`OUTCOMES_MAX`].
    Terminations {
        /// Number of conditions.
        count: u32,
    },
    /// The blocks do not cover the runs exactly, or refer to regions out of order.
    BadBlock {
        /// Index of the block; one past the last: all blocks together.
        block: u32,
    },
    /// A slot of a region is outside the `Bool` arena, or the region's numbers do not add up.
    BadRegion {
        /// Index of the region; one past the last: all regions together.
        region: u32,
    },
    /// A range that a region sets to null is outside its arena.
    BadBlank {
        /// Index of the range.
        blank: u32,
    },
    /// A delayed link points outside its arena.
    BadDelay {
        /// Index of the delay.
        delay: u32,
    },
    /// A monitor points outside its arena, is too wide, or is never due.
    BadMonitor {
        /// Index of the monitor.
        monitor: u32,
    },
    /// A value that is set from outside lies outside its arena, is published by the net itself, or exceeds
    /// [`INPUT_ELEMENTS_MAX`] together with those before it.
    BadInput {
        /// Index of the input.
        input: u32,
    },
    /// A published value lies outside its arena, or is not in the order of the topic keys.
    BadPublish {
        /// Index of the value.
        publish: u32,
    },
    /// A path clock is used twice or not at all.
    Clocks,
    /// `every` or `phase` of the rate is out of range.
    BadRate,
    /// A net that commands joints is not evaluated in every cycle.
    SlowArm {
        /// Device index.
        device: u32,
    },
    /// An initial `Bool` is not 0, 1 or 2.
    BadBool {
        /// Index of the slot.
        slot: u32,
    },
}

impl<'a> Plan<'a> {
    /// Verifies that running this plan accesses nothing outside its arenas, and no device or channel that does not
    /// exist.
    ///
    /// # Errors
    /// Returns the first fault found.
    pub fn check(
        &self,
        models: &[DeviceModel],
        configuration: u64,
    ) -> Result<CheckedPlan, PlanError> {
        if self.catalogue != primitives::fingerprint() {
            return Err(PlanError::OtherCatalogue);
        }
        if self.configuration != configuration {
            return Err(PlanError::OtherConfiguration);
        }
        let arenas = [self.reals.len(), self.bools.len(), self.ints.len()];
        if arenas.iter().any(|len| *len > SLOTS_MAX)
            || self.operands.len() > OPERANDS_MAX
            || self.monitors.len() > MONITORS_MAX
            || self.clocks > CLOCKS_MAX
            || models.len() > DEVICES_MAX
        {
            return Err(PlanError::TooLarge);
        }
        if let Some(slot) = self.bools.iter().position(|value| *value > 2) {
            return Err(PlanError::BadBool { slot: slot as u32 });
        }
        if !self.rate.is_good() {
            return Err(PlanError::BadRate);
        }
        let copied = self.check_copies()?.saturating_add(self.check_regions()?);
        let mut checked = self.check_runs(models)?;
        self.check_topics(&mut checked.resources)?;
        let arms = checked.resources.arms;
        if arms != 0 && self.rate.every > 1 {
            let device = arms.trailing_zeros();
            return Err(PlanError::SlowArm { device });
        }
        if copied.saturating_add(checked.work) > WORK_MAX {
            return Err(PlanError::TooLarge);
        }
        Ok(checked)
    }

    /// Returns the number of elements that delayed links copy and that are written from outside.
    fn check_copies(&self) -> Result<u64, PlanError> {
        let mut copied = 0u64;
        for (delay, index) in self.delays.iter().zip(0u32..) {
            copied = copied.saturating_add(u64::from(delay.width));
            if !self.contains(delay.store, delay.from, delay.width)
                || !self.contains(delay.store, delay.to, delay.width)
            {
                return Err(PlanError::BadDelay { delay: index });
            }
        }
        for (monitor, index) in self.monitors.iter().zip(0u32..) {
            let fits = self.contains(monitor.store, monitor.slot, monitor.width);
            if !fits || monitor.width as usize > MONITOR_WIDTH_MAX || monitor.every == 0 {
                return Err(PlanError::BadMonitor { monitor: index });
            }
        }
        Ok(copied.saturating_add(self.check_inputs()?))
    }

    /// Returns the number of elements that are written from outside.
    fn check_inputs(&self) -> Result<u64, PlanError> {
        if self.inputs.len() > INPUTS_MAX {
            return Err(PlanError::TooLarge);
        }
        let mut elements = 0u32;
        for (input, index) in self.inputs.iter().zip(0u32..) {
            let inside = |slot: u32| self.contains(input.store, slot, input.width);
            elements = elements.saturating_add(input.width);
            let fits = inside(input.slot)
                && input.at_least.is_none_or(inside)
                && input.at_most.is_none_or(inside)
                && self.contains(Store::Int, input.since, 1)
                && self.contains(Store::Real, input.age, 1);
            if !fits || elements > INPUT_ELEMENTS_MAX {
                return Err(PlanError::BadInput { input: index });
            }
        }
        Ok(u64::from(elements))
    }

    /// Checks that each topic is published once, that the net does not subscribe to its own topics, and that all
    /// published values are inside their arenas.
    fn check_topics(&self, resources: &mut Resources) -> Result<(), PlanError> {
        let subscribes = self.inputs.iter().filter(|input| input.topic.is_some());
        if self.publishes.len() > TOPICS_MAX || subscribes.count() > TOPICS_MAX {
            return Err(PlanError::TooLarge);
        }
        let mut last = 0;
        for (point, publish) in self.publishes.iter().zip(0u32..) {
            let rises = point.topic.key >= last && point.topic.key > 0;
            last = point.topic.key;
            if !self.contains(point.store, point.slot, point.width) || !rises {
                return Err(PlanError::BadPublish { publish });
            }
            let resource = Resource::Topic {
                key: point.topic.key,
            };
            if !resources.claim(resource) {
                return Err(PlanError::ClaimedTwice { resource });
            }
        }
        let own = |input: &InputPoint| {
            let topic = input.topic;
            topic.is_some_and(|topic| topic.key == 0 || resources.publishes(topic.key))
        };
        match self.inputs.iter().position(own) {
            Some(input) => Err(PlanError::BadInput {
                input: input as u32,
            }),
            None => Ok(()),
        }
    }

    fn check_runs(&self, models: &[DeviceModel]) -> Result<CheckedPlan, PlanError> {
        let mut tally = PlanTally {
            resources: Resources::NONE,
            clocks: 0,
            terminations: 0,
            cancels: 0,
            primitives: 0,
            work: 0,
        };
        for (run, index) in self.runs.iter().zip(0u32..) {
            let (entry, kernel) =
                primitives::kernel(run.kernel).ok_or(PlanError::UnknownKernel { run: index })?;
            let sizes = entry.spec.sizes(kernel);
            let group = entry.spec.operands(kernel).count();
            let operands = self
                .operands_of(run)
                .ok_or(PlanError::BadRun { run: index })?;
            if group == 0 || operands.is_empty() || operands.len() % group != 0 {
                return Err(PlanError::BadRun { run: index });
            }
            for (group, number) in operands.chunks_exact(group).zip(0u32..) {
                let first = run.first + number * group.len() as u32;
                tally.primitives += 1;
                let group = OperandGroup {
                    kernel,
                    sizes,
                    values: group,
                    first,
                };
                self.check_group(&entry.spec, group, models, &mut tally)?;
            }
        }
        if !(1..=OUTCOMES_MAX).contains(&tally.terminations) {
            return Err(PlanError::Terminations {
                count: tally.terminations,
            });
        }
        if tally.clocks.count_ones() != self.clocks {
            return Err(PlanError::Clocks);
        }
        Ok(CheckedPlan {
            resources: tally.resources,
            can_cancel: tally.cancels > 0,
            primitives: tally.primitives,
            work: tally.work,
        })
    }

    fn check_group(
        &self,
        spec: &Spec,
        group: OperandGroup<'_>,
        models: &[DeviceModel],
        tally: &mut PlanTally,
    ) -> Result<(), PlanError> {
        let OperandGroup {
            kernel,
            sizes: list,
            values,
            first,
        } = group;
        let sizes = Sizes::read(&list, values);
        let work = sizes.work().saturating_mul(values.len() as u64);
        tally.work = tally.work.saturating_add(work);
        let mut device = None;
        let operands = spec.operands_before_sizes(kernel);
        let operands = operands.chain(list.iter().map(Operand::Size));
        for ((operand, &value), index) in operands.zip(values).zip(first..) {
            let bad = PlanError::BadOperand { operand: index };
            let good = match operand {
                Operand::Slot { store, width, .. } => {
                    self.contains(store, value, sizes.width(width))
                }
                Operand::Arm => {
                    device = models.get(value as usize).map(|model| (value, model));
                    device.is_some_and(|(_, model)| model.arm.is_some())
                }
                Operand::Device => {
                    device = models.get(value as usize).map(|model| (value, model));
                    device.is_some()
                }
                Operand::Channel(kind) => {
                    let (device, model) = device.ok_or(bad)?;
                    tally.claim_channel(spec.role, kind, device, value)?;
                    model
                        .channels
                        .get(kind as usize)
                        .is_some_and(|count| value < *count)
                        && value < channel_max(kind)
                }
                Operand::Clock => value < self.clocks && tally.take_clock(value),
                // The slots that a size multiplies were checked to be in their arenas, which bounds the size.
                Operand::Size(Size::Open | Size::Dim(_)) => value > 0,
                Operand::Size(Size::Cycles) => (1..=CYCLES_MAX).contains(&value),
            };
            if !good {
                return Err(bad);
            }
        }
        let width = spec.has_width(kernel).then_some(sizes.get(Size::Open));
        tally.account(spec.role, device, width, first)
    }

    /// Returns the operands of a run.
    pub fn operands_of(&self, run: &KernelRun) -> Option<&'a [u32]> {
        self.operands
            .get(run.first as usize..)?
            .get(..run.operands as usize)
    }

    fn contains(&self, store: Store, slot: u32, width: u32) -> bool {
        let len = match store {
            Store::Real => self.reals.len(),
            Store::Bool => self.bools.len(),
            Store::Int => self.ints.len(),
        };
        width > 0 && u64::from(slot) + u64::from(width) <= len as u64
    }
}

fn channel_max(kind: ChannelKind) -> u32 {
    match kind {
        ChannelKind::DigitalInput | ChannelKind::DigitalOutput => DIGITAL_MAX as u32,
        ChannelKind::AnalogInput | ChannelKind::AnalogOutput => ANALOG_MAX as u32,
    }
}

/// The operands of one primitive.
#[derive(Clone, Copy)]
struct OperandGroup<'a> {
    kernel: &'a Kernel,
    /// Found once for all groups of a run.
    sizes: SizeList,
    values: &'a [u32],
    /// Index of the first operand in the plan.
    first: u32,
}

/// Claims and counts that the check has accumulated.
struct PlanTally {
    resources: Resources,
    clocks: u64,
    terminations: u32,
    cancels: u32,
    primitives: u32,
    work: u64,
}

impl PlanTally {
    fn take_clock(&mut self, clock: u32) -> bool {
        let bit = 1u64.checked_shl(clock).unwrap_or(0);
        let free = bit != 0 && self.clocks & bit == 0;
        self.clocks |= bit;
        free
    }

    fn claim(&mut self, resource: Resource) -> Result<(), PlanError> {
        if self.resources.claim(resource) {
            Ok(())
        } else {
            Err(PlanError::ClaimedTwice { resource })
        }
    }

    fn claim_channel(
        &mut self,
        role: Role,
        kind: ChannelKind,
        device: u32,
        channel: u32,
    ) -> Result<(), PlanError> {
        match (role, kind) {
            _ if channel >= channel_max(kind) => Ok(()),
            (Role::CommandsChannel, ChannelKind::DigitalOutput) => {
                self.claim(Resource::Digital { device, channel })
            }
            (Role::CommandsChannel, ChannelKind::AnalogOutput) => {
                self.claim(Resource::Analog { device, channel })
            }
            _ => Ok(()),
        }
    }

    fn account(
        &mut self,
        role: Role,
        device: Option<(u32, &DeviceModel)>,
        width: Option<u32>,
        first: u32,
    ) -> Result<(), PlanError> {
        // Joint ports are as wide as the device has joints; no other check ties width to device.
        if let (Some(width), Some((_, model))) = (width, device)
            && (model.joints != width || width as usize > JOINTS_MAX)
        {
            return Err(PlanError::BadOperand { operand: first });
        }
        match role {
            Role::Termination => self.terminations += 1,
            Role::Cancel => self.cancels += 1,
            Role::CommandsArm => {
                if let Some((device, _)) = device {
                    self.claim(Resource::Arm { device })?;
                }
            }
            _ => {}
        }
        Ok(())
    }
}
