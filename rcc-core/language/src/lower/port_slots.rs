//! The slots of all ports of a net, in one block of memory. Runs on the loader's threads.

use super::SlotRange;

/// Slots of the inputs and outputs, by item.
#[derive(Clone, Debug)]
pub struct PortSlots {
    slots: Vec<SlotRange>,
    /// Where the slots of its inputs begin and end, by item.
    inputs: Vec<[u32; 2]>,
    /// Where the slots of its outputs begin and end, by item.
    outputs: Vec<[u32; 2]>,
}

impl PortSlots {
    /// Returns the slots of items none of which has a slot yet.
    pub(super) fn none(items: usize) -> PortSlots {
        PortSlots {
            slots: Vec::new(),
            inputs: vec![[0; 2]; items],
            outputs: vec![[0; 2]; items],
        }
    }

    /// Returns the number of slots so far, from which on those that are pushed next are the ports of one item.
    pub(super) fn begin(&self) -> u32 {
        // At most as many as the operands of a plan and its outputs.
        self.slots.len() as u32
    }

    /// Appends the slot of the next port.
    pub(super) fn push(&mut self, slot: SlotRange) {
        self.slots.push(slot);
    }

    /// The slots from `begin` on are the inputs of an item.
    pub(super) fn end_inputs(&mut self, item: usize, begin: u32) {
        self.inputs[item] = [begin, self.begin()];
    }

    /// The slots from `begin` on are the outputs of an item.
    pub(super) fn end_outputs(&mut self, item: usize, begin: u32) {
        self.outputs[item] = [begin, self.begin()];
    }

    /// Returns the slots of an item's inputs, by input of the spec; of a `Termination` with named outcomes, by outcome.
    #[must_use]
    pub fn inputs(&self, item: usize) -> &[SlotRange] {
        self.range(self.inputs.get(item))
    }

    /// Returns the slots of an item's outputs, by output of the spec.
    #[must_use]
    pub fn outputs(&self, item: usize) -> &[SlotRange] {
        self.range(self.outputs.get(item))
    }

    fn range(&self, range: Option<&[u32; 2]>) -> &[SlotRange] {
        let [begin, end] = range.copied().unwrap_or_default();
        self.slots.get(begin as usize..end as usize).unwrap_or(&[])
    }
}
