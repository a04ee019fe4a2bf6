//! Counts SIGINT, SIGTERM and, unless it is ignored, SIGHUP, so that loops can check for them. One thread waits for the
//! signals; any thread may read the count.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;

use rcc_api::codes;
use rcc_process::signals::ignores_hangup;
use tokio::runtime::Builder;
use tokio::signal::unix::{Signal as SignalStream, SignalKind, signal};

use crate::failure::Failure;

/// Number of signals that asked the program to end.
#[derive(Clone, Debug)]
pub struct Interrupts {
    // Relaxed everywhere: the counter orders no other memory access.
    count: Arc<AtomicU32>,
}

impl Interrupts {
    /// Counts SIGINT, SIGTERM and SIGHUP from now on; they no longer end the program. SIGHUP stays ignored under `nohup`.
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
            let hangup = (!ignores_hangup()).then(|| signal(SignalKind::hangup()));
            (
                signal(SignalKind::interrupt()),
                signal(SignalKind::terminate()),
                hangup.transpose(),
            )
        };
        let (mut interrupt, mut terminate, mut hangup) = (
            registered.0.map_err(failed)?,
            registered.1.map_err(failed)?,
            registered.2.map_err(failed)?,
        );
        let wait = move || {
            runtime.block_on(async move {
                loop {
                    tokio::select! {
                        _ = interrupt.recv() => {}
                        _ = terminate.recv() => {}
                        () = received(&mut hangup) => {}
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

/// Waits for a signal; for ever without a stream of it.
async fn received(stream: &mut Option<SignalStream>) {
    match stream {
        Some(stream) => {
            stream.recv().await;
        }
        None => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;
    use std::time::Duration;

    use nix::sys::signal::{Signal, kill};
    use nix::unistd::Pid;

    use super::*;

    /// Tells the process that the test starts that it is that one.
    const UNDER_NOHUP: &str = "RCC_TEST_UNDER_NOHUP";

    #[test]
    fn a_program_under_nohup_outlives_its_terminal() {
        if std::env::var_os(UNDER_NOHUP).is_some() {
            return survive();
        }
        let output = Command::new("sh")
            .args(["-c", r#"trap "" HUP; exec "$0" "$@""#])
            .arg(std::env::current_exe().expect("this test"))
            .args([
                "--exact",
                "interrupt::tests::a_program_under_nohup_outlives_its_terminal",
            ])
            .env(UNDER_NOHUP, "1")
            .output();
        let output = output.expect("a shell");
        let told = String::from_utf8_lossy(&output.stdout);
        assert!(
            output.status.success() && told.contains("1 passed"),
            "{output:?}"
        );
    }

    fn survive() {
        let interrupts = Interrupts::listen().expect("a thread");
        for signal in [Signal::SIGHUP, Signal::SIGTERM] {
            kill(Pid::this(), signal).expect("sent");
        }
        while !interrupts.asked() {
            thread::sleep(Duration::from_millis(1));
        }
        // The other one would be counted at the same time.
        thread::sleep(Duration::from_millis(100));
        assert_eq!(interrupts.count(), 1);
    }
}
