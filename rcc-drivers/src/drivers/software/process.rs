//! The program of a software device: started, read and written by threads of its own, so that the exchange thread waits for
//! none of it; started again with growing pauses when it ends.
//!
//! A frame is written only when the last one was answered, so that a slow program reads the newest outputs, never a queue
//! ([`SentFrames`] says what a wrong line means to that).

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, killpg};
use nix::unistd::Pid;
use rcc_driver_kit::driver::LinkDiagnosis;
use rcc_process::log_throttle::LogThrottle;
use serde_json::{Value, json};

use super::message::{Frame, Values};

mod guard;
mod sent_frames;

use guard::Guard;
use sent_frames::SentFrames;

/// Longest line of the program, bytes.
const LINE_MAX: u64 = 64 * 1024;
/// First and longest pause before a program is started again.
const PAUSES: [Duration; 2] = [Duration::from_millis(200), Duration::from_secs(5)];
/// A program that ran for this long has not failed at its start.
const SETTLED: Duration = Duration::from_secs(10);
/// Time for the program to end by itself when its input is closed.
const GRACE: Duration = Duration::from_millis(500);

/// Whether the program runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgramState {
    /// It runs; it may be silent.
    Running,
    /// It has ended, or could not be started; it is started again.
    Ended,
}

/// Counters, and what the threads share with the exchange thread.
#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    running: AtomicBool,
    /// The last frame has not been answered, nor assumed to be.
    asked: AtomicBool,
    starts: AtomicU64,
    answers: AtomicU64,
    refused: AtomicU64,
    /// Periods in which no frame was sent, as the last one had not been answered.
    late: AtomicU64,
    /// The newest values; each thread holds it only to move them.
    newest: Mutex<Option<Values>>,
    /// Not for the exchange thread.
    last: Mutex<Last>,
}

#[derive(Debug, Default)]
struct Last {
    /// Frames of this life of the program.
    frames: SentFrames,
    /// Why the last line was refused, and how the program ended.
    words: String,
    throttle: LogThrottle,
}

/// A program and its threads.
#[derive(Debug)]
pub struct Program {
    shared: Arc<Shared>,
    frames: Option<SyncSender<Frame>>,
    thread: Option<JoinHandle<()>>,
}

impl Program {
    /// Starts the thread that starts the program in `folder`.
    ///
    /// # Errors
    /// Returns an error if there is no thread to be had. A program that does not start is not an error: it may later.
    pub fn start(command: Vec<String>, folder: PathBuf) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        // One frame: the newest one when the program is ready for it.
        let (frames, next_frame) = sync_channel(1);
        let own = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("program".to_owned())
            .spawn(move || keep_running(&command, &folder, &own, &next_frame))?;
        Ok(Self {
            shared,
            frames: Some(frames),
            thread: Some(thread),
        })
    }

    /// Returns the newest values if they were not returned yet; does not wait.
    pub fn newest(&self) -> Option<Values> {
        self.shared.newest.try_lock().ok()?.take()
    }

    /// Returns whether the program runs.
    pub fn state(&self) -> ProgramState {
        match self.shared.running.load(Ordering::Acquire) {
            true => ProgramState::Running,
            false => ProgramState::Ended,
        }
    }

    /// Sends a frame if the last one has been answered; otherwise the program is late.
    pub fn offer(&self, frame: impl FnOnce() -> Frame) {
        // Before the frame leaves: its answer may come at once.
        if self.shared.asked.swap(true, Ordering::AcqRel) {
            self.shared.late.fetch_add(1, Ordering::Relaxed);
        } else if let Some(frames) = &self.frames {
            // Full: a frame is on its way, and will be answered; disconnected: the program is not started any more.
            let _ = frames.try_send(frame());
        }
    }

    /// Returns the number of periods in which the program was not ready for a frame.
    pub fn late(&self) -> u64 {
        self.shared.late.load(Ordering::Relaxed)
    }

    /// Returns the number of lines that were refused.
    pub fn refused(&self) -> u64 {
        self.shared.refused.load(Ordering::Relaxed)
    }

    /// Returns the counters.
    pub fn counters(&self) -> Arc<dyn LinkDiagnosis> {
        Arc::clone(&self.shared) as Arc<dyn LinkDiagnosis>
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        // Ends the writer, which closes the program's input.
        self.frames = None;
        if let Some(thread) = self.thread.take() {
            // It has reported a panic by itself.
            let _ = thread.join();
        }
    }
}

impl LinkDiagnosis for Shared {
    fn link(&self) -> Value {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let last = self.last();
        json!({
            "running": self.running.load(Ordering::Relaxed),
            "starts": count(&self.starts),
            "answers": count(&self.answers),
            "late": count(&self.late),
            "refused": count(&self.refused),
            "last_words": last.words,
        })
    }
}

impl Shared {
    /// Keeps words for `doctor`, and writes them to the log, at most once a second: a program may give any number of wrong
    /// lines.
    fn tell(&self, words: String) {
        let mut last = self.last();
        if let Some(others) = last.throttle.admit(Instant::now()) {
            tracing::warn!("{words}; {others} similar messages suppressed");
        }
        last.words = words;
    }

    fn last(&self) -> MutexGuard<'_, Last> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Starts the program until the driver ends.
fn keep_running(command: &[String], folder: &Path, shared: &Arc<Shared>, frames: &Receiver<Frame>) {
    let mut pause = PAUSES[0];
    while !shared.stop.load(Ordering::Acquire) {
        let begun = Instant::now();
        let ended = match start(command, folder) {
            Ok((child, guard)) => live(child, guard, shared, frames),
            Err(error) => format!("it cannot be started: {error}"),
        };
        shared.running.store(false, Ordering::Release);
        if shared.stop.load(Ordering::Acquire) {
            return;
        }
        shared.tell(format!("{}: {ended}", command.join(" ")));
        pause = match begun.elapsed() > SETTLED {
            true => PAUSES[0],
            false => (2 * pause).min(PAUSES[1]),
        };
        let again = Instant::now() + pause;
        // A frame that nobody read belongs to the program that has ended.
        while let Some(left) = again.checked_duration_since(Instant::now()) {
            match frames.recv_timeout(left) {
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => break,
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
        shared.asked.store(false, Ordering::Release);
    }
}

/// Starts the program, and what ends it if this process dies.
fn start(command: &[String], folder: &Path) -> std::io::Result<(Child, Guard)> {
    let [program, arguments @ ..] = command else {
        return Err(std::io::ErrorKind::InvalidInput.into());
    };
    let mut command = Command::new(program);
    if !folder.as_os_str().is_empty() {
        command.current_dir(folder);
    }
    let mut child = command
        .args(arguments)
        .process_group(0)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()?;
    match Guard::start(group(&child)) {
        Ok(guard) => Ok((child, guard)),
        Err(error) => {
            end_group(group(&child));
            child.wait()?;
            Err(error)
        }
    }
}

/// The process group that the program leads.
fn group(child: &Child) -> Pid {
    Pid::from_raw(i32::try_from(child.id()).unwrap_or(i32::MAX))
}

/// Ends a program with all that it has started; it may have ended meanwhile.
fn end_group(group: Pid) {
    // Then there is nobody to signal.
    let _ = killpg(group, Signal::SIGKILL);
}

/// Exchanges lines with the program until it ends; returns how it ended.
fn live(mut child: Child, guard: Guard, shared: &Arc<Shared>, frames: &Receiver<Frame>) -> String {
    let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
        return "its input or output is missing".to_owned();
    };
    let group = group(&child);
    shared.starts.fetch_add(1, Ordering::Relaxed);
    shared.last().frames = SentFrames::default();
    shared.asked.store(false, Ordering::Release);
    shared.running.store(true, Ordering::Release);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| read(BufReader::new(output), shared));
        write(input, shared, frames);
        // Its input is closed: it may end by itself. One that has only closed its output has not ended.
        let end = Instant::now() + GRACE;
        let mut has_ended = || reader.is_finished() && matches!(child.try_wait(), Ok(Some(_)));
        while !has_ended() && Instant::now() < end {
            std::thread::park_timeout(Duration::from_millis(5));
        }
        if !has_ended() {
            end_group(group);
        }
    });
    drop(guard);
    match child.wait() {
        Ok(status) => format!("it has ended: {status}"),
        Err(error) => format!("it has ended: {error}"),
    }
}

/// Writes frames until the program's output has ended or the driver ends.
fn write(mut input: ChildStdin, shared: &Shared, frames: &Receiver<Frame>) {
    loop {
        match frames.recv_timeout(Duration::from_millis(50)) {
            Ok(frame) => {
                let number = shared.last().frames.push(Instant::now());
                if input.write_all(frame.line(number).as_bytes()).is_err() {
                    return;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        if !shared.running.load(Ordering::Acquire) {
            return;
        }
    }
}

/// Reads lines until the end of the program's output, or a line that has no end.
fn read(mut output: impl BufRead, shared: &Shared) {
    let mut line = String::new();
    loop {
        line.clear();
        match (&mut output).take(LINE_MAX).read_line(&mut line) {
            Ok(0) => break,
            Ok(_) if line.ends_with('\n') => {}
            Ok(_) => {
                shared.tell(format!(
                    "a line of the program is cut or longer than {LINE_MAX} bytes"
                ));
                break;
            }
            Err(error) => {
                shared.tell(format!("a line of the program cannot be read: {error}"));
                break;
            }
        }
        let answered = match Values::read(&line, |number| shared.last().frames.answer(number)) {
            Ok(values) => {
                shared.answers.fetch_add(1, Ordering::Relaxed);
                let names_frame = values.frame.is_some();
                *shared.newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(values);
                names_frame
            }
            Err(cause) => {
                shared.refused.fetch_add(1, Ordering::Relaxed);
                shared.last().frames.refuse();
                shared.tell(format!("an answer of the program is refused: {cause}"));
                true
            }
        };
        if answered && shared.last().frames.all_answered() {
            shared.asked.store(false, Ordering::Release);
        }
    }
    shared.running.store(false, Ordering::Release);
}
