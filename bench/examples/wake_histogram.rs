//! Prints the wake-up latency of a running executor from its own histogram: `wake_histogram CELL` prints one line of
//! JSON, µs. `wake_histogram CELL remove` removes what the cell has left in shared memory, after its end. Used by
//! `bench/wakeup`, which runs cyclictest in turns with an executor.

use std::error::Error;

use rcc_core::message::CycleStatus;
use rcc_core::timing::CycleTiming;
use rcc_exec::setup::FIFO;
use rcc_ipc::{Cell, Session};
use rcc_protocol::Role;
use rcc_protocol::control::{STATUS, TIMING};

fn main() -> Result<(), Box<dyn Error>> {
    let name = std::env::args()
        .nth(1)
        .ok_or("usage: wake_histogram CELL [remove]")?;
    let cell = Cell::find(&name)?.ok_or_else(|| format!("cell `{name}` not found"))?;
    if std::env::args().nth(2).as_deref() == Some("remove") {
        rcc_bench::executor::remove(&cell);
        return Ok(());
    }
    let announced = cell
        .announced(Role::Executor, "exec")?
        .ok_or("no executor is running in this cell")?;
    let session = Session::join(&cell, Role::Cli, "wake-histogram")?;
    let service = |name: &str| {
        announced
            .services
            .get(name)
            .ok_or_else(|| format!("the executor announces no {name}"))
    };
    let timing: CycleTiming = session.open_board(service(TIMING)?)?.read();
    let status: CycleStatus = session.open_board(service(STATUS)?)?.read();
    let wake = &timing.wake;
    let us = |ns: u64| ns as f64 * 1e-3;
    println!(
        "{{\"cycles\": {}, \"p50\": {}, \"p99\": {}, \"max\": {}, \"fifo\": {}}}",
        wake.count(),
        us(wake.quantile(500)),
        us(wake.quantile(990)),
        us(wake.max()),
        status.grants & FIFO != 0
    );
    Ok(())
}
