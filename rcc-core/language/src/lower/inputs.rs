//! Values that are set from outside: where the executor writes them, when they expire and within which bounds.
//! The loader's threads.

use rcc_core::plan::InputPoint;
use rcc_core::primitive::Role;
use rcc_core::types::{NULL_INT, Type};

use super::{Lowering, Slot};
use crate::resolve::Item;
use crate::syntax::literal::{Literal, Shape, Stored};

/// So far a number of evaluations may be from a whole one and still be meant as it: times are written in decimals.
const ROUNDING: f64 = 1e-6;

impl Lowering<'_> {
    /// By `Input` primitive, in the order of the text.
    pub(super) fn inputs(&mut self) -> Vec<InputPoint> {
        let items = 0..self.net.graph.items.len();
        items.filter_map(|number| self.input(number)).collect()
    }

    fn input(&mut self, number: usize) -> Option<InputPoint> {
        let item = self.item(number);
        let [value, age] = self.slots.get(number)?.outputs.as_slice() else {
            return None;
        };
        if item.spec().role != Role::Input {
            return None;
        }
        let (value, age) = (*value, age.slot);
        let ty = self.port_type(number, item.spec().outputs.first()?);
        let since = self.arena.variable(&Stored::Ints(vec![NULL_INT])).slot;
        Some(InputPoint {
            store: value.store,
            slot: value.slot,
            width: value.width,
            since,
            age,
            expires: self.expires(item),
            at_least: self.bound(item, "at_least", ty).map(|slot| slot.slot),
            at_most: self.bound(item, "at_most", ty).map(|slot| slot.slot),
        })
    }

    /// Evaluations after which a value is null; 0 = never.
    fn expires(&self, item: &Item<'_>) -> u32 {
        let seconds = given(item, "expires").and_then(Literal::number);
        seconds.map_or(0, |seconds| {
            let evaluations = seconds * self.net.graph.evaluations_hz();
            // A cast of what is larger gives the largest number: years.
            (evaluations - ROUNDING).ceil().max(1.0) as u32
        })
    }

    fn bound(&mut self, item: &Item<'_>, name: &str, ty: Type) -> Option<Slot> {
        let stored = given(item, name)?.stored(ty)?;
        Some(self.arena.constant(&stored))
    }
}

/// A parameter that is given and not null.
pub(crate) fn given<'a>(item: &Item<'a>, name: &str) -> Option<&'a Literal> {
    let mut rows = item.spec().parameters.iter().zip(&item.parameters);
    let (_, literal) = rows.find(|(parameter, _)| parameter.name == name)?;
    literal.filter(|literal| literal.shape != Shape::Null)
}
