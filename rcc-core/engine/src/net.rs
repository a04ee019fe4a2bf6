//! A loaded net with its arenas: built by the intake thread, evaluated by the real-time thread.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use rcc_core::axis::{AxisState, Phases};
use rcc_core::cycle::{cycle, cycle_timed};
use rcc_core::frame::{DeviceInput, DeviceModel, DeviceOutput, Frame, Preparation, PrepareFault};
use rcc_core::message::{COMMANDS_MAX, FaultCode, Joints, MONITOR_WIDTH_MAX, MonitorRecord};
use rcc_core::path::{MotionLimits, MotionState, Motions, SpeedOverride};
use rcc_core::plan::{
    CheckedPlan, InputPoint, KernelRun, MonitorPoint, Plan, PublishPoint, Rate, Resources,
    ValuePoint,
};
use rcc_core::primitives;
use rcc_core::types::{NULL_BOOL, Store};
use rcc_motion::{MotionSet, MotionSetBuilder};
use rcc_protocol::control::{InputValue, PlanData, Refusal};

use crate::input::{ArenaSlices, NetInputs, TopicSource, null};
use crate::queue::ValueReading;
use crate::record::entry::NetSnapshot;

/// A net that can be evaluated, with all memory that it needs.
#[derive(Debug)]
pub struct Net {
    // Shared with the writer of incident files. The real-time thread never drops the last reference: it gives the whole
    // net back.
    data: Arc<PlanData>,
    checked: CheckedPlan,
    reals: Box<[f64]>,
    bools: Box<[u8]>,
    ints: Box<[i64]>,
    motions: MotionSet,
    /// Conditions for which the start values were computed.
    start_conditions: StartConditions,
    inputs: NetInputs,
    outputs: Box<[DeviceOutput]>,
    /// Number of primitives in each run.
    run_lengths: Box<[u32]>,
    /// Expected duration of one evaluation on this machine, ns; 0: not known.
    pub expected_ns: u64,
    /// Number of evaluations since START.
    pub cycles: u64,
    /// Executor cycle of the last evaluation; undefined before the first one.
    pub evaluated_cycle: u64,
    /// CANCEL was requested.
    pub cancel_requested: bool,
    #[cfg(test)]
    /// Makes the next evaluation panic.
    pub panics: bool,
}

/// Everything that determines a net: equal origins give equal nets.
#[derive(Clone, Debug)]
pub struct NetOrigin {
    /// The plan, with start values.
    pub data: Arc<PlanData>,
    /// Conditions for which the start values were computed.
    pub start_conditions: StartConditions,
}

/// Conditions that start values depend on.
#[derive(Clone, Debug, PartialEq)]
pub struct StartConditions {
    /// Hold set-point of each device, rad; `None` if it was not known.
    pub holds: Arc<[Option<Joints>]>,
    /// The executor's period, s.
    pub dt_s: f64,
    /// How often the net was prepared again because its arms rested elsewhere at START; modulo 256.
    pub prepared_again: u8,
}

/// Result of one evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Evaluation {
    /// The net continues.
    Running,
    /// `Termination` was true.
    Terminated,
    /// The net cannot continue.
    Fault(FaultCode),
}

/// Duration of one run of equal primitives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunTime {
    /// Number of the kernel in plans.
    pub kernel: u16,
    /// Number of primitives in the run.
    pub primitives: u32,
    /// Duration, ns; includes the cost of one clock read.
    pub ns: u64,
}

impl Net {
    /// Checks the plan, computes its start values from the hold set-points of the devices and allocates its memory.
    /// `dt_s` is the executor's period, s. Not for the real-time thread.
    ///
    /// # Errors
    /// Returns [`Refusal::Plan`] if the plan check fails, [`Refusal::Prepare`] if start values cannot be computed.
    pub fn build(
        mut data: PlanData,
        models: &[DeviceModel],
        configuration: u64,
        holds: &[Option<Joints>],
        dt_s: f64,
    ) -> Result<Box<Net>, Refusal> {
        let checked = data
            .plan()
            .check(models, configuration)
            .map_err(Refusal::Plan)?;
        let step_s = step_s(dt_s, data.rate);
        let motions = prepare(&mut data, models, holds, step_s).map_err(Refusal::Prepare)?;
        let start_conditions = StartConditions {
            holds: holds.into(),
            dt_s,
            prepared_again: 0,
        };
        Ok(Net::assemble(
            Arc::new(data),
            checked,
            motions,
            start_conditions,
            models.len(),
        ))
    }

    /// Builds a net again from [`Net::origin`]: checks the plan and computes its start values. Not for the real-time
    /// thread.
    ///
    /// # Errors
    /// Returns [`Refusal::Plan`] if the plan check fails, [`Refusal::Prepare`] if start values cannot be computed.
    pub fn rebuild(
        origin: &NetOrigin,
        models: &[DeviceModel],
        configuration: u64,
    ) -> Result<Box<Net>, Refusal> {
        let StartConditions {
            holds,
            dt_s,
            prepared_again,
        } = &origin.start_conditions;
        let data = (*origin.data).clone();
        let mut net = Net::build(data, models, configuration, holds, *dt_s)?;
        net.start_conditions.prepared_again = *prepared_again;
        Ok(net)
    }

    /// Builds the same net for the current hold set-points: computes its start values again. Not for the real-time
    /// thread.
    ///
    /// # Errors
    /// Returns a [`Refusal`] if start values cannot be computed for these hold set-points.
    pub fn prepare_again(
        origin: &NetOrigin,
        models: &[DeviceModel],
        configuration: u64,
        holds: &[Option<Joints>],
    ) -> Result<Box<Net>, Refusal> {
        let data = (*origin.data).clone();
        let mut net = Net::build(
            data,
            models,
            configuration,
            holds,
            origin.start_conditions.dt_s,
        )?;
        net.start_conditions.prepared_again =
            origin.start_conditions.prepared_again.wrapping_add(1);
        Ok(net)
    }

    /// How often the net was prepared again, see [`StartConditions::prepared_again`].
    pub fn prepared_again(&self) -> u8 {
        self.start_conditions.prepared_again
    }

    /// Number of its primitives.
    pub fn primitives(&self) -> u64 {
        self.run_lengths
            .iter()
            .map(|length| u64::from(*length))
            .sum()
    }

    fn assemble(
        data: Arc<PlanData>,
        checked: CheckedPlan,
        motions: MotionSet,
        start_conditions: StartConditions,
        devices: usize,
    ) -> Box<Net> {
        Box::new(Net {
            reals: data.reals.clone().into(),
            bools: data.bools.clone().into(),
            ints: data.ints.clone().into(),
            inputs: NetInputs::of(&data.inputs),
            outputs: vec![DeviceOutput::NONE; devices].into(),
            run_lengths: data.runs.iter().map(primitives_in).collect(),
            expected_ns: 0,
            motions,
            start_conditions,
            checked,
            data,
            cycles: 0,
            evaluated_cycle: 0,
            cancel_requested: false,
            #[cfg(test)]
            panics: false,
        })
    }

    /// The origin of the net. Not for the real-time thread.
    pub fn origin(&self) -> NetOrigin {
        NetOrigin {
            data: Arc::clone(&self.data),
            start_conditions: self.start_conditions.clone(),
        }
    }

    /// The arenas: reals, bools, ints.
    pub fn arenas(&self) -> (&[f64], &[u8], &[i64]) {
        (&self.reals, &self.bools, &self.ints)
    }

    /// Its motions.
    pub fn motions(&self) -> &MotionSet {
        &self.motions
    }

    /// Restores a recorded state. Returns `None` and changes nothing if the sizes belong to another net.
    pub fn restore(&mut self, state: &NetSnapshot<'_>) -> Option<()> {
        let fits = state.reals.len() == self.reals.len()
            && state.ints.len() == self.ints.len()
            && state.bools.len() == self.bools.len().div_ceil(8);
        if !fits {
            return None;
        }
        self.motions.restore(state.motions)?;
        for (place, word) in self.reals.iter_mut().zip(state.reals) {
            *place = f64::from_bits(*word);
        }
        for (place, word) in self.ints.iter_mut().zip(state.ints) {
            *place = word.cast_signed();
        }
        let bytes = state.bools.iter().flat_map(|word| word.to_le_bytes());
        for (place, byte) in self.bools.iter_mut().zip(bytes) {
            *place = byte;
        }
        (self.cycles, self.cancel_requested) = (state.cycles, state.cancel);
        Some(())
    }

    /// The resources that the net claims.
    pub fn resources(&self) -> &Resources {
        &self.checked.resources
    }

    /// Returns true if it has a `Cancel` primitive.
    pub fn can_cancel(&self) -> bool {
        self.checked.can_cancel
    }

    /// Returns true if it continues with null when a device that it commands is lost.
    pub fn survives_device_loss(&self) -> bool {
        self.data.survives_device_loss
    }

    /// The cycles in which it is evaluated.
    pub fn rate(&self) -> Rate {
        self.data.rate
    }

    /// Outputs of the last evaluation, by device.
    pub fn outputs(&self) -> &[DeviceOutput] {
        &self.outputs
    }

    /// Copies values as the last evaluation left them into `reading`.
    ///
    /// # Errors
    /// Returns [`Refusal::NoSuchValue`] if a value lies outside of the arenas.
    pub fn read(&self, reading: &mut ValueReading) -> Result<(), Refusal> {
        let mut room = reading.values.words.iter_mut();
        for (point, value) in reading.points.iter().zip(0u32..) {
            self.copy(*point, &mut room)
                .ok_or(Refusal::NoSuchValue { value })?;
        }
        let values = &mut reading.values;
        values.cycle = if self.cycles > 0 {
            self.evaluated_cycle
        } else {
            0
        };
        values.evaluations = self.cycles;
        values.every = self.data.rate.every;
        Ok(())
    }

    /// Copies a published value to another net. It becomes null if width or type of slot differ, which happens if a
    /// plan declares wrong types.
    pub fn copy_published(&self, publish: usize, to: &InputPoint, room: &mut [u64]) {
        room.fill(null(to.store));
        let point = self.data.publishes.get(publish);
        let fits = |point: &&PublishPoint| point.store == to.store && point.width == to.width;
        if let Some(point) = point.filter(fits) {
            let point = ValuePoint {
                store: point.store,
                slot: point.slot,
                width: point.width,
            };
            // `Plan::check` has proved that it lies within the arena.
            let _: Option<()> = self.copy(point, &mut room.iter_mut());
        }
    }

    /// Stages values that other nets have published; `version` is the version of the published topics, and `find`
    /// returns the source for an input.
    pub fn receive(
        &mut self,
        (cycle, version): (u64, u64),
        nets: &Nets,
        find: impl Fn(&InputPoint) -> Option<TopicSource>,
    ) {
        let points = &self.data.inputs;
        self.inputs.bind(points, version, find);
        self.inputs
            .receive(points, nets, cycle, self.data.rate.every);
    }

    /// Restores the state after `build` when START was refused; values that were taken are staged again.
    pub fn reset_after_refused_start(&mut self) {
        self.reset();
        self.inputs.restore_first(&self.data.inputs);
    }

    /// Returns true if it subscribes to values of other nets.
    pub fn subscribes(&self) -> bool {
        self.data.inputs.iter().any(|input| input.topic.is_some())
    }

    /// Copies a value, one word per element.
    fn copy<'w>(
        &self,
        point: ValuePoint,
        room: &mut impl Iterator<Item = &'w mut u64>,
    ) -> Option<()> {
        let first = point.slot as usize;
        let slots = first..first.checked_add(point.width as usize)?;
        match point.store {
            Store::Real => {
                let values = self.reals.get(slots)?.iter();
                values
                    .zip(room)
                    .for_each(|(value, word)| *word = value.to_bits());
            }
            Store::Bool => {
                let values = self.bools.get(slots)?.iter();
                values
                    .zip(room)
                    .for_each(|(value, word)| *word = u64::from(*value));
            }
            Store::Int => {
                let values = self.ints.get(slots)?.iter();
                values
                    .zip(room)
                    .for_each(|(value, word)| *word = value.cast_unsigned());
            }
        }
        Some(())
    }

    /// Stages values for the next evaluation, all or none.
    ///
    /// # Errors
    /// Returns [`Refusal::Input`] for the first value that cannot be set.
    pub fn set(&mut self, values: &[InputValue]) -> Result<(), Refusal> {
        self.inputs.set(&self.data.plan(), values)
    }

    /// The staged values from outside.
    pub fn inputs(&self) -> &NetInputs {
        &self.inputs
    }

    /// The staged values from outside, mutable.
    pub fn inputs_mut(&mut self) -> &mut NetInputs {
        &mut self.inputs
    }

    /// Restores the state after `build`; staged values stay staged. Copies, does not allocate.
    pub fn reset(&mut self) {
        self.reals.copy_from_slice(&self.data.reals);
        self.bools.copy_from_slice(&self.data.bools);
        self.ints.copy_from_slice(&self.data.ints);
        self.motions.reset();
        self.cycles = 0;
        self.cancel_requested = false;
        self.outputs.fill(DeviceOutput::NONE);
    }

    /// Evaluates one cycle. `dt_s` is the executor's period (s), of which the net's own period is a multiple. The
    /// commands are in [`Net::outputs`]; they are valid only if the evaluation is not a fault.
    pub fn evaluate(
        &mut self,
        models: &[DeviceModel],
        devices: &[DeviceInput],
        dt_s: f64,
    ) -> Evaluation {
        self.evaluate_with(models, devices, dt_s, cycle)
    }

    /// As [`Net::evaluate`]; passes index and state of each motion that is stepped to `seen`.
    pub fn evaluate_observed(
        &mut self,
        models: &[DeviceModel],
        devices: &[DeviceInput],
        dt_s: f64,
        seen: impl FnMut(usize, &MotionState),
    ) -> Evaluation {
        self.evaluate_with(models, devices, dt_s, |plan, frame| {
            let mut motions = ObservedMotions {
                motions: &mut *frame.motions,
                seen,
            };
            let mut inner = Frame {
                reals: &mut *frame.reals,
                bools: &mut *frame.bools,
                ints: &mut *frame.ints,
                outputs: &mut *frame.outputs,
                motions: &mut motions,
                ..*frame
            };
            cycle(plan, &mut inner);
            let Frame {
                cycle,
                terminated,
                motion_failed,
                ..
            } = inner;
            (frame.cycle, frame.terminated, frame.motion_failed) =
                (cycle, terminated, motion_failed);
        })
    }

    /// As [`Net::evaluate`]; also returns the duration of the run with index `timed`, measured with `clock` (ns).
    pub fn evaluate_timed(
        &mut self,
        models: &[DeviceModel],
        devices: &[DeviceInput],
        dt_s: f64,
        (timed, clock): (usize, fn() -> u64),
    ) -> (Evaluation, Option<RunTime>) {
        let mut ns = 0;
        let evaluation = self.evaluate_with(models, devices, dt_s, |plan, frame| {
            ns = cycle_timed(plan, frame, timed, clock);
        });
        let run = self.data.runs.get(timed).zip(self.run_lengths.get(timed));
        // A run whose region is inactive took no time; that is not a measurement.
        let run = run.filter(|_| ns > 0);
        let time = run.map(|(run, primitives)| RunTime {
            kernel: run.kernel,
            primitives: *primitives,
            ns,
        });
        (evaluation, time)
    }

    /// The plan that it evaluates.
    pub fn plan(&self) -> Plan<'_> {
        self.data.plan()
    }

    /// Number of runs of equal primitives.
    pub fn runs(&self) -> usize {
        self.data.runs.len()
    }

    fn evaluate_with(
        &mut self,
        models: &[DeviceModel],
        devices: &[DeviceInput],
        dt_s: f64,
        cycle: impl FnOnce(&Plan<'_>, &mut Frame<'_>),
    ) -> Evaluation {
        self.outputs.fill(DeviceOutput::NONE);
        let step_s = step_s(dt_s, self.data.rate);
        let mut arenas = ArenaSlices {
            reals: &mut self.reals,
            bools: &mut self.bools,
            ints: &mut self.ints,
        };
        let first = self.cycles == 0;
        self.inputs
            .begin(&self.data.inputs, &mut arenas, first, step_s);
        let mut frame = Frame {
            reals: &mut self.reals,
            bools: &mut self.bools,
            ints: &mut self.ints,
            models,
            devices,
            outputs: &mut self.outputs,
            motions: &mut self.motions,
            dt_s: step_s,
            cycle: self.cycles,
            cancel_requested: self.cancel_requested,
            terminated: false,
            motion_failed: false,
        };
        let plan = self.data.plan();
        #[cfg(test)]
        let panics = self.panics;
        // A panic here is a bug of a primitive; it ends this net and no other. After a panic nothing of a net is used
        // before `reset` has overwritten it, so it need not be unwind safe.
        let completed = catch_unwind(AssertUnwindSafe(|| {
            #[cfg(test)]
            assert!(!panics, "asked for by a test");
            cycle(&plan, &mut frame);
        }));
        if completed.is_err() {
            return Evaluation::Fault(FaultCode::Panic);
        }
        self.cycles = frame.cycle;
        match (frame.motion_failed, frame.terminated) {
            (true, _) => Evaluation::Fault(FaultCode::Motion),
            (false, true) => Evaluation::Terminated,
            (false, false) => Evaluation::Running,
        }
    }

    /// Calls `push` with each monitor that is due in the last evaluated cycle.
    pub fn monitors(&self, mut push: impl FnMut(u32, &[f64])) {
        let evaluated = self.cycles.saturating_sub(1);
        for (monitor, index) in self.data.monitors.iter().zip(0..) {
            if evaluated.is_multiple_of(u64::from(monitor.every.max(1))) {
                let mut values = [0.0; MONITOR_WIDTH_MAX];
                let width = self.read_monitor(monitor, &mut values);
                push(index, &values[..width]);
            }
        }
    }

    fn read_monitor(&self, monitor: &MonitorPoint, values: &mut [f64; MONITOR_WIDTH_MAX]) -> usize {
        let (slot, width) = (
            monitor.slot as usize,
            (monitor.width as usize).min(MONITOR_WIDTH_MAX),
        );
        let places = values.iter_mut().take(width);
        match monitor.store {
            Store::Real => places
                .zip(self.reals.iter().skip(slot))
                .for_each(|(place, value)| *place = *value),
            Store::Bool => places
                .zip(self.bools.iter().skip(slot))
                .for_each(|(place, value)| {
                    *place = if value & NULL_BOOL != 0 {
                        f64::NAN
                    } else {
                        f64::from(*value)
                    };
                }),
            Store::Int => places
                .zip(self.ints.iter().skip(slot))
                .for_each(|(place, value)| *place = f64::from_bits(value.cast_unsigned())),
        }
        width
    }
}

/// Passes the states of all stepped motions to an observer.
struct ObservedMotions<'a, F> {
    motions: &'a mut dyn Motions,
    seen: F,
}

impl<F: FnMut(usize, &MotionState)> Motions for ObservedMotions<'_, F> {
    fn step(&mut self, index: usize, drive: SpeedOverride) -> Option<MotionState> {
        let state = self.motions.step(index, drive)?;
        (self.seen)(index, &state);
        Some(state)
    }

    fn plan_axis(&mut self, from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
        self.motions.plan_axis(from, goal, limits)
    }
}

/// Logical time between two evaluations of a net, s. Computed from whole nanoseconds, so that 10 steps of a net at 100
/// Hz take exactly as long as 100 steps of one at 1 kHz.
fn step_s(dt_s: f64, rate: Rate) -> f64 {
    match rate.every {
        0 | 1 => dt_s,
        every => (dt_s * 1e9).round() * f64::from(every) / 1e9,
    }
}

/// Makes a monitor record.
pub fn monitor_record(
    cycle: u64,
    stamp_ns: u64,
    command: u64,
    monitor: u32,
    values: &[f64],
) -> MonitorRecord {
    let mut all = [0.0; MONITOR_WIDTH_MAX];
    for (place, value) in all.iter_mut().zip(values) {
        *place = *value;
    }
    let width = values.len() as u32;
    MonitorRecord {
        sequence: 0,
        cycle,
        stamp_ns,
        command,
        monitor,
        width,
        values: all,
    }
}

/// Runs `prepare` of every primitive that has one on the initial arenas, and builds the motions.
fn prepare(
    data: &mut PlanData,
    models: &[DeviceModel],
    holds: &[Option<Joints>],
    dt_s: f64,
) -> Result<MotionSet, PrepareFault> {
    let mut motions = MotionSetBuilder::new(models, holds, dt_s, data.clocks);
    for run in &data.runs {
        let Some((entry, kernel)) = primitives::kernel(run.kernel) else {
            continue;
        };
        let Some(prepare) = entry.prepare else {
            continue;
        };
        let group = entry.spec.operands(kernel).count().max(1);
        let operands = &data.operands[run.first as usize..][..run.operands as usize];
        for operands in operands.chunks_exact(group) {
            let mut preparation = Preparation {
                reals: &mut data.reals,
                ints: &data.ints,
                bools: &data.bools,
                models,
                holds,
                motions: &mut motions,
                dt_s,
            };
            prepare(&mut preparation, operands)?;
        }
    }
    motions.finish()
}

/// Number of primitives in a run.
fn primitives_in(run: &KernelRun) -> u32 {
    let group = primitives::kernel(run.kernel)
        .map_or(1, |(entry, kernel)| entry.spec.operands(kernel).count());
    run.operands / (group.max(1) as u32)
}

/// One slot per row of the command table.
pub type Nets = [Option<Box<Net>>; COMMANDS_MAX];

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A net of one `Termination` that never ends.
    pub(crate) fn endless() -> Box<Net> {
        let (termination, _) = primitives::find("Termination").unwrap();
        let run = KernelRun {
            kernel: primitives::kernel_number(termination, 0),
            first: 0,
            operands: 1,
        };
        let catalogue = primitives::fingerprint();
        let plan = PlanData {
            catalogue,
            bools: vec![0],
            operands: vec![0],
            runs: vec![run],
            ..PlanData::default()
        };
        Net::build(plan, &[], 0, &[], 1e-3).unwrap()
    }

    #[test]
    fn a_panic_in_a_primitive_is_a_fault_of_its_net() {
        let mut net = endless();
        assert_eq!(net.evaluate(&[], &[], 1e-3), Evaluation::Running);
        net.panics = true;
        assert_eq!(
            net.evaluate(&[], &[], 1e-3),
            Evaluation::Fault(FaultCode::Panic)
        );
    }
}
