//! The rate of a net: `period` or `rate`, and `phase`, as whole cycles of the cell. Runs on the loader's threads.

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_core::plan::{EVERY_MAX, Rate};
use rcc_core::unit::Unit;

use crate::codes;
use crate::devices::DeviceTable;
use crate::syntax::Timing;
use crate::syntax::literal::Literal;

/// Longest period of a net, s. START is answered in the first evaluation, so it limits the delay of the answer.
const PERIOD_MAX_S: f64 = 1.0;
/// Relative tolerance within which a number of cycles counts as a whole one.
const TOLERANCE: f64 = 1e-9;

/// Returns the rate of a net; if it has errors, the rate of the cell.
pub fn rate_of(timing: &Timing, cell: &DeviceTable, diagnostics: &mut Vec<Diagnostic>) -> Rate {
    match read(timing, cell) {
        Ok(rate) => rate,
        // Already reported where the literal was read.
        Err(None) => Rate::EVERY_CYCLE,
        Err(Some(diagnostic)) => {
            diagnostics.push(*diagnostic);
            Rate::EVERY_CYCLE
        }
    }
}

/// Why there is no rate; `None` if that is already reported.
type RateError = Option<Box<Diagnostic>>;

fn read(timing: &Timing, cell: &DeviceTable) -> Result<Rate, RateError> {
    let base_s = cell.period_ns.max(1) as f64 / 1e9;
    let every = match (&timing.period, &timing.rate) {
        (None, None) => 1,
        (Some(_), Some(rate)) => {
            let message = "`period` and `rate` exclude each other";
            return Err(refuse(
                codes::WRONG_SHAPE,
                rate.span,
                message,
                "keep one of the two",
            ));
        }
        (Some(period), None) => {
            let cycles = positive_number_in_unit(period, "period", Unit::SECOND, "5 ms")? / base_s;
            every(cycles, period.span, base_s, &|cycles| time(cycles * base_s))?
        }
        (None, Some(rate)) => {
            let hz = positive_number_in_unit(rate, "rate", Unit::HERTZ, "200 Hz")?;
            let shown = |cycles: f64| format!("{} Hz", short(1.0 / (cycles * base_s)));
            every(1.0 / (hz * base_s), rate.span, base_s, &shown)?
        }
    };
    let phase = match &timing.phase {
        None => 0,
        Some(literal) => phase(literal, every, base_s)?,
    };
    Ok(Rate { every, phase })
}

fn every(
    cycles: f64,
    span: Span,
    base_s: f64,
    shown: &dyn Fn(f64) -> String,
) -> Result<u32, RateError> {
    let most = f64::from(EVERY_MAX)
        .min(PERIOD_MAX_S / base_s * (1.0 + TOLERANCE))
        .floor();
    // Negated, so that NaN is refused as well.
    let in_range = cycles >= 1.0 - TOLERANCE && cycles <= most + TOLERANCE;
    if !in_range {
        let message = format!(
            "the net's period of {} is out of range",
            time(cycles * base_s)
        );
        let help = format!(
            "choose from {} (every cycle) to {}",
            shown(1.0),
            shown(most)
        );
        return Err(refuse(codes::OUT_OF_RANGE, span, message, help));
    }
    match whole(cycles) {
        Some(every) => Ok(every.max(1)),
        None => {
            let [less, more] = [cycles.floor().max(1.0), cycles.ceil().min(most)];
            let message = format!(
                "the net's period of {} is not a multiple of the cell's period of {}",
                time(cycles * base_s),
                time(base_s)
            );
            let help = format!("the nearest are {} and {}", shown(less), shown(more));
            Err(refuse(codes::NOT_A_MULTIPLE, span, message, help))
        }
    }
}

fn phase(literal: &Literal, every: u32, base_s: f64) -> Result<u32, RateError> {
    let cycles = number_in_unit(literal, "phase", Unit::SECOND, "2 ms")? / base_s;
    let last = f64::from(every - 1);
    let in_range = (-TOLERANCE..=last + TOLERANCE).contains(&cycles);
    if !in_range {
        let message = format!(
            "the phase of {} is outside of the net's period",
            time(cycles * base_s)
        );
        let help = match every {
            1 => "remove it: this net is evaluated in every cycle".to_owned(),
            _ => format!("choose from 0 ms to {}", time(last * base_s)),
        };
        return Err(refuse(codes::OUT_OF_RANGE, literal.span, message, help));
    }
    whole(cycles).ok_or_else(|| {
        let message = format!(
            "the phase of {} is not a whole number of cycles",
            time(cycles * base_s)
        );
        let [less, more] = [cycles.floor(), cycles.ceil()].map(|cycles| time(cycles * base_s));
        let help = format!("the nearest are {less} and {more}");
        refuse(codes::NOT_A_MULTIPLE, literal.span, message, help)
    })
}

/// Returns the nearest whole number, if it is within the tolerance.
fn whole(cycles: f64) -> Option<u32> {
    let nearest = cycles.round();
    // In range: both callers have checked.
    ((cycles - nearest).abs() <= TOLERANCE * nearest.max(1.0)).then_some(nearest as u32)
}

fn positive_number_in_unit(
    literal: &Literal,
    key: &str,
    unit: Unit,
    example: &str,
) -> Result<f64, RateError> {
    let value = number_in_unit(literal, key, unit, example)?;
    if value > 0.0 {
        return Ok(value);
    }
    let message = format!("`{key}` must be greater than 0");
    Err(refuse(
        codes::OUT_OF_RANGE,
        literal.span,
        message,
        format!("write `{key}: {example}`"),
    ))
}

fn number_in_unit(
    literal: &Literal,
    key: &str,
    unit: Unit,
    example: &str,
) -> Result<f64, RateError> {
    if literal.is_refused() {
        return Err(None);
    }
    let help = format!("write `{key}: {example}`");
    let Some(value) = literal.number() else {
        let message =
            format!("type mismatch: `{key}` expects a number with a unit, found {literal}");
        return Err(refuse(codes::TYPE_MISMATCH, literal.span, message, help));
    };
    if let Some((have, _)) = literal.units().into_iter().find(|(have, _)| *have != unit) {
        let message = format!("unit mismatch: `{key}` expects {unit}, found {have}");
        return Err(refuse(codes::UNIT_MISMATCH, literal.span, message, help));
    }
    Ok(value)
}

fn refuse(
    code: &'static str,
    span: Span,
    message: impl Into<String>,
    help: impl Into<String>,
) -> RateError {
    Some(Box::new(Diagnostic::error(code, span, message).help(help)))
}

/// Formats a time in ms.
fn time(seconds: f64) -> String {
    format!("{} ms", short(seconds * 1e3))
}

/// Formats a number with at most 6 decimals, without trailing zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
