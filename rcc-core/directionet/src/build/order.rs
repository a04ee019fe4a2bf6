//! The order of the text's primitives: sources before readers, except for `Pre`, which gives the value of the previous
//! cycle. Runs on the loader's threads.

use std::collections::VecDeque;

use rcc_config::diagnostic::Diagnostic;
use rcc_language::codes;

use super::Conversion;
use crate::flatten::FlatSource;
use crate::table::{Counterpart, SpecialConversion};

/// Most primitives of a cycle that a message names.
const NAMED_MAX: usize = 8;

impl Conversion<'_, '_> {
    /// Returns all primitives in an order of evaluation. A cycle is reported, and its primitives are left out.
    pub(super) fn order(&mut self) -> Vec<usize> {
        let count = self.flat.primitives.len();
        let mut readers = vec![Vec::new(); count];
        let mut missing = vec![0_usize; count];
        for (number, primitive) in self.flat.primitives.iter().enumerate() {
            let links = primitive.inputs.iter().map(|(_, source)| source);
            for source in links.chain(&primitive.active) {
                if let FlatSource::Output { primitive, .. } = source
                    && !self.is_pre(*primitive)
                    && let (Some(readers), Some(missing)) =
                        (readers.get_mut(*primitive), missing.get_mut(number))
                {
                    readers.push(number);
                    *missing += 1;
                }
            }
        }
        let mut ready: VecDeque<usize> =
            (0..count).filter(|n| missing.get(*n) == Some(&0)).collect();
        let mut order = Vec::new();
        while let Some(number) = ready.pop_front() {
            order.push(number);
            for reader in readers.get(number).into_iter().flatten() {
                if let Some(missing) = missing.get_mut(*reader) {
                    *missing -= 1;
                    if *missing == 0 {
                        ready.push_back(*reader);
                    }
                }
            }
        }
        if order.len() < count {
            self.report_circle(&missing);
        }
        order
    }

    pub(super) fn is_pre(&self, number: usize) -> bool {
        let entry = self.entries.get(number).copied().flatten();
        entry.is_some_and(|entry| entry.row.to == Counterpart::Special(SpecialConversion::Pre))
    }

    /// Follows the links backwards from a primitive that waits until one is met again, which closes the cycle.
    fn report_circle(&mut self, missing: &[usize]) {
        let waits = |number: usize| missing.get(number).is_some_and(|missing| *missing > 0);
        let Some(mut number) = (0..missing.len()).find(|number| waits(*number)) else {
            return;
        };
        let mut seen = vec![false; missing.len()];
        let mut path = Vec::new();
        while let Some(seen) = seen.get_mut(number).filter(|seen| !**seen) {
            *seen = true;
            path.push(number);
            let Some(primitive) = self.flat.primitives.get(number) else {
                return;
            };
            let links = primitive.inputs.iter().map(|(_, source)| source);
            let next = links
                .chain(&primitive.active)
                .find_map(|source| match source {
                    FlatSource::Output { primitive, .. }
                        if waits(*primitive) && !self.is_pre(*primitive) =>
                    {
                        Some(*primitive)
                    }
                    _ => None,
                });
            let Some(next) = next else { return };
            number = next;
        }
        let start = path.iter().position(|it| *it == number).unwrap_or(0);
        let circle = path.get(start..).unwrap_or_default();
        let names: Vec<String> = circle
            .iter()
            .rev()
            .take(NAMED_MAX)
            .filter_map(|number| Some(self.flat.primitives.get(*number)?.path.clone()))
            .collect();
        let more = if circle.len() > NAMED_MAX {
            " → …"
        } else {
            ""
        };
        let message = format!("loop without a `Pre`: {}{more}", names.join(" → "));
        let span = self.span(number);
        let diagnostic = Diagnostic::error(codes::LOOP_WITHOUT_DELAY, span, message);
        self.diagnostics.push(
            diagnostic.help("insert a `Pre` into one link of the loop, such as `Core::DoublePre`"),
        );
    }
}
