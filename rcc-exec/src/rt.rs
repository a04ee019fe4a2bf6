//! The real-time loop: wait, latch boards, run the cycle, which writes the set-points, write the other boards. It sleeps
//! only at the top of the loop.
//!
//! All of its data was allocated before the first cycle or arrives through a ring buffer.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use bytemuck::Zeroable;
use rcc_core::helper::{HelperHeartbeat, HelperTable};
use rcc_core::message::{CycleStatus, MAGIC, Tables};
use rcc_core::timing::CycleTiming;
use rcc_ipc::BoardWriter;
use rcc_os::clock::{monotonic_ns, sleep_until};

use crate::boards::Engine;
use crate::clock::{Clock, Packet};

/// Nets that have not ended this long after the stop request are aborted, ns.
const STOP_MAX_NS: u64 = 5_000_000_000;

/// The boards of the executor itself; the engine has those of the devices.
#[derive(Debug)]
pub struct Boards {
    /// Counters of the executor, written each cycle.
    pub status: BoardWriter<CycleStatus>,
    /// Command and device tables.
    pub tables: BoardWriter<Tables>,
    /// Histograms of the cycle and measured costs of primitives.
    pub timing: BoardWriter<CycleTiming>,
    /// Table of the helper threads.
    pub helpers: BoardWriter<HelperTable>,
    /// Heartbeats of the helper threads, from which the table is made.
    pub beats: Box<[Arc<HelperHeartbeat>]>,
}

/// Builds the table of helper threads, with relaxed loads only.
fn helper_table(beats: &[Arc<HelperHeartbeat>]) -> HelperTable {
    let mut table = HelperTable::zeroed();
    table.magic = MAGIC;
    for (row, beat) in table.helpers.iter_mut().zip(beats) {
        *row = beat.entry();
    }
    table
}

/// Runs cycles until `stop` is set and no net is active.
///
/// `stop` is set by the main thread (Release there, Acquire here); this load is its only partner.
pub fn run(mut engine: Engine, mut boards: Boards, mut clock: Clock, stop: &Arc<AtomicBool>) {
    let mut stop_ns = None;
    loop {
        let deadline_ns = clock.deadline_ns();
        sleep_until(deadline_ns);
        let woke_ns = monotonic_ns();
        engine.latch_boards(woke_ns);
        follow(&mut clock, &mut engine, woke_ns);
        engine.cycle(woke_ns);
        write(&mut engine, &mut boards);
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
                // Run one more cycle, so that drivers see that nothing is commanded.
                engine.cycle(monotonic_ns());
                engine.end_recording();
                return write(&mut engine, &mut boards);
            }
            if ended_ns - since_ns > STOP_MAX_NS {
                engine.abort_all();
            }
        }
    }
}

/// Passes the latched measurement of the followed device, if there is one, to the clock.
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

/// Writes the results of the cycle to the boards; the set-points are written already.
pub fn write(engine: &mut Engine, boards: &mut Boards) {
    boards.status.write(engine.status());
    if let Some(tables) = engine.tables_due() {
        boards.tables.write(tables);
        boards.helpers.write(&helper_table(&boards.beats));
    }
    if engine.timing_due() {
        boards.timing.write(engine.timing());
    }
}
