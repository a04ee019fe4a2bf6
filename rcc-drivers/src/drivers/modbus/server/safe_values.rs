//! The safe values of one server: every one is sent, whatever the server answers, and each once before any is sent again.
//! Pure; run by the host's thread.
//!
//! A request whose answer does not come in its share of the time-out is overtaken by the next one: both are then on their
//! way, told apart by their transaction numbers (MODBUS Messaging on TCP/IP V1.0b, 4.2). So all of them are sent within
//! one time-out. Those that were never confirmed come first, and of them who was sent least often, also over connections:
//! a server that closes after each request, or drops what comes while it is at work, gets all values in a few rounds.

use std::time::{Duration, Instant};

use super::super::fault::ServerFault;
use super::super::frame::Response;
use super::super::points::{DesiredValue, OutputSource};
use super::response::BUSY_PAUSE;
use super::write::unfit;
use super::{PendingRequest, Purpose, Server, Step};

/// Connections that end after one request take the next one with them; so often, the last of 64 outputs has had its turn.
const TRIES_MAX: u32 = 8;

/// What is known of the safe values; rows by the place of an output.
#[derive(Debug)]
pub(super) struct SafeValueSweep {
    rows: Vec<SafeValueState>,
    /// Sweeps so far: each begins at another output.
    count: usize,
    /// RequestLimits that were overtaken; at most one for each output.
    overtaken: Vec<PendingRequest>,
    /// When the request that waits may be overtaken.
    turn: Instant,
    /// All have been sent; from now on only answers are waited for.
    all_sent: bool,
    /// What comes cannot be understood any more, and is dropped.
    ignores_input: bool,
    /// The server was busy.
    busy: Option<ServerFault>,
    /// Since the last loss all have been sent, and their answers have come or had their time.
    done: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct SafeValueState {
    /// Confirmations since the last loss.
    confirmed: u32,
    /// RequestLimits since the last loss.
    tries: u32,
    /// It was sent in this sweep.
    asked: bool,
    /// Not again before then: the server was busy.
    not_before: Option<Instant>,
    /// Its register as it was read last; for outputs that are bits.
    others: Option<u16>,
}

impl SafeValueSweep {
    pub(super) fn new(outputs: usize, now: Instant) -> Self {
        Self {
            rows: vec![SafeValueState::default(); outputs],
            count: 0,
            overtaken: Vec::with_capacity(outputs),
            turn: now,
            all_sent: false,
            ignores_input: false,
            busy: None,
            done: false,
        }
    }

    /// A sweep begins.
    pub(super) fn begin(&mut self) {
        for row in &mut self.rows {
            (row.asked, row.not_before) = (false, None);
        }
        self.overtaken.clear();
        (self.all_sent, self.ignores_input, self.busy) = (false, false, None);
        self.count = self.count.wrapping_add(1);
    }

    /// All are as they are to be. Once the server is lost, nothing has been sent.
    pub(super) fn forget(&mut self) {
        for row in &mut self.rows {
            (row.confirmed, row.tries) = (0, 0);
        }
        self.done = false;
    }

    /// The server says that it has done these.
    pub(super) fn confirm(&mut self, places: std::ops::Range<usize>) {
        for row in self.rows.get_mut(places).unwrap_or_default() {
            row.confirmed = row.confirmed.saturating_add(1);
        }
    }

    pub(super) fn was_asked(&self, place: usize) -> bool {
        self.rows.get(place).is_some_and(|row| row.asked)
    }

    /// Keeps what a register is beside our bits.
    pub(super) fn keep(&mut self, place: usize, register: u16) {
        if let Some(row) = self.rows.get_mut(place) {
            row.others = Some(register);
        }
    }

    /// These are to be sent again in this sweep, after the others.
    fn repeat(&mut self, places: std::ops::Range<usize>, not_before: Option<Instant>) {
        for row in self.rows.get_mut(places).unwrap_or_default() {
            (row.asked, row.not_before) = (false, not_before);
        }
    }
}

impl Server {
    /// Every safe value has been sent since the last loss, and its answer has come or had its time.
    #[must_use]
    pub fn is_released(&self) -> bool {
        self.sweep.done
    }

    /// Some output has neither confirmed its safe value since the last loss, nor been sent it often enough: a request may
    /// be lost with its connection.
    #[must_use]
    pub fn has_unsent_safe_values(&self) -> bool {
        let rows = self.sweep.rows.iter().zip(&self.points.outputs);
        let mut open = rows.filter(|(row, _)| row.confirmed == 0 && row.tries < TRIES_MAX);
        open.any(|(_, output)| matches!(output.desired(&self.released), DesiredValue::Value(_)))
    }

    /// The next safe value is sent, or there is none left: then true when all answers have come.
    pub(super) fn continue_sweep(&mut self, now: Instant) -> bool {
        for place in 0..self.points.outputs.len() {
            if let Some(DesiredValue::Unfit(value)) = self.desired(place) {
                let fault = unfit(&self.points.outputs[place], value);
                self.refused.get_or_insert(fault);
            }
        }
        let Some(place) = self.next_safe() else {
            return self.pending.is_none() && self.sweep.overtaken.is_empty();
        };
        match self.points.outputs[place].source {
            OutputSource::Bits { .. } => {
                let Some(wanted) = self.changed(place) else {
                    return false;
                };
                self.write_bits(place, wanted, now);
            }
            OutputSource::Coil { .. } => self.write_coils(place, now),
            OutputSource::Number { .. } => self.write_numbers(place, now),
        }
        self.count_asked(now);
        false
    }

    /// The request that waits gives way to the next one, if its time is over.
    pub(super) fn overtake_pending(&mut self, now: Instant) {
        let Some(pending) = self.pending.filter(PendingRequest::has_gone) else {
            return;
        };
        let is_last = self.next_safe().is_none() && !self.can_write_blind(&pending);
        if now < self.sweep.turn || (is_last && !self.sweep.ignores_input) {
            return;
        }
        self.pending = None;
        match pending.purpose {
            _ if self.sweep.ignores_input => {}
            Purpose::Fetch { place } if self.can_write_blind(&pending) => {
                // Nobody else writes the register, so it is as it was.
                self.fetched = self.sweep.rows[place]
                    .others
                    .map(|register| (place, register));
                self.sweep.repeat(place..place + 1, None);
            }
            _ => self.sweep.overtaken.push(pending),
        }
    }

    /// When [`Server::overtake_pending`] has something to do.
    pub(super) fn turn(&self) -> Option<Instant> {
        let is_blind = self.pending.is_some_and(|one| self.can_write_blind(&one));
        let gives_way = self.sweep.ignores_input || is_blind || self.next_safe().is_some();
        gives_way.then_some(self.sweep.turn)
    }

    /// An answer that is awaited still, though its request was overtaken.
    pub(super) fn take_overtaken(&mut self, transaction: u16) -> Option<PendingRequest> {
        let mut overtaken = self.sweep.overtaken.iter();
        let place = overtaken.position(|one| one.message.transaction() == transaction)?;
        Some(self.sweep.overtaken.swap_remove(place))
    }

    /// The oldest request without an answer.
    pub(super) fn unanswered(&self) -> Option<PendingRequest> {
        let oldest = self.sweep.overtaken.iter().min_by_key(|one| one.from);
        oldest.copied().or(self.pending)
    }

    /// The time of this sweep is over: why.
    pub(super) fn end_sweep(&mut self) -> Option<ServerFault> {
        self.sweep.done |= self.sweep.all_sent;
        let busy = self.sweep.busy.take();
        self.refused
            .take()
            .filter(|_| self.sweep.ignores_input)
            .or(busy)
    }

    /// The answers of this sweep have come.
    pub(super) fn finish_sweep(&mut self, again: bool) -> Option<ServerFault> {
        self.sweep.done = true;
        self.refused
            .take()
            .filter(|_| again || self.sweep.ignores_input)
    }

    /// What came is no answer. The safe values are sent all the same; the fault is told after them.
    pub(super) fn ignore_input(&mut self, fault: ServerFault) {
        self.refused = Some(fault);
        self.sweep.ignores_input = true;
        self.sweep.overtaken.clear();
        self.inbox.clear();
        self.pending = self.pending.filter(|pending| !pending.has_gone());
    }

    /// What comes is dropped.
    pub(super) fn ignores_input(&self) -> bool {
        matches!(self.step, Step::Safe { .. }) && self.sweep.ignores_input
    }

    /// A safe value was refused: what is tried again, and what is not.
    pub(super) fn handle_refusal_in_sweep(
        &mut self,
        purpose: Purpose,
        passing: bool,
        fault: ServerFault,
        now: Instant,
    ) {
        let places = match purpose {
            Purpose::Write { from, end, .. } => from..end,
            Purpose::Fetch { place } => place..place + 1,
            _ => return,
        };
        if passing {
            self.sweep.repeat(places, Some(now + BUSY_PAUSE));
            self.sweep.busy = Some(fault);
        } else if places.len() > 1 {
            self.one_by_one = self.one_by_one.max(places.end);
            self.sweep.repeat(places, None);
        } else {
            self.refused.get_or_insert(fault);
        }
    }

    /// A register was read that is changed in part: it is written next.
    pub(super) fn write_fetched(&mut self, place: usize) {
        self.sweep.repeat(place..place + 1, None);
    }

    /// The output that is sent next: one whose register has just been read, or who was confirmed, then sent least often.
    fn next_safe(&self) -> Option<usize> {
        if let Some((place, _)) = self.fetched
            && self.changed(place).is_some()
        {
            return Some(place);
        }
        let length = self.sweep.rows.len();
        let rows = self.sweep.rows.iter().enumerate();
        let open = rows.filter(|(place, row)| !row.asked && self.changed(*place).is_some());
        let first = self.sweep.count.wrapping_sub(1) % length.max(1);
        let order = |(place, row): &(usize, &SafeValueState)| {
            let turn = (place + length - first) % length;
            (row.not_before, row.confirmed, row.tries, turn)
        };
        open.min_by_key(order).map(|(place, _)| place)
    }

    /// The request that has just been made counts.
    fn count_asked(&mut self, now: Instant) {
        let Some(pending) = &mut self.pending else {
            return;
        };
        let places = match pending.purpose {
            Purpose::Write { from, end, .. } => from..end,
            Purpose::Fetch { place } => place..place + 1,
            _ => return,
        };
        for row in self.sweep.rows.get_mut(places).unwrap_or_default() {
            row.tries = row.tries.saturating_add(1);
            row.asked = true;
            pending.from = pending.from.max(row.not_before.take().unwrap_or(now));
        }
        self.sweep.turn = pending.from + self.share();
        if !self.sweep.all_sent && self.next_safe().is_none() {
            self.sweep.all_sent = true;
            self.due = now + self.settings.timeout;
        }
    }

    /// How long an answer is waited for before the next request is sent.
    fn share(&self) -> Duration {
        // Bits take two requests if their register must be read before.
        let each = if self.settings.mask_write { 1 } else { 2 };
        let requests = u32::try_from(each * self.points.outputs.len()).unwrap_or(u32::MAX);
        self.settings.timeout / requests.max(1)
    }

    fn can_write_blind(&self, pending: &PendingRequest) -> bool {
        match pending.purpose {
            Purpose::Fetch { place } => self
                .sweep
                .rows
                .get(place)
                .is_some_and(|row| row.others.is_some()),
            _ => false,
        }
    }

    /// The answer to a request that was overtaken.
    pub(super) fn handle_late_response(
        &mut self,
        late: &PendingRequest,
        answer: &Response<'_>,
        now: Instant,
    ) -> Result<(), ServerFault> {
        match answer {
            Response::Data(data) => {
                self.take(late.purpose, data, now);
                Ok(())
            }
            Response::Exception(code) => self.handle_exception(late, *code, now),
        }
    }
}
