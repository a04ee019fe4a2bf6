//! The frequency responses of the filter primitives, measured with sampled sines, against their closed forms.

use core::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use nalgebra::Complex;

use super::Biquad;
use crate::testing::PrimitiveHarness;

const DT_S: f64 = 1e-3;
const J: Complex<f64> = Complex::new(0.0, 1.0);

/// e^(j angle).
fn turned(angle: f64) -> Complex<f64> {
    Complex::new(angle.cos(), angle.sin())
}

fn size(value: Complex<f64>) -> f64 {
    value.re.hypot(value.im)
}

/// Measures gain and phase of a primitive at a frequency: correlates its output with the input over whole seconds,
/// after `settle_s`.
fn measured(bench: &mut PrimitiveHarness, frequency_hz: f64, settle_s: usize) -> Complex<f64> {
    const CYCLES: usize = 1000;
    let angle = |cycle: usize| TAU * ((frequency_hz * cycle as f64 * DT_S) % 1.0);
    let mut sum = Complex::new(0.0, 0.0);
    for cycle in 0..CYCLES * (settle_s + 1) {
        let out = bench.set_real("in", angle(cycle).sin()).step().real("out");
        if cycle >= CYCLES * settle_s {
            // sin = (e^jφ - e^-jφ) / 2j; over whole periods only the first half remains.
            sum += out * turned(-angle(cycle)) * 2.0 * J / CYCLES as f64;
        }
    }
    sum
}

/// Returns the prototype's s, in units of its own ω, that the bilinear transform maps to a frequency.
fn warped(frequency_hz: f64, own_hz: f64) -> Complex<f64> {
    J * (PI * frequency_hz * DT_S).tan() / (PI * own_hz * DT_S).tan()
}

fn bench(name: &str, parameters: &[(&str, f64)]) -> PrimitiveHarness {
    let mut bench = PrimitiveHarness::new(name);
    for (name, value) in parameters {
        bench.set_real(name, *value);
    }
    bench.prepare().unwrap();
    bench
}

fn agree(name: &str, parameters: &[(&str, f64)], closed: impl Fn(f64) -> Complex<f64>) {
    for frequency_hz in [1.0, 5.0, 17.0, 40.0, 60.0, 133.0, 250.0, 441.0] {
        let have = measured(&mut bench(name, parameters), frequency_hz, 3);
        let want = closed(frequency_hz);
        assert!(
            size(have - want) < 1e-9,
            "{name} at {frequency_hz} Hz: {have}, not {want}"
        );
    }
}

#[test]
fn a_second_order_low_pass_has_the_response_of_its_prototype() {
    for (cutoff, damping) in [(40.0, FRAC_1_SQRT_2), (10.0, 1.0), (300.0, 0.3)] {
        let parameters = [("cutoff", cutoff), ("damping", damping)];
        agree("SecondOrderLowPass", &parameters, |frequency| {
            let s = warped(frequency, cutoff);
            1.0 / (s * s + 2.0 * damping * s + 1.0)
        });
    }
}

#[test]
fn a_high_pass_has_the_response_of_its_prototype() {
    for cutoff in [5.0, 40.0, 300.0] {
        agree("HighPass", &[("cutoff", cutoff)], |frequency| {
            let s = warped(frequency, cutoff);
            s / (s + 1.0)
        });
    }
}

#[test]
fn a_notch_has_the_response_of_its_prototype() {
    for (frequency, quality) in [(60.0, 3.0), (133.0, 1.0)] {
        let parameters = [("frequency", frequency), ("quality", quality)];
        agree("Notch", &parameters, |at| {
            let s = warped(at, frequency);
            (s * s + 1.0) / (s * s + s / quality + 1.0)
        });
    }
}

#[test]
fn a_first_order_low_pass_has_the_response_of_its_difference_equation_and_nearly_that_of_a_lag() {
    let time_constant = 0.02;
    let lag = |frequency: f64| 1.0 / (1.0 + J * TAU * frequency * time_constant);
    agree(
        "FirstOrderLowPass",
        &[("time_constant", time_constant)],
        |frequency| {
            let gain = 1.0 - f64::exp(-DT_S / time_constant);
            gain / (1.0 - (1.0 - gain) * turned(-TAU * frequency * DT_S))
        },
    );
    let have = measured(
        &mut bench("FirstOrderLowPass", &[("time_constant", time_constant)]),
        1.0,
        3,
    );
    assert!(size(have - lag(1.0)) < 0.005, "{have}");
}

#[test]
fn a_derivative_has_the_response_of_its_difference_equation() {
    for time_constant in [0.0, 0.05] {
        let mut bench = PrimitiveHarness::new("Derivative");
        bench.set_real("time_constant", time_constant);
        for frequency in [1.0, 40.0] {
            let have = measured(&mut bench, frequency, 3);
            let back = turned(-TAU * frequency * DT_S);
            let want = (1.0 - back) / (time_constant + DT_S - time_constant * back);
            assert!(size(have - want) < 1e-7 * size(want), "{have}, not {want}");
        }
    }
}

#[test]
fn a_biquad_has_the_response_of_its_coefficients() {
    let notch = Biquad::notch(60.0, 3.0, DT_S);
    let names = ["b0", "b1", "b2", "a1", "a2"];
    let values = notch.b.into_iter().chain(notch.a);
    let parameters: std::vec::Vec<_> = names.into_iter().zip(values).collect();
    let (mut one, mut other) = (
        bench("Biquad", &parameters),
        bench("Notch", &[("frequency", 60.0), ("quality", 3.0)]),
    );
    for cycle in 0..1000 {
        let input = f64::from(cycle * cycle % 101);
        let out = one.set_real("in", input).step().real("out");
        assert_eq!(other.set_real("in", input).step().real("out"), out);
    }
}

#[test]
fn a_filter_recovers_from_an_overflow() {
    let far = 1e300;
    for bad in [
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        -f64::MAX,
        f64::NAN,
    ] {
        let parameters = [("cutoff", 40.0), ("damping", 0.1)];
        let mut bench = bench("SecondOrderLowPass", &parameters);
        bench.set_real("in", far).step();
        for sign in [1.0, 1.0, -1.0, 1.0, -1.0] {
            let out = bench.set_real("in", sign * bad).step().real("out");
            assert!(!out.is_infinite(), "{bad}");
        }
        bench.set_real("in", far);
        for _ in 0..2000 {
            bench.step();
        }
        assert!((bench.real("out") - far).abs() < 1e-9 * far, "{bad}");
    }
}

#[test]
fn a_cutoff_far_below_the_rate_keeps_its_precision() {
    let mut bench = bench("SecondOrderLowPass", &[("cutoff", 1e-3), ("damping", 1.0)]);
    bench.set_real("in", 0.0).step();
    bench.set_real("in", 1.0);
    // The step response of 1 / (1 + s/ω)² at t = 1/ω is 1 - 2/e.
    let cycles = (1.0 / (TAU * 1e-3) / DT_S) as usize;
    for _ in 0..cycles {
        bench.step();
    }
    let want = 1.0 - 2.0 * f64::exp(-1.0);
    assert!(
        (bench.real("out") - want).abs() < 1e-5,
        "{}",
        bench.real("out")
    );
}
