//! `StateMachine`: a small table of transitions between numbered states, with at most one transition per cycle.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Dim, ElementType, Example, Int, Kernel, NullRule,
    Parameter, ParameterKind, Port, PortType, Real, Slot, Spec, StateSpec, Step, UnitRule,
    operands,
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
    &[Kernel::each::<StateMachine>()],
);

operands! {
    struct StateMachine {
        on: Slot<Bool>, reset: Slot<Bool>, state: Slot<Int>, entered: Slot<Bool>, time: Slot<Real>,
        /// Rows `[from, to, condition]`.
        transitions: Slot<[Real; 3]>, initial: Slot<Int>, since: Slot<Real>,
        /// The state, and 1 after the first cycle.
        memory: Slot<[Int; 2]>, conditions: u32, rows: u32,
    }
}

impl Step for StateMachine {
    #[inline]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let [last, begun] = frame.get(self.memory)?;
        let begins = begun == 0 || frame.get(self.reset)? == 1;
        let before = if begins {
            frame.get(self.initial)?
        } else {
            last
        };
        let mut after = before;
        let mut moved = begins;
        for row in 0..self.rows {
            let [from, to, condition] = frame.get(self.transitions + row * 3)?;
            // An index outside `on` and null match no condition; the loader refuses both.
            let exists = (0.0..f64::from(self.conditions)).contains(&condition);
            let fits = from == before as f64 && exists;
            if fits && frame.get(self.on + condition as u32)? == 1 {
                after = to as i64;
                moved = true;
                break;
            }
        }
        let elapsed = if moved {
            0.0
        } else {
            frame.get(self.since)? + frame.dt_s
        };
        frame.put(self.memory, [after, 1])?;
        frame.put(self.since, elapsed)?;
        frame.put(self.state, after)?;
        frame.put(self.entered, u8::from(moved))?;
        frame.put(self.time, elapsed)
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::PrimitiveHarness;

    #[test]
    fn a_row_whose_condition_does_not_exist_never_matches() {
        for (condition, state) in [
            (-1.0, 0),
            (f64::NAN, 0),
            (1.0, 0),
            (f64::INFINITY, 0),
            (0.0, 1),
        ] {
            let mut bench = PrimitiveHarness::new("StateMachine");
            bench.set_int("initial", 0);
            bench
                .set_bool("on", Some(true))
                .set_bool("reset", Some(false));
            bench.set_reals("transitions", &[0.0, 1.0, condition]);
            assert_eq!(bench.step().int("state"), state, "{condition}");
        }
    }
}
