//! Values from net to net: what nets published up to the cycle before is laid ready in those that subscribe to it, before
//! any of them is evaluated, so that the order of the rows never shows. Real-time thread.
//!
//! Who publishes what is looked up when a command begins or ceases to run; in all other cycles a value costs its copy.

use rcc_core::plan::InputPoint;
use rcc_core::topic::Topic;
use rcc_ipc::control::Refusal;

use super::switch::rows;
use super::{Engine, Pending, is_active};
use crate::input::Feed;
use crate::net::Net;

impl Engine {
    pub(super) fn deliver(&mut self) {
        for row in rows(self.subscribers) {
            if !self.is_due(row) {
                continue;
            }
            // Out of its row while it reads the others; nobody subscribes to itself.
            let Some(mut net) = self.nets.get_mut(row).and_then(Option::take) else {
                continue;
            };
            let find = |input: &InputPoint| self.publisher(input);
            net.receive(self.version, &self.nets, find);
            if let Some(place) = self.nets.get_mut(row) {
                *place = Some(net);
            }
        }
    }

    /// Who publishes what an input shows: a net that runs, and not one that is over and waits for its arms.
    fn publisher(&self, input: &InputPoint) -> Option<Feed> {
        let topic = input.topic?;
        let mut running = rows(self.busy).filter(|row| {
            let entry = self.tables.commands.get(*row);
            let over = matches!(self.pending.get(*row), Some(Pending::Settle { .. }));
            entry.is_some_and(|entry| is_active(entry.state)) && !over
        });
        running.find_map(|row| {
            let net = self.nets.get(row)?.as_ref()?;
            let mut publishes = net.plan().publishes.iter();
            let publish = publishes.position(|point| {
                let same = point.store == input.store && point.width == input.width;
                same && point.topic == topic
            })?;
            Some(Feed { row, publish })
        })
    }

    /// All who publish a topic and subscribe to it mean the same by it. `leave` and `arrive` as for
    /// [`Engine::check_free`].
    pub(super) fn check_topics(&self, row: usize, leave: u64, arrive: u64) -> Result<(), Refusal> {
        let net = |row: usize| self.nets.get(row).and_then(Option::as_deref);
        let Some(own) = net(row) else {
            return Err(Refusal::UnknownCommand);
        };
        for (row, other) in self.beside(row, leave, arrive) {
            let clash = net(row).and_then(|net| clash(own, net).or_else(|| clash(net, own)));
            if let Some(Topic { key, .. }) = clash {
                return Err(Refusal::OtherTopic { other, key });
            }
        }
        Ok(())
    }
}

/// A topic that one publishes and the other one subscribes to as something else.
fn clash(publishes: &Net, subscribes: &Net) -> Option<Topic> {
    let shown = subscribes.plan().inputs.iter();
    let mut shown = shown.filter_map(|input| input.topic);
    let given = publishes.plan().publishes;
    shown.find(|shown| {
        let mut given = given.iter().map(|point| point.topic);
        given.any(|given| given.key == shown.key && given.kind != shown.kind)
    })
}
