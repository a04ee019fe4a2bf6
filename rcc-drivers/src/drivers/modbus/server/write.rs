//! Writing the outputs of one server: finds the changed ones and combines them into requests.
//! Pure; run by the host's thread.

use std::time::Instant;

use rcc_core::message::DIGITAL_MAX;

use super::super::address::Table;
use super::super::fault::ServerFault;
use super::super::frame::ModbusRequest;
use super::super::points::{DesiredValue, OutputPoint, OutputSource, RawOutput};
use super::{Purpose, Server, Step};

/// More registers than one write can contain.
const REGISTERS_MAX: usize = 128;

impl Server {
    /// Writes the next outputs from `cursor` on that have changed; returns false if there are none.
    pub(super) fn write_next(&mut self, cursor: usize, now: Instant) -> bool {
        for place in cursor..self.points.outputs.len() {
            if let Some(DesiredValue::Unfit(value)) = self.desired(place) {
                let fault = unfit(&self.points.outputs[place], value);
                self.refused.get_or_insert(fault);
            }
            if let Some(wanted) = self.changed(place) {
                // The outputs before need no request, and the response does not concern them.
                self.continue_at(place);
                match self.points.outputs[place].source {
                    OutputSource::Bits { .. } => self.write_bits(place, wanted, now),
                    OutputSource::Coil { .. } => self.write_coils(place, now),
                    OutputSource::Number { .. } => self.write_numbers(place, now),
                }
                return true;
            }
        }
        false
    }

    /// Marks the outputs up to `end` as written.
    pub(super) fn confirm(&mut self, from: usize, end: usize, mask: u16) {
        for place in from..end {
            let Some(DesiredValue::Value(wanted)) = self.desired(place) else {
                continue;
            };
            let Some(written) = self.written.get_mut(place) else {
                continue;
            };
            let mask = mask & wanted.mask;
            let first = (written.words[0] & !mask) | (wanted.words[0] & mask);
            written.words = wanted.words;
            written.words[0] = first;
            written.mask |= mask;
        }
    }

    pub(super) fn desired(&self, place: usize) -> Option<DesiredValue> {
        let output = self.points.outputs.get(place)?;
        Some(output.desired(&self.writing))
    }

    pub(super) fn changed(&self, place: usize) -> Option<RawOutput> {
        match self.desired(place)? {
            DesiredValue::Value(wanted) if self.written.get(place)?.changes(&wanted) != 0 => {
                Some(wanted)
            }
            _ => None,
        }
    }

    pub(super) fn write_coils(&mut self, place: usize, now: Instant) {
        let mut values = [false; DIGITAL_MAX];
        let most = usize::from(self.settings.requests.write_bits).min(values.len());
        let mut length = 0;
        let end = self.gather(place, most, |at, raw, _| {
            values[at] = raw.words[0] != 0;
            length = at + 1;
        });
        let (first, values) = (self.points.outputs[place].address, &values[..length]);
        let purpose = Purpose::Write {
            from: place,
            end,
            mask: u16::MAX,
        };
        self.ask(&ModbusRequest::WriteCoils { first, values }, purpose, now);
    }

    pub(super) fn write_numbers(&mut self, place: usize, now: Instant) {
        let mut values = [0; REGISTERS_MAX];
        let most = usize::from(self.settings.requests.write_registers).min(values.len());
        let mut length = 0;
        let end = self.gather(place, most, |at, raw, width| {
            length = at + width;
            values[at..length].copy_from_slice(&raw.words[..width]);
        });
        let (first, values) = (self.points.outputs[place].address, &values[..length]);
        let purpose = Purpose::Write {
            from: place,
            end,
            mask: u16::MAX,
        };
        self.ask(
            &ModbusRequest::WriteRegisters { first, values },
            purpose,
            now,
        );
    }

    /// Calls `put` with offset, value and width of the changed outputs from `from` on that are contiguous; returns the
    /// end.
    fn gather(
        &self,
        from: usize,
        most: usize,
        mut put: impl FnMut(usize, RawOutput, usize),
    ) -> usize {
        let outputs = &self.points.outputs;
        let Some(first) = outputs.get(from) else {
            return from;
        };
        let mut length = 0;
        let mut place = from;
        while let Some(output) = outputs.get(place) {
            let width = usize::from(output.width());
            let follows = output.table == first.table
                && !matches!(output.source, OutputSource::Bits { .. })
                && usize::from(output.address) == usize::from(first.address) + length;
            let alone = place > from && (place < self.one_by_one || self.is_asked(place));
            match self.changed(place) {
                Some(raw) if follows && !alone && length + width <= most => put(length, raw, width),
                _ => break,
            }
            length += width;
            place += 1;
        }
        place
    }

    /// Returns true if this safe value has already been sent in this sweep.
    fn is_asked(&self, place: usize) -> bool {
        matches!(self.step, Step::Safe { .. }) && self.sweep.was_asked(place)
    }

    /// Writes bits of a register: the whole register if all bits are ours, otherwise by function 22, or by reading it
    /// and writing it back.
    pub(super) fn write_bits(&mut self, place: usize, wanted: RawOutput, now: Instant) {
        let first = self.points.outputs[place].address;
        let changes = self.written[place].changes(&wanted);
        let whole = wanted.mask == u16::MAX;
        let mask = if whole { u16::MAX } else { changes };
        let purpose = Purpose::Write {
            from: place,
            end: place + 1,
            mask,
        };
        let fetched = self.fetched.take().filter(|(at, _)| *at == place);
        let request = match fetched {
            _ if whole => ModbusRequest::WriteRegisters {
                first,
                values: &[wanted.words[0]],
            },
            _ if self.settings.mask_write => ModbusRequest::Mask {
                address: first,
                mask,
                values: wanted.words[0],
            },
            Some((_, others)) => {
                let value = (others & !mask) | (wanted.words[0] & mask);
                self.ask(
                    &ModbusRequest::WriteRegisters {
                        first,
                        values: &[value],
                    },
                    purpose,
                    now,
                );
                return;
            }
            None => {
                let request = ModbusRequest::Read {
                    table: Table::Holding,
                    first,
                    count: 1,
                };
                self.ask(&request, Purpose::Fetch { place }, now);
                return;
            }
        };
        self.ask(&request, purpose, now);
    }
}

pub(super) fn unfit(output: &OutputPoint, value: f64) -> ServerFault {
    let limits = match &output.source {
        OutputSource::Number { format, .. } => format.number.limits(),
        _ => [0.0, 1.0],
    };
    ServerFault::Unfit {
        channel: output.name.clone(),
        value,
        lower: limits[0],
        upper: limits[1],
    }
}
