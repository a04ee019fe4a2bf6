//! Threads reserved for CANCEL and ABORT. They are created before the first request, so they are free however many
//! blocking threads are busy.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use rcc_process::helpers;
use tokio::sync::oneshot;

use super::codes;
use super::connection::STOPS;
use super::error::ApiError;

/// Number of threads: while one waits for an executor that does not answer, the other takes the next request.
const THREADS: usize = 2;

type Job = Box<dyn FnOnce() + Send>;

/// Handle of the threads; they end when the last clone is dropped.
#[derive(Clone, Debug)]
pub struct StopWorkers(SyncSender<Job>);

impl StopWorkers {
    /// Starts the threads.
    ///
    /// # Errors
    /// Returns an error if the system cannot create a thread.
    pub fn start() -> io::Result<StopWorkers> {
        // Twice the number that one listener admits, so that no admitted request of the two listeners is refused here.
        let (jobs, work) = sync_channel::<Job>(2 * STOPS.connections);
        let work = Arc::new(Mutex::new(work));
        for number in 0..THREADS {
            let work = Arc::clone(&work);
            helpers::thread(&format!("stop-{number}"), move || run(&work))?;
        }
        Ok(StopWorkers(jobs))
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

fn run(work: &Mutex<Receiver<Job>>) {
    loop {
        let job = work.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(job) = job else {
            return;
        };
        // The panic hook reports a panic; the thread survives for the next job.
        let _ = std::panic::catch_unwind(std::panic::AssertUnwindSafe(job));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_that_hangs_or_panics_does_not_keep_the_next_one()
    -> Result<(), Box<dyn std::error::Error>> {
        let workers = StopWorkers::start()?;
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
