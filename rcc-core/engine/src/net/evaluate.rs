//! Evaluation of a net, one cycle at a time. Real-time thread; rehearsal and replay in virtual time.

use std::panic::{AssertUnwindSafe, catch_unwind};

use rcc_core::axis::{AxisState, AxisTask, Phases};
use rcc_core::cycle::{Schedule, cycle, cycle_timed};
use rcc_core::frame::{DeviceInput, DeviceModel, DeviceOutput, Frame};
use rcc_core::message::FaultCode;
use rcc_core::path::{MotionLimits, MotionState, Motions, SpeedOverride};
use rcc_core::plan::Rate;

use super::Net;
use crate::rows::set_bits;

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
        self.evaluate_with(models, devices, dt_s, |schedule, frame| {
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
            cycle(schedule, &mut inner);
            let Frame {
                cycle,
                terminated,
                outcome,
                motion_failed,
                ..
            } = inner;
            (frame.cycle, frame.motion_failed) = (cycle, motion_failed);
            (frame.terminated, frame.outcome) = (terminated, outcome);
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
        let evaluation = self.evaluate_with(models, devices, dt_s, |schedule, frame| {
            ns = cycle_timed(schedule, frame, timed, clock);
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

    fn evaluate_with(
        &mut self,
        models: &[DeviceModel],
        devices: &[DeviceInput],
        dt_s: f64,
        cycle: impl FnOnce(&Schedule<'_>, &mut Frame<'_>),
    ) -> Evaluation {
        // Of all other devices it commands nothing, as checked with the plan.
        for device in set_bits(self.devices) {
            if let Some(output) = self.outputs.get_mut(device) {
                *output = DeviceOutput::NONE;
            }
        }
        let step_s = step_s(dt_s, self.data.rate);
        let mut arenas = self.arena.slices_mut();
        let first = self.cycles == 0;
        self.inputs
            .begin(&self.data.inputs, &mut arenas, first, step_s);
        let mut frame = Frame {
            reals: arenas.reals,
            bools: arenas.bools,
            ints: arenas.ints,
            models,
            devices,
            arms: &self.arms,
            outputs: &mut self.outputs,
            motions: &mut self.motions,
            dt_s: step_s,
            cycle: self.cycles,
            cancel_requested: self.cancel_requested,
            terminated: false,
            outcome: 0,
            motion_failed: false,
        };
        let schedule = self.data.schedule(&self.ready);
        #[cfg(test)]
        let panics = self.panics;
        // A panic here is a bug of a primitive; it ends this net and no other. After a panic nothing of a net is used
        // before `reset` has overwritten it, so it need not be unwind safe.
        let completed = catch_unwind(AssertUnwindSafe(|| {
            #[cfg(test)]
            assert!(!panics, "asked for by a test");
            cycle(&schedule, &mut frame);
        }));
        if completed.is_err() {
            self.arms.fill(None);
            return Evaluation::Fault(FaultCode::Panic);
        }
        (self.cycles, self.outcome) = (frame.cycle, frame.outcome);
        let (failed, terminated) = (frame.motion_failed, frame.terminated);
        if first {
            self.arms.fill(None);
        }
        match (failed, terminated) {
            (true, _) => Evaluation::Fault(FaultCode::Motion),
            (false, true) => Evaluation::Terminated,
            (false, false) => Evaluation::Running,
        }
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

    fn plan_axes(&mut self, tasks: &[AxisTask], ways: &mut [Phases]) {
        self.motions.plan_axes(tasks, ways);
    }
}

/// Logical time between two evaluations of a net, s. Computed from whole nanoseconds, so that 10 steps of a net at 100
/// Hz take exactly as long as 100 steps of one at 1 kHz.
pub(super) fn step_s(dt_s: f64, rate: Rate) -> f64 {
    match rate.every {
        0 | 1 => dt_s,
        every => (dt_s * 1e9).round() * f64::from(every) / 1e9,
    }
}
