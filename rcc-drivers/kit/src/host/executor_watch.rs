//! Watches the announcements for the executor, and opens and closes the command board of its device for the host's
//! thread.
//! Run by one helper thread; the host's thread only receives opened boards through a channel and sends old ones back.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use rcc_ipc::events::EventRecorder;
use rcc_ipc::{CommandReader, Session};
use rcc_os::process_instance::Liveness;
use rcc_process::log_throttle::LogThrottle;
use rcc_process::{Helper, Helpers};
use rcc_protocol::control::command_board;
use rcc_protocol::events::{EventKind, event_text};
use rcc_protocol::{Announcement, ProcessMismatch, Role};

/// Watchdog limit of one turn, which reads announcements and opens boards.
const TURN_MAX: Duration = Duration::from_secs(5);
/// Interval at which the announcements are read.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// A change in the state of the executor.
#[derive(Debug)]
pub enum ExecutorEvent {
    /// The executor's command board has been opened.
    Commands(CommandReader),
    /// The executor is gone.
    Gone,
    /// The executor belongs to another build, or was started with another configuration of this device: its commands
    /// are ignored.
    Incompatible,
}

/// The host's ends of the channels to the helper thread.
#[derive(Debug)]
pub struct ExecutorWatch {
    events_in: Receiver<ExecutorEvent>,
    /// Sends boards back to be closed by the helper thread.
    old: Sender<CommandReader>,
}

impl ExecutorWatch {
    /// Starts watching the cell of `session` for the commands of the device whose driver is announced as `own`.
    ///
    /// # Errors
    /// Returns an error if the operating system refuses to create a thread.
    pub fn start(
        session: Session,
        own: Announcement,
        recorder: EventRecorder,
        helpers: &Helpers,
    ) -> std::io::Result<Self> {
        let (event_sender, events_in) = channel();
        let (give_back, old) = channel();
        let mut state = WatchState {
            session,
            board: command_board(&own.label),
            own,
            event_sender,
            recorder,
            followed: None,
            incompatible: None,
            last_error: String::new(),
            unknown_throttle: LogThrottle::default(),
        };
        helpers.spawn("watch", TURN_MAX, move |helper| {
            watch(&mut state, &old, helper)
        })?;
        Ok(Self {
            events_in,
            old: give_back,
        })
    }

    /// Returns the next change, if any; does not block.
    #[must_use]
    pub fn next_event(&self) -> Option<ExecutorEvent> {
        self.events_in.try_recv().ok()
    }

    /// Hands back a board that is no longer read.
    pub fn give_back(&self, board: CommandReader) {
        // If the thread has ended, the board is closed here.
        drop(self.old.send(board));
    }
}

fn watch(state: &mut WatchState, old: &Receiver<CommandReader>, helper: &Helper) {
    while !helper.rest(LOOK_EVERY) {
        if state.look().is_err() {
            return;
        }
        old.try_iter().for_each(drop);
    }
}

/// The host's thread no longer receives events.
struct HostGone;

/// State of the helper thread.
struct WatchState {
    session: Session,
    /// Name of the device's command board.
    board: String,
    own: Announcement,
    event_sender: Sender<ExecutorEvent>,
    recorder: EventRecorder,
    followed: Option<Announcement>,
    /// The executor that is ignored because of its build or configuration.
    incompatible: Option<Announcement>,
    /// The last error that was logged, so that each is logged once.
    last_error: String,
    unknown_throttle: LogThrottle,
}

impl WatchState {
    /// Drops an executor that is known to be dead; follows one that is known to be alive and agrees on the
    /// configuration of our device.
    fn look(&mut self) -> Result<(), HostGone> {
        let known = [&self.followed, &self.incompatible];
        let known = known.map(|one| one.as_ref().map(|one| (one.incarnation, one.liveness())));
        for liveness in known.iter().flatten().map(|(_, liveness)| liveness) {
            match liveness {
                Liveness::Alive => {}
                Liveness::Dead => {
                    tracing::info!("the executor is gone");
                    (self.followed, self.incompatible) = (None, None);
                    self.event_sender
                        .send(ExecutorEvent::Gone)
                        .map_err(|_| HostGone)?;
                }
                // The executor is still followed: without fresh commands the device is brought to rest anyway.
                Liveness::Unknown(error) => self.report_unknown(error),
            }
        }
        let Some(executor) = self.executor() else {
            return Ok(());
        };
        let is_known = |one: &(u64, Liveness)| one.0 == executor.incarnation;
        if known.iter().flatten().any(is_known) {
            return Ok(());
        }
        // One check per executor process is enough: neither process reads its configuration again or changes its build.
        if let Some(why) = ProcessMismatch::about_device(&self.own, &executor, &self.own.label) {
            let (pid, remedy) = (executor.pid, why.remedy());
            tracing::warn!("ignores the set-points of the executor (pid {pid}): {why}; {remedy}");
            self.recorder.tell(why.event(&executor));
            (self.followed, self.incompatible) = (None, Some(executor));
            return self
                .event_sender
                .send(ExecutorEvent::Incompatible)
                .map_err(|_| HostGone);
        }
        let Some(service) = executor.services.get(&self.board) else {
            return Ok(());
        };
        match self.session.open_commands(service) {
            Ok(reader) => {
                tracing::info!(service, "follows the executor's board");
                self.last_error.clear();
                (self.followed, self.incompatible) = (Some(executor), None);
                self.event_sender
                    .send(ExecutorEvent::Commands(reader))
                    .map_err(|_| HostGone)?;
            }
            Err(error) => {
                let words = error.to_string();
                if words != self.last_error {
                    tracing::warn!("{words}");
                    self.last_error = words;
                }
            }
        }
        Ok(())
    }

    /// Returns the announcement of an executor that is known to be alive.
    fn executor(&mut self) -> Option<Announcement> {
        let announced = match self.session.cell().announced_all() {
            Ok(announced) => announced,
            Err(error) => {
                self.report_unknown(&error);
                return None;
            }
        };
        let executors = announced
            .into_iter()
            .filter(|one| one.role == Role::Executor);
        for executor in executors {
            match executor.liveness() {
                Liveness::Alive => return Some(executor),
                Liveness::Dead => {}
                Liveness::Unknown(error) => self.report_unknown(&error),
            }
        }
        None
    }

    /// Logs that the state of the executor is unknown, and does nothing else.
    fn report_unknown(&mut self, why: &dyn std::fmt::Display) {
        let Some(others) = self.unknown_throttle.admit(Instant::now()) else {
            return;
        };
        tracing::warn!(
            "cannot determine whether the executor is alive ({why}); checking again; {others} similar messages suppressed"
        );
        self.recorder.tell(EventKind::LifeUnknown {
            process: "executor".to_owned(),
            why: event_text(&why.to_string()),
        });
    }
}
