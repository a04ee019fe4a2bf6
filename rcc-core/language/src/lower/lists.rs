//! Lists of links, whose elements must be adjacent in memory. An output that a list reads is computed directly in the
//! list, unless another list has claimed it; a constant is part of the initial values; a delayed link is copied there;
//! everything else is copied before the reader runs. Runs on the loader's threads.

use std::collections::BTreeMap;

use rcc_core::plan::{Delay, KernelRun};
use rcc_core::primitive::{PortType, Role};
use rcc_core::primitives;
use rcc_core::types::Type;

use super::{Lowering, SlotRange};
use crate::resolve::{ListElement, OutputId, ResolvedLink, ResolvedList};
use crate::syntax::part::ListPosition;
use crate::syntax::stored_value::StoredValue;

/// A list: item and input.
type ListKey = (usize, usize);

/// Slots of the lists, and the copies of their elements.
#[derive(Default)]
pub struct ListLayout {
    /// Outputs that are computed in a list, with the offset of the element.
    claimed: BTreeMap<OutputId, (ListKey, u32)>,
    /// Slots of each list.
    blocks: BTreeMap<ListKey, SlotRange>,
    /// Elements to copy before an item runs, by item.
    copies: BTreeMap<usize, Vec<ElementCopy>>,
    /// Delayed links that end in lists.
    pub delays: Vec<Delay>,
}

/// A copy within an arena.
#[derive(Clone, Copy)]
struct ElementCopy {
    from: SlotRange,
    to: u32,
}

impl<'a> Lowering<'a> {
    /// Decides which outputs are computed in the list that reads them; the first list wins.
    pub fn claim_list_outputs(&mut self) {
        for (number, item) in self.net.graph.items.iter().enumerate() {
            for (input, list) in item.lists() {
                for element in &list.elements {
                    let ListElement::Link(link) = element else {
                        continue;
                    };
                    let constant = self.item(link.from.item).spec().role == Role::Constant;
                    if link.delayed || link.part.is_some() || constant {
                        continue;
                    }
                    let (offset, _) = self.place_in(number, input, link.position);
                    let claimed = &mut self.lists.claimed;
                    claimed
                        .entry(link.from)
                        .or_insert(((number, input), offset));
                }
            }
        }
    }

    /// Returns the slots of an output that is computed in a list; `None` if it is not.
    pub fn claimed_slot(
        &mut self,
        output: OutputId,
        ty: Type,
        initial: Option<&StoredValue>,
    ) -> Option<SlotRange> {
        let (key, offset) = *self.lists.claimed.get(&output)?;
        let slot = self.block(key)?.slot + offset;
        let null = || StoredValue::null(ty);
        let initial = initial.cloned().unwrap_or_else(null);
        self.arena.write(slot, &initial);
        Some(SlotRange {
            store: initial.store(),
            slot,
            width: ty.width(),
        })
    }

    /// Returns the slots of a list; allocates them on first use.
    fn block(&mut self, key: ListKey) -> Option<SlotRange> {
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
        let null = StoredValue::null(ty);
        let first = self.arena.variable(&null);
        (1..values).for_each(|_| {
            self.arena.variable(&null);
        });
        let block = SlotRange {
            width: first.width * u32::from(values),
            ..first
        };
        self.lists.blocks.insert(key, block);
        Some(block)
    }

    /// Returns offset and type of a position in the list at an input.
    fn place_in(&self, number: usize, input: usize, position: ListPosition) -> (u32, Type) {
        // The checks refuse lists that do not fit their inputs.
        let nothing = (0, Type::Real);
        let Some(port) = self.item(number).spec().inputs.get(input) else {
            return nothing;
        };
        let ty = self.port_type(number, port);
        match (port.ty, position.steps) {
            (PortType::Many(_), [Some((index, _)), _]) => (index * ty.width(), ty),
            _ => position.of(ty).unwrap_or(nothing),
        }
    }

    /// Lays out a list after all outputs have their slots.
    pub fn place_list(
        &mut self,
        number: usize,
        input: usize,
        list: &ResolvedList<'a>,
    ) -> Option<SlotRange> {
        let key = (number, input);
        let block = self.block(key)?;
        for element in &list.elements {
            match element {
                ListElement::Literal(literal, position) => {
                    let (offset, ty) = self.place_in(number, input, *position);
                    if let Some(stored) = literal.stored(ty) {
                        self.arena.write(block.slot + offset, &stored);
                    }
                }
                ListElement::Link(link) => self.place_link(key, block, link),
            }
        }
        Some(block)
    }

    fn place_link(&mut self, key: ListKey, block: SlotRange, link: &ResolvedLink<'a>) {
        let (offset, ty) = self.place_in(key.0, key.1, link.position);
        let to = block.slot + offset;
        let from = self.source(link, ty);
        if link.delayed {
            let initial = link.initial.and_then(|initial| initial.stored(ty));
            self.arena
                .write(to, &initial.unwrap_or_else(|| StoredValue::null(ty)));
            self.lists.delay(from, to);
        } else if self.item(link.from.item).spec().role == Role::Constant {
            self.arena.repeat(from, to);
        } else if from.slot != to {
            self.lists.copy(key.0, from, to);
        }
    }

    /// Appends the runs that copy the elements of an item's lists.
    pub fn copies_before(
        &mut self,
        number: usize,
        runs: &mut Vec<KernelRun>,
        operands: &mut Vec<u32>,
    ) {
        let Some(mut moves) = self.lists.copies.remove(&number) else {
            return;
        };
        let Some((row, entry)) = primitives::find("Copy") else {
            return;
        };
        let kernel = |one: &ElementCopy| {
            let kernel = entry.kernel_for(Some(one.from.store), one.from.width);
            primitives::kernel_number(row, kernel.unwrap_or(0))
        };
        // A stable sort: the same text gives the same bytes.
        moves.sort_by_key(kernel);
        for group in moves.chunk_by(|a, b| kernel(a) == kernel(b)) {
            let first = operands.len() as u32;
            for ElementCopy { from, to } in group {
                operands.extend([from.slot, *to]);
                operands.extend((from.width > 1).then_some(from.width));
            }
            runs.push(KernelRun {
                kernel: group.first().map_or(0, kernel),
                first,
                operands: operands.len() as u32 - first,
            });
        }
    }

    /// Returns the items whose lists are not copied yet: those without a kernel.
    pub fn items_with_pending_copies(&self) -> Vec<usize> {
        self.lists.copies.keys().copied().collect()
    }
}

impl ListLayout {
    fn delay(&mut self, from: SlotRange, to: u32) {
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

    fn copy(&mut self, item: usize, from: SlotRange, to: u32) {
        let moves = self.copies.entry(item).or_default();
        match moves.last_mut() {
            Some(last)
                if last.from.slot + last.from.width == from.slot
                    && last.to + last.from.width == to =>
            {
                last.from.width += from.width;
            }
            _ => moves.push(ElementCopy { from, to }),
        }
    }
}
