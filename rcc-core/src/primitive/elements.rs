//! Shared parts of primitives that reduce an array to one value: their ports, and the fold from the first element to
//! the last. The specs are read by the loader, the kernels by the real-time thread.

use super::{
    Bool, Dim, Element, ElementType, Int, Kernel, Operation, Port, PortType, Real, Slot, Spec,
    UnitRule, choose, each, operands,
};
use crate::frame::Frame;
use crate::types::{NULL_BOOL, Store, Type};

/// Spec of a primitive that reduces an array of numbers to one number.
pub const ELEMENTS: Spec = Spec {
    null: "a null element gives null",
    inputs: &[Port::new(
        "in",
        PortType::Array(ElementType::Open, Dim::Var(0)),
        UnitRule::Var(0),
        "an array of numbers",
    )],
    outputs: &[Port::number("out", UnitRule::Var(0), "result")],
    ..Spec::PLAIN
};

/// Spec of a primitive that reduces an array of Bools; the primitive adds its output.
pub const TRUTHS: Spec = Spec {
    null: "a null element gives null",
    inputs: &[Port::new(
        "in",
        PortType::Array(ElementType::Are(Type::Bool), Dim::Var(0)),
        UnitRule::Typed,
        "an array of Bools",
    )],
    ..Spec::PLAIN
};

operands! {
    struct Elements<E> { input: Slot<E>, out: Slot<E>, length: u32 }
}

/// The kernels that reduce an array of numbers from the first element to the last; null if an element is null.
pub const fn reduce<O: Operation<Real> + Operation<Int>>() -> [Kernel; 2] {
    [
        Kernel::of(Store::Real, fold::<Real, O>),
        Kernel::of(Store::Int, fold::<Int, O>),
    ]
}

#[inline(always)]
fn fold<E: Element, O: Operation<E>>(frame: &mut Frame<'_>, operands: &[u32]) {
    each(frame, operands, |frame, array: Elements<E>| {
        let mut result = frame.get(array.input)?;
        for i in 1..array.length {
            result = O::apply(result, frame.get(array.input + i)?);
        }
        frame.put(array.out, result)
    });
}

/// `Bool[n] → Bool` on the lowest bit, starting with `first`: null if an element is null.
#[inline(always)]
pub fn fold_bool(
    frame: &mut Frame<'_>,
    operands: &[u32],
    first: u8,
    operation: impl Fn(u8, u8) -> u8,
) {
    each(frame, operands, |frame, array: Elements<Bool>| {
        let (mut result, mut null) = (first, 0);
        for i in 0..array.length {
            let value = frame.get(array.input + i)?;
            null |= value & NULL_BOOL;
            result = operation(result, value & 1);
        }
        frame.put(array.out, choose(null != 0, NULL_BOOL, result))
    });
}
