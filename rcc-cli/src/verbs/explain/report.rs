//! What is known of a net, as a value: the keys of `--output json` are its fields. Pure.

use rcc_core::primitives;
use rcc_engine::costs::Costs;
use rcc_language::structure::{NetStructure, PrimitiveRole, PortInfo, SourceInfo};
use serde::Serialize;

use crate::verbs::source::ResolvedNet;

/// What a net is and needs.
#[derive(Clone, Debug, Serialize)]
pub struct Explanation {
    /// Its name.
    pub net: String,
    /// Primitives that are evaluated.
    pub primitives: u32,
    /// What one evaluation is expected to take.
    pub expected_ns: u64,
    /// The cell's period.
    pub period_ns: u64,
    /// Evaluated every so many cycles.
    pub every: u32,
    /// Where the costs come from.
    pub costs: String,
    /// By type, the dearest first.
    pub types: Vec<TypeShare>,
    /// Runs of equal kernels.
    pub runs: usize,
    /// What is evaluated only while a condition is true, outer ones first.
    pub regions: Vec<ConditionalRegion>,
    /// What it needs of memory.
    pub memory: NetMemory,
    /// Primitives in the order of evaluation.
    pub order: Vec<EvaluationStep>,
    /// The longest way from a source to a result, in time.
    pub path: CriticalPath,
    /// Values that can be null, in the order of the file.
    pub nulls: Vec<NullSource>,
    /// Commands, ends and motions whose inputs can be null, and what follows.
    pub consequences: Vec<Consequence>,
    /// What the running cell has left.
    pub cell: Option<CellCapacity>,
}

/// All primitives of a type.
#[derive(Clone, Debug, Serialize)]
pub struct TypeShare {
    /// The type.
    #[serde(rename = "type")]
    pub ty: &'static str,
    /// How many.
    pub count: u64,
    /// All of them together.
    pub all_ns: f64,
}

/// What is evaluated only while a condition is true.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConditionalRegion {
    /// The instance or primitive that has the condition.
    pub id: String,
    /// The condition.
    pub condition: String,
    /// Primitives in it, those of inner regions too.
    pub primitives: u64,
    /// What these are expected to take while it is active.
    pub ns: f64,
}

/// What a net needs of memory: elements, and bytes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NetMemory {
    /// `Real` slots, 8 bytes each.
    pub reals: usize,
    /// `Bool` slots, 1 byte each.
    pub bools: usize,
    /// `Int` slots, 8 bytes each.
    pub ints: usize,
    /// All arenas.
    pub arena_bytes: usize,
    /// Bytes of outputs.
    pub output_bytes: usize,
    /// Bytes of what delayed links carry.
    pub delayed_bytes: usize,
    /// The rest: constants, one for all that are equal, and what primitives remember.
    pub other_bytes: usize,
    /// Operands, 4 bytes each.
    pub operands: usize,
    /// Inputs that are constants.
    pub constant_inputs: usize,
    /// Places where these constants lie.
    pub constants: usize,
}

/// A primitive in its turn.
#[derive(Clone, Debug, Serialize)]
pub struct EvaluationStep {
    /// Its place in the order, from 0.
    pub order: usize,
    /// Which run it is in, from 0.
    pub run: usize,
    /// Its id.
    pub id: String,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: &'static str,
    /// The arena of its kernel, where it has several.
    pub kernel: Option<String>,
    /// What it is expected to take.
    pub ns: f64,
    /// Its outputs.
    pub outputs: Vec<StepOutput>,
    /// Why these can be null; `None`: they never are.
    pub null: Option<String>,
}

/// An output.
#[derive(Clone, Debug, Serialize)]
pub struct StepOutput {
    /// Its name.
    pub name: &'static str,
    /// Its type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Its first element, in the arena of its type.
    pub slot: u32,
}

/// A way through a net.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CriticalPath {
    /// All on it together.
    pub ns: f64,
    /// Ids, the source first.
    pub ids: Vec<String>,
}

/// What can be null.
#[derive(Clone, Debug, Serialize)]
pub struct NullSource {
    /// The primitive.
    pub id: String,
    /// All its outputs.
    pub outputs: Vec<&'static str>,
    /// Why, and the way to it.
    pub why: String,
}

/// What follows from null.
#[derive(Clone, Debug, Serialize)]
pub struct Consequence {
    /// `primitive.input`.
    pub input: String,
    /// Why it can be null.
    pub why: String,
    /// What its primitive then does.
    pub then: String,
}

/// What the running cell has left.
#[derive(Clone, Debug, Serialize)]
pub struct CellCapacity {
    /// Its name.
    pub cell: String,
    /// What nets may need of a cycle together.
    pub budget_ns: u64,
    /// What those that run do.
    pub committed_ns: u64,
    /// The rest.
    pub left_ns: u64,
    /// The dearest net that runs.
    pub dearest: Option<String>,
    /// What it needs.
    pub dearest_ns: u64,
}

impl Explanation {
    /// All that is known of a net.
    pub fn of(found: &ResolvedNet, costs: &Costs, origin: String, cell: Option<CellCapacity>) -> Explanation {
        let (structure, plan) = (&found.structure, found.compiled.plan.plan());
        let types = costs.shares(&plan).into_iter().map(|share| TypeShare {
            ty: share.name,
            count: share.count,
            all_ns: share.ns,
        });
        let order = steps(found, costs);
        Explanation {
            net: structure.net.clone(),
            primitives: structure.order.len() as u32,
            expected_ns: costs.expected_ns(&plan),
            period_ns: found.config.period_ns,
            every: plan.rate.every,
            costs: origin,
            types: types.collect(),
            runs: plan.runs.len(),
            memory: memory(found),
            regions: regions(structure, &order),
            path: longest(structure, &order),
            order,
            nulls: nulls(structure),
            consequences: consequences(structure),
            cell,
        }
    }
}

fn steps(found: &ResolvedNet, costs: &Costs) -> Vec<EvaluationStep> {
    let (structure, plan) = (&found.structure, found.compiled.plan.plan());
    let mut items = structure.order.iter().enumerate();
    let mut steps = Vec::new();
    for (run, it) in plan.runs.iter().enumerate() {
        let kernel = primitives::kernel(it.kernel);
        let kernel = kernel.filter(|(entry, _)| entry.kernels.len() > 1);
        let kernel = kernel.and_then(|(_, kernel)| kernel.store);
        let kernel = kernel.map(|store| format!("{store:?}"));
        for ns in costs.of_primitives(&plan, it).unwrap_or_default() {
            let Some((order, part)) = items.next() else {
                break;
            };
            let Some(part) = structure.primitives.get(*part) else {
                continue;
            };
            steps.push(EvaluationStep {
                order,
                run,
                id: part.id.clone(),
                ty: part.type_name,
                kernel: kernel.clone(),
                ns,
                outputs: part.outputs.iter().map(output).collect(),
                null: part.null.clone(),
            });
        }
    }
    steps
}

fn regions(structure: &NetStructure, order: &[EvaluationStep]) -> Vec<ConditionalRegion> {
    let mut regions: Vec<ConditionalRegion> = Vec::new();
    for (step, part) in order.iter().zip(&structure.order) {
        let part = structure.primitives.get(*part);
        for activity in part.into_iter().flat_map(|part| &part.active) {
            let known = regions.iter().position(|region| region.id == activity.id);
            let place = known.unwrap_or_else(|| {
                regions.push(ConditionalRegion {
                    id: activity.id.clone(),
                    condition: activity.condition.clone(),
                    primitives: 0,
                    ns: 0.0,
                });
                regions.len() - 1
            });
            regions[place].primitives += 1;
            regions[place].ns += step.ns;
        }
    }
    regions
}

fn output(pin: &PortInfo) -> StepOutput {
    StepOutput {
        name: pin.name,
        ty: pin.type_name.clone(),
        unit: pin.unit.clone(),
        slot: pin.slot,
    }
}

const fn bytes(store: rcc_core::types::Store) -> usize {
    match store {
        rcc_core::types::Store::Bool => 1,
        _ => 8,
    }
}

fn memory(found: &ResolvedNet) -> NetMemory {
    let (structure, plan) = (&found.structure, found.compiled.plan.plan());
    let outputs = structure
        .primitives
        .iter()
        .filter(|part| part.role != PrimitiveRole::Constant);
    let outputs = outputs.flat_map(|part| &part.outputs);
    let output_bytes = outputs
        .map(|pin| pin.width as usize * bytes(pin.store))
        .sum();
    let delays = plan.delays.iter();
    let delayed_bytes = delays
        .map(|delay| delay.width as usize * bytes(delay.store))
        .sum();
    let arena_bytes = 8 * (plan.reals.len() + plan.ints.len()) + plan.bools.len();
    let is_constant = |pin: &&PortInfo| {
        let constant = |source: &SourceInfo| !matches!(source, SourceInfo::Link(_));
        !pin.sources.is_empty() && pin.sources.iter().all(constant)
    };
    let inputs = structure.primitives.iter().flat_map(|part| &part.inputs);
    let mut places: Vec<_> = inputs
        .filter(is_constant)
        .map(|pin| (bytes(pin.store), pin.store as u8, pin.slot))
        .collect();
    let constant_inputs = places.len();
    places.sort_unstable();
    places.dedup();
    NetMemory {
        reals: plan.reals.len(),
        bools: plan.bools.len(),
        ints: plan.ints.len(),
        arena_bytes,
        output_bytes,
        delayed_bytes,
        other_bytes: arena_bytes.saturating_sub(output_bytes + delayed_bytes),
        operands: plan.operands.len(),
        constant_inputs,
        constants: places.len(),
    }
}

/// The longest way in time; what is delayed begins anew.
fn longest(structure: &NetStructure, order: &[EvaluationStep]) -> CriticalPath {
    let mut best = vec![(0.0_f64, None::<usize>); structure.primitives.len()];
    for (step, part) in order.iter().zip(&structure.order) {
        let sources = structure.primitives[*part]
            .inputs
            .iter()
            .flat_map(|pin| &pin.sources);
        let sources = sources.filter_map(|source| match source {
            SourceInfo::Link(link) if !link.delayed => Some(link.primitive),
            _ => None,
        });
        let before = sources.max_by(|a, b| best[*a].0.total_cmp(&best[*b].0));
        let ns = before.map_or(0.0, |before| best[before].0);
        best[*part] = (ns + step.ns, before);
    }
    let last = (0..best.len())
        .rev()
        .max_by(|a, b| best[*a].0.total_cmp(&best[*b].0));
    let mut path = CriticalPath {
        ns: last.map_or(0.0, |last| best[last].0),
        ids: Vec::new(),
    };
    let mut at = last.filter(|_| path.ns > 0.0);
    while let Some(part) = at {
        path.ids.push(structure.primitives[part].id.clone());
        // What is read comes earlier in the order, so the way has an end.
        at = best[part].1;
    }
    path.ids.reverse();
    path
}

fn nulls(structure: &NetStructure) -> Vec<NullSource> {
    let parts = structure.primitives.iter();
    parts
        .filter_map(|part| {
            Some(NullSource {
                id: part.id.clone(),
                outputs: part.outputs.iter().map(|pin| pin.name).collect(),
                why: part.null.clone()?,
            })
        })
        .collect()
}

fn consequences(structure: &NetStructure) -> Vec<Consequence> {
    let parts = structure.primitives.iter().filter(|part| {
        matches!(
            part.role,
            PrimitiveRole::Commands | PrimitiveRole::Moves | PrimitiveRole::Ends
        )
    });
    parts
        .flat_map(|part| {
            part.inputs.iter().filter_map(|pin| {
                Some(Consequence {
                    input: format!("{}.{}", part.id, pin.name),
                    why: pin.null.clone()?,
                    then: part.null_words.to_owned(),
                })
            })
        })
        .collect()
}
