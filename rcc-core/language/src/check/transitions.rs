//! Rules about the transitions of state machines. Runs on the loader's threads.

use rcc_config::diagnostic::Diagnostic;
use rcc_core::types::Type;

use crate::codes;
use crate::infer::Typed;
use crate::syntax::literal::{Literal, LiteralShape};

/// Largest number of a state: the table stores Reals, which are exact up to here.
const STATE_MAX: f64 = 9_007_199_254_740_992.0;

/// Requires that the rows of a `StateMachine` have whole numbers of states, and indices of conditions that exist: a row
/// with any other number never matches.
pub fn transitions_are_possible(net: Typed<'_>, diagnostics: &mut Vec<Diagnostic>) {
    for (number, item) in net.graph.items_of(|spec| spec.name == "StateMachine") {
        let (Some(table), Some(on)) = (item.given("transitions"), item.spec().inputs.first())
        else {
            continue;
        };
        let conditions = match net.inferred.port_type(net.graph, number, on.ty) {
            Some(Type::Bools(length)) => f64::from(length),
            // Its length is unknown, or it is something else, which is reported.
            _ => f64::INFINITY,
        };
        let most = [STATE_MAX, STATE_MAX, conditions - 1.0];
        for (row, elements) in rows(table).enumerate() {
            let elements = elements.iter().zip(most).enumerate();
            for (column, (element, most)) in elements {
                if is_index(element, most) {
                    continue;
                }
                let wanted = match column {
                    2 if most.is_finite() => format!("0 to {most}"),
                    _ => "a whole number, at least 0".to_owned(),
                };
                let message = format!(
                    "`{}.transitions[{row},{column}]` must be {wanted}, found {element}",
                    item.id()
                );
                let diagnostic = Diagnostic::error(codes::OUT_OF_RANGE, element.span, message);
                diagnostics.push(diagnostic.help(
                    "a row is [state before, state after, index of the condition in `on` from 0]",
                ));
            }
        }
    }
}

/// Returns the rows of a table; those that are not lists of three are reported as another type.
fn rows(table: &Literal) -> impl Iterator<Item = &[Literal]> {
    let rows = match &table.shape {
        LiteralShape::List(rows) => rows.as_slice(),
        _ => &[],
    };
    rows.iter().filter_map(|row| match &row.shape {
        LiteralShape::List(elements) if elements.len() == 3 => Some(elements.as_slice()),
        _ => None,
    })
}

/// Returns true for a whole number from 0 to `most`, and for what is reported as another type.
fn is_index(element: &Literal, most: f64) -> bool {
    match element.number() {
        Some(number) => (0.0..=most).contains(&number) && number.fract() == 0.0,
        None => !element.is_null(),
    }
}
