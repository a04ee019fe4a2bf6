//! The thread that exchanges with the line, session after session, and what it shares with the host's thread.
//! It sends a frame each period; if the host is late, the outputs of before are sent again, and if the host is silent, the
//! safe values.

use std::io;
use std::ops::ControlFlow;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use ethercrab::SubDeviceState;

use super::counters::LineCounters;
use super::points::Points;
use super::reasons;
use crate::session::{
    self, Application, Cycle, Loss, PortErrors, SessionError, SessionOptions, TerminalImage,
};

/// Pause between two sessions.
const PAUSE: Duration = Duration::from_millis(200);

/// State that the two threads share.
#[derive(Debug)]
pub struct Shared {
    state: Mutex<LineState>,
    changed: Condvar,
}

/// State of the line.
#[derive(Debug)]
pub struct LineState {
    /// Newest inputs, and the outputs of the next exchange; empty before the first session.
    pub image: Vec<TerminalImage>,
    /// The outputs of the next exchange if the host is silent; in `outputs` only.
    pub released: Vec<TerminalImage>,
    /// Result of the last exchange.
    pub cycle: Cycle,
    /// Time of the last exchange.
    pub at: Instant,
    /// Number of exchanges so far.
    pub number: u64,
    /// Why there is no exchange; 0 = there are exchanges.
    pub reason: u32,
    /// The host has sent outputs in this session.
    pub driven: bool,
    /// The host was silent for too long, and the line got the safe values; the host resets it.
    pub silenced: bool,
    /// Time of the host's last outputs.
    pub sent: Instant,
    stop: bool,
}

impl Shared {
    /// Locks the state even after a panic: it holds plain numbers.
    pub fn lock(&self) -> MutexGuard<'_, LineState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a change of the state, at most until `deadline`; returns false if that has passed.
    pub fn wait<'a>(
        &'a self,
        state: MutexGuard<'a, LineState>,
        deadline: Instant,
    ) -> (MutexGuard<'a, LineState>, bool) {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return (state, false);
        }
        let woken = self.changed.wait_timeout(state, left);
        (woken.unwrap_or_else(PoisonError::into_inner).0, true)
    }
}

/// The thread; dropping it ends the session after one more exchange, and waits for that.
#[derive(Debug)]
pub struct LineThread {
    /// Shared with the thread.
    pub shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl LineThread {
    /// Starts the thread; it inherits the priority of the caller.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses.
    pub fn start(
        options: SessionOptions,
        points: Points,
        counters: Arc<LineCounters>,
        silence_max: Duration,
    ) -> io::Result<LineThread> {
        let now = Instant::now();
        let shared = Arc::new(Shared {
            state: Mutex::new(LineState {
                image: Vec::new(),
                released: Vec::new(),
                cycle: Cycle::First,
                at: now,
                number: 0,
                reason: reasons::STARTING,
                driven: false,
                silenced: false,
                sent: now,
                stop: false,
            }),
            changed: Condvar::new(),
        });
        let mut exchanging = Exchanging {
            shared: Arc::clone(&shared),
            points,
            counters,
            silence_max,
            last_outputs_sent: false,
            refused: None,
        };
        let thread = thread::Builder::new()
            .name("line".into())
            .spawn(move || exchanging.run(&options))?;
        Ok(LineThread {
            shared,
            thread: Some(thread),
        })
    }
}

impl Drop for LineThread {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        self.shared.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic has been reported by the thread itself.
            let _ = thread.join();
        }
    }
}

/// The thread's side.
struct Exchanging {
    shared: Arc<Shared>,
    points: Points,
    counters: Arc<LineCounters>,
    /// Without outputs of the host for this time the safe values are sent.
    silence_max: Duration,
    /// The thread must end, and the last outputs of the host have been given to an exchange.
    last_outputs_sent: bool,
    /// Why the process data of the line cannot be used.
    refused: Option<String>,
}

impl Exchanging {
    fn run(&mut self, options: &SessionOptions) {
        while !self.must_end() {
            self.counters.begin_session();
            let counters = Arc::clone(&self.counters);
            let result = session::run(options, &counters.frames, self);
            let result = match self.refused.take() {
                Some(cause) => Err(SessionError::Image(cause)),
                None => result,
            };
            if let Err(error) = result {
                self.fail(&error);
            }
        }
    }

    /// Reports the end of a session, and pauses.
    fn fail(&mut self, error: &SessionError) {
        let text = error.to_string();
        if self.counters.set_fault(Some(text.clone())) {
            tracing::warn!("the EtherCAT line is lost: {text}");
        }
        let shared = Arc::clone(&self.shared);
        let mut state = shared.lock();
        state.reason = reasons::of(error);
        self.counters.set_reason(state.reason);
        shared.changed.notify_all();
        let until = Instant::now() + PAUSE;
        let mut waits = true;
        while waits && !state.stop {
            (state, waits) = shared.wait(state, until);
        }
    }
}

impl Application for Exchanging {
    fn must_end(&self) -> bool {
        self.shared.lock().stop
    }

    fn drives_outputs(&self) -> bool {
        self.shared.lock().driven
    }

    fn cycle(&mut self, image: &mut [TerminalImage], cycle: Cycle) -> ControlFlow<()> {
        let shared = Arc::clone(&self.shared);
        let mut state = shared.lock();
        match cycle {
            Cycle::First => return self.begin(&mut state, image),
            Cycle::Complete => self.counters.count_complete(),
            Cycle::InputsOnly => {}
            Cycle::Lost(loss) => self.counters.count_loss(loss),
        }
        if matches!(cycle, Cycle::Complete | Cycle::InputsOnly) {
            for (own, new) in state.image.iter_mut().zip(&*image) {
                own.inputs.copy_from_slice(&new.inputs);
            }
        }
        if cycle == Cycle::Complete && state.reason != 0 {
            tracing::info!("the EtherCAT line is in OP");
        }
        state.reason = match cycle {
            Cycle::InputsOnly | Cycle::Lost(Loss::Starting) => reasons::STARTING,
            _ => 0,
        };
        self.counters.set_reason(state.reason);
        if cycle == Cycle::Complete {
            self.counters.clear_fault();
        }
        state.cycle = cycle;
        state.at = Instant::now();
        state.number += 1;
        shared.changed.notify_all();
        if state.stop && (self.last_outputs_sent || !state.driven) {
            return ControlFlow::Break(());
        }
        self.last_outputs_sent = state.stop;
        let silent = state.sent.elapsed() > self.silence_max && !state.stop;
        state.silenced |= silent && state.driven;
        let outputs = if silent {
            &state.released
        } else {
            &state.image
        };
        for (next, own) in image.iter_mut().zip(outputs) {
            next.outputs.copy_from_slice(&own.outputs);
        }
        ControlFlow::Continue(())
    }

    fn states(&mut self, states: &[SubDeviceState]) {
        self.counters.states(states);
    }

    fn clock_difference(&mut self, position: usize, difference_ns: i64) {
        self.counters.clock_difference(position, difference_ns);
    }

    fn port_errors(&mut self, position: usize, errors: PortErrors) {
        self.counters.port_errors(position, errors);
    }
}

impl Exchanging {
    /// Begins a session: the terminals have switched off, so outputs that hold have no value.
    fn begin(&mut self, state: &mut LineState, image: &mut [TerminalImage]) -> ControlFlow<()> {
        if let Err(cause) = self.points.check(image) {
            self.refused = Some(cause);
            return ControlFlow::Break(());
        }
        self.points.release(image);
        state.image = image.to_vec();
        state.released = image.to_vec();
        state.driven = false;
        ControlFlow::Continue(())
    }
}
