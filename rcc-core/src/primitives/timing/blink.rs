//! `Blink`: alternates between true and false with given durations.

use crate::frame::Frame;
use crate::primitive::{
    Bool, CatalogueEntry, DefaultValue, Example, Int, Kernel, Parameter, Port, Real, Slot, Spec,
    StateSpec, Step, UnitRule, choose, higher, operands, whole,
};
use crate::types::NULL_BOOL;

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "Blink",
        summary: "Alternates between true and false while enabled, starting with true.",
        null: "a null input gives null and restarts the pattern",
        examples: &[Example::new(
            "2 ms on, 1 ms off",
            "{on: 2 ms, off: 1 ms}",
            "enable | out
             true | true
             true | true
             true | false
             true | true
             false | false
             true | true
             null | null
             true | true",
        )],
        inputs: &[Port::bool("enable", "while false, the output is false")
            .default(DefaultValue::Bool(true))],
        outputs: &[Port::bool("out", "on")],
        parameters: &[
            Parameter::real(
                "on",
                UnitRule::SECOND,
                "duration of true; at least one cycle",
            )
            .above(0.0),
            Parameter::real(
                "off",
                UnitRule::SECOND,
                "duration of false; at least one cycle",
            )
            .above(0.0),
        ],
        state: StateSpec {
            ints: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<Blink>()],
);

operands! {
    struct Blink { enable: Slot<Bool>, out: Slot<Bool>, on: Slot<Real>, off: Slot<Real>, age: Slot<Int> }
}

impl Step for Blink {
    /// `age`: cycles since the current period of the pattern started, with the first cycle of true as 0.
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let (enabled, dt_s) = (frame.get(self.enable)?, frame.dt_s);
        let cycles = |time_s: f64| whole(higher(libm::round(time_s / dt_s), 1.0)).max(1);
        let (on, off) = (cycles(frame.get(self.on)?), cycles(frame.get(self.off)?));
        let before = frame.get(self.age)?;
        let next = before.saturating_add(1);
        let next = choose(next >= on.saturating_add(off), 0, next);
        let is_enabled = enabled == 1;
        frame.put(self.age, choose(is_enabled, next, 0))?;
        let value = u8::from(is_enabled & (before < on));
        frame.put(self.out, choose(enabled & NULL_BOOL != 0, NULL_BOOL, value))
    }
}
