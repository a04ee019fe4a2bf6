//! Threads that do nothing but CANCEL and ABORT, made before the first request: whatever else the loader does, and however
//! many blocking threads are busy, these are free.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use rcc_process::helpers;
use tokio::sync::oneshot;

use super::codes;
use super::connection::STOPS;
use super::error::ApiError;

/// Threads: one that waits for an executor without an answer does not keep the other from the next request.
const THREADS: usize = 2;

type Job = Box<dyn FnOnce() + Send>;

/// The threads; they end with the last clone of this.
#[derive(Clone, Debug)]
pub struct StopWorkers(SyncSender<Job>);

impl StopWorkers {
    /// Makes the threads.
    ///
    /// # Errors
    /// The system gives none.
    pub fn start() -> io::Result<StopWorkers> {
        // As many as the doors let in at a time, so that none is refused here; and some of another door.
        let (jobs, work) = sync_channel::<Job>(2 * STOPS.connections);
        let work = Arc::new(Mutex::new(work));
        for number in 0..THREADS {
            let work = Arc::clone(&work);
            helpers::thread(&format!("stop-{number}"), move || run(&work))?;
        }
        Ok(StopWorkers(jobs))
    }

    /// Runs `what` on one of the threads; it is run also if nobody waits for its result any more.
    ///
    /// # Errors
    /// Those of `what`; or the lane is full, or `what` panicked.
    pub async fn run<T: Send + 'static>(
        &self,
        what: impl FnOnce() -> Result<T, ApiError> + Send + 'static,
    ) -> Result<T, ApiError> {
        let (answer, answered) = oneshot::channel();
        let job: Job = Box::new(move || {
            // Nobody waits any more: it is done nevertheless.
            let _ = answer.send(what());
        });
        if self.0.try_send(job).is_err() {
            return Err(ApiError::new(
                codes::TOO_MANY,
                "too many CANCEL and ABORT are under way",
                "try again at once",
            ));
        }
        answered.await.unwrap_or_else(|_| {
            Err(ApiError::new(
                codes::PROCESS_FAILED,
                "the loader could not do it",
                "this is a fault of the loader: report it, and try again",
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
        // A panic is told by the hook and ends the job: the thread is for the next one.
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
