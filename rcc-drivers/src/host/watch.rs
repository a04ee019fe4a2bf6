//! Watches the announcements for the executor, and opens and closes its device's commands for the host's thread.
//! One helper thread; the host's thread only takes finished boards from a channel and gives old ones back.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use rcc_ipc::control::command_board;
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::seldom::Seldom;
use rcc_ipc::{Announcement, CommandReader, Disagreement, Liveness, Role, Session};
use rcc_process::{Helper, Helpers};

/// How long a look may take: announcements are read and boards opened.
const TURN_MAX: Duration = Duration::from_secs(5);
/// How often the announcements are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// What has become of the executor.
#[derive(Debug)]
pub enum News {
    /// Where it writes the commands.
    Commands(CommandReader),
    /// It is gone.
    Gone,
    /// It is of another build, or was started with another configuration of this device: what it writes is not looked at.
    Stranger,
}

/// The ends of the helper thread.
#[derive(Debug)]
pub struct Watch {
    news: Receiver<News>,
    /// Where boards are given back to be closed.
    old: Sender<CommandReader>,
}

impl Watch {
    /// Begins to watch the cell of `session` for the commands of the device whose driver is announced as `own`.
    ///
    /// # Errors
    /// The system refuses a thread.
    pub fn start(
        session: Session,
        own: Announcement,
        recorder: Recorder,
        helpers: &Helpers,
    ) -> std::io::Result<Self> {
        let (tell, news) = channel();
        let (give_back, old) = channel();
        let watched = Watched {
            session,
            board: command_board(&own.label),
            own,
            tell,
            recorder,
            followed: None,
            stranger: None,
            complaint: String::new(),
            doubts: Seldom::default(),
        };
        helpers.spawn("watch", TURN_MAX, move |helper| {
            watch(watched, &old, helper)
        })?;
        Ok(Self {
            news,
            old: give_back,
        })
    }

    /// What has changed since the last time, if anything; does not wait.
    #[must_use]
    pub fn news(&self) -> Option<News> {
        self.news.try_recv().ok()
    }

    /// Gives a board back that is no longer read.
    pub fn give_back(&self, board: CommandReader) {
        // Without its thread the board is closed here.
        drop(self.old.send(board));
    }
}

fn watch(mut watched: Watched, old: &Receiver<CommandReader>, helper: &Helper) {
    while !helper.rest(LOOK_EVERY) {
        if watched.look().is_err() {
            return;
        }
        old.try_iter().for_each(drop);
    }
}

/// The host's thread takes no news any more.
struct Over;

/// What the thread knows and tells.
struct Watched {
    session: Session,
    /// Name of the device's commands.
    board: String,
    own: Announcement,
    tell: Sender<News>,
    recorder: Recorder,
    followed: Option<Announcement>,
    /// The executor that is not followed because of its build or configuration.
    stranger: Option<Announcement>,
    /// The last complaint, so that it is made once.
    complaint: String,
    doubts: Seldom,
}

impl Watched {
    /// Lets go of an executor that is known to be dead, and follows one that is known to live and means the same by our
    /// device's channels.
    fn look(&mut self) -> Result<(), Over> {
        let known = [&self.followed, &self.stranger];
        let known = known.map(|one| one.as_ref().map(|one| (one.incarnation, one.liveness())));
        for liveness in known.iter().flatten().map(|(_, liveness)| liveness) {
            match liveness {
                Liveness::Alive => {}
                Liveness::Dead => {
                    tracing::info!("the executor has gone");
                    (self.followed, self.stranger) = (None, None);
                    self.tell.send(News::Gone).map_err(|_| Over)?;
                }
                // It is followed on: without fresh commands the device is brought to rest anyway.
                Liveness::Unknown(error) => self.doubt(error),
            }
        }
        let Some(executor) = self.executor() else {
            return Ok(());
        };
        let is_known = |one: &(u64, Liveness)| one.0 == executor.incarnation;
        if known.iter().flatten().any(is_known) {
            return Ok(());
        }
        // Once in a life of the executor is enough: neither of us reads the configuration again or becomes another build.
        if let Some(why) = Disagreement::about_device(&self.own, &executor, &self.own.label) {
            let (pid, remedy) = (executor.pid, why.remedy());
            tracing::warn!("takes no set-point from the executor (pid {pid}): {why}; {remedy}");
            self.recorder.tell(why.event(&executor));
            (self.followed, self.stranger) = (None, Some(executor));
            return self.tell.send(News::Stranger).map_err(|_| Over);
        }
        let Some(service) = executor.services.get(&self.board) else {
            return Ok(());
        };
        match self.session.open_commands(service) {
            Ok(reader) => {
                tracing::info!(service, "follows the executor's board");
                self.complaint.clear();
                (self.followed, self.stranger) = (Some(executor), None);
                self.tell.send(News::Commands(reader)).map_err(|_| Over)?;
            }
            Err(error) => {
                let words = error.to_string();
                if words != self.complaint {
                    tracing::warn!("{words}");
                    self.complaint = words;
                }
            }
        }
        Ok(())
    }

    /// The executor that is known to live.
    fn executor(&mut self) -> Option<Announcement> {
        let announced = match self.session.cell().announced_all() {
            Ok(announced) => announced,
            Err(error) => {
                self.doubt(&error);
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
                Liveness::Unknown(error) => self.doubt(&error),
            }
        }
        None
    }

    /// Whether the executor lives is not known: that is told, and nothing else is done.
    fn doubt(&mut self, why: &dyn std::fmt::Display) {
        let Some(others) = self.doubts.say(Instant::now()) else {
            return;
        };
        tracing::warn!(
            "whether the executor lives is not known ({why}); looked at again; {others} more such looks"
        );
        self.recorder.tell(Kind::LifeUnknown {
            process: "executor".to_owned(),
            why: events::text(&why.to_string()),
        });
    }
}
