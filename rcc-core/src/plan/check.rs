//! Checks a plan before it is built: every index, width, limit and order. Pure.

use super::{
    CLOCKS_MAX, INPUT_ELEMENTS_MAX, INPUTS_MAX, InputPoint, KernelRun, MONITORS_MAX, OPERANDS_MAX,
    OUTCOMES_MAX, Plan, PlanError, Resource, Resources, SLOTS_MAX, TOPICS_MAX, WORK_MAX,
};
use crate::frame::DeviceModel;
use crate::joints::JOINTS_MAX;
use crate::message::{ANALOG_MAX, DEVICES_MAX, DIGITAL_MAX, MONITOR_WIDTH_MAX};
use crate::primitive::{
    CYCLES_MAX, ChannelKind, Kernel, Operand, Role, Size, SizeList, Sizes, Spec,
};
use crate::primitives;
use crate::types::Store;

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

    pub(super) fn contains(&self, store: Store, slot: u32, width: u32) -> bool {
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
