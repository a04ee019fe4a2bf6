//! The safe values of one server: each is sent, whatever the server answers, and once before any is sent again.
//! Pure; run by the host's thread.
//!
//! If the response to a request does not arrive within its share of the time-out, the next request overtakes it: both
//! are then pending, told apart by their transaction numbers (MODBUS Messaging on TCP/IP V1.0b, 4.2). All of them are
//! therefore sent within one time-out. Unconfirmed values come first, among them those sent least often, also across
//! connections: a server that closes the connection after each request, or drops requests while it is busy, gets all
//! values within a few rounds.

use std::time::{Duration, Instant};

use super::super::fault::ServerFault;
use super::super::frame::Response;
use super::super::points::{DesiredValue, OutputSource};
use super::response::BUSY_PAUSE;
use super::write::unfit;
use super::{PendingRequest, Purpose, Server, Step};

/// Attempts per output: a connection that ends after one request also takes the next one with it, and this number
/// suffices to reach the last of 64 outputs.
const TRIES_MAX: u32 = 8;

/// State of the safe values, one row per output.
#[derive(Debug)]
pub(super) struct SafeValueSweep {
    rows: Vec<SafeValueState>,
    /// Number of sweeps so far: each starts at another output.
    count: usize,
    /// Requests that were overtaken; at most one per output.
    overtaken: Vec<PendingRequest>,
    /// Time at which the pending request may be overtaken.
    turn: Instant,
    /// All values have been sent; only responses are awaited.
    all_sent: bool,
    /// Received bytes are invalid and are dropped.
    ignores_input: bool,
    /// The server was busy.
    busy: Option<ServerFault>,
    /// All values have been sent since the last loss, and their responses have arrived or timed out.
    done: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct SafeValueState {
    /// Number of confirmations since the last loss.
    confirmed: u32,
    /// Number of requests since the last loss.
    tries: u32,
    /// The value has been sent in this sweep.
    asked: bool,
    /// Not to be sent before this time: the server was busy.
    not_before: Option<Instant>,
    /// Last value read from its register; for outputs that are bits.
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

    /// Starts a sweep.
    pub(super) fn begin(&mut self) {
        for row in &mut self.rows {
            (row.asked, row.not_before) = (false, None);
        }
        self.overtaken.clear();
        (self.all_sent, self.ignores_input, self.busy) = (false, false, None);
        self.count = self.count.wrapping_add(1);
    }

    /// Resets the counts once all values are confirmed, so that after the next loss each counts as not sent.
    pub(super) fn forget(&mut self) {
        for row in &mut self.rows {
            (row.confirmed, row.tries) = (0, 0);
        }
        self.done = false;
    }

    /// Counts the confirmation of these outputs.
    pub(super) fn confirm(&mut self, places: std::ops::Range<usize>) {
        for row in self.rows.get_mut(places).unwrap_or_default() {
            row.confirmed = row.confirmed.saturating_add(1);
        }
    }

    pub(super) fn was_asked(&self, place: usize) -> bool {
        self.rows.get(place).is_some_and(|row| row.asked)
    }

    /// Stores the value of a register that contains our bits and others.
    pub(super) fn keep(&mut self, place: usize, register: u16) {
        if let Some(row) = self.rows.get_mut(place) {
            row.others = Some(register);
        }
    }

    /// Marks these outputs to be sent again in this sweep, after the others.
    fn repeat(&mut self, places: std::ops::Range<usize>, not_before: Option<Instant>) {
        for row in self.rows.get_mut(places).unwrap_or_default() {
            (row.asked, row.not_before) = (false, not_before);
        }
    }
}

impl Server {
    /// Returns true if every safe value has been sent since the last loss, and its response has arrived or timed out.
    #[must_use]
    pub fn is_released(&self) -> bool {
        self.sweep.done
    }

    /// Returns true if some output has neither confirmed its safe value since the last loss, nor been sent it often
    /// enough: a request may be lost with its connection.
    #[must_use]
    pub fn has_unsent_safe_values(&self) -> bool {
        let rows = self.sweep.rows.iter().zip(&self.points.outputs);
        let mut open = rows.filter(|(row, _)| row.confirmed == 0 && row.tries < TRIES_MAX);
        open.any(|(_, output)| matches!(output.desired(&self.released), DesiredValue::Value(_)))
    }

    /// Sends the next safe value; if none is left, returns true once all responses have arrived.
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

    /// Lets the next request overtake the pending one, if its share of the time-out is over.
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
                // Nobody else writes the register, so its last value is still valid.
                self.fetched = self.sweep.rows[place]
                    .others
                    .map(|register| (place, register));
                self.sweep.repeat(place..place + 1, None);
            }
            _ => self.sweep.overtaken.push(pending),
        }
    }

    /// Returns the time at which [`Server::overtake_pending`] has work to do.
    pub(super) fn turn(&self) -> Option<Instant> {
        let is_blind = self.pending.is_some_and(|one| self.can_write_blind(&one));
        let gives_way = self.sweep.ignores_input || is_blind || self.next_safe().is_some();
        gives_way.then_some(self.sweep.turn)
    }

    /// Returns the overtaken request with this transaction number, if its response is still awaited.
    pub(super) fn take_overtaken(&mut self, transaction: u16) -> Option<PendingRequest> {
        let mut overtaken = self.sweep.overtaken.iter();
        let place = overtaken.position(|one| one.message.transaction() == transaction)?;
        Some(self.sweep.overtaken.swap_remove(place))
    }

    /// Returns the oldest request without a response.
    pub(super) fn unanswered(&self) -> Option<PendingRequest> {
        let oldest = self.sweep.overtaken.iter().min_by_key(|one| one.from);
        oldest.copied().or(self.pending)
    }

    /// Ends a sweep at its deadline; returns the fault, if any.
    pub(super) fn end_sweep(&mut self) -> Option<ServerFault> {
        self.sweep.done |= self.sweep.all_sent;
        let busy = self.sweep.busy.take();
        self.refused
            .take()
            .filter(|_| self.sweep.ignores_input)
            .or(busy)
    }

    /// Ends a sweep after its last response; returns the fault, if any.
    pub(super) fn finish_sweep(&mut self, again: bool) -> Option<ServerFault> {
        self.sweep.done = true;
        self.refused
            .take()
            .filter(|_| again || self.sweep.ignores_input)
    }

    /// Drops all received bytes after an invalid response. The safe values are still sent; the fault is returned
    /// afterwards.
    pub(super) fn ignore_input(&mut self, fault: ServerFault) {
        self.refused = Some(fault);
        self.sweep.ignores_input = true;
        self.sweep.overtaken.clear();
        self.inbox.clear();
        self.pending = self.pending.filter(|pending| !pending.has_gone());
    }

    /// Returns true if received bytes are dropped.
    pub(super) fn ignores_input(&self) -> bool {
        matches!(self.step, Step::Safe { .. }) && self.sweep.ignores_input
    }

    /// Handles the refusal of a safe value: decides whether it is tried again.
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

    /// Marks an output whose register has been read: its bits are written next.
    pub(super) fn write_fetched(&mut self, place: usize) {
        self.sweep.repeat(place..place + 1, None);
    }

    /// Returns the output to send next: one whose register has just been read, otherwise the one with the fewest
    /// confirmations, then the fewest requests.
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

    /// Counts the request that has just been made.
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

    /// Returns how long a response is awaited before the next request is sent.
    fn share(&self) -> Duration {
        // Bits need two requests if their register must be read first.
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

    /// Processes the response to an overtaken request.
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
