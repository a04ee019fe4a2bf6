//! Threads that read streams of another program. Makes, ends and restarts them; used by the one thread that knows what is to
//! be read.

use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::time::{Duration, Instant};

use crate::helpers;

/// Longest wait for readers that were asked to end, before others begin. They look at the request after each sample, at the
/// usual rates within 10 ms; those that take longer end beside their successors.
const END_MAX: Duration = Duration::from_millis(100);

/// What one thread reads.
pub trait Reader: Send + Sync + 'static {
    /// Why a stream is broken.
    type Error: Display;

    /// Reads until the stream ends, or this is requested.
    ///
    /// # Errors
    /// Returns an error if the stream is broken.
    fn read(&self, end: &EndRequest) -> Result<(), Self::Error>;
}

/// Tells a reader to end.
#[derive(Clone, Debug, Default)]
pub struct EndRequest(Arc<AtomicBool>);

impl EndRequest {
    /// Returns true if the reader is to end.
    #[must_use]
    pub fn is_made(&self) -> bool {
        // Acquire pairs with the release in `ask_to_end`.
        self.0.load(Ordering::Acquire)
    }
}

/// How a reader has ended: why, if it was not the end of its stream.
type End = Result<(), String>;

struct RunningReader<R> {
    reader: Arc<R>,
    end: EndRequest,
    ended: Receiver<End>,
}

impl<R: Reader> RunningReader<R> {
    fn start(name: &'static str, reader: Arc<R>) -> RunningReader<R> {
        let end = EndRequest::default();
        let (told, ended) = sync_channel(1);
        let (own, own_end, own_told) = (Arc::clone(&reader), end.clone(), told.clone());
        let thread = helpers::thread(name, move || {
            let result = own.read(&own_end);
            tell_end(&own_told, result.map_err(|error| error.to_string()));
        });
        if let Err(error) = thread {
            tell_end(&told, Err(error.to_string()));
        }
        RunningReader { reader, end, ended }
    }

    /// Returns how it has ended; `None` if it reads.
    fn end(&self) -> Option<End> {
        match self.ended.try_recv() {
            Ok(end) => Some(end),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err("the thread has panicked".to_owned())),
        }
    }
}

fn tell_end(to: &SyncSender<End>, end: End) {
    // Nobody waits any more for one that was asked to end.
    let _ = to.try_send(end);
}

/// The present readers.
pub struct Readers<R> {
    /// Name of their threads.
    name: &'static str,
    running: Vec<RunningReader<R>>,
    /// [`END_MAX`], but for tests.
    end_max: Duration,
    /// Why a reader has ended by itself, so that it is logged once.
    problem: String,
}

impl<R: Reader> Readers<R> {
    /// No readers; `name` is that of their threads.
    #[must_use]
    pub fn new(name: &'static str) -> Readers<R> {
        Readers {
            name,
            running: Vec::new(),
            end_max: END_MAX,
            problem: String::new(),
        }
    }

    /// Ends the present readers and starts others. Those that end in time have ended before: the loader limits the streams
    /// that a process has at a time.
    pub fn replace(&mut self, readers: Vec<R>) {
        let old = self.ask_to_end();
        if !readers.is_empty() {
            let until = Instant::now() + self.end_max;
            for reader in old {
                let left = until.saturating_duration_since(Instant::now());
                // One that does not end in time is left alone.
                let _ = reader.ended.recv_timeout(left);
            }
        }
        let start = |reader| RunningReader::start(self.name, Arc::new(reader));
        self.running = readers.into_iter().map(start).collect();
    }

    /// Asks the readers to end, and does not wait.
    pub fn end(&mut self) {
        drop(self.ask_to_end());
    }

    fn ask_to_end(&mut self) -> Vec<RunningReader<R>> {
        for reader in &self.running {
            // Release pairs with the acquire in `is_made`.
            reader.end.0.store(true, Ordering::Release);
        }
        std::mem::take(&mut self.running)
    }

    /// Starts those again that have ended by themselves: the loader was restarted, or had no place for another stream.
    pub fn restart_ended(&mut self) {
        let mut problem = String::new();
        for running in &mut self.running {
            let Some(end) = running.end() else { continue };
            if let Err(words) = end {
                problem = words;
            }
            *running = RunningReader::start(self.name, Arc::clone(&running.reader));
        }
        if !problem.is_empty() && problem != self.problem {
            tracing::warn!(
                "{}: a stream has ended and is read anew: {problem}",
                self.name
            );
        }
        self.problem = problem;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::mpsc::{Sender, channel};

    use super::*;

    /// Longest wait for what must happen.
    const LIMIT: Duration = Duration::from_secs(60);

    /// What comes from a stream: a sample, or the reason why it is broken.
    type Sample = Result<(), &'static str>;

    /// Tells what it does.
    struct TestReader {
        name: &'static str,
        told: SyncSender<String>,
        stream: Mutex<Receiver<Sample>>,
    }

    impl Reader for TestReader {
        type Error = &'static str;

        fn read(&self, end: &EndRequest) -> Sample {
            let stream = self.stream.lock().expect("a stream");
            let tell = |what: &str| drop(self.told.send(format!("{} {what}", self.name)));
            tell("begins");
            while let Ok(sample) = stream.recv() {
                if end.is_made() {
                    tell("ends");
                    return Ok(());
                }
                sample?;
            }
            Ok(())
        }
    }

    /// Returns a reader, and where its samples come from.
    fn reader(name: &'static str, told: &SyncSender<String>) -> (TestReader, Sender<Sample>) {
        let (samples, stream) = channel();
        let (told, stream) = (told.clone(), Mutex::new(stream));
        (TestReader { name, told, stream }, samples)
    }

    #[test]
    fn a_reader_that_ends_by_itself_is_started_again_and_others_go_on() {
        let (told, steps) = sync_channel(16);
        let (broken, samples) = reader("a", &told);
        let (other, _samples) = reader("b", &told);
        let mut readers = Readers::new("test");
        readers.replace(vec![broken, other]);
        let mut begun = [(); 2].map(|()| steps.recv_timeout(LIMIT).expect("it begins"));
        begun.sort();
        assert_eq!(begun, ["a begins", "b begins"]);
        for _ in 0..3 {
            // The loader was restarted, or had no place for the stream.
            let broken = Err("no place");
            samples.send(broken).expect("it reads");
            let until = Instant::now() + LIMIT;
            while readers.problem.is_empty() {
                assert!(Instant::now() < until, "its end is not seen");
                std::thread::yield_now();
                readers.restart_ended();
            }
            assert_eq!(readers.problem, "no place");
            assert_eq!(steps.recv_timeout(LIMIT).as_deref(), Ok("a begins"));
            readers.restart_ended();
            assert_eq!(readers.problem, "", "it reads");
        }
        assert!(steps.try_recv().is_err(), "the other one goes on");
    }

    #[test]
    fn old_readers_end_before_new_ones_begin() {
        let (told, steps) = sync_channel(16);
        let (old, samples) = reader("old", &told);
        let mut readers = Readers::new("test");
        readers.end_max = LIMIT;
        readers.replace(vec![old]);
        assert_eq!(steps.recv_timeout(LIMIT).as_deref(), Ok("old begins"));
        let end = readers.running[0].end.clone();
        // Its next sample comes after it was asked to end.
        let sampling = std::thread::spawn(move || {
            while !end.is_made() {
                std::thread::yield_now();
            }
            samples.send(Ok(())).expect("it reads");
        });
        let (new, _samples) = reader("new", &told);
        readers.replace(vec![new]);
        sampling.join().expect("a sample");
        for step in ["old ends", "new begins"] {
            assert_eq!(steps.recv_timeout(LIMIT).as_deref(), Ok(step));
        }
    }
}
