//! The request sequence of one server, and the processing of its responses.
//! Pure; time is given by the caller; run by the host's thread.
//!
//! On a new connection, and after every fault: safe values (see `safe_values`), `on_connect`, safe values that were
//! refused before, and only then poll rounds: all inputs, the changed outputs, the watchdog.

use std::time::{Duration, Instant};

use super::fault::ServerFault;
use super::frame::{EncodedRequest, ModbusRequest, ReceiveBuffer};
use super::points::{InputTarget, Points, RawOutput, ReadBlock};
use super::settings::ServerSettings;
use rcc_driver_kit::driver::{Inputs, Outputs};

mod response;
mod safe_values;
#[cfg(test)]
mod tests;
mod watchdog;
mod write;

use response::BUSY_PAUSE;
use safe_values::SafeValueSweep;

/// Present step; the numbers are list indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Waiting for the next round.
    Idle,
    /// Writing safe values; refused ones are tried again after `on_connect`.
    Safe { again: bool },
    /// Writing the values of `on_connect`.
    OnConnect(usize),
    /// Reading inputs.
    Read(usize),
    /// Inputs have been read; waiting for the commanded outputs.
    Decide,
    /// Writing outputs.
    Write(usize),
    /// Writing the watchdog.
    Watchdog,
}

/// Purpose of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    OnConnect,
    Read,
    /// Outputs up to `end`, exclusive; `mask` gives the bits of a register.
    Write {
        from: usize,
        end: usize,
        mask: u16,
    },
    /// The register whose bits are to be changed next.
    Fetch {
        place: usize,
    },
    Watchdog,
}

/// A request that is being sent, or waits for its response.
#[derive(Clone, Copy, Debug)]
struct PendingRequest {
    message: EncodedRequest,
    purpose: Purpose,
    /// Number of bytes sent.
    sent: usize,
    /// Time from which on it is sent.
    from: Instant,
}

impl PendingRequest {
    /// Returns true if all bytes have been sent.
    fn has_gone(&self) -> bool {
        self.sent == self.message.bytes().len()
    }
}

/// Counters since the driver started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerCounts {
    /// Rounds that could not start because the last one had not ended.
    pub late: u64,
    /// Responses without a pending request.
    pub discarded: u64,
}

/// The requests to one server, and what is known about it.
#[derive(Debug)]
pub struct Server {
    settings: ServerSettings,
    points: Points,
    /// Values of the outputs without a command.
    released: Outputs,
    step: Step,
    pending: Option<PendingRequest>,
    transaction: u16,
    inbox: ReceiveBuffer,
    /// Deadline of the present step.
    due: Instant,
    commanded: Option<Outputs>,
    /// Values that are being written.
    writing: Outputs,
    written: Vec<RawOutput>,
    /// A register that is to be changed in part: index of its output, and the value that was read.
    fetched: Option<(usize, u16)>,
    /// Outputs before this index are written one by one, because they were refused together.
    one_by_one: usize,
    refused: Option<ServerFault>,
    /// The server was too busy for some of the outputs, which are written again after the others.
    busy: Option<ServerFault>,
    /// No request is sent before this time.
    not_before: Instant,
    sweep: SafeValueSweep,
    building: Inputs,
    inputs: Inputs,
    complete: bool,
    /// The inputs have not been taken yet.
    fresh: bool,
    /// Time at which the inputs were requested, and the duration of reading them.
    asked: Instant,
    read_time: Duration,
    heartbeat_value: Option<u16>,
    heartbeat_changed: Option<Instant>,
    prepared: Instant,
    watchdog_count: u16,
    watchdog_due: Instant,
    other_unit: Option<u8>,
    counts: ServerCounts,
}

impl Server {
    /// A server that has not been reached yet.
    #[must_use]
    pub fn new(settings: ServerSettings, points: Points, released: Outputs, now: Instant) -> Self {
        Self {
            written: vec![RawOutput::default(); points.outputs.len()],
            sweep: SafeValueSweep::new(points.outputs.len(), now),
            settings,
            points,
            released,
            step: Step::Idle,
            pending: None,
            transaction: 0,
            inbox: ReceiveBuffer::default(),
            due: now,
            commanded: None,
            writing: Outputs::NONE,
            fetched: None,
            one_by_one: 0,
            refused: None,
            busy: None,
            not_before: now,
            building: Inputs::NONE,
            inputs: Inputs::NONE,
            complete: false,
            fresh: false,
            asked: now,
            read_time: Duration::ZERO,
            heartbeat_value: None,
            heartbeat_changed: None,
            prepared: now,
            watchdog_count: 0,
            watchdog_due: now,
            other_unit: None,
            counts: ServerCounts::default(),
        }
    }

    /// Returns the settings.
    #[must_use]
    pub fn settings(&self) -> &ServerSettings {
        &self.settings
    }

    /// Returns the counters.
    #[must_use]
    pub fn counts(&self) -> ServerCounts {
        self.counts
    }

    /// Starts on a new connection; bytes of the last one are dropped.
    pub fn connected(&mut self, now: Instant) {
        self.inbox.clear();
        self.prepare(now);
    }

    /// Restarts the sequence on the same connection; the state of the server's outputs is unknown.
    pub fn prepare(&mut self, now: Instant) {
        self.pending = None;
        self.written.fill(RawOutput::default());
        (self.complete, self.fresh) = (false, false);
        self.heartbeat_changed = None;
        self.prepared = now;
        self.commanded = None;
        self.writing = self.released;
        self.begin(Step::Safe { again: false }, now);
    }

    /// Returns true if all inputs are known and the heartbeat is alive.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.complete
    }

    /// Returns a fault if the server answers but its heartbeat has stopped.
    #[must_use]
    pub fn standstill(&self, now: Instant) -> Option<ServerFault> {
        let heartbeat = self.settings.heartbeat.as_ref()?;
        let since = self.heartbeat_changed.unwrap_or(self.prepared);
        let still = now.saturating_duration_since(since) > heartbeat.within;
        still.then(|| ServerFault::Frozen {
            address: heartbeat.address.to_string(),
            within: heartbeat.within,
        })
    }

    /// Returns true if the inputs of this round have been read.
    #[must_use]
    pub fn has_read(&self) -> bool {
        self.complete && !matches!(self.step, Step::Read(_))
    }

    /// Returns true if nothing is left to do until the next round.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.step == Step::Idle && self.pending.is_none()
    }

    /// Returns true if the server waits for its commanded outputs.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.step == Step::Decide
    }

    /// Returns the duration of reading the inputs in the last complete round.
    #[must_use]
    pub fn read_time(&self) -> Option<Duration> {
        self.complete.then_some(self.read_time)
    }

    /// Starts a round; returns false if the last one has not ended.
    pub fn tick(&mut self, now: Instant) -> bool {
        if !matches!(self.step, Step::Idle | Step::Decide) {
            self.counts.late += 1;
            return false;
        }
        self.commanded = None;
        self.asked = now;
        self.begin(Step::Read(0), now);
        true
    }

    /// Sets the commanded outputs of this round.
    pub fn command(&mut self, outputs: &Outputs, now: Instant) {
        self.commanded = Some(*outputs);
        if self.step == Step::Decide {
            self.write_from_the_beginning(now);
        }
    }

    /// Returns true if nothing is being read or written.
    #[must_use]
    pub fn may_finish(&self) -> bool {
        matches!(self.step, Step::Idle | Step::Decide) && self.pending.is_none()
    }

    /// As [`Server::command`], but also between rounds: the last action at the end.
    pub fn finish(&mut self, outputs: &Outputs, now: Instant) {
        self.commanded = Some(*outputs);
        if matches!(self.step, Step::Idle | Step::Decide) {
            self.write_from_the_beginning(now);
        }
    }

    /// Returns true if there are inputs that have not been taken.
    #[must_use]
    pub fn is_fresh(&self) -> bool {
        self.fresh
    }

    /// Copies the inputs of the last complete round.
    pub fn take_inputs(&mut self, inputs: &mut Inputs) {
        self.fresh = false;
        for item in self.points.reads.iter().flat_map(|read| &read.items) {
            match item.target {
                InputTarget::Bit { index } | InputTarget::RegisterBit { index, .. } => {
                    let bit = 1_u64 << index;
                    inputs.digital = (inputs.digital & !bit) | (self.inputs.digital & bit);
                    inputs.digital_known |= bit;
                }
                InputTarget::Number { index, .. } => {
                    inputs.analog[index] = self.inputs.analog[index]
                }
                InputTarget::Heartbeat => {}
            }
        }
    }

    /// Returns the space for received bytes; see [`Server::received`].
    pub fn room(&mut self) -> &mut [u8] {
        self.inbox.room()
    }

    /// Processes `count` received bytes.
    ///
    /// # Errors
    /// Returns a fault if they are not a valid response, or one that ends this attempt.
    pub fn received(&mut self, count: usize, now: Instant) -> Result<(), ServerFault> {
        self.inbox.filled(count);
        if self.ignores_input() {
            self.inbox.clear();
            return Ok(());
        }
        let inbox = std::mem::take(&mut self.inbox);
        let (used, result) = self.process_received(inbox, now);
        self.inbox = used;
        match result {
            Err(fault @ ServerFault::Broken(_)) if matches!(self.step, Step::Safe { .. }) => {
                self.ignore_input(fault);
                Ok(())
            }
            result => result,
        }
    }

    /// Makes the next request if none is pending, and checks the deadline.
    ///
    /// # Errors
    /// Returns a fault if a response is overdue, or if something was refused in this round.
    pub fn advance(&mut self, now: Instant) -> Result<(), ServerFault> {
        if let Step::Safe { .. } = self.step {
            self.overtake_pending(now);
        }
        if self.pending.is_none() {
            self.next(now)?;
        }
        match self.unanswered() {
            Some(pending) if now >= self.due => Err(self.overdue(&pending)),
            _ => Ok(()),
        }
    }

    /// Returns the bytes to send now.
    #[must_use]
    pub fn to_send(&self, now: Instant) -> &[u8] {
        match &self.pending {
            Some(pending) if now >= pending.from => {
                pending.message.bytes().get(pending.sent..).unwrap_or(&[])
            }
            _ => &[],
        }
    }

    /// Counts sent bytes.
    pub fn sent(&mut self, count: usize) {
        if let Some(pending) = &mut self.pending {
            pending.sent += count;
        }
    }

    /// Returns the time at which [`Server::advance`] has work to do even if nothing is received.
    #[must_use]
    pub fn wake(&self, now: Instant) -> Option<Instant> {
        if self.unanswered().is_none() {
            // A step that has just started must still make its first request.
            let is_waiting = matches!(self.step, Step::Idle | Step::Decide);
            return (!is_waiting).then_some(now);
        }
        let from = self.pending.map(|pending| pending.from);
        let turn = match self.step {
            Step::Safe { .. } => self.turn(),
            _ => None,
        };
        let ahead = [from, turn].into_iter().flatten().filter(|at| *at > now);
        Some(ahead.fold(self.due, Instant::min))
    }

    fn begin(&mut self, step: Step, now: Instant) {
        self.step = step;
        self.due = now + self.settings.timeout;
        (self.refused, self.busy) = (None, None);
        self.not_before = now;
        self.one_by_one = 0;
        self.fetched = None;
        self.other_unit = None;
        if let Step::Safe { .. } = step {
            self.sweep.begin();
        }
    }

    /// Performs steps until one makes a request or waits.
    fn next(&mut self, now: Instant) -> Result<(), ServerFault> {
        loop {
            match self.step {
                Step::Idle | Step::Decide => return Ok(()),
                Step::Safe { again } => {
                    if !self.continue_sweep(now) {
                        return Ok(());
                    }
                    match self.finish_sweep(again) {
                        Some(fault) => return Err(fault),
                        None if again => {
                            self.sweep.forget();
                            self.step = Step::Idle;
                        }
                        None => self.begin(Step::OnConnect(0), now),
                    }
                }
                Step::OnConnect(place) => {
                    if self.assign(place, now) {
                        return Ok(());
                    }
                    self.begin(Step::Safe { again: true }, now);
                }
                Step::Read(place) => {
                    if let Some(ReadBlock {
                        table,
                        first,
                        count,
                        ..
                    }) = self.points.reads.get(place)
                    {
                        let (table, first, count) = (*table, *first, *count);
                        self.ask(
                            &ModbusRequest::Read {
                                table,
                                first,
                                count,
                            },
                            Purpose::Read,
                            now,
                        );
                        return Ok(());
                    }
                    self.finish_reading(now);
                }
                Step::Write(cursor) => {
                    if self.write_next(cursor, now) {
                        return Ok(());
                    }
                    if self.busy.is_some() && now + BUSY_PAUSE < self.due {
                        self.busy = None;
                        self.not_before = now + BUSY_PAUSE;
                        self.step = Step::Write(0);
                        continue;
                    }
                    if let Some(fault) = self.refused.take().or(self.busy.take()) {
                        return Err(fault);
                    }
                    self.step = Step::Watchdog;
                }
                Step::Watchdog => {
                    if self.write_watchdog(now) {
                        return Ok(());
                    }
                    self.step = Step::Idle;
                }
            }
        }
    }

    fn finish_reading(&mut self, now: Instant) {
        self.inputs = self.building;
        self.read_time = now.saturating_duration_since(self.asked);
        // A heartbeat is valid from its first change on.
        let lives = self.settings.heartbeat.is_none() || self.heartbeat_changed.is_some();
        self.complete = lives && self.standstill(now).is_none();
        self.fresh = self.complete;
        match self.commanded {
            Some(_) => self.write_from_the_beginning(now),
            None => self.begin(Step::Decide, now),
        }
    }

    fn write_from_the_beginning(&mut self, now: Instant) {
        self.writing = self.commanded.unwrap_or(self.released);
        self.begin(Step::Write(0), now);
    }

    fn ask(&mut self, request: &ModbusRequest<'_>, purpose: Purpose, now: Instant) {
        self.transaction = self.transaction.wrapping_add(1);
        // The length was checked when the driver was opened.
        if let Some(message) = EncodedRequest::new(self.transaction, self.settings.unit, request) {
            self.pending = Some(PendingRequest {
                message,
                purpose,
                sent: 0,
                from: now.max(self.not_before),
            });
        }
    }
}
