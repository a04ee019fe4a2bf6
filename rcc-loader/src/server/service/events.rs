//! The newest events of the cell's log, numbered, so that a client can ask for those that follow. Run by blocking threads
//! of the server; the log is read when a client asks.

use std::collections::VecDeque;
use std::io;
use std::sync::{Mutex, PoisonError};

use rcc_api::bodies::{EventPage, EventView};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::events::{EventNames, NAMES_MAX};
use rcc_ipc::Cell;
use rcc_ipc::events::EventReader;
use rcc_protocol::events::{Event, hex_digits};

use super::Service;

/// Number of events that are kept for clients, the newest of the log: at 4 KiB a line, 16 MiB at most.
pub const EVENTS_MAX: usize = 4096;

/// The events of the log; empty until a client asks.
#[derive(Debug, Default)]
pub struct SharedEventLog(Mutex<Option<NumberedEvents>>);

/// Events in the order of the log, numbered from 0 since this process first read it.
#[derive(Debug)]
struct NumberedEvents {
    reader: EventReader,
    names: EventNames,
    events: VecDeque<EventView>,
    /// Number of the next event.
    next: u64,
}

/// A position in the log: the incarnation of the loader that numbers the events, and the number of the next one.
#[derive(Clone, Debug, PartialEq, Eq)]
struct EventPosition {
    incarnation: String,
    number: u64,
}

impl EventPosition {
    fn parse(text: &str) -> Option<EventPosition> {
        let (incarnation, number) = text.split_once('-')?;
        Some(EventPosition {
            incarnation: incarnation.to_owned(),
            number: number.parse().ok()?,
        })
    }
}

impl NumberedEvents {
    fn open(cell: &Cell) -> NumberedEvents {
        NumberedEvents {
            reader: EventReader::open(&cell.state()),
            names: EventNames::keeping(NAMES_MAX),
            events: VecDeque::new(),
            next: 0,
        }
    }

    fn read_on(&mut self) -> io::Result<()> {
        loop {
            let batch = self.reader.poll()?;
            if batch.is_empty() {
                return Ok(());
            }
            self.add(batch);
        }
    }

    /// Adds events that were read at a time: sorted, because several processes write the log.
    fn add(&mut self, mut batch: Vec<Event>) {
        batch.sort_by(|a, b| a.time.cmp(&b.time));
        // A name may be reported after the first event of its command.
        batch.iter().for_each(|event| self.names.learn(event));
        for event in &batch {
            if self.events.len() == EVENTS_MAX {
                self.events.pop_front();
            }
            self.events.push_back(self.names.view(event));
            self.next += 1;
        }
    }

    /// Returns at most `limit` events: the first ones from `from` on, or without it the newest.
    fn page(&self, from: Option<u64>, limit: usize) -> (Vec<EventView>, u64, bool) {
        let oldest = self.next - self.events.len() as u64;
        let known = from.filter(|from| (oldest..=self.next).contains(from));
        let skipped = match (from, known) {
            (_, Some(from)) => (from - oldest) as usize,
            (Some(_), None) => 0,
            (None, None) => self.events.len().saturating_sub(limit),
        };
        let events: Vec<EventView> = self
            .events
            .iter()
            .skip(skipped)
            .take(limit)
            .cloned()
            .collect();
        let next = oldest + (skipped + events.len()) as u64;
        (events, next, known.is_some() || from.is_none())
    }
}

impl Service {
    /// Returns at most `limit` events: those after the position `after`, or without it the newest.
    ///
    /// # Errors
    /// Returns an error if `after` is not a position, or if the log cannot be read.
    pub fn events(&self, after: Option<&str>, limit: Option<usize>) -> Result<EventPage, ApiError> {
        let incarnation = hex_digits(self.own.incarnation);
        let after = after.map(|text| EventPosition::parse(text).ok_or_else(|| no_position(text)));
        let after = after.transpose()?;
        // A position of another incarnation cannot be found: the page begins with the oldest event.
        let from = after.map(|after| match after.incarnation == incarnation {
            true => after.number,
            false => u64::MAX,
        });
        // A panic leaves at worst a part of a batch.
        let mut log = self
            .event_log
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let log = log.get_or_insert_with(|| NumberedEvents::open(self.executor.cell()));
        log.read_on().map_err(|error| {
            let message = format!("cannot read the event log: {error}");
            ApiError::new(
                codes::PROCESS_FAILED,
                message,
                "see the loader's log; try again",
            )
        })?;
        let (events, next, continues) = log.page(from, limit.unwrap_or(EVENTS_MAX));
        Ok(EventPage {
            events,
            next: format!("{incarnation}-{next}"),
            continues,
        })
    }
}

fn no_position(text: &str) -> ApiError {
    let shown: String = text.chars().take(80).collect();
    ApiError::new(
        codes::BAD_REQUEST,
        format!("`{shown}` is not a position in the event log"),
        "give `after` the value of `next` of an earlier answer, or omit it",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_protocol::events::{EventKind, EventOrigin, EventSource};

    fn events(count: u64) -> Vec<Event> {
        let source = EventSource::this(EventOrigin::Loader, "loader");
        let what = |number: u64| EventKind::Stopping {
            why: number.to_string(),
        };
        (0..count)
            .map(|number| Event::now(source.clone(), Some(number), what(number)))
            .collect()
    }

    fn log() -> NumberedEvents {
        let folder = rcc_testing::folder();
        let cell = Cell::at("events", folder.path()).expect("a cell");
        NumberedEvents::open(&cell)
    }

    #[test]
    fn a_client_that_asks_for_what_follows_misses_nothing() {
        let mut log = log();
        log.add(events(10));
        let (newest, next, continues) = log.page(None, 4);
        assert_eq!((newest.len(), next, continues), (4, 10, true));
        assert_eq!(newest[0].cycle, Some(6));
        assert_eq!(log.page(Some(10), 4), (vec![], 10, true));
        log.add(events(3));
        let (first, next, continues) = log.page(Some(10), 2);
        assert_eq!((first.len(), next, continues), (2, 12, true));
        let (rest, next, _) = log.page(Some(12), 2);
        assert_eq!((rest.len(), next), (1, 13));
    }

    #[test]
    fn a_client_is_told_when_events_are_missing() {
        let mut log = log();
        log.add(events(EVENTS_MAX as u64 + 5));
        assert_eq!(log.events.len(), EVENTS_MAX);
        let (page, _, continues) = log.page(Some(4), 1);
        assert_eq!((page[0].cycle, continues), (Some(5), false));
        assert!(log.page(Some(5), 1).2);
        // A position of another loader.
        let (page, _, continues) = log.page(Some(u64::MAX), 1);
        assert_eq!((page[0].cycle, continues), (Some(5), false));
    }

    #[test]
    fn a_position_has_an_incarnation_and_a_number() {
        let wanted = EventPosition {
            incarnation: "0f".into(),
            number: 7,
        };
        assert_eq!(EventPosition::parse("0f-7"), Some(wanted));
        for text in ["", "7", "0f-", "0f--7", "0f-x"] {
            assert_eq!(EventPosition::parse(text), None, "{text}");
        }
    }
}
