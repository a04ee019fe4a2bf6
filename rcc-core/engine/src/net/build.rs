//! Builds nets from plans: checks, start values, motions, memory. Not for the real-time thread.

use std::sync::Arc;

use rcc_core::frame::{DeviceModel, DeviceOutput, Preparation, PrepareFault};
use rcc_core::message::Joints;
use rcc_core::plan::{CheckedPlan, KernelRun};
use rcc_core::primitives;
use rcc_motion::{MotionSet, MotionSetBuilder};
use rcc_protocol::control::{PlanData, Refusal};

use super::arena::Arena;
use super::evaluate::step_s;
use super::{Net, NetOrigin, StartConditions};
use crate::input::NetInputs;

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

    fn assemble(
        data: Arc<PlanData>,
        checked: CheckedPlan,
        motions: MotionSet,
        start_conditions: StartConditions,
        devices: usize,
    ) -> Box<Net> {
        let ready = data.ready_runs();
        let used = (0..devices).filter(|device| checked.resources.uses(*device));
        Box::new(Net {
            ready,
            devices: used.fold(0, |bits, device| bits | 1 << device),
            arena: Arena::new(&data.reals, &data.bools, &data.ints),
            inputs: NetInputs::of(&data.inputs),
            outputs: vec![DeviceOutput::NONE; devices].into(),
            arms: vec![None; devices].into(),
            run_lengths: data.runs.iter().map(primitives_in).collect(),
            expected_ns: 0,
            motions,
            start_conditions,
            checked,
            data,
            cycles: 0,
            evaluated_cycle: 0,
            outcome: 0,
            cancel_requested: false,
            #[cfg(test)]
            panics: false,
        })
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
