//! Writes to one server besides its outputs: `on_connect` and the watchdog.
//! Pure; run by the host's thread.

use std::time::Instant;

use super::super::address::{Form, Table};
use super::super::frame::ModbusRequest;
use super::{Purpose, Server};

impl Server {
    /// Writes the next value of `on_connect`; returns false after the last one.
    pub(super) fn assign(&mut self, place: usize, now: Instant) -> bool {
        let Some(assignment) = self.settings.on_connect.get(place) else {
            return false;
        };
        let (first, words) = (assignment.address.number, assignment.words);
        let width = usize::from(assignment.address.width());
        match assignment.address.form {
            Form::Bit => {
                let values = &[words[0] != 0];
                self.ask(
                    &ModbusRequest::WriteCoils { first, values },
                    Purpose::OnConnect,
                    now,
                );
            }
            _ => {
                let values = &words[..width];
                self.ask(
                    &ModbusRequest::WriteRegisters { first, values },
                    Purpose::OnConnect,
                    now,
                );
            }
        }
        true
    }

    /// Writes the watchdog if it is due.
    pub(super) fn write_watchdog(&mut self, now: Instant) -> bool {
        let Some(watchdog) = self
            .settings
            .watchdog
            .as_ref()
            .filter(|_| now >= self.watchdog_due)
        else {
            return false;
        };
        let first = watchdog.address.number;
        // No burst after a pause.
        self.watchdog_due = (self.watchdog_due + watchdog.every).max(now);
        self.watchdog_count = self.watchdog_count.wrapping_add(1);
        let (on, count) = (self.watchdog_count & 1 == 1, self.watchdog_count);
        match watchdog.address.table {
            Table::Coil => self.ask(
                &ModbusRequest::WriteCoils {
                    first,
                    values: &[on],
                },
                Purpose::Watchdog,
                now,
            ),
            _ => self.ask(
                &ModbusRequest::WriteRegisters {
                    first,
                    values: &[count],
                },
                Purpose::Watchdog,
                now,
            ),
        }
        true
    }
}
