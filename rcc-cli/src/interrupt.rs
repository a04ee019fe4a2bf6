//! Counts SIGINT, SIGTERM and SIGHUP, so that loops can check for them. One thread waits for the signals; any thread
//! may read the count.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;

use rcc_api::codes;
use tokio::runtime::Builder;
use tokio::signal::unix::{SignalKind, signal};

use crate::failure::Failure;

/// Number of signals that asked the program to end.
#[derive(Clone, Debug)]
pub struct Interrupts {
    // Relaxed everywhere: the counter orders no other memory access.
    count: Arc<AtomicU32>,
}

impl Interrupts {
    /// Counts SIGINT, SIGTERM and SIGHUP from now on; they no longer end the program.
    ///
    /// # Errors
    /// Fails if the system provides no thread or no signal handling.
    pub fn listen() -> Result<Interrupts, Failure> {
        let failed = |error: std::io::Error| {
            Failure::new(
                codes::PROCESS_FAILED,
                error.to_string(),
                "close other programs to free resources",
            )
        };
        let runtime = Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(failed)?;
        let count = Arc::new(AtomicU32::new(0));
        let counted = Arc::clone(&count);
        let registered = {
            let _inside = runtime.enter();
            let kinds = [
                SignalKind::interrupt(),
                SignalKind::terminate(),
                SignalKind::hangup(),
            ];
            kinds.map(signal)
        };
        let [interrupt, terminate, hangup] = registered;
        let (mut interrupt, mut terminate, mut hangup) = (
            interrupt.map_err(failed)?,
            terminate.map_err(failed)?,
            hangup.map_err(failed)?,
        );
        let wait = move || {
            runtime.block_on(async move {
                loop {
                    tokio::select! {
                        _ = interrupt.recv() => {}
                        _ = terminate.recv() => {}
                        _ = hangup.recv() => {}
                    }
                    counted.fetch_add(1, Ordering::Relaxed);
                }
            });
        };
        thread::Builder::new()
            .name("signals".into())
            .spawn(wait)
            .map_err(failed)?;
        Ok(Interrupts { count })
    }

    /// Returns the number of signals so far.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.count.load(Ordering::Relaxed)
    }

    /// Returns true after the first signal.
    #[must_use]
    pub fn asked(&self) -> bool {
        self.count() > 0
    }
}
