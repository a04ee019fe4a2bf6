//! Values that are set from outside: their slots, expiry and bounds; and values that are published for other nets. Runs
//! on the loader's threads.

use rcc_core::plan::{InputPoint, PublishPoint};
use rcc_core::primitive::{Port, Role};
use rcc_core::topic::Topic;
use rcc_core::types::{NULL_INT, Type};

use super::{Lowering, SlotRange};
use crate::resolve::ResolvedPrimitive;
use crate::syntax::literal::Literal;
use crate::syntax::stored_value::StoredValue;

/// Tolerance within which a number of evaluations counts as whole: times are written in decimals.
const ROUNDING: f64 = 1e-6;

impl Lowering<'_> {
    /// Returns the inputs, by `Input` or `Subscribe` primitive in the order of the text.
    pub(super) fn inputs(&mut self) -> Vec<InputPoint> {
        let items = 0..self.net.graph.items.len();
        items.filter_map(|number| self.input(number)).collect()
    }

    fn input(&mut self, number: usize) -> Option<InputPoint> {
        let item = self.item(number);
        let [value, age] = *self.slots.outputs(number) else {
            return None;
        };
        if item.spec().role != Role::Input {
            return None;
        }
        let age = age.slot;
        let ty = self.port_type(number, item.spec().outputs.first()?);
        let since = self.arena.variable(&StoredValue::int(NULL_INT)).slot;
        Some(InputPoint {
            store: value.store,
            slot: value.slot,
            width: value.width,
            since,
            age,
            expires: self.expires(item),
            at_least: self.bound(item, "at_least", ty).map(|slot| slot.slot),
            at_most: self.bound(item, "at_most", ty).map(|slot| slot.slot),
            topic: self.topic(number, item.spec().outputs.first()?),
        })
    }

    /// Returns the published values, by `Publish` primitive in the order of the topics' keys.
    pub(super) fn publishes(&self) -> Vec<PublishPoint> {
        let items = self.net.graph.items.iter().enumerate();
        let items = items.filter(|(_, item)| item.spec().role == Role::Publish);
        let point = |(number, item): (usize, &ResolvedPrimitive<'_>)| {
            let slot = *self.slots.outputs(number).first()?;
            Some(PublishPoint {
                topic: self.topic(number, item.spec().outputs.first()?)?,
                store: slot.store,
                slot: slot.slot,
                width: slot.width,
            })
        };
        let mut points: Vec<_> = items.filter_map(point).collect();
        points.sort_unstable_by_key(|point| point.topic.key);
        points
    }

    fn topic(&self, number: usize, port: &Port) -> Option<Topic> {
        let topic = self.item(number).topic()?;
        let (type_name, unit) = self.net.port_texts(number, port);
        Some(Topic::new(topic, &type_name, &unit.unwrap_or_default()))
    }

    /// Returns the number of evaluations after which the value becomes null; 0 for never.
    fn expires(&self, item: &ResolvedPrimitive<'_>) -> u32 {
        let seconds = item.given("expires").and_then(Literal::number);
        seconds.map_or(0, |seconds| {
            let evaluations = seconds * self.net.graph.evaluations_hz();
            // The cast saturates at the largest number, which is years.
            (evaluations - ROUNDING).ceil().max(1.0) as u32
        })
    }

    fn bound(&mut self, item: &ResolvedPrimitive<'_>, name: &str, ty: Type) -> Option<SlotRange> {
        let stored = item.given(name)?.stored(ty)?;
        Some(self.arena.constant(&stored))
    }
}
