//! `StateMachine`: a small table of transitions between numbered states, with at most one transition per cycle.

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Dim, ElementType, Example, Kernel, NullRule, Parameter,
    ParameterKind, Port, PortType, Spec, StateSpec, UnitRule, each,
};
use crate::types::Type;
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "StateMachine",
        summary: "A state that changes by a table of transitions, at most once per cycle.",
        null: "a null condition counts as false; the outputs are never null",
        null_rule: NullRule::Known,
        formula: "Moore machine: the first row [from, to, on] with from = state and on[on] true leads to `to`",
        inputs: &[
            Port::new(
                "on",
                PortType::Array(ElementType::Are(Type::Bool), Dim::Var(0)),
                UnitRule::Typed,
                "conditions, referred to by index in the rows",
            ),
            Port::bool(
                "reset",
                "returns to the initial state, before any transition",
            )
            .default(DefaultValue::Bool(false)),
        ],
        outputs: &[
            Port::int("state", "state after this cycle's transition"),
            Port::bool(
                "entered",
                "true in the cycle in which the state was entered",
            )
            .diagnostic(),
            Port::real(
                "time",
                UnitRule::Is(Unit::SECOND),
                "time since the state was entered, 0 in that cycle",
            )
            .within(0.0, f64::INFINITY)
            .diagnostic(),
        ],
        parameters: &[
            Parameter::new(
                "transitions",
                ParameterKind::Value(
                    PortType::Matrix(Dim::Var(1), Dim::Is(3)),
                    UnitRule::Is(Unit::ONE),
                ),
                "rows of three integers: from state, to state, index of the condition (from 0); the first matching row wins",
            ),
            Parameter::new(
                "initial",
                ParameterKind::Value(PortType::Is(Type::Int), UnitRule::Typed),
                "state before the first transition",
            )
            .default(DefaultValue::Int(0)),
        ],
        state: StateSpec {
            reals: 1,
            ints: 2,
            ..StateSpec::NONE
        },
        examples: &[Example::new(
            "idle 0, moving 1, done 2; on[0] starts, on[1] ends",
            "{transitions: [[0, 1, 0], [1, 2, 1]]}",
            "on | reset | state | entered | time
             [false, false] | false | 0 | true | 0.0
             [false, true] | false | 0 | false | 0.001
             [true, true] | false | 1 | true | 0.0
             [null, true] | false | 2 | true | 0.0
             [true, true] | false | 2 | false | 0.001
             [true, true] | true | 1 | true | 0.0",
        )],
        ..Spec::PLAIN
    },
    &[Kernel::new(|frame, operands| each(frame, operands, step))],
);

#[inline]
fn step(frame: &mut Frame<'_>, group: [u32; 11]) -> Option<()> {
    let [
        on,
        reset,
        state,
        entered,
        time,
        table,
        initial,
        since,
        ints,
        conditions,
        rows,
    ] = group;
    let begins = frame.get_int(ints + 1)? == 0 || frame.get_bool(reset)? == 1;
    let before = frame.get_int(if begins { initial } else { ints })?;
    let mut after = before;
    let mut moved = begins;
    for row in 0..rows {
        let [from, to, condition] = frame.get_reals(table + row * 3)?;
        // Saturates; an invalid condition index matches no condition.
        let condition = condition as u32;
        let fits = from == before as f64 && condition < conditions;
        if fits && frame.get_bool(on + condition)? == 1 {
            after = to as i64;
            moved = true;
            break;
        }
    }
    let elapsed = if moved {
        0.0
    } else {
        frame.get_real(since)? + frame.dt_s
    };
    frame.put_int(ints, after)?;
    frame.put_int(ints + 1, 1)?;
    frame.put_real(since, elapsed)?;
    frame.put_int(state, after)?;
    frame.put_bool(entered, u8::from(moved))?;
    frame.put_real(time, elapsed)
}
