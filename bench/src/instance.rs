//! A loaded graph in virtual time: the arenas of its plan, a station that measures the external inputs, and the same
//! `cycle()` as on a robot. Any thread.

use std::collections::HashMap;

use bytemuck::Zeroable;
use rcc_core::cycle::{ReadyRun, cycle};
use rcc_core::frame::{DeviceInput, DeviceModel, Frame};
use rcc_core::guard::JointLimits;
use rcc_core::message::Measurement;
use rcc_core::types::{NULL_BOOL, NULL_INT, Store};
use rcc_core::unit::Unit;
use rcc_language::devices::{CellChannel, CellDevice, DeviceTable};
use rcc_language::{Compiled, compile_for};

use crate::graph::{Graph, NULL_WORD, NodeValue, SinkHash, external_bool, external_real};
use crate::net::{DEVICE, net};
use crate::straight::GraphInputs;

/// Number of external numbers of a graph.
pub const REALS: usize = 8;
/// Number of external truth values of a graph.
pub const BOOLS: usize = 4;

/// Returns the devices of the cell that the nets are for: one station whose channels are the external inputs.
#[must_use]
pub fn cell() -> DeviceTable {
    let channels = |letter: char, count: usize| {
        let channel = |k| CellChannel {
            name: format!("{letter}{k}"),
            unit: Unit::ONE,
            range: None,
        };
        (0..count).map(channel).collect::<Vec<_>>()
    };
    let model = DeviceModel {
        joints: 0,
        arm: None,
        limits: JointLimits {
            lower: [0.0; 8],
            upper: [0.0; 8],
            velocity_max: [0.0; 8],
            acceleration_max: [0.0; 8],
            jerk_max: [0.0; 8],
            joints: 0,
        },
        first_tolerance_rad: 0.0,
        base: rcc_core::pose::Pose::IDENTITY,
        workspace: None,
        channels: [BOOLS as u32, 0, REALS as u32, 0],
        ..DeviceModel::NONE
    };
    DeviceTable {
        fingerprint: 0,
        period_ns: 1_000_000,
        devices: vec![CellDevice {
            name: DEVICE.to_string(),
            model,
            channels: [
                channels('v', BOOLS),
                Vec::new(),
                channels('u', REALS),
                Vec::new(),
            ],
        }],
    }
}

/// Returns what the station measures in a cycle, counted from 1.
#[must_use]
pub fn measurement(cycle: u64) -> Measurement {
    let mut measurement = Measurement::zeroed();
    measurement.analog = [f64::NAN; _];
    for (k, place) in measurement.analog.iter_mut().take(REALS).enumerate() {
        *place = external_real(cycle, k);
    }
    measurement.digital_known = (1 << BOOLS) - 1;
    for k in 0..BOOLS {
        measurement.digital |= u64::from(external_bool(cycle, k)) << k;
    }
    measurement
}

/// The slots of a node's result.
#[derive(Clone, Copy, Debug)]
struct ResultSlots {
    store: Store,
    slot: usize,
    width: usize,
}

/// A running graph.
pub struct GraphInstance {
    /// The compiled net.
    pub net: Compiled,
    runs: Box<[ReadyRun]>,
    reals: Vec<f64>,
    bools: Vec<u8>,
    ints: Vec<i64>,
    models: Vec<DeviceModel>,
    devices: [DeviceInput; 1],
    /// Slots by node of the graph.
    slots: Vec<ResultSlots>,
    sinks: Vec<usize>,
    cycles: u64,
}

impl GraphInstance {
    /// Compiles a graph with the whole loader.
    ///
    /// # Errors
    /// Returns the faults of the net, which would be a bug of this package.
    pub fn new(graph: &Graph) -> Result<GraphInstance, rcc_language::Faults> {
        let text = net(graph);
        let cell = cell();
        let net = compile_for(&text.text, "graph.json", &cell)?;
        let ports = net.names.primitives.iter().map(|primitive| {
            let out = primitive.outputs.iter().find(|port| port.name == "out");
            (primitive.id.as_str(), out)
        });
        let ports: HashMap<_, _> = ports.collect();
        let slots = text.outputs.iter().map(|output| {
            // Every reference names an output of the net that was just generated.
            let port = ports[output.id.as_str()].expect("an output `out`");
            let (slot, width) = (port.slot as usize, port.width as usize);
            let element = output.index.map(|index| (slot + index as usize, 1));
            let (slot, width) = element.unwrap_or((slot, width));
            ResultSlots {
                store: port.store,
                slot,
                width,
            }
        });
        Ok(GraphInstance {
            slots: slots.collect(),
            runs: net.plan.ready_runs(),
            reals: net.plan.reals.clone(),
            bools: net.plan.bools.clone(),
            ints: net.plan.ints.clone(),
            models: cell.models(),
            devices: [DeviceInput {
                present: true,
                measurement: measurement(1),
            }],
            sinks: graph.sinks.clone(),
            net,
            cycles: 0,
        })
    }

    /// Runs the next cycle with its external inputs.
    pub fn step(&mut self) {
        self.devices[0].measurement = measurement(self.cycles + 1);
        self.evaluate();
    }

    /// Runs the next cycle with the external inputs of the previous one: what benchmarks time.
    pub fn evaluate(&mut self) {
        let mut frame = Frame {
            reals: &mut self.reals,
            bools: &mut self.bools,
            ints: &mut self.ints,
            models: &self.models,
            devices: &self.devices,
            arms: &[],
            outputs: &mut [],
            motions: &mut (),
            dt_s: 1e-3,
            cycle: self.cycles,
            cancel_requested: false,
            terminated: false,
            outcome: 0,
            motion_failed: false,
        };
        cycle(&self.net.plan.schedule(&self.runs), &mut frame);
        self.cycles = frame.cycle;
    }

    /// Sets the external inputs of the next evaluations, as cheaply as reading a driver's board.
    pub fn measure(&mut self, inputs: &GraphInputs) {
        let measurement = &mut self.devices[0].measurement;
        for (place, value) in measurement.analog.iter_mut().zip(inputs.u) {
            *place = value;
        }
        let bits = inputs.v.iter().rev();
        measurement.digital = bits.fold(0, |bits, bit| bits << 1 | u64::from(*bit));
    }

    /// Returns the number of cycles so far.
    #[must_use]
    pub fn cycles(&self) -> u64 {
        self.cycles
    }

    /// Returns the number of primitives that a cycle evaluates.
    #[must_use]
    pub fn primitives(&self) -> usize {
        let runs = &self.net.plan.runs;
        runs.iter()
            .filter_map(|run| {
                let (entry, kernel) = rcc_core::primitives::kernel(run.kernel)?;
                let group = entry.spec.operands(kernel).count();
                (run.operands as usize).checked_div(group)
            })
            .sum()
    }

    /// Returns the result of a node; `None` is null.
    #[must_use]
    pub fn value(&self, node: usize) -> Option<NodeValue> {
        let ResultSlots { store, slot, width } = self.slots[node];
        match store {
            Store::Bool => match self.bools[slot] {
                value if value & NULL_BOOL != 0 => None,
                value => Some(NodeValue::Bool(value == 1)),
            },
            Store::Int => match self.ints[slot] {
                NULL_INT => None,
                value => Some(NodeValue::Int(value)),
            },
            Store::Real => {
                let values = &self.reals[slot..slot + width];
                match values {
                    [value] if value.is_nan() => None,
                    [value] => Some(NodeValue::Real(*value)),
                    [.., last] if last.is_nan() => None,
                    _ => Some(NodeValue::Transform(values.try_into().ok()?)),
                }
            }
        }
    }

    /// Returns the hash of the sinks.
    #[must_use]
    pub fn hash(&self) -> SinkHash {
        let mut hash = SinkHash::default();
        for sink in &self.sinks {
            let store = self.slots[*sink].store;
            match self.value(*sink) {
                Some(NodeValue::Bool(value)) => hash.word(u64::from(value)),
                Some(NodeValue::Int(value)) => hash.word(value.cast_unsigned()),
                Some(NodeValue::Real(value)) => hash.real(value),
                Some(NodeValue::Transform(values)) => values.iter().for_each(|v| hash.real(*v)),
                None => hash.word(match store {
                    Store::Bool => u64::from(NULL_BOOL),
                    Store::Int => NULL_INT.cast_unsigned(),
                    Store::Real => NULL_WORD,
                }),
            }
        }
        hash
    }
}
