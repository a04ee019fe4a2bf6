//! Communication between the processes of one cell: names, boards (newest value), rings (last values), streams,
//! requests, announcements and cleaning. This is the only package that depends on iceoryx2. Runs on threads that are
//! not real-time, except for reading and writing boards and rings, which the real-time threads do.
//!
//! No service has a fixed name: a process creates its services under `<role>-<label>/<incarnation>.<n>/<name>` and
//! writes the full names into its [`Announcement`]; other processes open the names that they find there.
//!
//! ```no_run
//! use rcc_ipc::{Announcement, Cell, Role, Session};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let cell = Cell::new("demo")?;
//! let session = Session::join(&cell, Role::Driver, "lwr")?;
//! let mut measured = session.create_board::<[f64; 7]>("meas")?;
//! let _announced = cell.announce(&Announcement::of(&session).service("meas", measured.service()))?;
//! measured.write(&[0.0; 7]);
//! # Ok(())
//! # }
//! ```

pub mod announce;
pub mod board;
pub mod build;
pub mod cell;
pub mod clean;
pub mod clock;
pub mod commands;
pub mod configuration;
pub mod control;
pub mod events;
pub mod lock;
pub mod log_throttle;
pub mod ownership;
pub mod pattern;
mod prefix;
pub mod process_instance;
mod reap;
pub mod rehearsal;
pub mod request;
pub mod ring;
pub mod session;
mod shared;
pub mod shm_space;
pub mod spill_file;
pub mod stream;
pub mod version;
pub mod wire;

pub use announce::{AnnounceError, Announced, Announcement};
pub use board::{BoardError, BoardReader, BoardWriter};
pub use build::{Build, BuildMismatch};
pub use cell::{Cell, CellError};
pub use clock::{monotonic_ns, sleep_until};
pub use commands::{CommandReader, CommandWriter};
pub use configuration::{Configuration, ProcessMismatch};
pub use process_instance::{Liveness, ProcessInstance};
pub use request::{
    AnswerError, CallError, Client, PollError, REQUEST_MAX, RESPONSE_MAX, Request, RequestError,
    Server,
};
pub use session::{Role, Session, SessionError};
pub use stream::{Publisher, StreamError, Subscriber};
