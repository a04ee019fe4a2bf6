//! Client of a cell for Rust programs: what `rcc-net` builds is loaded, started, awaited, canceled, handed over, set and
//! watched. Each call blocks the calling thread until the loader has answered; nothing here is real-time.
//!
//! ```no_run
//! use rcc_client::Cell;
//!
//! let cell = Cell::connect()?;
//! let outcome = cell.run("net: short\nprimitives:\n  time: {type: Time}\n  late: {type: Greater, inputs: {a: time.out, b: 1 s}}\n  end: {type: Termination, inputs: {done: late.out}}\n")?;
//! println!("{outcome}");
//! # Ok::<(), rcc_client::ClientError>(())
//! ```

mod cell;
mod command;
mod connection;
mod error;
mod lease;
mod outcome;
pub mod published;
mod transport;
mod watch;

pub use cell::Cell;
pub use command::Command;
pub use error::{ClientError, RequestError};
pub use lease::LeaseHolder;
pub use outcome::Outcome;
pub use rcc_api::bodies::{CommandView, DeviceView, OnClientLoss, StatusView, ValuesView};
pub use rcc_api::streams::StreamValues;
pub use transport::{Lines, LoaderClient, RemoteLoader, no_loader, runtime_folder, segment};
pub use watch::Watch;

/// Returns the text of a body.
fn json_text(body: &impl serde::Serialize) -> Result<String, ClientError> {
    serde_json::to_string(body).map_err(|error| ClientError::NotUnderstood(error.to_string()))
}
