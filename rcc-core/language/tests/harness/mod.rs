//! A cell in virtual time: one net, ideal devices, and the same `cycle()` as on a robot. A cycle is a step. Used by
//! tests.

use std::path::{Path, PathBuf};

use bytemuck::Zeroable;
use rcc_config::CellConfig;
use rcc_core::cycle::{ReadyRun, cycle};
use rcc_core::frame::{DeviceInput, DeviceModel, DeviceOutput, Frame, Preparation};
use rcc_core::message::{Joints, Measurement};
use rcc_core::types::Store;
use rcc_language::{Compiled, compile};
use rcc_motion::{MotionSet, MotionSetBuilder};

/// Loads the configuration of a cell of the repository.
pub fn cell(path: &str) -> CellConfig {
    CellConfig::load_offline(&folder(path)).unwrap_or_else(|faults| panic!("{faults}"))
}

/// Returns a path in the repository.
pub fn folder(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(path)
}

/// Start position of the demo's arm, see `configs/cells/demo.yaml`, rad.
#[allow(dead_code)] // Not every test begins there.
pub const DEMO_START: [f64; 7] = [
    0.0,
    (-30.0_f64).to_radians(),
    0.0,
    90.0_f64.to_radians(),
    0.0,
    (-60.0_f64).to_radians(),
    0.0,
];

/// Compiles an example net for the demo.
#[allow(dead_code)] // Not every test has example nets.
pub fn example(name: &str, cell: &CellConfig) -> Compiled {
    let path = folder("configs/nets").join(format!("{name}.yaml"));
    let text = std::fs::read_to_string(path).unwrap();
    compile(&text, name, cell).unwrap_or_else(|faults| panic!("{faults}"))
}

/// A running net.
#[allow(dead_code)] // Not every test looks at everything.
pub struct NetHarness {
    pub net: Compiled,
    runs: Box<[ReadyRun]>,
    models: Vec<DeviceModel>,
    pub inputs: Vec<DeviceInput>,
    /// Commands of the previous cycle.
    pub outputs: Vec<DeviceOutput>,
    pub reals: Vec<f64>,
    pub bools: Vec<u8>,
    pub ints: Vec<i64>,
    motions: MotionSet,
    dt_s: f64,
    pub cycle: u64,
    pub cancel: bool,
    pub terminated: bool,
    pub outcome: u32,
}

impl NetHarness {
    /// Prepares a command: every arm is held at `hold`, and all measurements are known.
    pub fn new(net: Compiled, cell: &CellConfig, hold: [f64; 7]) -> NetHarness {
        let models = cell.models();
        let mut joints: Joints = [0.0; 8];
        joints[..7].copy_from_slice(&hold);
        let inputs = models.iter().map(|model| {
            let mut measurement = Measurement::zeroed();
            (measurement.joints, measurement.position, measurement.hold) =
                (model.joints, joints, joints);
            measurement.digital_known = u64::MAX;
            DeviceInput {
                present: true,
                measurement,
            }
        });
        let inputs: Vec<DeviceInput> = inputs.collect();
        let holds: Vec<Option<Joints>> = models
            .iter()
            .map(|model| model.arm.map(|_| joints))
            .collect();
        let mut reals = net.plan.reals.clone();
        let plan = net.plan.plan();
        let dt_s = cell.period_ns as f64 * 1e-9;
        let mut motions = MotionSetBuilder::new(&models, &holds, dt_s, net.plan.clocks);
        for run in plan.runs {
            let (entry, kernel) = rcc_core::primitives::kernel(run.kernel).unwrap();
            let Some(prepare) = entry.prepare else {
                continue;
            };
            let group = entry.spec.operands(kernel).count();
            for operands in plan.operands_of(run).unwrap().chunks_exact(group) {
                let mut preparation = Preparation {
                    reals: &mut reals,
                    ints: &net.plan.ints,
                    bools: &net.plan.bools,
                    models: &models,
                    holds: &holds,
                    motions: &mut motions,
                    dt_s,
                };
                prepare(&mut preparation, operands).unwrap();
            }
        }
        let motions = motions.finish().unwrap();
        NetHarness {
            runs: net.plan.ready_runs(),
            motions,
            outputs: vec![DeviceOutput::NONE; models.len()],
            bools: net.plan.bools.clone(),
            ints: net.plan.ints.clone(),
            net,
            models,
            inputs,
            reals,
            dt_s,
            cycle: 0,
            cancel: false,
            terminated: false,
            outcome: 0,
        }
    }

    /// Runs one cycle. Arms follow without delay.
    pub fn step(&mut self) {
        self.outputs.fill(DeviceOutput::NONE);
        let mut frame = Frame {
            reals: &mut self.reals,
            bools: &mut self.bools,
            ints: &mut self.ints,
            models: &self.models,
            devices: &self.inputs,
            arms: &[],
            outputs: &mut self.outputs,
            motions: &mut self.motions,
            dt_s: self.dt_s,
            cycle: self.cycle,
            cancel_requested: self.cancel,
            terminated: false,
            outcome: 0,
            motion_failed: false,
        };
        cycle(&self.net.plan.schedule(&self.runs), &mut frame);
        assert!(!frame.motion_failed);
        (self.terminated, self.outcome) = (frame.terminated, frame.outcome);
        self.cycle += 1;
        for (input, output) in self.inputs.iter_mut().zip(&self.outputs) {
            if output.has_position {
                input.measurement.position = output.position;
            }
        }
    }

    fn slot(&self, name: &str) -> (Store, usize, usize) {
        let (id, port) = name.split_once('.').unwrap();
        let primitive = self
            .net
            .names
            .primitives
            .iter()
            .find(|primitive| primitive.id == id)
            .unwrap();
        let mut ports = primitive.outputs.iter().chain(&primitive.inputs);
        let port = ports.find(|known| known.name == port).unwrap();
        (port.store, port.slot as usize, port.width as usize)
    }

    /// Returns the elements of a port; null is NaN.
    pub fn values(&self, name: &str) -> Vec<f64> {
        let (store, slot, width) = self.slot(name);
        (slot..slot + width)
            .map(|slot| match store {
                Store::Real => self.reals[slot],
                Store::Bool if self.bools[slot] > 1 => f64::NAN,
                Store::Bool => f64::from(self.bools[slot]),
                Store::Int if self.ints[slot] == i64::MIN => f64::NAN,
                Store::Int => self.ints[slot] as f64,
            })
            .collect()
    }

    /// Sets the elements of a port to those of another net, or to null.
    #[allow(dead_code)]
    pub fn copy_from(&mut self, other: &NetHarness, name: &str, null: bool) {
        let (store, slot, width) = self.slot(name);
        let (_, from, _) = other.slot(name);
        for index in 0..width {
            let (to, from) = (slot + index, from + index);
            match store {
                Store::Real => self.reals[to] = if null { f64::NAN } else { other.reals[from] },
                Store::Bool => self.bools[to] = if null { 2 } else { other.bools[from] },
                Store::Int => self.ints[to] = if null { i64::MIN } else { other.ints[from] },
            }
        }
    }

    /// Sets the first element of a port in the arena of its type; `None` is null.
    #[allow(dead_code)]
    pub fn set_element(
        &mut self,
        name: &str,
        real: Option<f64>,
        int: Option<i64>,
        truth: Option<bool>,
    ) {
        match self.slot(name) {
            (Store::Real, slot, _) => self.reals[slot] = real.unwrap_or(f64::NAN),
            (Store::Int, slot, _) => self.ints[slot] = int.unwrap_or(i64::MIN),
            (Store::Bool, slot, _) => self.bools[slot] = truth.map_or(2, u8::from),
        }
    }

    /// Sets the first element of a port of numbers.
    #[allow(dead_code)]
    pub fn set_real(&mut self, name: &str, value: f64) {
        let (_, slot, _) = self.slot(name);
        self.reals[slot] = value;
    }

    /// Returns the first element of a port.
    #[allow(dead_code)]
    pub fn value(&self, name: &str) -> f64 {
        self.values(name)[0]
    }
}

/// Returns seven joint positions as the kinematics expect them.
#[allow(dead_code)]
pub fn eight(&[q1, q2, q3, q4, q5, q6, q7]: &[f64; 7]) -> Joints {
    [q1, q2, q3, q4, q5, q6, q7, 0.0]
}
