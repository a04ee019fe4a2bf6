//! Puts the primitives of the operations into the net. Runs on the loader's threads.

use std::collections::HashMap;

use super::places::PortWords;
use super::values::{Operation, Operations, marked};
use crate::syntax::{Primitive, Source};

/// Gives the operations their ids, and puts each before the primitive with its expression.
///
/// `whole` are the operations that are a whole `Formula`, by the number of the primitive; `refused` is added at the end.
pub fn insert(
    operations: Vec<Operation>,
    whole: &HashMap<usize, usize>,
    refused: Vec<Primitive>,
    primitives: &mut Vec<Primitive>,
    words: &mut PortWords,
) {
    let used = used(&operations, primitives);
    let mut ids: Vec<String> = Vec::with_capacity(operations.len());
    let mut counts: HashMap<usize, usize> = HashMap::new();
    let mut by_owner: HashMap<usize, Vec<usize>> = HashMap::new();
    for (number, operation) in operations.iter().enumerate() {
        let id = match &operation.id {
            Some(id) => id.clone(),
            None if !used[number] => String::new(),
            None => {
                let count = counts.entry(operation.owner).or_default();
                *count += 1;
                by_owner.entry(operation.owner).or_default().push(number);
                let owner = primitives.get(operation.owner);
                let owner = owner.map_or("", |owner| owner.id.name.as_str());
                format!("{owner}/{count}")
            }
        };
        if used[number] {
            words.add(&id, &operation.symbol);
        }
        ids.push(id);
    }
    let mut lowered = Vec::with_capacity(primitives.len() + operations.len());
    for (owner, mut primitive) in std::mem::take(primitives).into_iter().enumerate() {
        for number in by_owner.remove(&owner).unwrap_or_default() {
            lowered.push(Operations::primitive(&operations[number], &ids[number]));
        }
        if let Some(&number) = whole.get(&owner) {
            primitive = Primitive {
                id: primitive.id,
                ..Operations::primitive(&operations[number], &ids[number])
            };
        }
        lowered.push(primitive);
    }
    lowered.extend(refused);
    for primitive in &mut lowered {
        let inputs = primitive.inputs.iter_mut().map(|(_, source)| source);
        for source in inputs.chain(&mut primitive.active) {
            put_ids(source, &ids);
        }
    }
    *primitives = lowered;
}

/// Returns which operations are read, directly or through others.
fn used(operations: &[Operation], primitives: &[Primitive]) -> Vec<bool> {
    let mut used = vec![false; operations.len()];
    let mark = |source: &Source, used: &mut Vec<bool>| {
        for number in source.links().iter().filter_map(|link| marked(&link.from)) {
            if let Some(place) = used.get_mut(number) {
                *place = true;
            }
        }
    };
    for primitive in primitives {
        let inputs = primitive.inputs.iter().map(|(_, source)| source);
        for source in inputs.chain(&primitive.active) {
            mark(source, &mut used);
        }
    }
    for (number, operation) in operations.iter().enumerate().rev() {
        used[number] |= operation.id.is_some();
        if used[number] {
            for (value, span) in &operation.inputs {
                mark(&Operations::source(value, *span), &mut used);
            }
        }
    }
    used
}

/// Puts ids in the place of marks.
fn put_ids(source: &mut Source, ids: &[String]) {
    match source {
        Source::Link(link) => {
            if let Some(id) = marked(&link.from).and_then(|number| ids.get(number)) {
                link.from.primitive = id.as_str().into();
            }
        }
        Source::List(list) => list.elements.iter_mut().for_each(|one| put_ids(one, ids)),
        Source::Outcomes(outcomes) => {
            outcomes
                .rows
                .iter_mut()
                .for_each(|(_, one)| put_ids(one, ids));
        }
        Source::Literal(_) | Source::Formula(_) | Source::Refused => {}
    }
}
