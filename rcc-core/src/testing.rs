//! A test harness for one primitive: allocates its slots, sets inputs, runs its kernel and reads outputs. Test code
//! only.

use std::boxed::Box;
use std::vec;
use std::vec::Vec;

use bytemuck::Zeroable;

use crate::axis::{AxisState, AxisTask, Phases};
use crate::frame::{DeviceInput, DeviceModel, DeviceOutput, Frame, Preparation, PrepareFault};
use crate::impedance::ImpedanceLimits;
use crate::joints::{ArmMotion, JOINTS_MAX, JointLimits, Joints};
use crate::kinematics::Arm;
use crate::message::Measurement;
use crate::path::{
    MotionBuilder, MotionLimits, MotionState, Motions, PathRequest, PathState, SpeedOverride,
};
use crate::pose::Pose;
use crate::primitive::{CatalogueEntry, Kernel, Operand, Size, Sizes};
use crate::primitives;
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store};

// Some items serve other packages only.
#[allow(dead_code)]
#[path = "../testing/src/arms.rs"]
pub mod arms;

/// A motion that continues until it is stopped, for tests of the primitives that use it.
#[derive(Default)]
struct EndlessMotion {
    built: bool,
    stopped: bool,
}

impl MotionBuilder for EndlessMotion {
    fn path(&mut self, _index: u32, request: &PathRequest<'_>) -> Result<(), PrepareFault> {
        assert!(!request.legs.is_empty());
        self.built = true;
        Ok(())
    }
}

impl Motions for EndlessMotion {
    fn step(&mut self, _index: usize, speed_override: SpeedOverride) -> Option<MotionState> {
        self.stopped |= speed_override.stop;
        let path = PathState {
            done: self.stopped,
            stopping: self.stopped,
            ..PathState::default()
        };
        let state = MotionState {
            path,
            leg: 0,
            pose: Pose::from_xyz_rpy([0.0; 3], [0.0; 3]),
            joints: [0.0; JOINTS_MAX],
            progress: 0.0,
            distance: 0.0,
            speed: 0.0,
            acceleration: 0.0,
            waiting: false,
            until_met: false,
        };
        self.built.then_some(state)
    }

    fn plan_axis(&mut self, from: &AxisState, goal: f64, limits: &MotionLimits) -> Phases {
        ().plan_axis(from, goal, limits)
    }

    fn plan_axes(&mut self, tasks: &[AxisTask], ways: &mut [Phases]) {
        ().plan_axes(tasks, ways);
    }
}

/// The impedance limits of FRI for an LWR 4+, with additional loads of at most 30 N and 30 N·m.
pub const IMPEDANCE: ImpedanceLimits = ImpedanceLimits {
    translation: [0.01, 5000.0],
    rotation: [0.01, 300.0],
    joint: [0.01, 2000.0],
    damping: [0.1, 1.0],
    rate: 2.0,
    force: 30.0,
    torque: 30.0,
    joint_torque: 30.0,
};

/// The LWR 4+ of the golden data, with the joint ranges of its data sheet.
pub fn lwr() -> DeviceModel {
    let plain = arms::plain_lwr(2000.0);
    DeviceModel {
        limits: within(arms::SEVEN_JOINTS, plain.limits),
        channels: [4, 4, 2, 2],
        impedance: Some(IMPEDANCE),
        ..plain
    }
}

/// A KR 6 R900-2, with the joint ranges of the golden data.
pub fn kr6() -> DeviceModel {
    let lwr = lwr();
    DeviceModel {
        joints: 6,
        arm: Some(Arm::OrthoParallel(arms::KR6)),
        limits: within(arms::SIX_JOINTS, lwr.limits),
        ..lwr
    }
}

/// Returns the limits with these joint ranges, deg.
fn within<const N: usize>(range: [[f64; 2]; N], limits: JointLimits) -> JointLimits {
    JointLimits {
        lower: arms::radians(range.map(|[lower, _]| lower)),
        upper: arms::radians(range.map(|[_, upper]| upper)),
        joints: N,
        ..limits
    }
}

/// One primitive with its slots and a cell with one LWR.
pub struct PrimitiveHarness {
    entry: &'static CatalogueEntry,
    kernel: &'static Kernel,
    reals: Vec<f64>,
    bools: Vec<u8>,
    ints: Vec<i64>,
    operands: Vec<u32>,
    names: Vec<(&'static str, usize)>,
    motions: EndlessMotion,
    pub model: DeviceModel,
    pub device: DeviceInput,
    pub output: DeviceOutput,
    pub arm: Option<ArmMotion>,
    pub hold: Option<Joints>,
    pub cycle: u64,
    pub cancel_requested: bool,
    pub terminated: bool,
    pub outcome: u32,
}

impl PrimitiveHarness {
    /// Creates a harness for a primitive without open ports, or with joint ports.
    pub fn new(name: &str) -> PrimitiveHarness {
        PrimitiveHarness::wide(name, None, JOINTS_MAX as u32 - 1)
    }

    /// Creates a harness for a primitive with open ports.
    pub fn wide(name: &str, store: Option<Store>, width: u32) -> PrimitiveHarness {
        let (_, entry) = primitives::find(name).expect("a primitive of the catalogue");
        let index = [store, None, Some(Store::Real)]
            .into_iter()
            .find_map(|store| entry.kernel_for(store, width));
        let kernel = &entry.kernels[index.expect("a kernel for this arena")];
        let spec = &entry.spec;
        let parameters = spec
            .parameters
            .iter()
            .filter(|p| p.kind.is_operand())
            .map(|p| p.name);
        let inputs = spec.inputs.iter().map(|p| p.name);
        let names = inputs
            .chain(spec.outputs.iter().map(|p| p.name))
            .chain(parameters);
        let names = names
            .enumerate()
            .map(|(index, name)| (name, index))
            .collect();
        let (mut reals, mut bools, mut ints) = (vec![], vec![], vec![]);
        let mut operands = vec![];
        let mut sizes = Sizes::ONE;
        sizes.set(Size::Open, if spec.has_width(kernel) { width } else { 1 });
        for operand in spec.operands(kernel) {
            let (store, w) = match operand {
                Operand::Slot { store, width, .. } => (store, sizes.width(width) as usize),
                Operand::Size(size) => {
                    operands.push(sizes.get(size));
                    continue;
                }
                _ => {
                    operands.push(0);
                    continue;
                }
            };
            operands.push(match store {
                Store::Real => extend(&mut reals, w, NULL_REAL),
                Store::Bool => extend(&mut bools, w, NULL_BOOL),
                Store::Int => extend(
                    &mut ints,
                    w,
                    if names_len(spec) > operands.len() {
                        NULL_INT
                    } else {
                        0
                    },
                ),
            });
        }
        let mut measurement = Measurement::zeroed();
        measurement.joints = 7;
        PrimitiveHarness {
            entry,
            kernel,
            reals,
            bools,
            ints,
            operands,
            names,
            motions: EndlessMotion::default(),
            model: lwr(),
            device: DeviceInput {
                present: true,
                measurement,
            },
            output: DeviceOutput::NONE,
            arm: None,
            hold: Some([0.0; JOINTS_MAX]),
            cycle: 0,
            cancel_requested: false,
            terminated: false,
            outcome: 0,
        }
    }

    /// An output may have the name of a parameter.
    fn slot(&self, name: &str) -> usize {
        self.slot_of(self.names.iter().find(|(known, _)| *known == name))
    }

    fn slot_to_set(&self, name: &str) -> usize {
        self.slot_of(self.names.iter().rev().find(|(known, _)| *known == name))
    }

    fn slot_of(&self, found: Option<&(&'static str, usize)>) -> usize {
        let (_, index) = found.expect("a port or parameter");
        self.operands[*index] as usize
    }

    pub fn set_real(&mut self, name: &str, value: f64) -> &mut PrimitiveHarness {
        let slot = self.slot_to_set(name);
        self.reals[slot] = value;
        self
    }

    pub fn set_reals(&mut self, name: &str, values: &[f64]) -> &mut PrimitiveHarness {
        let slot = self.slot_to_set(name);
        self.reals[slot..slot + values.len()].copy_from_slice(values);
        self
    }

    pub fn set_bool(&mut self, name: &str, value: Option<bool>) -> &mut PrimitiveHarness {
        let slot = self.slot_to_set(name);
        self.bools[slot] = value.map_or(NULL_BOOL, u8::from);
        self
    }

    pub fn set_int(&mut self, name: &str, value: i64) -> &mut PrimitiveHarness {
        let slot = self.slot_to_set(name);
        self.ints[slot] = value;
        self
    }

    /// Sets the state in the arena of `Real`, as a `Start` parameter does; it is the last slot of that arena.
    pub fn start_real(&mut self, value: f64) -> &mut PrimitiveHarness {
        *self.reals.last_mut().expect("a state") = value;
        self
    }

    /// Sets the state in the arena of `Bool`; it is the last slot of that arena.
    pub fn start_bool(&mut self, value: bool) -> &mut PrimitiveHarness {
        *self.bools.last_mut().expect("a state") = u8::from(value);
        self
    }

    /// Sets an operand that is not a slot, e.g. a channel.
    pub fn set_index(&mut self, name: &str, value: u32) -> &mut PrimitiveHarness {
        let (_, index) = *self
            .names
            .iter()
            .find(|(known, _)| *known == name)
            .expect("a parameter");
        self.operands[index] = value;
        self
    }

    pub fn real(&self, name: &str) -> f64 {
        self.reals[self.slot(name)]
    }

    pub fn reals(&self, name: &str, width: usize) -> &[f64] {
        let slot = self.slot(name);
        &self.reals[slot..slot + width]
    }

    pub fn bool(&self, name: &str) -> Option<bool> {
        match self.bools[self.slot(name)] {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    pub fn int(&self, name: &str) -> i64 {
        self.ints[self.slot(name)]
    }

    /// Computes the start values.
    pub fn prepare(&mut self) -> Result<(), PrepareFault> {
        let mut preparation = Preparation {
            reals: &mut self.reals,
            ints: &self.ints,
            bools: &self.bools,
            models: &[self.model],
            holds: &[self.hold],
            motions: &mut self.motions,
            dt_s: 1e-3,
        };
        (self.entry.prepare.expect("a prepared primitive"))(&mut preparation, &self.operands)
    }

    /// Runs one cycle.
    pub fn step(&mut self) -> &mut PrimitiveHarness {
        let mut outputs = Box::new([DeviceOutput::NONE]);
        let mut frame = Frame {
            reals: &mut self.reals,
            bools: &mut self.bools,
            ints: &mut self.ints,
            models: &[self.model],
            devices: &[self.device],
            arms: &[self.arm],
            outputs: outputs.as_mut_slice(),
            motions: &mut self.motions,
            dt_s: 1e-3,
            cycle: self.cycle,
            cancel_requested: self.cancel_requested,
            terminated: false,
            outcome: 0,
            motion_failed: false,
        };
        (self.kernel.run)(&mut frame, &self.operands);
        (self.terminated, self.outcome) = (frame.terminated, frame.outcome);
        self.output = outputs[0];
        self.cycle += 1;
        self
    }
}

fn names_len(spec: &crate::primitive::Spec) -> usize {
    spec.inputs.len() + spec.outputs.len() + spec.parameters.len()
}

fn extend<T: Clone>(arena: &mut Vec<T>, width: usize, null: T) -> u32 {
    let slot = arena.len();
    arena.resize(slot + width, null);
    slot as u32
}

/// Checks a `Real, Real → Real` primitive against rows `[a, b, out]`, and that null propagates.
pub fn check_binary(name: &str, rows: &[[f64; 3]]) {
    // Tests the kernel for single-element values, and the one for wide values if it exists.
    for width in [1, 3] {
        let mut bench = PrimitiveHarness::wide(name, Some(Store::Real), width);
        for [a, b, out] in rows.iter().copied() {
            let got = bench.set_real("a", a).set_real("b", b).step().real("out");
            assert!(
                got == out || (got.is_nan() && out.is_nan()),
                "{name}({a}, {b}) = {got}, not {out}"
            );
        }
        for (a, b) in [(NULL_REAL, 1.0), (1.0, NULL_REAL), (NULL_REAL, NULL_REAL)] {
            let got = bench.set_real("a", a).set_real("b", b).step().real("out");
            assert!(got.is_nan(), "{name}({a}, {b})");
        }
    }
}

/// Checks an `Int, Int → Int` primitive against rows `[a, b, out]`, and that null propagates.
pub fn check_int(name: &str, rows: &[[i64; 3]]) {
    for width in [1, 3] {
        let mut bench = PrimitiveHarness::wide(name, Some(Store::Int), width);
        for [a, b, out] in rows.iter().copied() {
            let got = bench.set_int("a", a).set_int("b", b).step().int("out");
            assert_eq!(got, out, "{name}({a}, {b})");
        }
        for (a, b) in [(NULL_INT, 1), (1, NULL_INT), (-1, NULL_INT), (NULL_INT, 0)] {
            let got = bench.set_int("a", a).set_int("b", b).step().int("out");
            assert_eq!(got, NULL_INT, "{name}({a}, {b})");
        }
    }
}

/// Checks a `Bool, Bool → Bool` primitive: `table[a][b]` for a, b in false, true, null.
pub fn check_truth_table(name: &str, table: [[Option<bool>; 3]; 3]) {
    let values = [Some(false), Some(true), None];
    let mut bench = PrimitiveHarness::new(name);
    for (a, row) in values.into_iter().zip(table) {
        for (b, out) in values.into_iter().zip(row) {
            assert_eq!(
                bench.set_bool("a", a).set_bool("b", b).step().bool("out"),
                out,
                "{name}({a:?}, {b:?})"
            );
        }
    }
}
