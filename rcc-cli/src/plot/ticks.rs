//! Positions and labels of an axis. Pure.

/// Returns about `count` round numbers from `low` to `high`: multiples of 1, 2 or 5 times a power of ten.
pub fn ticks(low: f64, high: f64, count: usize) -> Vec<f64> {
    let step = round_step((high - low) / count.max(1) as f64);
    if !(step.is_finite() && step > 0.0) {
        return Vec::new();
    }
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|number| number as f64 * step).collect()
}

/// Returns the least 1, 2 or 5 times a power of ten that is not below `least`.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let factors = [1.0, 2.0, 5.0, 10.0];
    let factor = factors
        .into_iter()
        .find(|factor| factor * power >= least * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

/// Formats a tick label with as many digits as it needs.
pub fn label(value: f64) -> String {
    let rounded = format!("{value:.6}");
    let trimmed = rounded.trim_end_matches('0').trim_end_matches('.');
    match trimmed {
        "0" | "-0" if value.abs() > 1e-12 => format!("{value:.1e}"),
        "-0" => "0".to_owned(),
        _ if value.abs() >= 1e6 => format!("{value:.2e}"),
        _ => trimmed.to_owned(),
    }
}

/// Returns the least and greatest of some values; never an empty range.
pub fn span(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values
        .filter(|value| value.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
            [low.min(value), high.max(value)]
        });
    match (low <= high, high - low) {
        (false, _) => [0.0, 1.0],
        (true, width) if width > 1e-9 * high.abs().max(low.abs()).max(1e-9) => [low, high],
        (true, _) => [low - 0.5, high + 0.5],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.03, 1.07, 5), [0.5, 1.0]);
        assert_eq!(ticks(0.03, 0.93, 5), [0.2, 0.4, 0.6000000000000001, 0.8]);
        assert_eq!(ticks(-110.0, 110.0, 6), [-100.0, -50.0, 0.0, 50.0, 100.0]);
        assert!(ticks(1.0, f64::NAN, 5).is_empty());
        assert_eq!(label(0.6000000000000001), "0.6");
        assert_eq!(label(-0.0), "0");
        assert_eq!(label(2.5e7), "2.50e7");
    }

    #[test]
    fn a_constant_value_gets_a_range_around_it() {
        assert_eq!(span([2.0, 2.0].into_iter()), [1.5, 2.5]);
        assert_eq!(span([f64::NAN].into_iter()), [0.0, 1.0]);
        assert_eq!(span([1.0, f64::INFINITY, 3.0].into_iter()), [1.0, 3.0]);
    }
}
