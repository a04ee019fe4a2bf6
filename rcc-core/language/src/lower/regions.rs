//! Lowers regions: which runs are evaluated under which condition, and which outputs become null while they are not.
//! Runs on the loader's threads.

use rcc_core::plan::{NO_REGION, NullRange, PlanRegion, RunBlock};
use rcc_core::types::Type;

use super::schedule::Batch;
use super::{Lowering, SlotRange};
use crate::resolve::InputSource;
use crate::syntax::stored_value::StoredValue;

/// The regions of a plan.
#[derive(Debug, Default)]
pub struct LoweredRegions {
    /// Blocks of consecutive runs of one region; a run is a batch.
    pub blocks: Vec<RunBlock>,
    /// In the order of their first blocks.
    pub regions: Vec<PlanRegion>,
    /// Outputs to set to null, in the order of the regions.
    pub blanks: Vec<NullRange>,
}

impl Lowering<'_> {
    /// Divides the runs of a schedule into blocks; empty for a net without regions.
    pub fn regions(&mut self, schedule: &[Batch]) -> LoweredRegions {
        let mut regions = LoweredRegions::default();
        if self.net.graph.regions.is_empty() {
            return regions;
        }
        let blanks = self.blanks(schedule);
        // Number in the plan, by region of the net.
        let mut numbers: Vec<Option<u32>> = vec![None; self.net.graph.regions.len()];
        for batch in schedule {
            let number = match batch.region {
                None => NO_REGION,
                Some(region) => {
                    self.begin(region, &mut numbers, &blanks, &mut regions);
                    numbers[region].unwrap_or(NO_REGION)
                }
            };
            match regions.blocks.last_mut() {
                Some(block) if block.region == number => block.runs += 1,
                _ => regions.blocks.push(RunBlock {
                    region: number,
                    runs: 1,
                }),
            }
        }
        regions
    }

    /// Numbers a region and those around it, each with a block that evaluates its condition.
    fn begin(
        &mut self,
        region: usize,
        numbers: &mut [Option<u32>],
        blanks: &[Vec<NullRange>],
        regions: &mut LoweredRegions,
    ) {
        let graph = self.net.graph;
        let parent = |region: &usize| graph.regions[*region].parent;
        let mut chain: Vec<usize> = std::iter::successors(Some(region), parent)
            .take_while(|region| numbers[*region].is_none())
            .collect();
        while let Some(region) = chain.pop() {
            let one = &graph.regions[region];
            let condition = match &one.condition {
                InputSource::Link(link) => self.link_slot(link, Type::Bool),
                InputSource::Literal(literal) => self.constant(Some(literal), Type::Bool),
                _ => self.constant(None, Type::Bool),
            };
            let within = one.parent.and_then(|parent| numbers[parent]);
            let within = within.and_then(|parent| regions.regions.get(parent as usize));
            let within = within.map_or(NO_REGION, |parent| parent.active);
            let active = self.arena.variable(&StoredValue::bool(0));
            // Fewer than the plan's operands, which are at most 2^20.
            let number = regions.regions.len() as u32;
            numbers[region] = Some(number);
            regions.regions.push(PlanRegion {
                condition: condition.slot,
                within,
                active: active.slot,
                blanks: blanks[region].len() as u32,
            });
            regions.blanks.extend(&blanks[region]);
            regions.blocks.push(RunBlock {
                region: number,
                runs: 0,
            });
        }
    }

    /// Returns the outputs computed directly in each region, adjacent ones merged, by region.
    fn blanks(&self, schedule: &[Batch]) -> Vec<Vec<NullRange>> {
        let mut blanks: Vec<Vec<NullRange>> = vec![Vec::new(); self.net.graph.regions.len()];
        for batch in schedule {
            let Some(region) = batch.region else { continue };
            let items = batch.items.iter();
            let outputs = items.flat_map(|item| self.slots.outputs(*item));
            for SlotRange { store, slot, width } in outputs.copied() {
                let mine = &mut blanks[region];
                let last = mine.iter_mut().rev().find(|last| last.store == store);
                match last {
                    Some(last) if last.slot + last.width == slot => last.width += width,
                    _ => mine.push(NullRange { store, slot, width }),
                }
            }
        }
        blanks
    }
}
