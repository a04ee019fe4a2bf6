//! Which runs are evaluated under which condition, and what becomes null while they are not.
//! The loader's threads.

use rcc_core::plan::{Blank, Block, NO_REGION, Region};
use rcc_core::types::Type;

use super::schedule::Batch;
use super::{Lowering, Slot};
use crate::resolve::Feed;
use crate::syntax::literal::Stored;

/// The regions of a plan.
#[derive(Debug, Default)]
pub struct Regions {
    /// How the runs are divided; one run is one batch.
    pub blocks: Vec<Block>,
    /// In the order of their first blocks.
    pub regions: Vec<Region>,
    /// In the order of the regions.
    pub blanks: Vec<Blank>,
}

impl Lowering<'_> {
    /// Divides the runs of a schedule; nothing for a net without regions.
    pub fn regions(&mut self, schedule: &[Batch]) -> Regions {
        let mut regions = Regions::default();
        if self.net.graph.regions.is_empty() {
            return regions;
        }
        let blanks = self.blanks(schedule);
        // By region of the net: its number in the plan.
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
                _ => regions.blocks.push(Block {
                    region: number,
                    runs: 1,
                }),
            }
        }
        regions
    }

    /// Gives a region and those around it their numbers, each with a block that decides it.
    fn begin(
        &mut self,
        region: usize,
        numbers: &mut [Option<u32>],
        blanks: &[Vec<Blank>],
        regions: &mut Regions,
    ) {
        let graph = self.net.graph;
        let parent = |region: &usize| graph.regions[*region].parent;
        let mut chain: Vec<usize> = std::iter::successors(Some(region), parent)
            .take_while(|region| numbers[*region].is_none())
            .collect();
        while let Some(region) = chain.pop() {
            let one = &graph.regions[region];
            let condition = match &one.condition {
                Feed::Wire(wire) => self.wire(wire, Type::Bool),
                Feed::Literal(literal) => self.constant(Some(literal), Type::Bool),
                _ => self.constant(None, Type::Bool),
            };
            let within = one.parent.and_then(|parent| numbers[parent]);
            let within = within.and_then(|parent| regions.regions.get(parent as usize));
            let within = within.map_or(NO_REGION, |parent| parent.active);
            let active = self.arena.variable(&Stored::Bools(vec![0]));
            // Fewer than the plan's operands, which are at most 2^20.
            let number = regions.regions.len() as u32;
            numbers[region] = Some(number);
            regions.regions.push(Region {
                condition: condition.slot,
                within,
                active: active.slot,
                blanks: blanks[region].len() as u32,
            });
            regions.blanks.extend(&blanks[region]);
            regions.blocks.push(Block {
                region: number,
                runs: 0,
            });
        }
    }

    /// By region: the outputs that are computed in it itself, neighbours together.
    fn blanks(&self, schedule: &[Batch]) -> Vec<Vec<Blank>> {
        let mut blanks: Vec<Vec<Blank>> = vec![Vec::new(); self.net.graph.regions.len()];
        for batch in schedule {
            let Some(region) = batch.region else { continue };
            let outputs = batch
                .items
                .iter()
                .flat_map(|item| &self.slots[*item].outputs);
            for Slot { store, slot, width } in outputs.copied() {
                let mine = &mut blanks[region];
                let last = mine.iter_mut().rev().find(|last| last.store == store);
                match last {
                    Some(last) if last.slot + last.width == slot => last.width += width,
                    _ => mine.push(Blank { store, slot, width }),
                }
            }
        }
        blanks
    }
}
