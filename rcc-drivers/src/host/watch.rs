//! Watches the announcements for the executor, and opens and closes its device's commands for the host's thread.
//! One helper thread; the host's thread only takes finished boards from a channel and gives old ones back.

use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rcc_ipc::control::command_board;
use rcc_ipc::{Announcement, CommandReader, Role, Session};

/// How often the announcements are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Where the executor writes the commands, or that it does no more.
pub type News = Option<CommandReader>;

/// The helper thread; dropping it ends the thread.
#[derive(Debug)]
pub struct Watch {
    news: Receiver<News>,
    /// Where boards are given back to be closed; `None` once the thread is to end.
    old: Option<Sender<CommandReader>>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Begins to watch the cell of `session` for `device`'s commands.
    ///
    /// # Errors
    /// The system refuses a thread.
    pub fn start(session: Session, device: &str) -> std::io::Result<Self> {
        let (tell, news) = channel();
        let (give_back, old) = channel();
        let board = command_board(device);
        let thread = thread::Builder::new()
            .name("watch".into())
            .spawn(move || watch(&session, &board, &tell, &old))?;
        Ok(Self {
            news,
            old: Some(give_back),
            thread: Some(thread),
        })
    }

    /// What has changed since the last time, if anything; does not wait.
    #[must_use]
    pub fn news(&self) -> Option<News> {
        self.news.try_recv().ok()
    }

    /// Gives a board back that is no longer read.
    pub fn give_back(&self, board: CommandReader) {
        if let Some(old) = &self.old {
            // Without its thread the board is closed here.
            drop(old.send(board));
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.old = None;
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the watch has panicked");
        }
    }
}

fn watch(session: &Session, board: &str, tell: &Sender<News>, old: &Receiver<CommandReader>) {
    let mut followed: Option<Announcement> = None;
    // The last complaint, so that it is made once.
    let mut complaint = String::new();
    loop {
        if followed.as_ref().is_some_and(|one| !one.is_alive()) {
            tracing::info!("the executor has gone");
            followed = None;
            if tell.send(None).is_err() {
                return;
            }
        }
        let followed_now = followed.as_ref().map(|one| one.incarnation);
        if let Some(executor) =
            executor(session).filter(|one| Some(one.incarnation) != followed_now)
            && let Some(service) = executor.services.get(board)
        {
            match session.open_commands(service) {
                Ok(reader) => {
                    tracing::info!(service, "follows the executor's board");
                    complaint.clear();
                    followed = Some(executor);
                    if tell.send(Some(reader)).is_err() {
                        return;
                    }
                }
                Err(error) => {
                    let words = error.to_string();
                    if words != complaint {
                        tracing::warn!("{words}");
                        complaint = words;
                    }
                }
            }
        }
        thread::sleep(LOOK_EVERY);
        loop {
            match old.try_recv() {
                Ok(board) => drop(board),
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => return,
            }
        }
    }
}

fn executor(session: &Session) -> Option<Announcement> {
    session
        .cell()
        .announced_all()
        .ok()?
        .into_iter()
        .find(|one| one.role == Role::Executor && one.is_alive())
}
