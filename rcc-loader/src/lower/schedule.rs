//! The order of evaluation: sources before readers, and as many primitives of one kernel in a row as that allows.
//! Kahn, "Topological sorting of large networks", CACM 5 (1962), with one ready list a kernel. The loader's threads.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

use rcc_core::primitives;
use rcc_core::types::Type;

use crate::check::Typed;
use crate::resolve::Item;

/// Primitives of one kernel in a row.
#[derive(Debug)]
pub struct Batch {
    /// Number of the kernel.
    pub kernel: u16,
    /// Numbers of the items.
    pub items: Vec<usize>,
}

/// The index of the kernel that an item needs; `None` if it has none.
fn kernel_of(net: Typed<'_>, number: usize, item: &Item<'_>) -> Option<usize> {
    let spec = item.spec();
    let mut ports = spec.inputs.iter().chain(spec.outputs);
    let open = ports.find(|port| port.ty.is_open());
    let ty = open.and_then(|port| net.inferred.port_type(net.graph, number, port.ty));
    let width = ty.map_or(1, Type::width);
    item.entry.kernel_for(ty.and_then(Type::store), width)
}

struct Ready {
    /// Items whose sources are all done, first of the file first.
    items: BinaryHeap<Reverse<usize>>,
    /// Items of this kernel that are not done.
    left: usize,
}

/// Orders the items that have a kernel. Of the kernels with ready items that one comes first which will be finished for
/// good, then that with most ready ones, then that of the smallest number; items in the order of the file.
pub fn schedule(net: Typed<'_>) -> Vec<Batch> {
    let items = &net.graph.items;
    let kernels: Vec<Option<u16>> = items
        .iter()
        .enumerate()
        .map(|(number, item)| {
            let kernel = kernel_of(net, number, item)?;
            Some(primitives::kernel_number(item.row, kernel))
        })
        .collect();
    let mut waits = vec![0usize; items.len()];
    let mut readers = vec![Vec::new(); items.len()];
    for (number, item) in items.iter().enumerate() {
        for (_, wire) in item.wires() {
            let source = wire.from.item;
            if !wire.delayed && kernels[source].is_some() {
                waits[number] += 1;
                readers[source].push(number);
            }
        }
    }
    let mut ready: BTreeMap<u16, Ready> = BTreeMap::new();
    for (number, kernel) in kernels.iter().enumerate() {
        let Some(kernel) = kernel else { continue };
        let row = ready.entry(*kernel).or_insert_with(|| Ready {
            items: BinaryHeap::new(),
            left: 0,
        });
        row.left += 1;
        if waits[number] == 0 {
            row.items.push(Reverse(number));
        }
    }
    let mut batches = Vec::new();
    while let Some(kernel) = next_kernel(&ready) {
        let mut batch = Batch {
            kernel,
            items: Vec::new(),
        };
        while let Some(number) = take(&mut ready, kernel) {
            batch.items.push(number);
            for reader in &readers[number] {
                waits[*reader] -= 1;
                if waits[*reader] == 0
                    && let Some(kernel) = kernels[*reader]
                    && let Some(row) = ready.get_mut(&kernel)
                {
                    row.items.push(Reverse(*reader));
                }
            }
        }
        batches.push(batch);
    }
    batches
}

fn next_kernel(ready: &BTreeMap<u16, Ready>) -> Option<u16> {
    let candidates = ready.iter().filter(|(_, row)| !row.items.is_empty());
    let rated = candidates.map(|(kernel, row)| {
        let finishes = row.items.len() == row.left;
        ((finishes, row.items.len(), Reverse(*kernel)), *kernel)
    });
    rated.max().map(|(_, kernel)| kernel)
}

fn take(ready: &mut BTreeMap<u16, Ready>, kernel: u16) -> Option<usize> {
    let row = ready.get_mut(&kernel)?;
    let Reverse(number) = row.items.pop()?;
    row.left -= 1;
    Some(number)
}
