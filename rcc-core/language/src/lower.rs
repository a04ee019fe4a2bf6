//! The lower pass, [`Checked`] → [`Lowered`]: a plan with an order of evaluation in runs of one kernel, slots for all
//! values, and operands in the order of `Spec::operands`. The same text gives the same bytes: no hash order, no clock.
//! Runs on the loader's threads.

mod arena;
mod delays;
mod inputs;
mod lists;
mod operands;
mod port_slots;
mod regions;
mod schedule;

use std::collections::{BTreeMap, BTreeSet};

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_core::plan::{CheckedPlan, KernelRun, MonitorPoint, OPERANDS_MAX, SLOTS_MAX};
use rcc_core::primitive::{DefaultValue as Default, ParameterKind, Port, PortType, Role};
use rcc_core::primitives;
use rcc_core::types::{Store, Type};
use rcc_protocol::control::PlanData;

use crate::check::Checked;
use crate::codes;
use crate::devices::DeviceTable;
use crate::infer::Typed;
use crate::resolve::{InputSource, ListElement, OutputId, ResolvedLink, ResolvedPrimitive, every};
use crate::syntax::literal::{Literal, LiteralShape};
use crate::syntax::part::ListPosition;
use crate::syntax::stored_value::StoredValue;
use arena::ArenaBuilder;
use delays::{DelayCopies, DelayKey};
use lists::ListLayout;
use operands::BatchKernel;
use schedule::Batch;

pub use port_slots::PortSlots;

/// A value in an arena.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotRange {
    /// The arena.
    pub store: Store,
    /// Index of the first slot.
    pub slot: u32,
    /// Number of slots.
    pub width: u32,
}

/// A plan and the slots of its ports.
#[derive(Clone, Debug)]
pub struct Lowered {
    /// The plan.
    pub plan: PlanData,
    /// Slots of the inputs and outputs, by item.
    pub slots: PortSlots,
    /// Items with a kernel, in the order of evaluation.
    pub order: Vec<usize>,
}

/// Lowers a net that keeps every rule.
///
/// # Errors
/// Returns [`codes::NET_TOO_LARGE`] if the plan exceeds a limit.
pub fn lower(net: Checked<'_>) -> Result<Lowered, Box<Diagnostic>> {
    let net = net.net();
    let schedule = schedule::schedule(net);
    let mut lowering = Lowering {
        net,
        arena: ArenaBuilder::default(),
        slots: PortSlots::none(net.graph.items.len()),
        copies: BTreeMap::new(),
        lists: ListLayout::default(),
        clocks: 0,
    };
    lowering.place(&schedule);
    let (runs, operands) = lowering.runs(&schedule);
    let regions = lowering.regions(&schedule);
    let monitors = lowering.monitors();
    let inputs = lowering.inputs();
    let publishes = lowering.publishes();
    let Lowering {
        arena,
        slots,
        copies,
        lists,
        clocks,
        ..
    } = lowering;
    let mut delays = delays::ranges(&copies);
    delays.extend(lists.delays);
    check_size(&arena, operands.len())?;
    let plan = PlanData {
        catalogue: primitives::fingerprint(),
        configuration: net.graph.cell.fingerprint,
        reals: arena.reals,
        bools: arena.bools,
        ints: arena.ints,
        runs,
        operands,
        blocks: regions.blocks,
        regions: regions.regions,
        blanks: regions.blanks,
        delays,
        monitors,
        inputs,
        publishes,
        clocks,
        rate: net.graph.rate,
        survives_device_loss: net.graph.net.survives_device_loss,
    };
    let batches = schedule.into_iter();
    Ok(Lowered {
        plan,
        slots,
        order: batches.flat_map(|batch| batch.items).collect(),
    })
}

/// Checks a plan as the executor will. A net that keeps every rule must lower to a valid plan; if not, this is a bug of
/// the compiler, and it is reported here instead of sending the plan.
///
/// # Errors
/// Returns the error that the executor would report.
pub fn prove(plan: &PlanData, cell: &DeviceTable) -> Result<CheckedPlan, Box<Diagnostic>> {
    let checked = plan.plan().check(&cell.models(), cell.fingerprint);
    checked.map_err(|error| {
        let message = format!("internal error: the plan of this net is invalid: {error:?}");
        let diagnostic = Diagnostic::error(codes::NET_TOO_LARGE, Span::default(), message);
        let help = "this is a bug of the compiler: report it with the net";
        Box::new(diagnostic.anywhere().help(help))
    })
}

/// Appends a run with the operands from `first` to `end`, unless there are none.
fn end_run(runs: &mut Vec<KernelRun>, kernel: u16, first: u32, end: u32) {
    if end > first {
        runs.push(KernelRun {
            kernel,
            first,
            operands: end - first,
        });
    }
}

fn check_size(arena: &ArenaBuilder, operands: usize) -> Result<(), Box<Diagnostic>> {
    let (reals, bools) = (arena.reals.len(), arena.bools.len());
    let slots = reals.max(bools).max(arena.ints.len());
    if slots <= SLOTS_MAX && operands <= OPERANDS_MAX {
        return Ok(());
    }
    let message = format!(
        "the net needs {slots} slots and {operands} operands; the limits are {SLOTS_MAX} and {OPERANDS_MAX}"
    );
    let diagnostic = Diagnostic::error(codes::NET_TOO_LARGE, Span::default(), message);
    Err(Box::new(
        diagnostic.anywhere().help("split it into several nets"),
    ))
}

/// Converts a default of the catalogue to a literal.
pub(crate) fn literal(value: Default) -> Literal {
    let shape = match value {
        Default::Real(value) => LiteralShape::Real(value, None),
        Default::Int(value) => LiteralShape::Int(value),
        Default::Bool(value) => LiteralShape::Bool(value),
        Default::Word(word) => LiteralShape::Text(word.to_owned()),
        Default::Null => LiteralShape::Null,
    };
    Literal::new(shape, Span::default())
}

/// Returns the value of a constant, or the initial value of an input.
fn initial_value<'a>(item: &ResolvedPrimitive<'a>) -> Option<&'a Literal> {
    let mut rows = item.spec().parameters.iter().zip(&item.parameters);
    let is_open = |kind| matches!(kind, ParameterKind::Value(PortType::Any, _));
    let (_, literal) = rows.find(|(parameter, _)| is_open(parameter.kind))?;
    *literal
}

struct Lowering<'a> {
    net: Typed<'a>,
    arena: ArenaBuilder,
    slots: PortSlots,
    copies: DelayCopies,
    lists: ListLayout,
    clocks: u32,
}

impl<'a> Lowering<'a> {
    fn item(&self, number: usize) -> &'a ResolvedPrimitive<'a> {
        // Every number here comes from the list of items.
        &self.net.graph.items[number]
    }

    fn port_type(&self, number: usize, port: &Port) -> Type {
        let ty = self.net.inferred.port_type(self.net.graph, number, port.ty);
        // The checks refuse nets with unknown types.
        ty.unwrap_or(Type::Real)
    }

    fn place(&mut self, schedule: &[Batch]) {
        self.claim_list_outputs();
        // Outputs first, in the order of evaluation, so that values that are computed together are adjacent in memory.
        for number in schedule.iter().flat_map(|batch| &batch.items) {
            self.place_outputs(*number);
        }
        for (number, item) in self.net.graph.items.iter().enumerate() {
            if item.entry.kernels.is_empty() {
                self.place_outputs(number);
            }
        }
        self.place_copies();
        for number in 0..self.net.graph.items.len() {
            self.place_inputs(number);
        }
    }

    /// Allocates slots for the values that delayed links carry: one range for all links with the same source and
    /// initial value, in the order of the sources, so that adjacent values can be copied together.
    fn place_copies(&mut self) {
        let items = self.net.graph.items.iter().enumerate();
        let keys = items.flat_map(|(number, item)| {
            item.links()
                .filter(|(_, link)| link.delayed && link.position == ListPosition::default())
                .filter_map(move |(port, link)| Some((number, item.spec().inputs.get(port)?, link)))
        });
        let conditions = self.net.graph.regions.iter();
        let conditions = conditions.filter_map(|region| match &region.condition {
            InputSource::Link(link) if link.delayed => Some(self.copy_key(link, Type::Bool)),
            _ => None,
        });
        let keys: BTreeSet<DelayKey> = keys
            .map(|(number, port, link)| self.copy_key(link, self.port_type(number, port)))
            .chain(conditions)
            .collect();
        for key in keys {
            let copy = self.arena.variable(&key.initial);
            self.copies.insert(key, copy);
        }
    }

    fn copy_key(&self, link: &ResolvedLink<'_>, ty: Type) -> DelayKey {
        let source = self.source(link, ty);
        let initial = link.initial.and_then(|initial| initial.stored(ty));
        DelayKey {
            store: source.store as u8,
            from: source.slot,
            initial: initial.unwrap_or_else(|| StoredValue::null(ty)),
        }
    }

    /// Returns the slots that a link reads: an output or a part of it.
    fn source(&self, link: &ResolvedLink<'_>, ty: Type) -> SlotRange {
        let OutputId { item, port } = link.from;
        let output = self.slots.outputs(item)[port];
        let whole = self.net.inferred.output_type(self.net.graph, link.from);
        let part = link.part.zip(whole).and_then(|(part, ty)| part.of(ty));
        SlotRange {
            slot: output.slot + part.map_or(0, |(offset, _)| offset),
            width: ty.width(),
            ..output
        }
    }

    fn runs(&mut self, schedule: &[Batch]) -> (Vec<KernelRun>, Vec<u32>) {
        let (mut runs, mut operands) = (Vec::new(), Vec::new());
        for batch in schedule {
            let mut first = operands.len() as u32;
            let kernel = BatchKernel::of(batch.kernel);
            for number in &batch.items {
                let before = operands.len() as u32;
                let mut copies = Vec::new();
                self.copies_before(*number, &mut copies, &mut operands);
                if !copies.is_empty() {
                    end_run(&mut runs, batch.kernel, first, before);
                    runs.append(&mut copies);
                    first = operands.len() as u32;
                }
                self.operands(*number, kernel.as_ref(), &mut operands);
            }
            end_run(&mut runs, batch.kernel, first, operands.len() as u32);
        }
        for number in self.items_with_pending_copies() {
            self.copies_before(number, &mut runs, &mut operands);
        }
        (runs, operands)
    }

    fn place_outputs(&mut self, number: usize) {
        let item = self.item(number);
        let begin = self.slots.begin();
        for (index, port) in item.spec().outputs.iter().enumerate() {
            let ty = self.port_type(number, port);
            // A constant starts with its value, an input with its initial value in its first output; everything else
            // starts as null.
            let value = match item.spec().role {
                Role::Constant | Role::Input if index == 0 => {
                    initial_value(item).and_then(|literal| literal.stored(ty))
                }
                _ => None,
            };
            if item.spec().role == Role::Constant {
                let value = value.unwrap_or_else(|| StoredValue::null(ty));
                self.slots.push(self.arena.constant(&value));
                continue;
            }
            let output = OutputId {
                item: number,
                port: index,
            };
            let claimed = self.claimed_slot(output, ty, value.as_ref());
            let slot = claimed.unwrap_or_else(|| match &value {
                Some(value) => self.arena.variable(value),
                None => self.arena.null(ty),
            });
            self.slots.push(slot);
        }
        self.slots.end_outputs(number, begin);
    }

    fn place_inputs(&mut self, number: usize) {
        let item = self.item(number);
        let begin = self.slots.begin();
        for (index, (input_source, port)) in item.inputs.iter().zip(item.spec().inputs).enumerate()
        {
            let ty = self.port_type(number, port);
            let slot = match input_source {
                InputSource::List(list) => match self.place_list(number, index, list) {
                    Some(slot) => slot,
                    None => self.constant(None, ty),
                },
                InputSource::Link(link) => self.link_slot(link, ty),
                InputSource::Literal(literal) => self.constant(Some(literal), ty),
                InputSource::Outcomes(outcomes) => {
                    // Each condition is a group of operands of its own.
                    for condition in &outcomes.conditions {
                        let slot = match condition {
                            ListElement::Link(link) => self.link_slot(link, ty),
                            ListElement::Literal(literal, _) => self.constant(Some(literal), ty),
                        };
                        self.slots.push(slot);
                    }
                    continue;
                }
                InputSource::Default(value) => self.default(*value, ty),
                // The checks refuse both.
                InputSource::Missing | InputSource::Refused => self.constant(None, ty),
            };
            self.slots.push(slot);
        }
        self.slots.end_inputs(number, begin);
    }

    fn constant(&mut self, literal: Option<&Literal>, ty: Type) -> SlotRange {
        let stored = literal.and_then(|literal| literal.stored(ty));
        let stored = stored.unwrap_or_else(|| StoredValue::null(ty));
        self.arena.constant(&stored)
    }

    /// Returns the slot of a default. A number is the default of every element of a composite or array.
    fn default(&mut self, value: Default, ty: Type) -> SlotRange {
        let several = matches!(
            ty,
            Type::Vector3 | Type::Twist | Type::Wrench | Type::Reals(_)
        );
        if let (Default::Real(value), true) = (value, several) {
            let stored = StoredValue::reals(std::iter::repeat_n(value, ty.width() as usize));
            return self.arena.constant(&stored);
        }
        self.constant(Some(&literal(value)), ty)
    }

    /// Returns the slots of the value that a link carries: the output, a part of it, or the copy from the previous
    /// cycle.
    fn link_slot(&mut self, link: &ResolvedLink<'_>, ty: Type) -> SlotRange {
        let source = self.source(link, ty);
        if !link.delayed {
            return source;
        }
        // Every delayed link has a copy.
        let copy = self.copies.get(&self.copy_key(link, ty));
        copy.copied().unwrap_or(source)
    }

    fn monitors(&self) -> Vec<MonitorPoint> {
        let items = self.net.graph.items.iter().enumerate();
        let points = items.filter(|(_, item)| item.spec().role == Role::Monitor);
        let point = |(number, item): (usize, &ResolvedPrimitive<'_>)| {
            let slot = self.slots.inputs(number).first()?;
            Some(MonitorPoint {
                store: slot.store,
                slot: slot.slot,
                width: slot.width,
                // The checks refuse invalid rates.
                every: every(item, self.net.graph).unwrap_or(1),
            })
        };
        points.filter_map(point).collect()
    }
}
