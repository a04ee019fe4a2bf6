//! The real-time thread: wait → latch → cycle → write boards. One sleep, at the top.
//!
//! Everything that it touches was made before the first cycle or handed to it through a ring.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rcc_core::message::{CommandImage, CycleStatus, Tables};
use rcc_core::timing::Timing;
use rcc_ipc::BoardWriter;
use rcc_ipc::clock::{monotonic_ns, sleep_until};

use rcc_engine::engine::Engine;

/// After this time a net that was asked to stop is aborted.
const STOP_MAX_NS: u64 = 5_000_000_000;

/// The boards that the executor writes.
#[derive(Debug)]
pub struct Boards {
    /// Counters, every cycle.
    pub status: BoardWriter<CycleStatus>,
    /// Command and device tables.
    pub tables: BoardWriter<Tables>,
    /// Histograms and what primitives cost.
    pub timing: BoardWriter<Timing>,
    /// Commands, by device.
    pub commands: Vec<BoardWriter<CommandImage>>,
}

/// Runs cycles until `stop` is set and no net is active any more.
///
/// `stop` is set by the main thread (Release there, Acquire here); its only partner is this load.
pub fn run(mut engine: Engine, mut boards: Boards, period_ns: u64, stop: &Arc<AtomicBool>) {
    let mut deadline_ns = monotonic_ns() + period_ns;
    let mut stop_ns = None;
    loop {
        sleep_until(deadline_ns);
        let woke_ns = monotonic_ns();
        engine.latch_boards(woke_ns);
        engine.cycle(woke_ns);
        write(&engine, &mut boards);
        let ended_ns = monotonic_ns();
        let skipped = next_deadline(&mut deadline_ns, period_ns, ended_ns);
        engine.account(
            woke_ns.saturating_sub(deadline_of(deadline_ns, period_ns, skipped)),
            ended_ns - woke_ns,
            skipped,
        );
        if stop.load(Ordering::Acquire) {
            engine.begin_stop();
            let since_ns = *stop_ns.get_or_insert(ended_ns);
            if engine.is_idle() {
                // One more cycle, so that drivers see that nothing is commanded.
                engine.cycle(monotonic_ns());
                return write(&engine, &mut boards);
            }
            if ended_ns - since_ns > STOP_MAX_NS {
                engine.abort_all();
            }
        }
    }
}

/// The deadline that this cycle had, from the next one.
fn deadline_of(next_ns: u64, period_ns: u64, skipped: u64) -> u64 {
    next_ns - period_ns * (skipped + 1)
}

/// Moves the deadline to the next one that is in the future: missed periods are skipped and counted, never caught up.
fn next_deadline(deadline_ns: &mut u64, period_ns: u64, now_ns: u64) -> u64 {
    *deadline_ns += period_ns;
    let behind_ns = now_ns.saturating_sub(*deadline_ns);
    let skipped = if now_ns >= *deadline_ns {
        behind_ns.checked_div(period_ns).unwrap_or(0) + 1
    } else {
        0
    };
    *deadline_ns += skipped * period_ns;
    skipped
}

/// Writes what the cycle came to.
pub fn write(engine: &Engine, boards: &mut Boards) {
    for (index, board) in boards.commands.iter_mut().enumerate() {
        if let Some(image) = engine.image(index) {
            board.write(image);
        }
    }
    boards.status.write(engine.status());
    if engine.tables_due() {
        boards.tables.write(engine.tables());
    }
    if engine.timing_due() {
        boards.timing.write(engine.timing());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missed_periods_are_skipped_and_counted() {
        for (now_ns, skipped, next_ns) in [
            (1_500, 0, 2_000),
            (1_999, 0, 2_000),
            (2_000, 1, 3_000),
            (5_200, 4, 6_000),
        ] {
            let mut deadline_ns = 1_000;
            assert_eq!(
                next_deadline(&mut deadline_ns, 1_000, now_ns),
                skipped,
                "now {now_ns}"
            );
            assert_eq!(deadline_ns, next_ns);
            assert_eq!(deadline_of(deadline_ns, 1_000, skipped), 1_000);
        }
    }
}
