//! The messages between the programs of one cell: requests and answers, announcements, events, and the names and layouts
//! of their services. Plain data, independent of the transport; used by threads that are not real-time.

pub mod announcement;
pub mod build;
pub mod configuration;
pub mod control;
pub mod element_kind;
pub mod ending;
pub mod events;
pub(crate) mod hexadecimal;
pub mod limits;
pub mod mismatch;
pub mod pattern;
pub mod refusal;
pub mod rehearsal;
pub mod role;
pub mod rules;
pub mod version;
pub mod wire;

pub use announcement::Announcement;
pub use build::Build;
pub use configuration::Configuration;
pub use mismatch::{BuildMismatch, ProcessMismatch};
pub use role::Role;
