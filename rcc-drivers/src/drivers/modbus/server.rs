//! The dialog with one server: what is asked next, and what its answers mean.
//! Pure, in time that the caller gives; run by the host's thread.
//!
//! On a new connection, and after every fault: safe values (see `safe`), `on_connect`, safe values that were refused
//! before, and only then rounds: all inputs, what the outputs have become, the watchdog.

use std::time::{Duration, Instant};

use super::fault::ServerFault;
use super::frame::{EncodedRequest, ModbusRequest, ReceiveBuffer};
use super::points::{InputTarget, Points, RawOutput, ReadBlock};
use super::settings::ServerSettings;
use crate::driver::{Inputs, Outputs};

mod response;
mod safe_values;
#[cfg(test)]
mod tests;
mod watchdog;
mod write;

use response::BUSY_PAUSE;
use safe_values::SafeValueSweep;

/// What is being done; the numbers are places in lists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Until the next round.
    Idle,
    /// Safe values; those refused are tried again after `on_connect`.
    Safe { again: bool },
    /// The values of `on_connect`.
    OnConnect(usize),
    /// Inputs.
    Read(usize),
    /// Inputs have come; until it is known what the outputs become.
    Decide,
    /// Outputs.
    Write(usize),
    /// A sign of life.
    Watchdog,
}

/// What the answer is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    OnConnect,
    Read,
    /// Outputs up to `end`, exclusive; `mask` are the bits of a register.
    Write {
        from: usize,
        end: usize,
        mask: u16,
    },
    /// The register whose bits are changed next.
    Fetch {
        place: usize,
    },
    Watchdog,
}

/// A request that is on its way, or waits for its answer.
#[derive(Clone, Copy, Debug)]
struct PendingRequest {
    message: EncodedRequest,
    purpose: Purpose,
    /// Bytes that have gone.
    sent: usize,
    /// It is sent (again) from then on.
    from: Instant,
}

impl PendingRequest {
    /// All of its bytes have gone.
    fn has_gone(&self) -> bool {
        self.sent == self.message.bytes().len()
    }
}

/// Counters since the driver started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerCounts {
    /// Rounds that could not begin because the last one had not ended.
    pub late: u64,
    /// Answers that nobody waited for.
    pub discarded: u64,
}

/// The dialog with one server.
#[derive(Debug)]
pub struct Server {
    settings: ServerSettings,
    points: Points,
    /// What nobody commands.
    released: Outputs,
    step: Step,
    pending: Option<PendingRequest>,
    transaction: u16,
    inbox: ReceiveBuffer,
    /// Until when what is being done must be done.
    due: Instant,
    commanded: Option<Outputs>,
    /// What is being written.
    writing: Outputs,
    written: Vec<RawOutput>,
    /// A register that is to be changed in part, as it was read, and which output that is.
    fetched: Option<(usize, u16)>,
    /// Outputs before this place are written one by one, as together they were refused.
    one_by_one: usize,
    refused: Option<ServerFault>,
    /// The server was too busy for some of the outputs, which are written again after the others.
    busy: Option<ServerFault>,
    /// RequestLimits wait until then.
    not_before: Instant,
    sweep: SafeValueSweep,
    building: Inputs,
    inputs: Inputs,
    complete: bool,
    /// The inputs have not been taken.
    fresh: bool,
    /// When the inputs were asked for, and how long they took.
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
    /// A server that has not been reached.
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

    /// Its settings.
    #[must_use]
    pub fn settings(&self) -> &ServerSettings {
        &self.settings
    }

    /// Counters.
    #[must_use]
    pub fn counts(&self) -> ServerCounts {
        self.counts
    }

    /// A new connection: nothing that came on the last one counts.
    pub fn connected(&mut self, now: Instant) {
        self.inbox.clear();
        self.prepare(now);
    }

    /// From the beginning on the same connection; nobody knows what the server has done meanwhile.
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

    /// All inputs are known and the device's program lives.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.complete
    }

    /// Why it is not complete though it answers: its heartbeat stands still.
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

    /// It waits for the next round, or for its outputs.
    #[must_use]
    pub fn has_read(&self) -> bool {
        self.complete && !matches!(self.step, Step::Read(_))
    }

    /// Nothing is left to do until the next round.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.step == Step::Idle && self.pending.is_none()
    }

    /// It is told its outputs next.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.step == Step::Decide
    }

    /// How long the inputs of the last complete round took.
    #[must_use]
    pub fn read_time(&self) -> Option<Duration> {
        self.complete.then_some(self.read_time)
    }

    /// A round begins, unless the last one still runs.
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

    /// What its outputs are to be, in this round.
    pub fn command(&mut self, outputs: &Outputs, now: Instant) {
        self.commanded = Some(*outputs);
        if self.step == Step::Decide {
            self.write_from_the_beginning(now);
        }
    }

    /// Nothing is being read or written.
    #[must_use]
    pub fn may_finish(&self) -> bool {
        matches!(self.step, Step::Idle | Step::Decide) && self.pending.is_none()
    }

    /// As [`Server::command`], also between rounds: the last thing that is done.
    pub fn finish(&mut self, outputs: &Outputs, now: Instant) {
        self.commanded = Some(*outputs);
        if matches!(self.step, Step::Idle | Step::Decide) {
            self.write_from_the_beginning(now);
        }
    }

    /// Inputs have come that nobody has taken.
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

    /// Where bytes that came are put; see [`Server::received`].
    pub fn room(&mut self) -> &mut [u8] {
        self.inbox.room()
    }

    /// So many bytes have come.
    ///
    /// # Errors
    /// They are no answer, or one that ends this attempt.
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

    /// Goes on: makes the next request if there is none, and looks at the clock.
    ///
    /// # Errors
    /// No answer in time, or what was refused in this round.
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

    /// Bytes that are to go now.
    #[must_use]
    pub fn to_send(&self, now: Instant) -> &[u8] {
        match &self.pending {
            Some(pending) if now >= pending.from => {
                pending.message.bytes().get(pending.sent..).unwrap_or(&[])
            }
            _ => &[],
        }
    }

    /// So many of them have gone.
    pub fn sent(&mut self, count: usize) {
        if let Some(pending) = &mut self.pending {
            pending.sent += count;
        }
    }

    /// When [`Server::advance`] has something to do though nothing comes.
    #[must_use]
    pub fn wake(&self, now: Instant) -> Option<Instant> {
        if self.unanswered().is_none() {
            // A step that has just begun has its first request still to make.
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

    /// Steps that need no answer are gone through; the first that needs one makes its request.
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
        // A heartbeat counts from its first change on.
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
        // Its length was checked when the driver was opened.
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
