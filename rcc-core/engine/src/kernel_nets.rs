//! Nets with many primitives of one kernel of the catalogue, generated from the primitive's spec alone, so that new
//! primitives are measured without changes here. Used by the benchmarks, and by the executor before its first cycle.

use bytemuck::Zeroable;
use rcc_core::frame::{DeviceInput, DeviceModel};
use rcc_core::guard::JointLimits;
use rcc_core::kinematics::{Arm, SrsArm};
use rcc_core::message::{ANALOG_MAX, DEVICES_MAX, DIGITAL_MAX, Joints, Measurement};
use rcc_core::path::leg_row;
use rcc_core::plan::{CLOCKS_MAX, KernelRun};
use rcc_core::primitive::{
    ChannelKind, DefaultValue, Kernel, Operand, ParameterKind, PortType, Role, Size, Sizes, Spec,
    TypeFamily,
};
use rcc_core::primitives::{self, CATALOGUE, CatalogueEntry};
use rcc_core::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store, Type};
use rcc_protocol::control::{PlanData, Refusal};

use crate::net::Net;

/// Primitives in one run; fewer if they claim a unique resource.
pub const RUN: u32 = 256;
/// Joints of the devices.
const JOINTS: u32 = 7;
/// Width of values of wide kernels; equal to the number of joints, because device primitives accept nothing else.
const WIDTH: u32 = JOINTS;
/// Length of windows, in evaluations.
const WINDOW: u32 = 100;
/// Position of the arms, rad.
pub const HOLD: Joints = [0.3, 0.5, -0.2, -1.6, 0.1, 1.0, 0.4, 0.0];
const PERIOD_S: f64 = 1e-3;

/// One kernel of the catalogue.
#[derive(Clone, Copy)]
pub struct CatalogueKernel {
    /// The primitive.
    pub entry: &'static CatalogueEntry,
    /// Number of the kernel in plans.
    pub number: u16,
    /// The kernel.
    pub kernel: &'static Kernel,
}

impl CatalogueKernel {
    /// Name of the primitive; with the type of slot if it has kernels for several.
    #[must_use]
    pub fn name(&self) -> String {
        let name = self.entry.spec.name;
        let wide = self.entry.spec.has_width(self.kernel);
        match (self.entry.kernels.len(), self.kernel.store) {
            (2.., Some(store)) if wide => format!("{name} ({store:?}[{WIDTH}])"),
            (2.., Some(store)) => format!("{name} ({store:?})"),
            _ => name.to_owned(),
        }
    }
}

/// All kernels, in the order of the catalogue.
pub fn rows() -> impl Iterator<Item = CatalogueKernel> {
    CATALOGUE.iter().enumerate().flat_map(|(index, entry)| {
        let kernels = entry.kernels.iter().enumerate();
        kernels.map(move |(kernel, it)| CatalogueKernel {
            entry,
            number: primitives::kernel_number(index, kernel),
            kernel: it,
        })
    })
}

/// The devices that the nets of this module use: arms with the greatest number of channels.
#[must_use]
pub fn models() -> Vec<DeviceModel> {
    let limits = JointLimits {
        lower: [-2.9; 8],
        upper: [2.9; 8],
        velocity_max: [2.0; 8],
        acceleration_max: [20.0; 8],
        jerk_max: [2000.0; 8],
        joints: JOINTS as usize,
    };
    let model = DeviceModel {
        joints: JOINTS,
        arm: Some(ARM),
        limits,
        first_tolerance_rad: 1e-3,
        base: rcc_core::pose::Pose::IDENTITY,
        workspace: None,
        channels: [
            DIGITAL_MAX as u32,
            DIGITAL_MAX as u32,
            ANALOG_MAX as u32,
            ANALOG_MAX as u32,
        ],
        ..DeviceModel::NONE
    };
    vec![model; DEVICES_MAX]
}

/// Measurements of these devices: present, at rest at their hold set-point.
#[must_use]
pub fn devices() -> Vec<DeviceInput> {
    let mut measurement = Measurement::zeroed();
    measurement.joints = JOINTS;
    measurement.hold = HOLD;
    measurement.position = HOLD;
    measurement.analog = [0.5; ANALOG_MAX];
    vec![
        DeviceInput {
            present: true,
            measurement
        };
        DEVICES_MAX
    ]
}

/// Dimensions of an LWR 4+.
const ARM: Arm = Arm::Srs(SrsArm {
    shoulder_height: 0.3105,
    upper_arm: 0.4,
    forearm: 0.39,
    wrist_to_flange: 0.078,
    signs: [1.0, -1.0, 1.0, 1.0, 1.0, -1.0, 1.0],
});

/// Number of primitives of a type that one net can have.
#[must_use]
pub fn count(spec: &Spec) -> u32 {
    match spec.role {
        Role::Termination => 1,
        Role::CommandsArm => DEVICES_MAX as u32,
        Role::Motion => CLOCKS_MAX.min(RUN),
        _ => RUN,
    }
}

/// A net of `count` primitives of a kernel, and a `Termination` that never ends it. Inputs are null only if that is
/// their default.
///
/// # Errors
/// Returns a [`Refusal`] if the executor would refuse the net.
pub fn net(row: &CatalogueKernel, count: u32) -> Result<Box<Net>, Refusal> {
    let mut builder = KernelNetBuilder {
        data: PlanData {
            catalogue: primitives::fingerprint(),
            ..PlanData::default()
        },
        number: 0,
    };
    for number in 0..count {
        builder.number = number;
        builder.group(&row.entry.spec, row.kernel);
    }
    let mut data = builder.data;
    let mut push = |kernel, first: usize, end: usize| {
        if end > first {
            data.runs.push(KernelRun {
                kernel,
                first: first as u32,
                operands: (end - first) as u32,
            });
        }
    };
    let end = data.operands.len();
    push(row.number, 0, end);
    if row.entry.spec.role != Role::Termination || count == 0 {
        let (termination, _) = primitives::find("Termination").unwrap_or((0, CATALOGUE[0]));
        push(primitives::kernel_number(termination, 0), end, end + 1);
        data.bools.push(0);
        data.operands.push(data.bools.len() as u32 - 1);
    }
    let holds = vec![Some(HOLD); DEVICES_MAX];
    Net::build(data, &models(), 0, &holds, PERIOD_S)
}

/// The type of a family with which its primitives are measured.
fn member(family: TypeFamily) -> Type {
    match family {
        TypeFamily::Frame | TypeFamily::Turn => Type::Pose,
        TypeFamily::Axes => Type::Twist,
        TypeFamily::Vector => Type::Vector3,
    }
}

/// The type with which a primitive of a family is measured; `None` if it takes no family.
fn member_of(spec: &Spec) -> Option<Type> {
    let families = spec.types().find_map(|ty| match ty {
        PortType::Of(family) => Some(family),
        _ => None,
    });
    families.map(member)
}

/// Lays out operands and slots, primitive by primitive.
struct KernelNetBuilder {
    data: PlanData,
    number: u32,
}

impl KernelNetBuilder {
    /// Adds the operands of one primitive, in the order of [`Spec::operands`].
    fn group(&mut self, spec: &Spec, kernel: &Kernel) {
        let mut sizes = Sizes::ONE;
        for size in spec.sizes(kernel).iter() {
            let width = match size {
                Size::Cycles => WINDOW,
                Size::Open => member_of(spec).map_or(WIDTH, Type::width),
                Size::Dim(_) => WIDTH,
            };
            sizes.set(size, width);
        }
        let motion = spec.role == Role::Motion;
        let parameters = spec.parameters.iter().filter(|row| row.kind.is_operand());
        let kinds = parameters.clone().map(|row| Some(row.kind));
        let ports = spec.inputs.iter().chain(spec.outputs).map(|_| None);
        let mut kinds = ports.chain(kinds);
        // Types and defaults of the first operands; state and sizes follow.
        let inputs = spec.inputs.iter().map(|port| (Some(port.ty), port.default));
        let outputs = spec
            .outputs
            .iter()
            .map(|_| (None, Some(DefaultValue::Null)));
        let parameters = parameters.map(|row| (row.kind.value().map(|(ty, _)| ty), row.default));
        let mut known = inputs.chain(outputs).chain(parameters);
        for operand in spec.operands(kernel) {
            let place = known.next();
            let number = self.number;
            let kind = kinds.next().flatten().filter(|_| motion);
            let goal = kind.and_then(|kind| self.goal(kind));
            if let Some(slot) = goal {
                self.data.operands.push(slot);
                continue;
            }
            let operand = match (operand, place) {
                (Operand::Slot { store, width, .. }, Some((ty, default))) => {
                    self.value(ty, store, sizes.width(width), default)
                }
                (Operand::Slot { store, width, .. }, None) => {
                    let start = if store == Store::Int {
                        DefaultValue::Int(0)
                    } else {
                        DefaultValue::Null
                    };
                    self.slot(store, sizes.width(width), Some(start))
                }
                (Operand::Arm | Operand::Device, _) => number % DEVICES_MAX as u32,
                (Operand::Channel(kind), _) => number / DEVICES_MAX as u32 % channels(kind),
                (Operand::Clock, _) => {
                    self.data.clocks += 1;
                    self.data.clocks - 1
                }
                (Operand::Size(size), _) => sizes.get(size),
            };
            self.data.operands.push(operand);
        }
    }

    /// The goal of a motion that is not a single pose; `None` for any other parameter.
    fn goal(&mut self, kind: ParameterKind) -> Option<u32> {
        // Each pose is a little further away.
        let pose = |number: u32| {
            let joints = HOLD.map(|joint| joint * (1.0 - 0.02 * f64::from(number)));
            ARM.forward(&joints).to_slots()
        };
        let poses = (1..=WIDTH).map(pose);
        match kind {
            ParameterKind::Value(PortType::Joints, _) => {
                let joints = HOLD.map(|joint| joint * 0.9);
                Some(self.reals(&joints[..JOINTS as usize]))
            }
            ParameterKind::Value(PortType::Is(Type::Vector3), _) => Some(self.reals(&pose(2)[..3])),
            ParameterKind::Poses(_) => {
                let poses: Vec<f64> = poses.flatten().collect();
                Some(self.reals(&poses))
            }
            ParameterKind::Path(_) => {
                let mut rows = Vec::new();
                for pose in poses {
                    let mut row = [NULL_REAL; leg_row::WIDTH];
                    row[0] = leg_row::LIN;
                    row[1..8].copy_from_slice(&pose);
                    rows.extend(row);
                }
                Some(self.reals(&rows))
            }
            _ => None,
        }
    }

    fn value(
        &mut self,
        ty: Option<PortType>,
        store: Store,
        width: u32,
        default: Option<DefaultValue>,
    ) -> u32 {
        match ty {
            Some(PortType::Is(ty)) if default.is_none() && store == Store::Real => {
                self.composite(ty)
            }
            Some(PortType::Of(family)) if default.is_none() && store == Store::Real => {
                self.composite(member(family))
            }
            Some(PortType::Matrix(..)) if default.is_none() => {
                let rows = (0..width).map(|place| place % (WIDTH + 1) == 0);
                let identity: Vec<f64> = rows.map(|one| f64::from(u8::from(one))).collect();
                self.reals(&identity)
            }
            Some(PortType::Joints) if default.is_none() => self.reals(&HOLD[..JOINTS as usize]),
            _ => self.slot(store, width, default),
        }
    }

    /// A valid value of a type.
    fn composite(&mut self, ty: Type) -> u32 {
        let joints = HOLD.map(|joint| joint * 0.9);
        match ty {
            Type::Real => self.slot(Store::Real, 1, None),
            Type::Pose => self.reals(&ARM.forward(&joints).to_slots()),
            Type::Rotation => self.reals(&[0.0, 0.0, 0.0, 1.0]),
            Type::Matrix(rows, columns) => {
                let places =
                    (0..rows).flat_map(|row| (0..columns).map(move |column| row == column));
                let identity: Vec<f64> = places
                    .map(|diagonal| f64::from(u8::from(diagonal)))
                    .collect();
                self.reals(&identity)
            }
            ty => self.slot(Store::Real, ty.width(), None),
        }
    }

    fn reals(&mut self, values: &[f64]) -> u32 {
        self.data.reals.extend(values);
        (self.data.reals.len() - values.len()) as u32
    }

    /// New slots with a default value, or with a number that differs between primitives.
    fn slot(&mut self, store: Store, width: u32, default: Option<DefaultValue>) -> u32 {
        let data = &mut self.data;
        let end = match store {
            Store::Real => {
                let value = match default {
                    Some(DefaultValue::Real(value)) => value,
                    Some(_) => NULL_REAL,
                    None => 0.5 + f64::from(self.number) / 1024.0,
                };
                data.reals.resize(data.reals.len() + width as usize, value);
                data.reals.len()
            }
            Store::Bool => {
                let value = match default {
                    Some(DefaultValue::Bool(value)) => u8::from(value),
                    Some(_) => NULL_BOOL,
                    None => u8::from(self.number.wrapping_mul(0x9e37_79b9) >> 31 == 1),
                };
                data.bools.resize(data.bools.len() + width as usize, value);
                data.bools.len()
            }
            Store::Int => {
                let value = match default {
                    Some(DefaultValue::Int(value)) => value,
                    Some(_) => NULL_INT,
                    None => i64::from(self.number),
                };
                data.ints.resize(data.ints.len() + width as usize, value);
                data.ints.len()
            }
        };
        end as u32 - width
    }
}

fn channels(kind: ChannelKind) -> u32 {
    match kind {
        ChannelKind::DigitalInput | ChannelKind::DigitalOutput => DIGITAL_MAX as u32,
        ChannelKind::AnalogInput | ChannelKind::AnalogOutput => ANALOG_MAX as u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::Evaluation;

    #[test]
    fn every_kernel_of_the_catalogue_can_be_measured() {
        for row in rows() {
            let net = net(&row, count(&row.entry.spec));
            let mut net = net.unwrap_or_else(|refusal| panic!("{}: {refusal:?}", row.name()));
            let evaluation = net.evaluate(&models(), &devices(), PERIOD_S);
            let ends = row.entry.spec.role == Role::Termination;
            let want = if ends {
                Evaluation::Terminated
            } else {
                Evaluation::Running
            };
            assert!(
                evaluation == want || evaluation == Evaluation::Running,
                "{}",
                row.name()
            );
        }
    }
}
