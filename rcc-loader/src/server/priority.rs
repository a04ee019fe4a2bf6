//! Nice values of the loader's threads: the thread that serves connections and the threads of CANCEL and ABORT run
//! before the threads that load, check and list, and before other programs of the same core. Set by the main thread
//! at start.

use std::io;

/// Nice value of the serving thread and of the threads of CANCEL and ABORT.
pub const SERVING_NICE: i32 = -10;

/// The nice value that the program was started with, which the worker threads keep.
#[derive(Clone, Copy, Debug)]
pub struct WorkerPriority(i32);

impl WorkerPriority {
    /// Raises the calling thread, and the threads that it creates from now on, to [`SERVING_NICE`].
    ///
    /// # Errors
    /// Returns an error if the system refuses; the nice value is unchanged then.
    pub fn raise_calling_thread() -> io::Result<WorkerPriority> {
        let started_with = rustix::process::getpriority_process(None)?;
        if started_with > SERVING_NICE {
            rustix::process::setpriority_process(None, SERVING_NICE)?;
        }
        Ok(WorkerPriority(started_with))
    }

    /// Gives the calling thread, which a raised thread created, the nice value of the workers.
    pub fn apply(self) {
        // A thread may always lower itself.
        let _ = rustix::process::setpriority_process(None, self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nice() -> i32 {
        rustix::process::getpriority_process(None).expect("the thread exists")
    }

    #[test]
    fn workers_keep_the_value_that_the_program_was_started_with() {
        let before = nice();
        let serving = std::thread::spawn(move || {
            let Ok(workers) = WorkerPriority::raise_calling_thread() else {
                // Not permitted here: nothing may have changed.
                return assert_eq!(nice(), before);
            };
            assert_eq!(nice(), before.min(SERVING_NICE));
            let worker = std::thread::spawn(move || {
                assert_eq!(nice(), before.min(SERVING_NICE), "inherited");
                workers.apply();
                nice()
            });
            assert_eq!(worker.join().expect("no panic"), before);
        });
        serving.join().expect("no panic");
        assert_eq!(nice(), before, "only the calling thread is raised");
    }
}
