//! Values of a net as its last evaluation left them: read by requests, copied to other nets, and monitored. Real-time
//! thread.

use rcc_core::message::{MONITOR_WIDTH_MAX, MonitorRecord};
use rcc_core::plan::{InputPoint, MonitorPoint, PublishPoint, ValuePoint};
use rcc_core::types::{NULL_BOOL, NULL_INT, Store};
use rcc_protocol::control::Refusal;
use rcc_protocol::rules::{Limit, Relation};

use super::Net;
use crate::input::{Publisher, null};
use crate::queue::ValueReading;

impl Net {
    /// Copies values as the last evaluation left them into `reading`.
    ///
    /// # Errors
    /// Returns [`Refusal::NoSuchValue`] if a value lies outside of the arenas.
    pub fn read(&self, reading: &mut ValueReading) -> Result<(), Refusal> {
        let mut room = reading.values.words.iter_mut();
        for (point, value) in reading.points.iter().zip(0u32..) {
            self.copy(*point, &mut room)
                .ok_or(Refusal::NoSuchValue { value })?;
        }
        let values = &mut reading.values;
        values.cycle = if self.cycles > 0 {
            self.evaluated_cycle
        } else {
            0
        };
        values.evaluations = self.cycles;
        values.every = self.data.rate.every;
        Ok(())
    }

    /// A published value of type `Bool` as the last evaluation left it.
    pub fn published_bool(&self, publish: usize) -> Option<u8> {
        let point = self.data.publishes.get(publish)?;
        let is = point.store == Store::Bool && point.width == 1;
        is.then(|| self.bool_at(point.slot)).flatten()
    }

    /// A `Bool` slot as the last evaluation left it; `None` before the first one.
    pub fn bool_at(&self, slot: u32) -> Option<u8> {
        let value = self.arenas().1.get(slot as usize).copied();
        value.filter(|_| self.cycles > 0)
    }

    /// A `Real` or `Int` slot as the last evaluation left it, compared as a slot of type `Bool`; null before the first
    /// evaluation, for a value or limit that is null, and for a slot outside of the arena.
    pub fn compared(&self, slot: u32, relation: Relation, limit: Limit) -> u8 {
        let slot = slot as usize;
        let held = match limit {
            Limit::Real(limit) => {
                let value = self.arenas().0.get(slot).filter(|value| !value.is_nan());
                let value = value.filter(|_| !limit.is_nan());
                value.map(|value| relation.holds(*value, limit))
            }
            Limit::Int(limit) => {
                let value = self
                    .arenas()
                    .2
                    .get(slot)
                    .filter(|value| **value != NULL_INT);
                let value = value.filter(|_| limit != NULL_INT);
                value.map(|value| relation.holds(*value, limit))
            }
        };
        held.filter(|_| self.cycles > 0).map_or(NULL_BOOL, u8::from)
    }

    /// Copies a value, one word per element.
    fn copy<'w>(
        &self,
        point: ValuePoint,
        room: &mut impl Iterator<Item = &'w mut u64>,
    ) -> Option<()> {
        let first = point.slot as usize;
        let slots = first..first.checked_add(point.width as usize)?;
        match point.store {
            Store::Real => {
                let values = self.arenas().0.get(slots)?.iter();
                values
                    .zip(room)
                    .for_each(|(value, word)| *word = value.to_bits());
            }
            Store::Bool => {
                let values = self.arenas().1.get(slots)?.iter();
                values
                    .zip(room)
                    .for_each(|(value, word)| *word = u64::from(*value));
            }
            Store::Int => {
                let values = self.arenas().2.get(slots)?.iter();
                values
                    .zip(room)
                    .for_each(|(value, word)| *word = value.cast_unsigned());
            }
        }
        Some(())
    }

    /// Calls `push` with each monitor that is due in the last evaluated cycle.
    pub fn monitors(&self, mut push: impl FnMut(u32, &[f64])) {
        let evaluated = self.cycles.saturating_sub(1);
        for (monitor, index) in self.data.monitors.iter().zip(0..) {
            if evaluated.is_multiple_of(u64::from(monitor.every.max(1))) {
                let mut values = [0.0; MONITOR_WIDTH_MAX];
                let width = self.read_monitor(monitor, &mut values);
                push(index, &values[..width]);
            }
        }
    }

    fn read_monitor(&self, monitor: &MonitorPoint, values: &mut [f64; MONITOR_WIDTH_MAX]) -> usize {
        let (slot, width) = (
            monitor.slot as usize,
            (monitor.width as usize).min(MONITOR_WIDTH_MAX),
        );
        let places = values.iter_mut().take(width);
        match monitor.store {
            Store::Real => places
                .zip(self.arenas().0.iter().skip(slot))
                .for_each(|(place, value)| *place = *value),
            Store::Bool => {
                places
                    .zip(self.arenas().1.iter().skip(slot))
                    .for_each(|(place, value)| {
                        *place = if value & NULL_BOOL != 0 {
                            f64::NAN
                        } else {
                            f64::from(*value)
                        };
                    })
            }
            Store::Int => places
                .zip(self.arenas().2.iter().skip(slot))
                .for_each(|(place, value)| *place = f64::from_bits(value.cast_unsigned())),
        }
        width
    }
}

impl Publisher for Net {
    fn evaluated_cycle(&self) -> u64 {
        self.evaluated_cycle
    }

    fn copy_published(&self, publish: usize, to: &InputPoint, room: &mut [u64]) {
        room.fill(null(to.store));
        let point = self.data.publishes.get(publish);
        let fits = |point: &&PublishPoint| point.store == to.store && point.width == to.width;
        if let Some(point) = point.filter(fits) {
            let point = ValuePoint {
                store: point.store,
                slot: point.slot,
                width: point.width,
            };
            // `Plan::check` has proved that it lies within the arena.
            let _: Option<()> = self.copy(point, &mut room.iter_mut());
        }
    }
}

/// Makes a monitor record.
pub fn monitor_record(
    cycle: u64,
    stamp_ns: u64,
    command: u64,
    monitor: u32,
    values: &[f64],
) -> MonitorRecord {
    let mut all = [0.0; MONITOR_WIDTH_MAX];
    for (place, value) in all.iter_mut().zip(values) {
        *place = *value;
    }
    let width = values.len() as u32;
    MonitorRecord {
        sequence: 0,
        cycle,
        stamp_ns,
        command,
        monitor,
        width,
        values: all,
    }
}
