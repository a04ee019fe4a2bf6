//! A loaded net with its arenas: built by the net-builder thread, evaluated by the real-time thread.

use std::sync::Arc;

use rcc_core::cycle::ReadyRun;
use rcc_core::frame::{ArmMotion, DeviceOutput};
use rcc_core::message::Joints;
use rcc_core::plan::{CheckedPlan, InputPoint, Plan, Rate, Resources};
use rcc_motion::MotionSet;
use rcc_protocol::control::{InputValue, PlanData, Refusal};

use crate::input::{NetInputs, TopicSource};
use crate::rows::RowIndex;
use crate::snapshot::NetSnapshot;

mod arena;
mod build;
mod evaluate;
mod values;

use arena::Arena;
pub use evaluate::{Evaluation, RunTime};
pub use values::monitor_record;

/// A net that can be evaluated, with all memory that it needs.
#[derive(Debug)]
pub struct Net {
    // Shared with the writer of incident files. The real-time thread never drops the last reference: it gives the whole
    // net back.
    data: Arc<PlanData>,
    checked: CheckedPlan,
    arena: Arena,
    motions: MotionSet,
    /// Conditions for which the start values were computed.
    start_conditions: StartConditions,
    inputs: NetInputs,
    outputs: Box<[DeviceOutput]>,
    /// By device: motion of the arm that the first evaluation takes over at a hand-over.
    arms: Box<[Option<ArmMotion>]>,
    /// Bit d: it commands device d.
    devices: u64,
    /// The runs of the plan, with their kernels.
    ready: Box<[ReadyRun]>,
    /// Number of primitives in each run.
    run_lengths: Box<[u32]>,
    /// Expected duration of one evaluation on this machine, ns; 0: not known.
    pub expected_ns: u64,
    /// Number of evaluations since START.
    pub cycles: u64,
    /// Executor cycle of the last evaluation; undefined before the first one.
    pub evaluated_cycle: u64,
    /// Index of the condition of `Termination` that ended it, in the order of the text; undefined while it runs.
    pub outcome: u32,
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

impl Net {
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

    /// The origin of the net. Not for the real-time thread.
    pub fn origin(&self) -> NetOrigin {
        NetOrigin {
            data: Arc::clone(&self.data),
            start_conditions: self.start_conditions.clone(),
        }
    }

    /// The arenas: reals, bools, ints.
    #[inline]
    pub fn arenas(&self) -> (&[f64], &[u8], &[i64]) {
        self.arena.slices()
    }

    /// The hash of all slots, see [`crate::hash`].
    #[inline]
    pub fn hash(&self) -> u64 {
        self.arena.hash()
    }

    /// Its motions.
    pub fn motions(&self) -> &MotionSet {
        &self.motions
    }

    /// Restores a recorded state. Returns `None` and changes nothing if the sizes belong to another net.
    pub fn restore(&mut self, state: &NetSnapshot<'_>) -> Option<()> {
        let arena = self.arena.slices_mut();
        let fits = state.reals.len() == arena.reals.len()
            && state.ints.len() == arena.ints.len()
            && state.bools.len() == arena.bools.len().div_ceil(8);
        if !fits {
            return None;
        }
        self.motions.restore(state.motions)?;
        for (place, word) in arena.reals.iter_mut().zip(state.reals) {
            *place = f64::from_bits(*word);
        }
        for (place, word) in arena.ints.iter_mut().zip(state.ints) {
            *place = word.cast_signed();
        }
        let bytes = state.bools.iter().flat_map(|word| word.to_le_bytes());
        for (place, byte) in arena.bools.iter_mut().zip(bytes) {
            *place = byte;
        }
        (self.cycles, self.cancel_requested) = (state.cycles, state.cancel);
        Some(())
    }

    /// The resources that the net claims.
    pub fn resources(&self) -> &Resources {
        &self.checked.resources
    }

    /// The devices of which it claims anything, bit by bit.
    #[inline]
    pub fn devices(&self) -> u64 {
        self.devices
    }

    /// The devices whose arm it claims, bit by bit.
    #[inline]
    pub fn arms(&self) -> u64 {
        self.checked.resources.arms
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

    /// Stages values that other nets have published; `version` is the version of the published topics, `find` returns
    /// the source for an input, and `net_in` the net in a row.
    pub fn receive<'n>(
        &mut self,
        (cycle, version): (u64, u64),
        find: impl Fn(&InputPoint) -> Option<TopicSource>,
        net_in: impl Fn(RowIndex) -> Option<&'n Net>,
    ) {
        let points = &self.data.inputs;
        self.inputs.bind(points, version, find);
        let now = (cycle, self.data.rate.every);
        self.inputs.receive(points, now, net_in);
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
        let PlanData {
            reals, bools, ints, ..
        } = &*self.data;
        self.arena.copy_from(reals, bools, ints);
        self.motions.reset();
        self.cycles = 0;
        self.cancel_requested = false;
        self.outputs.fill(DeviceOutput::NONE);
        self.arms.fill(None);
    }

    /// As [`Net::reset`], but keeps the motions to be taken over: a recording contains them before the evaluation.
    pub(crate) fn begin_again(&mut self) {
        let arms = std::mem::take(&mut self.arms);
        self.reset();
        self.arms = arms;
    }

    /// Sets the motion of an arm that its next evaluation, the first one, takes over.
    pub fn take_arm(&mut self, device: usize, motion: ArmMotion) {
        if let Some(place) = self.arms.get_mut(device) {
            *place = Some(motion);
        }
    }

    /// The motions of arms that its next evaluation takes over, with the indices of their devices.
    pub fn taken_arms(&self) -> impl Iterator<Item = (usize, &ArmMotion)> {
        let arms = self.arms.iter().enumerate();
        arms.filter_map(|(device, motion)| Some((device, motion.as_ref()?)))
    }

    /// The plan that it evaluates.
    pub fn plan(&self) -> Plan<'_> {
        self.data.plan()
    }

    /// Number of runs of equal primitives.
    pub fn runs(&self) -> usize {
        self.data.runs.len()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use rcc_core::message::FaultCode;
    use rcc_core::plan::KernelRun;
    use rcc_core::primitives;

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
