//! The meaning of each number in a plan's operand list. The loader writes operands, `Plan::check` verifies them and
//! kernels read them; all three follow [`Spec::operands`]. Not used in the cycle.

use super::{ChannelKind, Dim, Kernel, Parameter, ParameterKind, PortType, Role, Spec};
use crate::types::{Store, Type};

/// Maximum number of length variables of a primitive.
pub const DIMS_MAX: usize = 4;
/// Maximum number of sizes of a primitive: the open one, lengths, and that of a window.
const SIZES_MAX: usize = DIMS_MAX + 2;
/// Maximum number of evaluations that a window or delay line spans.
pub const CYCLES_MAX: u32 = 10_000;

/// A size that is fixed per use of a primitive and passed as an operand of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Number of elements of a value of the open type, or number of joints.
    Open,
    /// A length variable.
    Dim(u8),
    /// Length of a window in evaluations, 1 to [`CYCLES_MAX`].
    Cycles,
}

/// The number of elements of a slot operand: a constant times at most two sizes, or times their sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Width {
    /// The constant factor.
    pub times: u32,
    /// The sizes.
    pub sizes: [Option<Size>; 2],
    /// The sizes are added, not multiplied.
    pub sum: bool,
}

impl Width {
    /// A fixed number of elements.
    pub const fn fixed(times: u32) -> Width {
        Width {
            times,
            sizes: [None, None],
            sum: false,
        }
    }

    /// As many elements as `size`.
    pub const fn of(size: Size) -> Width {
        Width {
            times: 1,
            sizes: [Some(size), None],
            sum: false,
        }
    }

    /// As many elements as the product of both sizes.
    pub const fn product(a: Size, b: Size) -> Width {
        Width {
            times: 1,
            sizes: [Some(a), Some(b)],
            sum: false,
        }
    }
}

/// The sizes among the operands of a kernel, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SizeList([Option<Size>; SIZES_MAX]);

impl SizeList {
    /// Returns the sizes.
    pub fn iter(&self) -> impl Iterator<Item = Size> + use<> {
        self.0.into_iter().flatten()
    }
}

/// The sizes of one use of a primitive; a size that is not an operand of its kernel is 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    open: u32,
    dims: [u32; DIMS_MAX],
    cycles: u32,
}

impl Sizes {
    /// All sizes are 1.
    pub const ONE: Sizes = Sizes {
        open: 1,
        dims: [1; DIMS_MAX],
        cycles: 1,
    };

    /// Reads the sizes at the end of an operand group.
    pub fn read(sizes: &SizeList, group: &[u32]) -> Sizes {
        let mut read = Sizes::ONE;
        let tail = group.len().saturating_sub(sizes.iter().count());
        let values = group.get(tail..).unwrap_or(&[]);
        for (size, value) in sizes.iter().zip(values) {
            read.set(size, *value);
        }
        read
    }

    /// Returns one size.
    pub fn get(&self, size: Size) -> u32 {
        match size {
            Size::Open => self.open,
            Size::Dim(index) => self.dims.get(usize::from(index)).copied().unwrap_or(1),
            Size::Cycles => self.cycles,
        }
    }

    /// Sets one size.
    pub fn set(&mut self, size: Size, value: u32) {
        match size {
            Size::Open => self.open = value,
            Size::Dim(index) => {
                if let Some(place) = self.dims.get_mut(usize::from(index)) {
                    *place = value;
                }
            }
            Size::Cycles => self.cycles = value,
        }
    }

    /// Returns the number of elements of a slot operand; saturates at `u32::MAX`, which exceeds every arena.
    pub fn width(&self, width: Width) -> u32 {
        let sizes = width.sizes.into_iter().flatten().map(|size| self.get(size));
        if width.sum {
            return sizes
                .fold(0, u32::saturating_add)
                .saturating_mul(width.times);
        }
        sizes.fold(width.times, u32::saturating_mul)
    }

    /// Returns the number of elements that one evaluation may access for each operand.
    pub fn work(&self) -> u64 {
        let sizes = self.dims.iter().chain([&self.open]);
        sizes.fold(1, |product: u64, size| {
            product.saturating_mul(u64::from((*size).max(1)))
        })
    }
}

/// The meaning of a number in the operand list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operand {
    /// Index of the first element in the arena of `store`.
    Slot {
        /// The arena.
        store: Store,
        /// Number of elements.
        width: Width,
        /// The kernel writes it.
        written: bool,
    },
    /// Index of a device that has an arm.
    Arm,
    /// Index of a device.
    Device,
    /// Index of a channel of the device before it.
    Channel(ChannelKind),
    /// Index of a motion, which is also that of its path clock.
    Clock,
    /// One of the sizes.
    Size(Size),
}

/// State of a primitive besides its [`super::StateSpec`]: values of its open type, either a fixed number or a number
/// for each evaluation of a window. It is one block in the arena of that type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MemorySpec {
    /// Number of values; 0: none.
    pub values: u32,
    /// The number is for each evaluation of the window that a [`ParameterKind::Window`] gives.
    pub window: bool,
    /// The arena of the values, whatever the open type is; `None`: the arena of the open type.
    pub store: Option<Store>,
    /// Start value of every element, unless a [`ParameterKind::First`] gives it.
    pub start: super::DefaultValue,
}

impl MemorySpec {
    /// No state.
    pub const NONE: MemorySpec = MemorySpec {
        values: 0,
        window: false,
        store: None,
        start: super::DefaultValue::Null,
    };

    /// `values` values of the open type that start as null.
    pub const fn values(values: u32) -> MemorySpec {
        MemorySpec {
            values,
            ..MemorySpec::NONE
        }
    }

    /// `values` values of the open type for each evaluation of the window; they start as null.
    pub const fn window(values: u32) -> MemorySpec {
        MemorySpec {
            values,
            window: true,
            ..MemorySpec::NONE
        }
    }

    /// Places the values in this arena, whatever the open type is.
    pub const fn of(self, store: Store) -> MemorySpec {
        MemorySpec {
            store: Some(store),
            ..self
        }
    }

    /// Sets the start value.
    pub const fn starting(self, start: super::DefaultValue) -> MemorySpec {
        MemorySpec { start, ..self }
    }

    /// Returns the operand; `open` is the arena of the open type.
    fn operand(&self, open: Option<Store>) -> Option<Operand> {
        let values = if self.store.is_none() {
            Some(Size::Open)
        } else {
            None
        };
        let cycles = if self.window {
            Some(Size::Cycles)
        } else {
            None
        };
        (self.values > 0).then(|| Operand::Slot {
            store: self.store.or(open).unwrap_or(Store::Real),
            width: Width {
                times: self.values,
                sizes: [values, cycles],
                sum: false,
            },
            written: true,
        })
    }
}

/// Returns the operand of a port, for a kernel whose open ports are in the arena `open`.
fn slot(ty: PortType, open: Option<Store>, written: bool) -> Operand {
    let open = open.unwrap_or(Store::Real);
    let (store, width) = match ty {
        PortType::Is(ty) => (ty.store().unwrap_or(Store::Real), Width::fixed(ty.width())),
        PortType::Any | PortType::Linear | PortType::Of(_) => (open, Width::of(Size::Open)),
        PortType::Scalar | PortType::Number | PortType::Part => (open, Width::fixed(1)),
        PortType::Joints => (Store::Real, Width::of(Size::Open)),
        PortType::JointColumns(rows) => (
            Store::Real,
            Width {
                times: rows as u32,
                ..Width::of(Size::Open)
            },
        ),
        PortType::Array(elements, length) => (elements.store().unwrap_or(open), of_dim(length)),
        PortType::Matrix(rows, columns) => {
            let (rows, columns) = (of_dim(rows), of_dim(columns));
            let times = rows.times * columns.times;
            let [a, b] = [rows.sizes, columns.sizes].map(|[size, _]| size);
            (
                Store::Real,
                Width {
                    times,
                    sizes: [a, b],
                    sum: false,
                },
            )
        }
        PortType::Many(length) => {
            let [count, _] = of_dim(length).sizes;
            let sizes = [Some(Size::Open), count];
            (
                open,
                Width {
                    times: 1,
                    sizes,
                    sum: false,
                },
            )
        }
    };
    Operand::Slot {
        store,
        width,
        written,
    }
}

fn of_dim(dim: Dim) -> Width {
    match dim {
        Dim::Is(length) => Width::fixed(length as u32),
        Dim::Var(index) | Dim::Small(index) => Width::of(Size::Dim(index)),
        Dim::Sum(a, b) => Width {
            sum: true,
            ..Width::product(Size::Dim(a), Size::Dim(b))
        },
    }
}

fn parameter_operand(parameter: &Parameter, store: Option<Store>) -> Option<Operand> {
    match parameter.kind {
        ParameterKind::Value(ty, _) => Some(slot(ty, store, false)),
        ParameterKind::Poses(_) | ParameterKind::Path(_) => {
            let (ty, _) = parameter.kind.value()?;
            Some(slot(ty, store, false))
        }
        ParameterKind::Word(_) => Some(slot(PortType::Is(Type::Int), store, false)),
        ParameterKind::Arm => Some(Operand::Arm),
        ParameterKind::Device => Some(Operand::Device),
        ParameterKind::Channel(kind) => Some(Operand::Channel(kind)),
        _ => None,
    }
}

impl Spec {
    /// Returns the types of all ports and of all parameters that are values.
    pub fn types(&self) -> impl Iterator<Item = PortType> + use<'_> {
        let ports = self.inputs.iter().chain(self.outputs).map(|port| port.ty);
        let values = self
            .parameters
            .iter()
            .filter_map(|parameter| Some(parameter.kind.value()?.0));
        ports.chain(values)
    }

    /// Returns true for a primitive that commands a device: a unique resource.
    #[must_use]
    pub fn commands_device(&self) -> bool {
        matches!(self.role, Role::CommandsArm | Role::CommandsChannel)
    }

    /// Returns true if the primitive accepts values of several widths; the operands of a kernel that is not for
    /// single-element values then include the width.
    pub fn is_wide(&self) -> bool {
        self.types().any(PortType::is_wide)
    }

    /// Returns the sizes at the end of this kernel's operands, in order.
    pub fn sizes(&self, kernel: &Kernel) -> SizeList {
        let open = (self.is_wide() && !kernel.single).then_some(Size::Open);
        let dims = (0..DIMS_MAX as u8).filter(|dim| self.types().any(|ty| ty.has_dim(*dim)));
        let cycles = self.memory.window.then_some(Size::Cycles);
        let mut list = [None; SIZES_MAX];
        let sizes = open.into_iter().chain(dims.map(Size::Dim)).chain(cycles);
        for (place, size) in list.iter_mut().zip(sizes) {
            *place = Some(size);
        }
        SizeList(list)
    }

    /// Returns the operand for the primitive's memory in this kernel.
    pub fn memory_operand(&self, kernel: &Kernel) -> Option<Operand> {
        self.memory.operand(kernel.store)
    }

    /// Returns the names of the inputs, outputs and of those parameters that are operands, in operand order.
    pub fn operand_names(&self) -> impl Iterator<Item = &'static str> + Clone + use<'_> {
        let ports = self.inputs.iter().chain(self.outputs).map(|port| port.name);
        let parameters = self.parameters.iter();
        let parameters =
            parameters.filter(|parameter| parameter_operand(parameter, None).is_some());
        ports.chain(parameters.map(|parameter| parameter.name))
    }

    /// Returns the operands of a kernel of this primitive, in order: inputs, outputs, parameters, state (reals, bools,
    /// ints), memory, path clock, sizes. This order is the contract between loader, check and kernels.
    pub fn operands(&self, kernel: &Kernel) -> impl Iterator<Item = Operand> + use<'_> {
        let sizes = self.sizes(kernel).iter();
        self.operands_before_sizes(kernel)
            .chain(sizes.map(Operand::Size))
    }

    /// Returns the operands of a kernel of this primitive that come before the sizes.
    pub(crate) fn operands_before_sizes(
        &self,
        kernel: &Kernel,
    ) -> impl Iterator<Item = Operand> + use<'_> {
        let store = kernel.store;
        let state = [
            (Store::Real, self.state.reals),
            (Store::Bool, self.state.bools),
            (Store::Int, self.state.ints),
        ];
        let inputs = self.inputs.iter().map(move |p| slot(p.ty, store, false));
        let outputs = self.outputs.iter().map(move |p| slot(p.ty, store, true));
        let parameters = self
            .parameters
            .iter()
            .filter_map(move |parameter| parameter_operand(parameter, store));
        let state = state.into_iter().filter(|(_, count)| *count > 0);
        let state = state.map(|(store, count)| Operand::Slot {
            store,
            width: Width::fixed(count),
            written: true,
        });
        let clock = (self.role == Role::Motion).then_some(Operand::Clock);
        inputs
            .chain(outputs)
            .chain(parameters)
            .chain(state)
            .chain(self.memory.operand(store))
            .chain(clock)
    }

    /// Returns true if the operands of this kernel include the width of open or joint ports.
    pub fn has_width(&self, kernel: &Kernel) -> bool {
        self.is_wide() && !kernel.single
    }
}
