//! Values that come from outside: where the executor writes them, when they expire and within which bounds; and values for
//! other nets. The loader's threads.

use rcc_core::plan::{InputPoint, PublishPoint};
use rcc_core::primitive::{Port, Role};
use rcc_core::topic::Topic;
use rcc_core::types::{NULL_INT, Type};

use super::{Lowering, Slot};
use crate::names::port_names;
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
            topic: self.topic(number, item.spec().outputs.first()?, value),
        })
    }

    /// By `Publish` primitive, in the order of the topics' keys.
    pub(super) fn publishes(&self) -> Vec<PublishPoint> {
        let items = self.net.graph.items.iter().enumerate();
        let items = items.filter(|(_, item)| item.spec().role == Role::Publish);
        let point = |(number, item): (usize, &Item<'_>)| {
            let slot = *self.slots.get(number)?.outputs.first()?;
            Some(PublishPoint {
                topic: self.topic(number, item.spec().outputs.first()?, slot)?,
                store: slot.store,
                slot: slot.slot,
                width: slot.width,
            })
        };
        let mut points: Vec<_> = items.filter_map(point).collect();
        points.sort_unstable_by_key(|point| point.topic.key);
        points
    }

    fn topic(&self, number: usize, port: &Port, slot: Slot) -> Option<Topic> {
        let topic = self.item(number).topic()?;
        let names = port_names(self.net, number, port, slot);
        let unit = names.unit.unwrap_or_default();
        Some(Topic::new(topic, &names.type_name, &unit))
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
