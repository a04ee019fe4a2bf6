//! Transport between the processes of one cell: boards (newest value), rings (last values), streams, requests,
//! announcements, the event log and cleaning; [`rcc_protocol`] says what they carry. This is the only package that
//! depends on iceoryx2. Runs on threads that are not real-time, except for reading and writing boards and rings, which
//! the real-time threads do.
//!
//! No service has a fixed name: a process creates its services under `<role>-<label>/<incarnation>.<n>/<name>` and
//! writes the full names into its [`Announcement`](rcc_protocol::Announcement); other processes open the names that they find there.
//!
//! ```no_run
//! use rcc_ipc::{Cell, Session};
//! use rcc_protocol::Role;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let cell = Cell::new("demo")?;
//! let session = Session::join(&cell, Role::Driver, "lwr")?;
//! let mut measured = session.create_board::<[f64; 7]>("meas")?;
//! let _announced = cell.announce(&session.announcement().service("meas", measured.service()))?;
//! measured.write(&[0.0; 7]);
//! # Ok(())
//! # }
//! ```

pub mod announce;
mod base_folder;
pub mod board;
pub mod cell;
mod cell_error;
pub mod clean;
pub mod commands;
pub mod events;
mod failed_connections;
mod leftovers;
pub mod lock;
pub mod ownership;
mod prefix;
mod reap;
pub mod request;
pub mod ring;
pub mod session;
mod shared;
pub mod shm_space;
pub mod spill_file;
pub mod state_folder;
pub mod stream;
mod wake;
mod wipe;

pub use announce::{AnnounceError, Announced};
pub use board::{BoardError, BoardReader, BoardWriter};
pub use cell::{Cell, CellError};
pub use commands::{CommandReader, CommandWriter};
pub use request::{AnswerError, CallError, Client, PollError, Request, RequestError, Server};
pub use session::{Session, SessionError};
pub use state_folder::StateFolder;
pub use stream::{Publisher, StreamError, Subscriber};
pub use wake::WakeSender;
