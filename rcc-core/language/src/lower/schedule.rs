//! The order of evaluation: sources before readers, and as many primitives of one kernel in a row as that allows: each
//! change of the kernel is a jump that the processor cannot foresee. Kahn, "Topological sorting of large networks",
//! CACM 5 (1962), with one ready list a kernel; Hu, "Parallel sequencing and assembly line problems", Operations Research
//! 9 (1961), for which list is next: the one whose first item has the longest way to go. The loader's threads.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use rcc_core::primitives;
use rcc_core::types::Type;

use crate::check::Typed;
use crate::resolve::Item;

/// Primitives of one kernel and one region in a row.
#[derive(Debug)]
pub struct Batch {
    /// Number of the kernel.
    pub kernel: u16,
    /// Index of the region.
    pub region: Option<usize>,
    /// Numbers of the items.
    pub items: Vec<usize>,
}

/// The index of the kernel that an item needs; `None` if it has none.
fn kernel_of(net: Typed<'_>, number: usize, item: &Item<'_>) -> Option<usize> {
    // Without an open port the kernel is for no arena.
    let open = item.spec().types().find(|port| port.is_open());
    let ty = open.and_then(|_| net.inferred.open_type(number));
    let width = ty.map_or(1, Type::width);
    item.entry.kernel_for(ty.and_then(Type::store), width)
}

/// Items of one kernel.
#[derive(Default)]
struct Ready {
    /// Those whose sources are all done, by their height, the highest first; then the first of the file.
    items: BTreeSet<(Reverse<u32>, usize)>,
    /// How many are not done.
    left: usize,
}

/// What may be in one batch: region and kernel.
type Lot = (Option<usize>, u16);

/// What the schedule knows of the links.
struct Links {
    /// By item: sources that are not done.
    waits: Vec<usize>,
    /// By item: those that read it in the same cycle.
    readers: Vec<Vec<usize>>,
}

fn links(net: Typed<'_>, kernels: &[Option<Lot>]) -> Links {
    let items = &net.graph.items;
    let mut links = Links {
        waits: vec![0; items.len()],
        readers: vec![Vec::new(); items.len()],
    };
    for (number, item) in items.iter().enumerate() {
        // A primitive under a condition waits for it.
        for (_, wire) in net.graph.links(item) {
            let source = wire.from.item;
            if !wire.delayed && kernels[source].is_some() {
                links.waits[number] += 1;
                links.readers[source].push(number);
            }
        }
    }
    links
}

/// By item: the most changes of the kernel on any way from it to a result that nobody reads.
fn heights(links: &Links, kernels: &[Option<Lot>]) -> Vec<u32> {
    let mut waits = links.waits.clone();
    let mut order: Vec<usize> = (0..waits.len()).filter(|item| waits[*item] == 0).collect();
    let mut done = 0;
    while let Some(item) = order.get(done).copied() {
        done += 1;
        for reader in &links.readers[item] {
            waits[*reader] -= 1;
            if waits[*reader] == 0 {
                order.push(*reader);
            }
        }
    }
    let mut heights = vec![0; waits.len()];
    for item in order.into_iter().rev() {
        let above = links.readers[item].iter().map(|reader| {
            let changes = kernels[*reader] != kernels[item];
            heights[*reader] + u32::from(changes)
        });
        heights[item] = above.max().unwrap_or(0);
    }
    heights
}

/// Orders the items that have a kernel. Of the kernels with ready items that one comes first which is of the region at
/// hand, then that which will be finished for good, then the one with the highest item, then that with most ready ones, then that of the smallest number.
pub fn schedule(net: Typed<'_>) -> Vec<Batch> {
    let items = &net.graph.items;
    let kernels: Vec<Option<Lot>> = items
        .iter()
        .enumerate()
        .map(|(number, item)| {
            let kernel = kernel_of(net, number, item)?;
            Some((item.region, primitives::kernel_number(item.row, kernel)))
        })
        .collect();
    let mut links = links(net, &kernels);
    let heights = heights(&links, &kernels);
    let mut ready: BTreeMap<Lot, Ready> = BTreeMap::new();
    for (number, kernel) in kernels.iter().enumerate() {
        let Some(kernel) = kernel else { continue };
        let row = ready.entry(*kernel).or_default();
        row.left += 1;
        if links.waits[number] == 0 {
            row.items.insert((Reverse(heights[number]), number));
        }
    }
    let mut batches: Vec<Batch> = Vec::new();
    while let Some(kernel) = next_kernel(&ready, batches.last().and_then(|last| last.region)) {
        let mut batch = Batch {
            region: kernel.0,
            kernel: kernel.1,
            items: Vec::new(),
        };
        while let Some(number) = take(&mut ready, kernel) {
            batch.items.push(number);
            for reader in std::mem::take(&mut links.readers[number]) {
                links.waits[reader] -= 1;
                if links.waits[reader] == 0
                    && let Some(kernel) = kernels[reader]
                    && let Some(row) = ready.get_mut(&kernel)
                {
                    row.items.insert((Reverse(heights[reader]), reader));
                }
            }
        }
        batches.push(batch);
    }
    batches
}

fn next_kernel(ready: &BTreeMap<Lot, Ready>, region: Option<usize>) -> Option<Lot> {
    let rated = ready.iter().filter_map(|(kernel, row)| {
        let (Reverse(height), _) = row.items.first()?;
        let finishes = row.items.len() == row.left;
        let stays = kernel.0 == region;
        Some((
            (stays, finishes, *height, row.items.len(), Reverse(*kernel)),
            *kernel,
        ))
    });
    rated.max().map(|(_, kernel)| kernel)
}

fn take(ready: &mut BTreeMap<Lot, Ready>, kernel: Lot) -> Option<usize> {
    let row = ready.get_mut(&kernel)?;
    let (_, number) = row.items.pop_first()?;
    row.left -= 1;
    Some(number)
}
