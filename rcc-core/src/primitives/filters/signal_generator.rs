//! `SignalGenerator`: sine, square, triangle and sawtooth of one frequency, in phase.

use core::f64::consts::TAU;

use crate::frame::Frame;
use crate::primitive::{
    CatalogueEntry, DefaultValue, Example, Kernel, Port, Real, Slot, Spec, StateSpec, Step,
    UnitRule, finite, operands,
};

/// The row of the catalogue.
pub const ENTRY: CatalogueEntry = CatalogueEntry::new(
    Spec {
        name: "SignalGenerator",
        summary: "Periodic test signals: sine, square, triangle and sawtooth.",
        null: "a null input gives null; a null frequency freezes the phase",
        undefined: "overflow",
        formula: "phase += frequency · dt (turns), so that a change of frequency causes no jump; offset + amplitude times sin(2π phase), ±1 by half turns, and the triangle and the sawtooth with the same zero crossing",
        examples: &[Example::new(
            "an eighth of a period per cycle",
            "",
            "frequency | amplitude | offset | sine | square | triangle | sawtooth
                 125 Hz | 2.0 | 1.0 | 1.0 | 3.0 | 1.0 | 1.0
                 125 Hz | 2.0 | 1.0 | 2.414213562373095 | 3.0 | 2.0 | 1.5
                 125 Hz | 2.0 | 1.0 | 3.0 | 3.0 | 3.0 | 2.0
                 125 Hz | 2.0 | null | null | null | null | null
                 125 Hz | 2.0 | 1.0 | 1.0 | -1.0 | 1.0 | -1.0
                 125 Hz | 2.0 | 1.0 | -0.414213562373095 | -1.0 | 0.0 | -0.5
                 125 Hz | 2.0 | 1.0 | -1.0 | -1.0 | -1.0 | 0.0",
        )],
        inputs: &[
            Port::real("frequency", UnitRule::HERTZ, "frequency"),
            Port::real(
                "amplitude",
                UnitRule::Var(0),
                "largest distance from `offset`",
            )
            .default(DefaultValue::Real(1.0)),
            Port::real("offset", UnitRule::Var(0), "mean").default(DefaultValue::Real(0.0)),
        ],
        outputs: &[
            Port::real("sine", UnitRule::Var(0), "sine; starts at the mean, rising").diagnostic(),
            Port::real(
                "square",
                UnitRule::Var(0),
                "square wave; high in the first half of the period, low in the second",
            )
            .diagnostic(),
            Port::real(
                "triangle",
                UnitRule::Var(0),
                "triangle wave; starts at the mean, rising, with the peaks of the sine",
            )
            .diagnostic(),
            Port::real(
                "sawtooth",
                UnitRule::Var(0),
                "sawtooth; starts at the mean, rising; falls in the middle of the period",
            )
            .diagnostic(),
        ],
        // phase, in turns
        state: StateSpec {
            reals: 1,
            ..StateSpec::NONE
        },
        ..Spec::PLAIN
    },
    &[Kernel::each::<SignalGenerator>()],
);

operands! {
    struct SignalGenerator {
        frequency: Slot<Real>, amplitude: Slot<Real>, offset: Slot<Real>, sine: Slot<Real>, square: Slot<Real>,
        triangle: Slot<Real>, sawtooth: Slot<Real>, state: Slot<Real>,
    }
}

impl Step for SignalGenerator {
    #[inline(always)]
    fn step(self, frame: &mut Frame<'_>) -> Option<()> {
        let SignalGenerator {
            sine,
            square,
            triangle,
            sawtooth,
            ..
        } = self;
        let (frequency, before) = (frame.get(self.frequency)?, frame.get(self.state)?);
        let (amplitude, offset) = (frame.get(self.amplitude)?, frame.get(self.offset)?);
        let phase = if before.is_nan() { 0.0 } else { before };
        let line = if phase < 0.5 { phase } else { phase - 1.0 };
        let peak = if line > 0.25 {
            0.5 - line
        } else if line < -0.25 {
            -0.5 - line
        } else {
            line
        };
        let high = if phase < 0.5 { 1.0 } else { -1.0 };
        let scale = if frequency.is_nan() {
            frequency
        } else {
            amplitude
        };
        let shapes = [
            (sine, libm::sin(TAU * phase)),
            (square, high),
            (triangle, 4.0 * peak),
            (sawtooth, 2.0 * line),
        ];
        for (slot, shape) in shapes {
            frame.put(slot, finite(offset + scale * shape))?;
        }
        let moved = phase + frequency * frame.dt_s;
        let next = moved - libm::floor(moved);
        // Rounding may leave a full turn: it is the start of the next one.
        let next = if next < 1.0 { next } else { 0.0 };
        frame.put(self.state, if moved.is_finite() { next } else { phase })
    }
}
