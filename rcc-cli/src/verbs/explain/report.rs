//! Explanation of a net as a value; its fields are the keys of `--output json`. Pure.

use std::borrow::Cow;

use std::time::Instant;

use rcc_core::primitives;
use rcc_engine::costs::Costs;
use rcc_engine::net::Net;
use rcc_language::structure::{NetStructure, PortInfo, PrimitiveRole, SourceInfo};
use rcc_motion::TimeScaling;
use serde::Serialize;

use crate::net_source::ResolvedNet;
use crate::simulate;

/// Properties and requirements of a net.
#[derive(Clone, Debug, Serialize)]
pub struct Explanation {
    /// Name of the net.
    pub net: String,
    /// Number of primitives as the text has them: a formula or an instance of a fragment counts once.
    pub primitives: u32,
    /// Number of primitives that are evaluated: formulas and fragments are expanded, monitors are not evaluated.
    pub evaluated: u64,
    /// Expected time of one evaluation, ns.
    pub expected_ns: u64,
    /// Period of the cell, ns.
    pub period_ns: u64,
    /// Cycles from one evaluation to the next.
    pub every: u32,
    /// Origin of the costs.
    pub costs: String,
    /// Cost by type, most expensive first.
    pub types: Vec<TypeShare>,
    /// Number of runs of equal kernels.
    pub runs: usize,
    /// Regions evaluated only while a condition is true, outer ones first.
    pub regions: Vec<ConditionalRegion>,
    /// Memory requirements.
    pub memory: NetMemory,
    /// Primitives in order of evaluation.
    pub order: Vec<EvaluationStep>,
    /// Critical path: the longest chain of primitives in time.
    pub path: CriticalPath,
    /// Values that can be null, in the order of the file.
    pub nulls: Vec<NullSource>,
    /// Commands, terminations and motions with inputs that can be null, and the effect.
    pub consequences: Vec<Consequence>,
    /// Its motions as planned here, for arms at rest where they are simulated; `None` for a net without a motion, or if one
    /// cannot be planned.
    pub motions: Option<PlannedMotions>,
    /// Free capacity of the running cell.
    pub cell: Option<CellCapacity>,
}

/// The motions of a net, and what planning them took.
#[derive(Clone, Debug, Serialize)]
pub struct PlannedMotions {
    /// Sections from rest to rest, in the order of the motions and their legs.
    pub sections: Vec<MotionSection>,
    /// Time to build the net, most of which is the planning of its motions, ns.
    pub planning_ns: u64,
}

/// A section of a motion from rest to rest.
#[derive(Clone, Debug, Serialize)]
pub struct MotionSection {
    /// Id of the motion.
    pub motion: String,
    /// Its first and its last leg, from 1.
    pub legs: [u32; 2],
    /// How time passes on it.
    pub time_scaling: &'static str,
    /// Duration at full speed, s.
    pub duration_s: f64,
}

/// Total cost of all primitives of a type.
#[derive(Clone, Debug, Serialize)]
pub struct TypeShare {
    /// Type.
    #[serde(rename = "type")]
    pub ty: &'static str,
    /// Number of primitives.
    pub count: u64,
    /// Their total time, ns.
    pub all_ns: f64,
}

/// A region that is evaluated only while a condition is true.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConditionalRegion {
    /// Instance or primitive that has the condition.
    pub id: String,
    /// Condition.
    pub condition: String,
    /// Number of primitives in the region, including inner regions.
    pub primitives: u64,
    /// Their expected time while the region is active, ns.
    pub ns: f64,
}

/// Memory requirements of a net, in elements and bytes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NetMemory {
    /// `Real` slots, 8 bytes each.
    pub reals: usize,
    /// `Bool` slots, 1 byte each.
    pub bools: usize,
    /// `Int` slots, 8 bytes each.
    pub ints: usize,
    /// Bytes of all arenas.
    pub arena_bytes: usize,
    /// Bytes of outputs.
    pub output_bytes: usize,
    /// Bytes of delayed values.
    pub delayed_bytes: usize,
    /// Remaining bytes: constants (equal ones are shared) and states of primitives.
    pub other_bytes: usize,
    /// Operands, 4 bytes each.
    pub operands: usize,
    /// Number of constant inputs.
    pub constant_inputs: usize,
    /// Number of slots that hold these constants.
    pub constants: usize,
}

/// A primitive in the order of evaluation.
#[derive(Clone, Debug, Serialize)]
pub struct EvaluationStep {
    /// Position in the order, from 0.
    pub order: usize,
    /// Index of its run, from 0.
    pub run: usize,
    /// Id.
    pub id: String,
    /// Type.
    #[serde(rename = "type")]
    pub ty: &'static str,
    /// Arena of its kernel, if the type has several kernels.
    pub kernel: Option<String>,
    /// Expected time, ns.
    pub ns: f64,
    /// Outputs.
    pub outputs: Vec<StepOutput>,
    /// Why the outputs can be null; `None` if they never are.
    pub null: Option<String>,
}

/// An output of a primitive.
#[derive(Clone, Debug, Serialize)]
pub struct StepOutput {
    /// Name.
    pub name: Cow<'static, str>,
    /// Type.
    #[serde(rename = "type")]
    pub ty: String,
    /// Unit.
    pub unit: Option<String>,
    /// Slot of its first element, in the arena of its type.
    pub slot: u32,
}

/// A chain of primitives.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CriticalPath {
    /// Total time, ns.
    pub ns: f64,
    /// Ids, starting at the source.
    pub ids: Vec<String>,
}

/// A primitive whose outputs can be null.
#[derive(Clone, Debug, Serialize)]
pub struct NullSource {
    /// Id of the primitive.
    pub id: String,
    /// Names of all its outputs.
    pub outputs: Vec<Cow<'static, str>>,
    /// Why they can be null, and by which path.
    pub why: String,
}

/// Effect of a null input.
#[derive(Clone, Debug, Serialize)]
pub struct Consequence {
    /// `primitive.input`.
    pub input: String,
    /// Why it can be null.
    pub why: String,
    /// Behaviour of its primitive while it is null.
    pub then: String,
}

/// Free capacity of the running cell.
#[derive(Clone, Debug, Serialize)]
pub struct CellCapacity {
    /// Name of the cell.
    pub cell: String,
    /// Time per cycle available to all nets together, ns.
    pub budget_ns: u64,
    /// Time committed to running nets, ns.
    pub committed_ns: u64,
    /// Free time, ns.
    pub left_ns: u64,
    /// Most expensive running net.
    pub dearest: Option<String>,
    /// Its expected time, ns.
    pub dearest_ns: u64,
}

impl Explanation {
    /// Collects the explanation of a net.
    pub fn of(
        found: &ResolvedNet,
        costs: &Costs,
        origin: String,
        cell: Option<CellCapacity>,
    ) -> Explanation {
        let (structure, plan) = (&found.structure, found.compiled.plan.plan());
        let types = costs.shares(&plan).into_iter().map(|share| TypeShare {
            ty: share.name,
            count: share.count,
            all_ns: share.ns,
        });
        let types: Vec<TypeShare> = types.collect();
        let evaluated = types.iter().map(|share| share.count).sum();
        let order = steps(found, costs);
        Explanation {
            net: structure.net.clone(),
            primitives: found.compiled.primitives,
            evaluated,
            expected_ns: costs.expected_ns(&plan),
            period_ns: found.config.period_ns,
            every: plan.rate.every,
            costs: origin,
            types,
            runs: plan.runs.len(),
            memory: memory(found),
            regions: regions(structure, &order),
            path: longest(structure, &order),
            order,
            nulls: nulls(structure),
            consequences: consequences(structure),
            motions: motions(found),
            cell,
        }
    }
}

/// Plans the motions as the executor does.
fn motions(found: &ResolvedNet) -> Option<PlannedMotions> {
    let (config, plan) = (&found.config, found.compiled.plan.clone());
    let (models, holds) = (config.models(), simulate::holds(config));
    let dt_s = config.period_ns as f64 / 1e9;
    let begun = Instant::now();
    let net = Net::build(plan, &models, config.fingerprint(), &holds, dt_s).ok()?;
    let planning_ns = u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX);
    let sections = net.motions().sections().map(|(motion, section)| {
        let id = found.compiled.names.motions.get(motion).cloned();
        MotionSection {
            motion: id.unwrap_or_else(|| format!("motion {motion}")),
            legs: section.legs.map(|leg| leg + 1),
            time_scaling: match section.time_scaling {
                TimeScaling::Even => "even",
                TimeScaling::Adapted => "adapted",
                TimeScaling::TimeOptimal => "time-optimal",
                TimeScaling::FirstLaw => "first law: the method that improves it did not end",
            },
            duration_s: section.duration_s,
        }
    });
    let sections: Vec<MotionSection> = sections.collect();
    (!sections.is_empty()).then_some(PlannedMotions {
        sections,
        planning_ns,
    })
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
            let index = known.unwrap_or_else(|| {
                regions.push(ConditionalRegion {
                    id: activity.id.clone(),
                    condition: activity.condition.clone(),
                    primitives: 0,
                    ns: 0.0,
                });
                regions.len() - 1
            });
            regions[index].primitives += 1;
            regions[index].ns += step.ns;
        }
    }
    regions
}

fn output(pin: &PortInfo) -> StepOutput {
    StepOutput {
        name: pin.name.clone(),
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
    let mut slots: Vec<_> = inputs
        .filter(is_constant)
        .map(|pin| (bytes(pin.store), pin.store as u8, pin.slot))
        .collect();
    let constant_inputs = slots.len();
    slots.sort_unstable();
    slots.dedup();
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
        constants: slots.len(),
    }
}

/// Finds the longest chain in time; delayed links do not count.
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
        // Sources come earlier in the order, so the chain is finite.
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
                outputs: part.outputs.iter().map(|pin| pin.name.clone()).collect(),
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
