//! The order of evaluation: sources before readers, and as many consecutive primitives of one kernel as that allows,
//! because each change of kernel is an unpredictable jump for the processor. Kahn, "Topological sorting of large
//! networks", CACM 5 (1962), with a ready list for each kernel; the next list is chosen by Hu, "Parallel sequencing and
//! assembly line problems", Operations Research 9 (1961): the one whose first item has the longest remaining path. Runs
//! on the loader's threads.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use foldhash::{HashMap, HashSet};
use rcc_core::primitives;
use rcc_core::types::Type;

use crate::adjacency::Adjacency;
use crate::infer::Typed;
use crate::resolve::ResolvedPrimitive;

/// Consecutive primitives of one kernel and one region.
#[derive(Debug)]
pub struct Batch {
    /// Number of the kernel.
    pub kernel: u16,
    /// Index of the region.
    pub region: Option<usize>,
    /// Indices of the items.
    pub items: Vec<usize>,
}

/// Returns the index of the kernel that an item needs; `None` if it has none.
fn kernel_of(net: Typed<'_>, number: usize, item: &ResolvedPrimitive<'_>) -> Option<usize> {
    // Without an open port the kernel is the same for all arenas.
    let open = item.spec().types().find(|port| port.is_open());
    let ty = open.and_then(|_| net.inferred.open_type(number));
    let width = ty.map_or(1, Type::width);
    item.entry.kernel_for(ty.and_then(Type::store), width)
}

/// The items of one kernel that are not scheduled yet.
#[derive(Default)]
struct ReadyList {
    /// Items whose sources are all scheduled, highest first, then in the order of the file.
    items: BinaryHeap<(u32, Reverse<usize>)>,
    /// Number of items that are not scheduled.
    left: usize,
}

/// Items with the same key can be in one batch: region and kernel.
type BatchKey = (Option<usize>, u16);

/// The dependencies between items within a cycle.
struct Dependencies {
    /// Number of sources that are not scheduled, by item.
    waits: Vec<usize>,
    /// Items that read it in the same cycle, by item.
    readers: Adjacency,
}

fn dependencies(net: Typed<'_>, kernels: &[Option<usize>]) -> Dependencies {
    let sources = net.graph.items.iter().map(|item| {
        // A primitive in a region waits for the condition.
        let links = net.graph.dependencies(item).map(|(_, link)| link);
        let links = links.filter(|link| !link.delayed && kernels[link.from.item].is_some());
        links.map(|link| link.from.item)
    });
    let sources: Adjacency = sources.collect();
    Dependencies {
        waits: sources.rows().map(|(_, sources)| sources.len()).collect(),
        readers: sources.reversed(sources.count()),
    }
}

/// Returns the height by item: the most changes of kernel on any path from the item to a result that nothing reads.
fn heights(dependencies: &Dependencies, kernels: &[Option<usize>]) -> Vec<u32> {
    let mut waits = dependencies.waits.clone();
    let mut order: Vec<usize> = (0..waits.len()).filter(|item| waits[*item] == 0).collect();
    let mut done = 0;
    while let Some(item) = order.get(done).copied() {
        done += 1;
        for reader in dependencies.readers.of(item) {
            waits[*reader] -= 1;
            if waits[*reader] == 0 {
                order.push(*reader);
            }
        }
    }
    let mut heights = vec![0; waits.len()];
    for item in order.into_iter().rev() {
        let above = dependencies.readers.of(item).iter().map(|reader| {
            let changes = kernels[*reader] != kernels[item];
            heights[*reader] + u32::from(changes)
        });
        heights[item] = above.max().unwrap_or(0);
    }
    heights
}

/// Orders the items that have a kernel. Of the kernels with ready items, the next one is chosen by these criteria, in
/// order: same region as the previous batch; all its remaining items are ready; highest item; most ready items;
/// smallest number.
pub fn schedule(net: Typed<'_>) -> Vec<Batch> {
    let items = &net.graph.items;
    let key_of = |(number, item): (usize, &ResolvedPrimitive<'_>)| {
        let kernel = kernel_of(net, number, item)?;
        Some((item.region, primitives::kernel_number(item.row, kernel)))
    };
    let key_by_item: Vec<Option<BatchKey>> = items.iter().enumerate().map(key_of).collect();
    let keys: HashSet<BatchKey> = key_by_item.iter().copied().flatten().collect();
    let mut keys: Vec<BatchKey> = keys.into_iter().collect();
    keys.sort_unstable();
    let numbers: HashMap<BatchKey, usize> = keys.iter().copied().zip(0..).collect();
    let kernels = key_by_item.iter().map(|key| numbers.get(&(*key)?).copied());
    let kernels: Vec<Option<usize>> = kernels.collect();
    let dependencies = dependencies(net, &kernels);
    let heights = heights(&dependencies, &kernels);
    let Dependencies { mut waits, readers } = dependencies;
    let mut ready: Vec<ReadyList> = Vec::new();
    ready.resize_with(keys.len(), ReadyList::default);
    for (number, kernel) in kernels.iter().enumerate() {
        let Some(kernel) = kernel else { continue };
        let row = &mut ready[*kernel];
        row.left += 1;
        if waits[number] == 0 {
            row.items.push((heights[number], Reverse(number)));
        }
    }
    let mut batches: Vec<Batch> = Vec::new();
    while let Some(kernel) = next_kernel(&keys, &ready, batches.last().and_then(|last| last.region))
    {
        let (region, number_of_kernel) = keys[kernel];
        let mut batch = Batch {
            region,
            kernel: number_of_kernel,
            items: Vec::new(),
        };
        while let Some(number) = take(&mut ready[kernel]) {
            batch.items.push(number);
            for &reader in readers.of(number) {
                waits[reader] -= 1;
                if waits[reader] == 0
                    && let Some(kernel) = kernels[reader]
                {
                    ready[kernel].items.push((heights[reader], Reverse(reader)));
                }
            }
        }
        batches.push(batch);
    }
    batches
}

/// Returns the kernel whose list is next, as an index into the sorted `keys`.
fn next_kernel(keys: &[BatchKey], ready: &[ReadyList], region: Option<usize>) -> Option<usize> {
    let rows = keys.iter().zip(ready).enumerate();
    let rated = rows.filter_map(|(kernel, (key, row))| {
        let (height, _) = row.items.peek()?;
        let finishes = row.items.len() == row.left;
        let stays = key.0 == region;
        Some((stays, finishes, *height, row.items.len(), Reverse(kernel)))
    });
    rated.max().map(|(.., Reverse(kernel))| kernel)
}

fn take(row: &mut ReadyList) -> Option<usize> {
    let (_, Reverse(number)) = row.items.pop()?;
    row.left -= 1;
    Some(number)
}
