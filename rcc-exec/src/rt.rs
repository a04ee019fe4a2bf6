//! The real-time thread: wait → latch → cycle → write boards. One sleep, at the top.
//!
//! Everything that it touches was made before the first cycle or handed to it through a ring.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bytemuck::Zeroable;
use rcc_core::helper::{HelperHeartbeat, HelperTable};
use rcc_core::message::{CycleStatus, MAGIC, Tables};
use rcc_core::timing::CycleTiming;
use rcc_ipc::clock::{monotonic_ns, sleep_until};
use rcc_ipc::{BoardWriter, CommandWriter};

use rcc_engine::engine::Engine;

use crate::clock::{Clock, Packet};

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
    pub timing: BoardWriter<CycleTiming>,
    /// The helper threads.
    pub helpers: BoardWriter<HelperTable>,
    /// Their signs of life, of which the table is made.
    pub beats: Box<[Arc<HelperHeartbeat>]>,
    /// Commands, by device.
    pub commands: Vec<CommandWriter>,
}

/// The helper threads as others see them: relaxed loads, and nothing else.
fn helper_table(beats: &[Arc<HelperHeartbeat>]) -> HelperTable {
    let mut table = HelperTable::zeroed();
    table.magic = MAGIC;
    for (row, beat) in table.helpers.iter_mut().zip(beats) {
        *row = beat.entry();
    }
    table
}

/// Runs cycles until `stop` is set and no net is active any more.
///
/// `stop` is set by the main thread (Release there, Acquire here); its only partner is this load.
pub fn run(mut engine: Engine, mut boards: Boards, mut clock: Clock, stop: &Arc<AtomicBool>) {
    let mut stop_ns = None;
    loop {
        let deadline_ns = clock.deadline_ns();
        sleep_until(deadline_ns);
        let woke_ns = monotonic_ns();
        engine.latch_boards(woke_ns);
        follow(&mut clock, &mut engine, woke_ns);
        engine.cycle(woke_ns);
        write(&engine, &mut boards);
        let ended_ns = monotonic_ns();
        let skipped = clock.advance(ended_ns);
        engine.account(
            woke_ns.saturating_sub(deadline_ns),
            ended_ns - woke_ns,
            skipped,
        );
        if stop.load(Ordering::Acquire) {
            engine.begin_stop();
            let since_ns = *stop_ns.get_or_insert(ended_ns);
            if engine.is_idle() {
                // One more cycle, so that drivers see that nothing is commanded.
                engine.cycle(monotonic_ns());
                engine.end_recording();
                return write(&engine, &mut boards);
            }
            if ended_ns - since_ns > STOP_MAX_NS {
                engine.abort_all();
            }
        }
    }
}

/// Shows the clock the newest packet of the device that it follows, if any, as it was latched.
fn follow(clock: &mut Clock, engine: &mut Engine, now_ns: u64) {
    let Some(device) = clock.follows() else {
        return;
    };
    let measured = engine.measurement(device as usize);
    let packet = measured.map(|measured| Packet {
        periods: measured.periods,
        stamp_ns: measured.stamp_ns,
        period_ns: measured.period_ns,
    });
    clock.observe(now_ns, packet);
    engine.set_clock(clock.status());
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
        boards.helpers.write(&helper_table(&boards.beats));
    }
    if engine.timing_due() {
        boards.timing.write(engine.timing());
    }
}
