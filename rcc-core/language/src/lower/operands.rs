//! The operands of an item: the slots of its ports and parameters, its state, and its sizes. Runs on the loader's
//! threads.

use rcc_core::primitive::{
    Dim, Kernel, Operand, ParameterKind, Role, Size, SizeList, Sizes, StateSpec,
};
use rcc_core::primitives;
use rcc_core::types::{Store, Type};

use super::{Lowering, literal};
use crate::resolve::{ResolvedPrimitive, window};
use crate::syntax::stored_value::StoredValue;

/// Returns the start value of an item's state in one arena, if the item has a parameter for it.
fn start_value(item: &ResolvedPrimitive<'_>, store: Store) -> Option<StoredValue> {
    let mut rows = item.spec().parameters.iter().zip(&item.parameters);
    rows.find_map(|(parameter, given)| {
        let ParameterKind::Start(ty, _) = parameter.kind else {
            return None;
        };
        let stored = match (given, parameter.default) {
            (Some(given), _) => given.stored(ty),
            (None, default) => literal(default?).stored(ty),
        };
        stored.filter(|_| ty.store() == Some(store))
    })
}

/// The kernel of a batch, and the sizes at the end of its operands.
pub(super) struct BatchKernel {
    kernel: &'static Kernel,
    sizes: SizeList,
}

impl BatchKernel {
    /// Returns the kernel with this number.
    pub(super) fn of(number: u16) -> Option<BatchKernel> {
        let (entry, kernel) = primitives::kernel(number)?;
        let sizes = entry.spec.sizes(kernel);
        Some(BatchKernel { kernel, sizes })
    }
}

impl Lowering<'_> {
    /// Appends the operands of an item in the order of `Spec::operands`: inputs, outputs, parameters, state, clock,
    /// width.
    pub(super) fn operands(
        &mut self,
        number: usize,
        kernel: Option<&BatchKernel>,
        operands: &mut Vec<u32>,
    ) {
        let item = self.item(number);
        let spec = item.spec();
        let ports = [self.slots.inputs(number), self.slots.outputs(number)];
        operands.extend(
            ports
                .iter()
                .flat_map(|slots| slots.iter().map(|slot| slot.slot)),
        );
        for (parameter, literal) in spec.parameters.iter().zip(&item.parameters) {
            match parameter.kind {
                ParameterKind::Value(..) | ParameterKind::Poses(_) | ParameterKind::Path(_) => {
                    let Some((ty, _)) = parameter.kind.value() else {
                        continue;
                    };
                    let ty = self.net.inferred.port_type(self.net.graph, number, ty);
                    let ty = ty.unwrap_or(Type::Real);
                    let slot = match (literal, parameter.default) {
                        (None, Some(value)) => self.default(value, ty),
                        _ => self.constant(*literal, ty),
                    };
                    operands.push(slot.slot);
                }
                ParameterKind::Word(words) => {
                    let default = parameter.default.map(super::literal);
                    let word = literal.or(default.as_ref());
                    let place = word.and_then(|word| word.word(words)).unwrap_or(0);
                    let stored = StoredValue::int(place as i64);
                    operands.push(self.arena.constant(&stored).slot);
                }
                ParameterKind::Arm | ParameterKind::Device => {
                    operands.push(item.device.map_or(u32::MAX, |device| device as u32));
                }
                ParameterKind::Channel(_) => {
                    operands.push(item.channel.map_or(u32::MAX, |(channel, _)| channel));
                }
                _ => {}
            }
        }
        self.place_state(item, operands);
        let Some(BatchKernel {
            kernel,
            sizes: list,
        }) = kernel
        else {
            return;
        };
        let sizes = self.sizes(number, list);
        self.place_memory(number, kernel, &sizes, operands);
        if spec.role == Role::Motion {
            operands.push(self.clocks);
            self.clocks += 1;
        }
        operands.extend(list.iter().map(|size| sizes.get(size)));
    }

    /// Returns the sizes of an item.
    fn sizes(&self, number: usize, list: &SizeList) -> Sizes {
        let (item, inferred) = (self.item(number), self.net.inferred);
        let mut sizes = Sizes::ONE;
        for size in list.iter() {
            let value = match size {
                Size::Open => {
                    let open = item.spec().types().find(|ty| ty.is_wide());
                    let ty = open.and_then(|ty| inferred.port_type(self.net.graph, number, ty));
                    ty.map(Type::width)
                }
                Size::Dim(index) => inferred.length(number, Dim::Var(index)).map(u32::from),
                Size::Cycles => window(item, self.net.graph),
            };
            // The checks refuse nets with unknown sizes.
            sizes.set(size, value.unwrap_or(0));
        }
        sizes
    }

    /// Allocates slots for the past values that a primitive stores, and appends their operand.
    fn place_memory(
        &mut self,
        number: usize,
        kernel: &Kernel,
        sizes: &Sizes,
        operands: &mut Vec<u32>,
    ) {
        let item = self.item(number);
        let memory = &item.spec().memory;
        let Some(Operand::Slot { store, width, .. }) = item.spec().memory_operand(kernel) else {
            return;
        };
        let scalar = match store {
            Store::Real => Type::Real,
            Store::Bool => Type::Bool,
            Store::Int => Type::Int,
        };
        let mut rows = item.spec().parameters.iter().zip(&item.parameters);
        let first = rows.find_map(|(parameter, given)| {
            matches!(parameter.kind, ParameterKind::First(_)).then_some(*given)
        });
        let open = self.net.inferred.open_type(number);
        let given = first.flatten().zip(open);
        let start = given.and_then(|(literal, ty)| literal.stored(ty));
        let start = start.or_else(|| literal(memory.start).stored(scalar));
        let start = start.unwrap_or_else(|| StoredValue::null(scalar));
        let count = sizes.width(width).checked_div(start.width()).unwrap_or(0);
        operands.push(self.arena.repeated(&start, count));
    }

    /// Allocates slots for the state of a primitive with its start values, and appends their operands.
    fn place_state(&mut self, item: &ResolvedPrimitive<'_>, operands: &mut Vec<u32>) {
        let spec = item.spec();
        let StateSpec { reals, bools, ints } = spec.state;
        let counts = [
            (reals, Store::Real),
            (bools, Store::Bool),
            (ints, Store::Int),
        ];
        for (count, store) in counts.into_iter().filter(|(count, _)| *count > 0) {
            let start = start_value(item, store).unwrap_or_else(|| match store {
                Store::Real => StoredValue::null(Type::Real),
                Store::Bool => StoredValue::null(Type::Bool),
                // Counters start at 0, see `rcc_core::primitive::StateSpec`.
                Store::Int => StoredValue::int(0),
            });
            operands.push(self.arena.repeated(&start, count));
        }
    }
}
