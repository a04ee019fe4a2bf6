//! Constant folding: an operation on constants is computed when the net is loaded, by the kernel that would compute it in
//! the cycle. Runs on the loader's threads.

use rcc_core::frame::Frame;
use rcc_core::primitive::{Operand, Port, PortType, Spec, UnitRule};
use rcc_core::primitives::{self, CatalogueEntry, Subject};
use rcc_core::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store, Type};
use rcc_core::unit::Unit;

use crate::syntax::literal::LiteralShape;

/// Subjects whose functions depend on their inputs alone, not on the time or on a device.
const TIMELESS: &[&str] = &["Logic", "Arithmetic", "Selection and null"];

/// Returns the value of a primitive for constant inputs; `None` if it is left to the cycle. That is so for null and for
/// everything that is not a single number or truth value, if units do not fit (which is reported for the primitive), and
/// if the result would depend on whether a whole number is an `Int` or a `Real`.
#[must_use]
pub fn fold(spec: &Spec, inputs: &[&LiteralShape]) -> Option<LiteralShape> {
    let timeless = TIMELESS.contains(&Subject::of(spec.name)?.title);
    let [output] = spec.outputs else { return None };
    if !timeless || inputs.len() != spec.inputs.len() || !spec.parameters.is_empty() {
        return None;
    }
    let mut ports = spec.inputs.iter().zip(inputs);
    if !ports.all(|(port, constant)| is_in_range(port, constant)) {
        return None;
    }
    let unit = unit_of(spec, inputs)?;
    let (_, entry) = primitives::find(spec.name)?;
    if output.ty == PortType::Is(Type::Bool) || has_truth(inputs) {
        return truth(entry, inputs);
    }
    if !(output.ty == PortType::Is(Type::Real) || output.ty.is_open()) {
        return None;
    }
    let real = number(evaluate(entry, inputs, Store::Real)?)?;
    let is_whole = |constant: &&LiteralShape| matches!(constant, LiteralShape::Int(_));
    if !output.ty.is_open() || !inputs.iter().all(is_whole) {
        return Some(LiteralShape::Real(real, unit));
    }
    match evaluate(entry, inputs, Store::Int)? {
        #[allow(clippy::cast_precision_loss)] // Then the bits differ.
        LiteralShape::Int(whole) if (whole as f64).to_bits() == real.to_bits() => {
            Some(LiteralShape::Int(whole))
        }
        _ => None,
    }
}

fn has_truth(inputs: &[&LiteralShape]) -> bool {
    let is_truth = |constant: &&LiteralShape| matches!(constant, LiteralShape::Bool(_));
    inputs.iter().any(is_truth)
}

fn number(shape: LiteralShape) -> Option<f64> {
    match shape {
        LiteralShape::Real(value, _) => Some(value),
        _ => None,
    }
}

/// Returns the truth value of a comparison or a logic operation; the arenas of all types that its inputs may have agree
/// on it.
fn truth(entry: &CatalogueEntry, inputs: &[&LiteralShape]) -> Option<LiteralShape> {
    let stores = [Store::Bool, Store::Int, Store::Real];
    let found = stores.map(|store| evaluate(entry, inputs, store));
    let mut found = found.into_iter().flatten();
    let first = found.next()?;
    let agreed = matches!(first, LiteralShape::Bool(_)) && found.all(|other| other == first);
    agreed.then_some(first)
}

/// Returns false for a constant that the check of ranges refuses, and for one that is not a number or truth value.
fn is_in_range(port: &Port, constant: &LiteralShape) -> bool {
    let value = match constant {
        LiteralShape::Bool(_) => return true,
        #[allow(clippy::cast_precision_loss)] // Ranges are small numbers.
        LiteralShape::Int(value) => *value as f64,
        LiteralShape::Real(value, _) => *value,
        _ => return false,
    };
    port.least.is_none_or(|least| value >= least)
        && port.greatest.is_none_or(|greatest| value <= greatest)
}

/// Returns the unit of the result, `Some(None)` for a bare number; `None` if the units do not fit.
fn unit_of(spec: &Spec, inputs: &[&LiteralShape]) -> Option<Option<Unit>> {
    let mut variables: [Option<Unit>; 4] = [None; 4];
    for (port, constant) in spec.inputs.iter().zip(inputs) {
        let LiteralShape::Real(_, Some(unit)) = constant else {
            continue;
        };
        match port.unit {
            UnitRule::Is(wanted) if wanted == *unit => {}
            UnitRule::Var(index) => {
                let variable = variables.get_mut(usize::from(index))?;
                if variable.is_some_and(|known| known != *unit) {
                    return None;
                }
                *variable = Some(*unit);
            }
            _ => return None,
        }
    }
    let of = |index: u8| variables.get(usize::from(index)).copied().flatten();
    // In a product with a number that has a unit, a bare number has the unit 1.
    let both = |a: u8, b: u8| match (of(a), of(b)) {
        (None, None) => None,
        (a, b) => Some((a.unwrap_or(Unit::ONE), b.unwrap_or(Unit::ONE))),
    };
    match spec.outputs.first()?.unit {
        UnitRule::Is(unit) => Some(Some(unit)),
        UnitRule::Typed => Some(None),
        UnitRule::Var(index) => Some(of(index)),
        UnitRule::Product(a, b) => Some(both(a, b).map(|(a, b)| a.times(b))),
        UnitRule::Quotient(a, b) => Some(both(a, b).map(|(a, b)| a.per(b))),
        UnitRule::Root(index) => match of(index) {
            None => Some(None),
            Some(unit) => unit.root().map(Some),
        },
        _ => None,
    }
}

/// Runs the kernel of an arena once. Returns `None` if the arena has no kernel, if a
/// constant does not fit, and for null.
fn evaluate(
    entry: &CatalogueEntry,
    inputs: &[&LiteralShape],
    store: Store,
) -> Option<LiteralShape> {
    let spec = &entry.spec;
    let mut ports = spec.inputs.iter().chain(spec.outputs);
    let open = ports.any(|port| port.ty.is_open()).then_some(store);
    let kernel = entry.kernels.get(entry.kernel_for(open, 1)?)?;
    let (mut reals, mut bools, mut ints) = (Vec::new(), Vec::new(), Vec::new());
    let mut operands = Vec::new();
    let mut constants = inputs.iter();
    let mut result = None;
    for operand in spec.operands(kernel) {
        let store = match operand {
            Operand::Slot { store, .. } => store,
            Operand::Size(_) => {
                operands.push(1);
                continue;
            }
            _ => return None,
        };
        let constant = constants.next();
        let slot = match (store, constant) {
            (Store::Real, constant) => {
                let value = match constant {
                    None => NULL_REAL,
                    #[allow(clippy::cast_precision_loss)] // As a constant at a port of reals.
                    Some(LiteralShape::Int(value)) => *value as f64,
                    Some(LiteralShape::Real(value, _)) => *value,
                    Some(_) => return None,
                };
                push(&mut reals, value)
            }
            (Store::Bool, None) => push(&mut bools, NULL_BOOL),
            (Store::Bool, Some(LiteralShape::Bool(value))) => push(&mut bools, u8::from(*value)),
            (Store::Int, None) => push(&mut ints, NULL_INT),
            (Store::Int, Some(LiteralShape::Int(value))) => push(&mut ints, *value),
            _ => return None,
        };
        if constant.is_none() && result.is_none() {
            result = Some((store, slot as usize));
        }
        operands.push(slot);
    }
    let mut frame = Frame {
        reals: &mut reals,
        bools: &mut bools,
        ints: &mut ints,
        models: &[],
        devices: &[],
        arms: &[],
        outputs: &mut [],
        motions: &mut (),
        dt_s: 0.0,
        cycle: 0,
        cancel_requested: false,
        terminated: false,
        outcome: 0,
        motion_failed: false,
    };
    (kernel.run)(&mut frame, &operands);
    match result? {
        (Store::Real, slot) => {
            let value = *reals.get(slot)?;
            value.is_finite().then_some(LiteralShape::Real(value, None))
        }
        (Store::Bool, slot) => match *bools.get(slot)? {
            NULL_BOOL => None,
            value => Some(LiteralShape::Bool(value == 1)),
        },
        (Store::Int, slot) => match *ints.get(slot)? {
            NULL_INT => None,
            value => Some(LiteralShape::Int(value)),
        },
    }
}

fn push<T>(arena: &mut Vec<T>, value: T) -> u32 {
    arena.push(value);
    // A primitive has a handful of operands.
    arena.len() as u32 - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::functions::spec;

    fn real(value: f64) -> LiteralShape {
        LiteralShape::Real(value, None)
    }

    #[test]
    fn numbers_are_computed_by_the_kernels() {
        let millimetres = LiteralShape::Real(0.003, Some(Unit::METRE));
        let seconds = LiteralShape::Real(2.0, Some(Unit::SECOND));
        let (two, three) = (LiteralShape::Int(2), LiteralShape::Int(3));
        for (primitive, inputs, want) in [
            ("Add", vec![&two, &three], Some(LiteralShape::Int(5))),
            (
                "Add",
                vec![&two, &millimetres],
                Some(LiteralShape::Real(2.003, Some(Unit::METRE))),
            ),
            ("Add", vec![&seconds, &millimetres], None),
            ("Divide", vec![&two, &three], Some(real(2.0 / 3.0))),
            (
                "Divide",
                vec![&millimetres, &seconds],
                Some(LiteralShape::Real(
                    0.0015,
                    Some(Unit::METRE.per(Unit::SECOND)),
                )),
            ),
            ("Less", vec![&two, &three], Some(LiteralShape::Bool(true))),
            (
                "Less",
                vec![&two, &real(1.5)],
                Some(LiteralShape::Bool(false)),
            ),
            ("SquareRoot", vec![&real(2.0)], Some(real(2.0_f64.sqrt()))),
        ] {
            assert_eq!(
                fold(spec(primitive), &inputs),
                want,
                "{primitive} {inputs:?}"
            );
        }
    }

    #[test]
    fn what_depends_on_the_type_or_is_null_is_left_to_the_cycle() {
        let (zero, large) = (LiteralShape::Int(0), LiteralShape::Int(i64::MAX));
        for (primitive, inputs) in [
            // As a Real, -0 is not 0.
            ("Negate", vec![&zero]),
            ("Add", vec![&large, &large]),
            ("Divide", vec![&large, &zero]),
            ("Add", vec![&LiteralShape::Null, &zero]),
            ("Round", vec![&zero]),
        ] {
            assert_eq!(
                fold(spec(primitive), &inputs),
                None,
                "{primitive} {inputs:?}"
            );
        }
    }
}
