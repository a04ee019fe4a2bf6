//! The event log of the selected cell: its files on this machine, which need no process of the cell, or over HTTP from its
//! loader.

use std::path::PathBuf;
use std::time::Duration;

use rcc_api::bodies::EventPage;
use rcc_api::events::event;
use rcc_ipc::events::EventReader;
use rcc_protocol::events::Event;

use crate::client::LoaderClient;
use crate::context::Context;
use crate::failure::Failure;
use crate::kept_state::KeptState;
use crate::output::print_note;

/// Interval between two polls of a followed file.
const FILE_POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Interval between two requests to a loader.
const REQUEST_INTERVAL: Duration = Duration::from_millis(500);

/// The log of a cell, read from its oldest event on.
pub(super) enum EventLog {
    /// The files of a cell on this machine, and the path of the newest.
    File(PathBuf, EventReader),
    /// The loader at an address.
    Loader(LoaderLog),
}

/// The log as a loader shows it.
pub(super) struct LoaderLog {
    client: LoaderClient,
    /// Position of the next event.
    after: Option<String>,
    /// Number of events that this build does not know.
    unknown: u64,
}

impl EventLog {
    /// Opens the log: the one that is kept on this machine, or with `None` that of the loader at the address.
    ///
    /// # Errors
    /// Fails if the system provides no event queue.
    pub fn open(context: &Context, kept: Option<&KeptState>) -> Result<EventLog, Failure> {
        Ok(match kept {
            Some(KeptState { state, .. }) => {
                EventLog::File(state.events_file(), EventReader::open(state))
            }
            None => EventLog::Loader(LoaderLog {
                client: context.client()?,
                after: None,
                unknown: 0,
            }),
        })
    }

    /// Returns the events since the last call.
    ///
    /// # Errors
    /// Fails if the file cannot be read, or if the loader cannot be reached.
    pub fn poll(&mut self) -> Result<Vec<Event>, Failure> {
        match self {
            EventLog::File(path, reader) => reader
                .poll()
                .map_err(|error| Failure::unreadable(&path.display().to_string(), &error)),
            EventLog::Loader(log) => log.poll(),
        }
    }

    /// Returns the interval between two polls.
    pub fn interval(&self) -> Duration {
        match self {
            EventLog::File(..) => FILE_POLL_INTERVAL,
            EventLog::Loader(_) => REQUEST_INTERVAL,
        }
    }

    /// Returns the number of events that could not be read.
    pub fn unreadable(&self) -> u64 {
        match self {
            EventLog::File(_, reader) => reader.unreadable(),
            EventLog::Loader(log) => log.unknown,
        }
    }
}

impl LoaderLog {
    fn poll(&mut self) -> Result<Vec<Event>, Failure> {
        let path = match &self.after {
            Some(after) => format!("/events?after={after}"),
            None => "/events".to_owned(),
        };
        let page: EventPage = self.client.get(&path)?;
        if !page.continues {
            print_note(
                "events are missing or repeated here: the loader was restarted, or was slower than the log",
            );
        }
        self.after = Some(page.next);
        let events: Vec<Event> = page.events.iter().filter_map(event).collect();
        self.unknown += (page.events.len() - events.len()) as u64;
        Ok(events)
    }
}
