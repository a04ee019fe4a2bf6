//! Threads reserved for CANCEL and ABORT. They are created before the first request, so they are free however many
//! blocking threads are busy.

use std::io;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_process::priority::raise_stop_thread;
use rcc_process::{Helper, Helpers, helpers};
use tokio::sync::oneshot;

use super::connection::STOPS;

/// Names of the threads: while one waits for an executor that does not answer, the other takes the next request.
const THREADS: [&str; 2] = ["stop-0", "stop-1"];
/// Maximum time for one job: an executor that does not answer is given up after 5 s.
const JOB_MAX: Duration = Duration::from_secs(15);
/// Maximum time between two heartbeats of a thread without a job.
const IDLE_MAX: Duration = Duration::from_millis(500);
/// Twice the number that one listener admits, so that no admitted request of the two listeners is refused here.
const QUEUE_MAX: usize = 2 * STOPS.connections;

type Job = Box<dyn FnOnce() + Send>;

/// Handle of the threads; they end when the last clone is dropped, or with the other helpers.
#[derive(Clone, Debug)]
pub struct StopWorkers(Sender<Job>);

impl StopWorkers {
    /// Starts the threads, with heartbeats in the table of helpers.
    ///
    /// # Errors
    /// Returns an error if the system cannot create a thread.
    pub fn start(helpers: &Helpers) -> io::Result<StopWorkers> {
        let (sender, jobs) = bounded(QUEUE_MAX);
        for name in THREADS {
            let (jobs, helper) = (jobs.clone(), helpers.helper(name, JOB_MAX));
            helpers::thread(name, move || work(&jobs, &helper))?;
        }
        Ok(StopWorkers(sender))
    }

    /// Runs `what` on one of the threads, even if nobody waits for its result any more.
    ///
    /// # Errors
    /// Returns the error of `what`, [`codes::TOO_MANY`] if the queue is full, or [`codes::PROCESS_FAILED`] if `what`
    /// panicked.
    pub async fn run<T: Send + 'static>(
        &self,
        what: impl FnOnce() -> Result<T, ApiError> + Send + 'static,
    ) -> Result<T, ApiError> {
        let (answer, answered) = oneshot::channel();
        let job: Job = Box::new(move || {
            // The caller may be gone; the work is done nevertheless.
            let _ = answer.send(what());
        });
        if self.0.try_send(job).is_err() {
            return Err(ApiError::new(
                codes::TOO_MANY,
                "too many CANCEL and ABORT requests are being processed",
                "try again at once",
            ));
        }
        answered.await.unwrap_or_else(|_| {
            Err(ApiError::new(
                codes::PROCESS_FAILED,
                "the loader failed to process the request",
                "this is a bug in the loader: report it, and try again",
            ))
        })
    }
}

/// Runs jobs until the last sender is dropped or the helpers end.
fn work(jobs: &Receiver<Job>, helper: &Helper) {
    raise_stop_thread();
    while !helper.is_over() {
        helper.turn();
        match jobs.recv_timeout(IDLE_MAX) {
            Ok(job) => {
                // The panic hook reports a panic; the thread survives for the next job.
                let _ = std::panic::catch_unwind(std::panic::AssertUnwindSafe(job));
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_that_hangs_or_panics_does_not_keep_the_next_one()
    -> Result<(), Box<dyn std::error::Error>> {
        let workers = StopWorkers::start(&Helpers::default())?;
        let runtime = tokio::runtime::Builder::new_current_thread().build()?;
        let (hold, held) = std::sync::mpsc::channel::<()>();
        let hung = workers.clone();
        runtime.block_on(async {
            let hanging = hung.run(move || {
                let _ = held.recv();
                Ok(0)
            });
            let panics = workers.run(|| -> Result<u32, ApiError> { panic!("on purpose") });
            let fine = workers.run(|| Ok(7));
            tokio::pin!(hanging);
            tokio::select! {
                biased;
                _ = &mut hanging => panic!("it hangs"),
                () = async {
                    assert_eq!(panics.await.map_err(|error| error.code), Err(codes::PROCESS_FAILED));
                    assert_eq!(fine.await, Ok(7));
                } => {}
            }
            drop(hold);
            assert_eq!(hanging.await, Ok(0));
        });
        Ok(())
    }
}
