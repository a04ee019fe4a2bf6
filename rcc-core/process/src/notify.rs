//! What a program tells its supervisor, systemd or `rcc-cli up`: that it is ready, how it does, that it makes progress,
//! that it stops. A thread of its own does it, because a supervisor that does not listen may make it wait.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};
use std::{io, thread};

use sd_notify::NotifyState;

/// How often it is looked, without a watchdog.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Within the time of the watchdog it is looked so often: two looks may be late, or may find nothing new.
const LOOKS: u32 = 4;
/// At most one change of status in this time.
const STATUS_EVERY: Duration = Duration::from_secs(1);
/// How long a supervisor may take to be told that we stop.
const FAREWELL: Duration = Duration::from_millis(100);

/// How a program does, in one look.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pulse {
    /// Changes while the program does its work: cycles, exchanges, turns of a loop. No change, no heartbeat.
    pub progress: u64,
    /// One line for people.
    pub status: String,
}

/// The connection to the supervisor; does nothing without one (no `NOTIFY_SOCKET`).
#[derive(Debug)]
pub struct Notifier {
    farewell: Option<SyncSender<SyncSender<()>>>,
}

impl Notifier {
    /// Tells that the program is ready, and from now on what `look` finds.
    ///
    /// # Errors
    /// The system refuses a thread.
    pub fn ready(look: impl FnMut() -> Pulse + Send + 'static) -> io::Result<Notifier> {
        if std::env::var_os("NOTIFY_SOCKET").is_none() {
            return Ok(Notifier { farewell: None });
        }
        let (farewell, farewells) = sync_channel(1);
        let voice = Voice {
            look: Box::new(look),
            heart: Heart::default(),
            said: String::new(),
            said_at: None,
        };
        thread::Builder::new()
            .name("notify".into())
            .spawn(move || voice.run(&farewells))?;
        Ok(Notifier {
            farewell: Some(farewell),
        })
    }

    /// Tells that the program stops: no more heartbeats are sent.
    pub fn stopping(&self) {
        let Some(farewell) = &self.farewell else {
            return;
        };
        let (done, told) = sync_channel(1);
        // A supervisor that does not listen will find out.
        if farewell.try_send(done).is_ok() {
            let _ = told.recv_timeout(FAREWELL);
        }
    }
}

/// A heartbeat is owed to whoever made progress since the last one.
#[derive(Debug, Default)]
pub struct Heart {
    last: Option<u64>,
}

impl Heart {
    /// True if there is progress, which is always true for the first time.
    pub fn beats(&mut self, progress: u64) -> bool {
        self.last.replace(progress) != Some(progress)
    }
}

struct Voice {
    look: Box<dyn FnMut() -> Pulse + Send>,
    heart: Heart,
    said: String,
    said_at: Option<Instant>,
}

impl Voice {
    fn run(mut self, farewells: &Receiver<SyncSender<()>>) {
        let watchdog = sd_notify::watchdog_enabled();
        let every = watchdog.map_or(LOOK_EVERY, |time| (time / LOOKS).min(LOOK_EVERY));
        self.tell(&[NotifyState::Ready]);
        loop {
            match farewells.recv_timeout(every) {
                Err(RecvTimeoutError::Timeout) => self.tell(&[]),
                Ok(done) => {
                    send(&[NotifyState::Stopping, NotifyState::Status("stopping")]);
                    // Whoever waited may have given up.
                    let _ = done.try_send(());
                    return;
                }
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    fn tell(&mut self, first: &[NotifyState<'_>]) {
        let Pulse { progress, status } = (self.look)();
        let mut words = first.to_vec();
        if self.heart.beats(progress) {
            words.push(NotifyState::Watchdog);
        }
        let due = self.said_at.is_none_or(|at| at.elapsed() >= STATUS_EVERY);
        let news = due && status != self.said;
        if news {
            words.push(NotifyState::Status(&status));
        }
        if !words.is_empty() {
            send(&words);
        }
        if news {
            self.said = status;
            self.said_at = Some(Instant::now());
        }
    }
}

fn send(words: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(words) {
        tracing::debug!(%error, "the supervisor cannot be told");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_progress_no_heartbeat() {
        let mut heart = Heart::default();
        let beats: Vec<bool> = [0, 1, 1, 1, 7, 7, 8].map(|now| heart.beats(now)).to_vec();
        assert_eq!(beats, [true, true, false, false, true, false, true]);
    }
}
