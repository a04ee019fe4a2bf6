//! Times of the steps of one CANCEL or ABORT. A slow one is logged with them, so that its cause need not be guessed.

use std::convert::Infallible;
use std::fmt;
use std::time::{Duration, Instant};

use axum::extract::FromRequestParts;
use axum::http::request::Parts;

/// Time from the connection, or from the first byte on a kept-open one, above which a CANCEL or ABORT is logged.
const SLOW: Duration = Duration::from_millis(20);

/// Time since which the first byte of a request was awaited: when its connection was accepted, or when the previous
/// request on it was answered.
#[derive(Clone, Copy, Debug)]
pub(super) struct ArrivalTime(pub Instant);

/// That of its connection; a request without one arrives now. Nothing refuses a stop.
impl<S: Sync> FromRequestParts<S> for ArrivalTime {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<ArrivalTime, Infallible> {
        let arrived = parts.extensions.get().copied();
        Ok(arrived.unwrap_or_else(|| ArrivalTime(Instant::now())))
    }
}

/// The steps so far, each with its end.
#[derive(Debug)]
pub(super) struct StopSteps {
    arrived: Instant,
    steps: Vec<(&'static str, Instant)>,
}

impl StopSteps {
    pub fn since(arrived: ArrivalTime) -> StopSteps {
        StopSteps {
            arrived: arrived.0,
            steps: Vec::new(),
        }
    }

    /// Ends a step.
    pub fn done(&mut self, step: &'static str) {
        self.steps.push((step, Instant::now()));
    }

    /// Logs the steps if they took long together.
    pub fn log_if_slow(&self, what: &str) {
        let end = self.steps.last().map_or(self.arrived, |(_, end)| *end);
        let took = end.saturating_duration_since(self.arrived);
        if took > SLOW {
            tracing::warn!("{what} took {:.1} ms: {self}", milliseconds(took));
        }
    }
}

impl fmt::Display for StopSteps {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut begun = self.arrived;
        for (index, (step, end)) in self.steps.iter().enumerate() {
            let separator = if index == 0 { "" } else { ", " };
            let took = milliseconds(end.saturating_duration_since(begun));
            write!(out, "{separator}{step} {took:.1}")?;
            begun = *end;
        }
        Ok(())
    }
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_step_has_the_time_since_the_step_before() {
        let arrived = Instant::now();
        let after = |milliseconds| arrived + Duration::from_millis(milliseconds);
        let steps = StopSteps {
            arrived,
            steps: vec![
                ("head", after(3)),
                ("queue", after(3)),
                ("executor", after(45)),
            ],
        };
        assert_eq!(steps.to_string(), "head 3.0, queue 0.0, executor 42.0");
    }
}
