//! `Delay`: a value delayed by a time.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, Element, Example, Int, Kernel, MemorySpec, Parameter, ParameterKind,
    Port, PortType, Real, Slot, Spec, StateSpec, Step, UnitRule, copy, fill_null, operands,
};
use crate::unit::Unit;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Delay",
        summary: "A value delayed by a time that may change in any cycle.",
        null: "null is delayed like any value; a null age gives null, and so does an age that is negative or beyond `max`",
        undefined: "the age is beyond `max`, or the net has not run that long; age < 0",
        formula: "the value from round(age / period) evaluations ago; age 0: the current value",
        examples: &[
            Example::new(
                "two cycles",
                "{max: 2 ms}",
                "in | age | out
                 1 | 0.002 | null
                 2 | 0.002 | null
                 3 | 0.002 | 1
                 4 | 0.001 | 3
                 5 | 0 | 5
                 6 | 0.003 | null
                 7 | null | null",
            ),
            Example::new(
                "Bools",
                "{max: 1 ms}",
                "in | age | out\n true | 0.001 | null\n false | 0.001 | true\n false | 0.001 | false",
            ),
        ],
        inputs: &[
            Port::new("in", PortType::Any, UnitRule::Var(0), "value to delay"),
            Port::real("age", UnitRule::Is(Unit::SECOND), "delay, from 0 to `max`"),
        ],
        outputs: &[Port::new(
            "out",
            PortType::Any,
            UnitRule::Var(0),
            "delayed value",
        )],
        parameters: &[Parameter::new(
            "max",
            ParameterKind::Window,
            "largest delay, rounded to a whole number of evaluations",
        )],
        // index of the next value in the ring
        state: StateSpec {
            ints: 1,
            ..StateSpec::NONE
        },
        memory: MemorySpec::window(1),
        ..Spec::PLAIN
    },
    &[
        Kernel::each::<Delay<Real>>(),
        Kernel::each::<Delay<Bool>>(),
        Kernel::each::<Delay<Int>>(),
    ],
);

operands! {
    /// `place`: index in the ring of the next value.
    struct Delay<E> {
        input: Slot<E>, age: Slot<Real>, out: Slot<E>, place: Slot<Int>, ring: Slot<E>, width: u32, cycles: u32,
    }
}

impl<E: Element> Step for Delay<E> {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let Delay {
            input, out, width, ..
        } = self;
        let length = i64::from(self.cycles.max(1));
        let next = frame.get(self.place)?;
        let next = if (0..length).contains(&next) { next } else { 0 };
        // At most CYCLES_MAX elements; the plan's check multiplied this with the width.
        let slot = |place: i64| self.ring + place as u32 * width;
        let back = libm::round(frame.get(self.age)? / frame.dt_s);
        if back == 0.0 {
            copy(frame, input, out, width)?;
        } else if back >= 1.0 && back <= length as f64 {
            let then = next - back as i64;
            let then = if then < 0 { then + length } else { then };
            copy(frame, slot(then), out, width)?;
        } else {
            fill_null(frame, out, width)?;
        }
        copy(frame, input, slot(next), width)?;
        frame.put(self.place, if next + 1 < length { next + 1 } else { 0 })
    }
}
