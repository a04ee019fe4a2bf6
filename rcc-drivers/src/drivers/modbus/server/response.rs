//! Processing of the responses of one server.
//! Pure; run by the host's thread.

use std::time::{Duration, Instant};

use super::super::fault::{PASSING, ServerFault};
use super::super::frame::{self, ReceiveBuffer, Response};
use super::super::points::{InputTarget, ReadBlock};
use super::super::value::WIDTH_MAX;
use super::{PendingRequest, Purpose, Server, Step};

/// Pause before a request that a busy server has refused is repeated.
pub(super) const BUSY_PAUSE: Duration = Duration::from_millis(5);

/// Function 22, and the exception that a server answers to a function that it does not know.
const MASK_WRITE: u8 = 22;
const ILLEGAL_FUNCTION: u8 = 1;

impl Server {
    /// Processes all complete messages in `inbox` and returns it.
    pub(super) fn process_received(
        &mut self,
        mut inbox: ReceiveBuffer,
        now: Instant,
    ) -> (ReceiveBuffer, Result<(), ServerFault>) {
        loop {
            let (incoming, length) = match inbox.first() {
                Ok(Some(first)) => first,
                Ok(None) => return (inbox, Ok(())),
                Err(broken) => return (inbox, Err(ServerFault::Broken(broken))),
            };
            let result = match self.pending {
                // A request that has not been sent completely has no response yet: this one is late.
                Some(pending)
                    if pending.message.transaction() == incoming.transaction
                        && pending.has_gone() =>
                {
                    if incoming.unit == self.settings.unit {
                        match incoming.answer(&pending.message) {
                            Ok(answer) => self.handle_response(&pending, answer, now),
                            Err(broken) => Err(ServerFault::Broken(broken)),
                        }
                    } else {
                        self.other_unit = Some(incoming.unit);
                        self.counts.discarded += 1;
                        Ok(())
                    }
                }
                _ if incoming.unit != self.settings.unit => {
                    self.counts.discarded += 1;
                    Ok(())
                }
                _ => match self.take_overtaken(incoming.transaction) {
                    Some(late) => match incoming.answer(&late.message) {
                        Ok(answer) => self.handle_late_response(&late, &answer, now),
                        Err(broken) => Err(ServerFault::Broken(broken)),
                    },
                    None => {
                        self.counts.discarded += 1;
                        Ok(())
                    }
                },
            };
            inbox.forget(length);
            if result.is_err() {
                return (inbox, result);
            }
        }
    }

    fn handle_response(
        &mut self,
        pending: &PendingRequest,
        answer: Response<'_>,
        now: Instant,
    ) -> Result<(), ServerFault> {
        self.pending = None;
        match answer {
            Response::Data(data) => {
                self.take(pending.purpose, data, now);
                Ok(())
            }
            Response::Exception(code) => self.handle_exception(pending, code, now),
        }
    }

    pub(super) fn take(&mut self, purpose: Purpose, data: &[u8], now: Instant) {
        match (purpose, self.step) {
            (Purpose::OnConnect, Step::OnConnect(place)) => self.step = Step::OnConnect(place + 1),
            (Purpose::Read, Step::Read(place)) => {
                self.decode(place, data, now);
                self.step = Step::Read(place + 1);
            }
            (Purpose::Fetch { place }, step) => {
                let register = frame::register(data, 0);
                self.fetched = Some((place, register));
                self.sweep.keep(place, register);
                if let Step::Safe { .. } = step {
                    self.write_fetched(place);
                }
            }
            (Purpose::Write { from, end, mask }, Step::Write(_) | Step::Safe { .. }) => {
                self.confirm(from, end, mask);
                if let Step::Safe { .. } = self.step {
                    self.sweep.confirm(from..end);
                }
                self.continue_at(end);
            }
            (Purpose::Watchdog, _) => self.step = Step::Idle,
            // Each purpose occurs only in its own step.
            _ => {}
        }
    }

    pub(super) fn continue_at(&mut self, place: usize) {
        if let Step::Write(cursor) = &mut self.step {
            *cursor = place;
        }
    }

    /// Handles an exception. A refused output is skipped, so that it does not block the others; the fault is returned
    /// after them.
    pub(super) fn handle_exception(
        &mut self,
        pending: &PendingRequest,
        code: u8,
        now: Instant,
    ) -> Result<(), ServerFault> {
        if let Step::Safe { .. } = self.step {
            let fault = self.exception(pending, code);
            self.handle_refusal_in_sweep(pending.purpose, PASSING.contains(&code), fault, now);
            return Ok(());
        }
        let from = now + BUSY_PAUSE;
        if let (true, Step::Write(cursor)) = (PASSING.contains(&code), self.step) {
            let end = match pending.purpose {
                Purpose::Write { end, .. } => end,
                _ => cursor + 1,
            };
            self.busy = Some(self.exception(pending, code));
            self.continue_at(end);
            return Ok(());
        }
        if PASSING.contains(&code) && from < self.due {
            self.transaction = self.transaction.wrapping_add(1);
            let mut again = *pending;
            again.message.renumber(self.transaction);
            (again.sent, again.from) = (0, from);
            self.pending = Some(again);
            return Ok(());
        }
        let cursor = match self.step {
            Step::Write(cursor) => cursor,
            _ => 0,
        };
        let fault = self.exception(pending, code);
        match pending.purpose {
            Purpose::Write { end, .. } if end > cursor + 1 => self.one_by_one = end,
            Purpose::Write { .. } | Purpose::Fetch { .. } => {
                self.refused.get_or_insert(fault);
                self.continue_at(cursor + 1);
            }
            Purpose::OnConnect | Purpose::Read | Purpose::Watchdog => return Err(fault),
        }
        Ok(())
    }

    /// Returns the fault of an exception; a refusal of function 22 has a remedy of its own.
    fn exception(&self, pending: &PendingRequest, code: u8) -> ServerFault {
        let doing = self.doing(pending);
        // The function follows the seven bytes of the header (MODBUS Messaging on TCP/IP, 3.1.3).
        let function = pending.message.bytes().get(7);
        match (function, code) {
            (Some(&MASK_WRITE), ILLEGAL_FUNCTION) => ServerFault::NoMaskWrite { doing },
            _ => ServerFault::Exception { doing, code },
        }
    }

    fn decode(&mut self, place: usize, data: &[u8], now: Instant) {
        let Some(ReadBlock { table, items, .. }) = self.points.reads.get(place) else {
            return;
        };
        for item in items {
            let word = if table.is_bits() {
                u16::from(frame::bit(data, item.at))
            } else {
                frame::register(data, item.at)
            };
            match &item.target {
                InputTarget::Bit { index } => set(&mut self.building.digital, *index, word != 0),
                InputTarget::RegisterBit { index, bit } => {
                    set(&mut self.building.digital, *index, word >> bit & 1 == 1);
                }
                InputTarget::Number {
                    index,
                    format,
                    config,
                } => {
                    let mut words = [0; WIDTH_MAX];
                    for (offset, word) in words.iter_mut().enumerate() {
                        *word = frame::register(data, item.at + offset);
                    }
                    if let Some(input) = self.building.analog.get_mut(*index) {
                        *input = InputTarget::number(*format, config, &words);
                    }
                }
                InputTarget::Heartbeat => {
                    if self.heartbeat_value.is_some_and(|beat| beat != word) {
                        self.heartbeat_changed = Some(now);
                    }
                    self.heartbeat_value = Some(word);
                }
            }
        }
    }

    /// Returns why there is no response.
    pub(super) fn overdue(&mut self, pending: &PendingRequest) -> ServerFault {
        let why = match self.step {
            Step::Safe { .. } => self.end_sweep(),
            _ => None,
        };
        match (why, self.other_unit.take()) {
            (Some(fault), _) => fault,
            (None, Some(have)) => ServerFault::OtherUnit {
                want: self.settings.unit,
                have,
            },
            (None, None) => ServerFault::Timeout {
                doing: self.doing(pending),
                timeout: self.settings.timeout,
            },
        }
    }

    /// Returns a description of a request for messages.
    pub(super) fn doing(&self, pending: &PendingRequest) -> String {
        let points = |table: &str, first: u16, count: usize| match count {
            0 | 1 => format!("{table} {first}"),
            _ => format!("{table} {first} to {}", usize::from(first) + count - 1),
        };
        match (pending.purpose, self.step) {
            (Purpose::Read, Step::Read(place)) => match self.points.reads.get(place) {
                Some(read) => {
                    let names: Vec<&str> =
                        read.items.iter().map(|item| item.name.as_str()).collect();
                    let at = points(read.table.name(), read.first, usize::from(read.count));
                    format!("reading {at} ({})", names.join(", "))
                }
                None => "reading".to_owned(),
            },
            (Purpose::OnConnect, Step::OnConnect(place)) => {
                let assignment = self.settings.on_connect.get(place);
                let at = assignment.map_or(String::new(), |one| one.address.to_string());
                format!("writing on_connect.{place} ({at})")
            }
            (Purpose::Watchdog, _) => {
                let watchdog = self.settings.watchdog.as_ref();
                let at = watchdog.map_or(String::new(), |one| one.address.to_string());
                format!("writing the watchdog ({at})")
            }
            (Purpose::Write { .. } | Purpose::Fetch { .. }, _) => {
                let (from, end, verb) = match pending.purpose {
                    Purpose::Write { from, end, .. } => (from, end, "writing"),
                    Purpose::Fetch { place } => (place, place + 1, "reading"),
                    _ => (0, 0, "asking for"),
                };
                let outputs = self.points.outputs.get(from..end).unwrap_or(&[]);
                let names: Vec<&str> = outputs.iter().map(|output| output.name.as_str()).collect();
                let count = outputs
                    .iter()
                    .map(|output| usize::from(output.width()))
                    .sum();
                let at = outputs.first().map_or(String::new(), |output| {
                    points(output.table.name(), output.address, count)
                });
                format!("{verb} {at} ({})", names.join(", "))
            }
            _ => "a request".to_owned(),
        }
    }
}

fn set(bits: &mut u64, index: usize, on: bool) {
    let bit = 1_u64 << index;
    *bits = (*bits & !bit) | if on { bit } else { 0 };
}
