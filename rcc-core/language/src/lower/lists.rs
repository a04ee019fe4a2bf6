//! Lists of links: their elements must lie side by side. An output that only one list wants is computed right there;
//! a constant lies there from the beginning; a delayed link ends there; what is left is copied before the reader runs.
//! The loader's threads.

use std::collections::BTreeMap;

use rcc_core::plan::{Delay, Run};
use rcc_core::primitive::{PortType, Role};
use rcc_core::primitives;
use rcc_core::types::Type;

use super::{Lowering, Slot};
use crate::resolve::{Leaf, List, Output, Wire};
use crate::syntax::literal::Stored;
use crate::syntax::part::Place;

/// The list that feeds an input: item and input.
type Key = (usize, usize);

/// Where lists are, and what moves their elements there.
#[derive(Default)]
pub struct Lists {
    /// Outputs that are computed in a list, with the element's offset.
    claimed: BTreeMap<Output, (Key, u32)>,
    /// Where the lists are.
    blocks: BTreeMap<Key, Slot>,
    /// By item: elements to be copied before it runs.
    copies: BTreeMap<usize, Vec<Move>>,
    /// Delayed links that end in lists.
    pub delays: Vec<Delay>,
}

/// Elements that are copied within an arena.
#[derive(Clone, Copy)]
struct Move {
    from: Slot,
    to: u32,
}

impl<'a> Lowering<'a> {
    /// Decides which outputs are computed in the list that reads them.
    pub fn claim(&mut self) {
        for (number, item) in self.net.graph.items.iter().enumerate() {
            for (input, list) in item.lists() {
                for leaf in &list.leaves {
                    let Leaf::Wire(wire) = leaf else { continue };
                    let constant = self.item(wire.from.item).spec().role == Role::Constant;
                    if wire.delayed || wire.part.is_some() || constant {
                        continue;
                    }
                    let (offset, _) = self.place_in(number, input, wire.place);
                    let claimed = &mut self.lists.claimed;
                    claimed
                        .entry(wire.from)
                        .or_insert(((number, input), offset));
                }
            }
        }
    }

    /// The slots of an output that is computed in a list; `None` if it is not.
    pub fn claimed(&mut self, output: Output, ty: Type, initial: &Stored) -> Option<Slot> {
        let (key, offset) = *self.lists.claimed.get(&output)?;
        let slot = self.block(key)?.slot + offset;
        self.arena.write(slot, initial);
        Some(Slot {
            store: initial.store(),
            slot,
            width: ty.width(),
        })
    }

    /// The slots of a list.
    fn block(&mut self, key: Key) -> Option<Slot> {
        if let Some(block) = self.lists.blocks.get(&key) {
            return Some(*block);
        }
        let (number, input) = key;
        let port = self.item(number).spec().inputs.get(input)?;
        let ty = self.port_type(number, port);
        let values = match port.ty {
            PortType::Many(length) => self.net.inferred.length(number, length)?,
            _ => 1,
        };
        let null = Stored::null(ty);
        let first = self.arena.variable(&null);
        (1..values).for_each(|_| {
            self.arena.variable(&null);
        });
        let block = Slot {
            width: first.width * u32::from(values),
            ..first
        };
        self.lists.blocks.insert(key, block);
        Some(block)
    }

    /// Offset and type of a place in the list at an input.
    fn place_in(&self, number: usize, input: usize, place: Place) -> (u32, Type) {
        // The check refuses lists that do not fit their inputs.
        let nothing = (0, Type::Real);
        let Some(port) = self.item(number).spec().inputs.get(input) else {
            return nothing;
        };
        let ty = self.port_type(number, port);
        match (port.ty, place.steps) {
            (PortType::Many(_), [Some((index, _)), _]) => (index * ty.width(), ty),
            _ => place.of(ty).unwrap_or(nothing),
        }
    }

    /// Lays a list out once all outputs have their places.
    pub fn place_list(&mut self, number: usize, input: usize, list: &List<'a>) -> Option<Slot> {
        let key = (number, input);
        let block = self.block(key)?;
        for leaf in &list.leaves {
            match leaf {
                Leaf::Literal(literal, place) => {
                    let (offset, ty) = self.place_in(number, input, *place);
                    if let Some(stored) = literal.stored(ty) {
                        self.arena.write(block.slot + offset, &stored);
                    }
                }
                Leaf::Wire(wire) => self.place_wire(key, block, wire),
            }
        }
        Some(block)
    }

    fn place_wire(&mut self, key: Key, block: Slot, wire: &Wire<'a>) {
        let (offset, ty) = self.place_in(key.0, key.1, wire.place);
        let to = block.slot + offset;
        let from = self.source(wire, ty);
        if wire.delayed {
            let initial = wire.initial.and_then(|initial| initial.stored(ty));
            self.arena.write(to, &initial.unwrap_or(Stored::null(ty)));
            self.lists.delay(from, to);
        } else if self.item(wire.from.item).spec().role == Role::Constant {
            self.arena.repeat(from, to);
        } else if from.slot != to {
            self.lists.copy(key.0, from, to);
        }
    }

    /// The runs that bring the elements of an item's lists together.
    pub fn copies_before(&mut self, number: usize, runs: &mut Vec<Run>, operands: &mut Vec<u32>) {
        let Some(mut moves) = self.lists.copies.remove(&number) else {
            return;
        };
        let Some((row, entry)) = primitives::find("Copy") else {
            return;
        };
        let kernel = |one: &Move| {
            let kernel = entry.kernel_for(Some(one.from.store), one.from.width);
            primitives::kernel_number(row, kernel.unwrap_or(0))
        };
        // Stable: the same text gives the same bytes.
        moves.sort_by_key(kernel);
        for group in moves.chunk_by(|a, b| kernel(a) == kernel(b)) {
            let first = operands.len() as u32;
            for Move { from, to } in group {
                operands.extend([from.slot, *to]);
                operands.extend((from.width > 1).then_some(from.width));
            }
            runs.push(Run {
                kernel: group.first().map_or(0, kernel),
                first,
                operands: operands.len() as u32 - first,
            });
        }
    }

    /// The items whose lists are still to be brought together: those without a kernel.
    pub fn left_to_copy(&self) -> Vec<usize> {
        self.lists.copies.keys().copied().collect()
    }
}

impl Lists {
    fn delay(&mut self, from: Slot, to: u32) {
        match self.delays.last_mut() {
            Some(last)
                if last.store == from.store
                    && last.from + last.width == from.slot
                    && last.to + last.width == to =>
            {
                last.width += from.width;
            }
            _ => self.delays.push(Delay {
                store: from.store,
                from: from.slot,
                to,
                width: from.width,
            }),
        }
    }

    fn copy(&mut self, item: usize, from: Slot, to: u32) {
        let moves = self.copies.entry(item).or_default();
        match moves.last_mut() {
            Some(last)
                if last.from.slot + last.from.width == from.slot
                    && last.to + last.from.width == to =>
            {
                last.from.width += from.width;
            }
            _ => moves.push(Move { from, to }),
        }
    }
}
