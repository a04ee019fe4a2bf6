//! The state of a driver for its supervisor: turns of the exchange loop, state and quality of the device.
//! Written by the exchange thread, read by the thread that notifies the supervisor.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use rcc_core::message::{DeviceState, Measurement};

use super::reason::{self, Reason};

/// Shared between the two threads; Relaxed, because each value is independent.
#[derive(Debug)]
pub struct DriverHealth {
    turns: AtomicU64,
    state: AtomicU32,
    reason: AtomicU32,
    quality_permille: AtomicU32,
    late: AtomicU64,
    reasons: &'static [Reason],
}

impl DriverHealth {
    /// State of a driver with these reasons.
    #[must_use]
    pub fn new(reasons: &'static [Reason]) -> Arc<DriverHealth> {
        Arc::new(DriverHealth {
            turns: AtomicU64::new(0),
            state: AtomicU32::new(0),
            reason: AtomicU32::new(0),
            quality_permille: AtomicU32::new(0),
            late: AtomicU64::new(0),
            reasons,
        })
    }

    /// Counts one turn of the exchange loop.
    pub fn update(&self, measurement: &Measurement) {
        self.state.store(measurement.state, Ordering::Relaxed);
        self.reason.store(measurement.reason, Ordering::Relaxed);
        let quality = measurement.quality_permille;
        self.quality_permille.store(quality, Ordering::Relaxed);
        self.late.store(measurement.late, Ordering::Relaxed);
        self.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Returns the report for the supervisor.
    #[must_use]
    pub fn report(&self) -> rcc_process::HealthReport {
        let state = DeviceState::from_number(self.state.load(Ordering::Relaxed));
        let because = match self.reason.load(Ordering::Relaxed) {
            0 => String::new(),
            number => format!(" ({})", reason::meaning(number, self.reasons)),
        };
        let status = match state {
            DeviceState::Offline => format!("offline{because}"),
            _ => format!(
                "{}{because}, quality {:.1} %, {} late or lost answers",
                state.name(),
                f64::from(self.quality_permille.load(Ordering::Relaxed)) * 0.1,
                self.late.load(Ordering::Relaxed),
            ),
        };
        rcc_process::HealthReport {
            progress: self.turns.load(Ordering::Relaxed),
            status,
        }
    }
}
