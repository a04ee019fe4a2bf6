//! The messages between the programs of one cell: requests and answers, announcements, events, and the names and layouts
//! of their services. Plain data, independent of the transport; used by threads that are not real-time.

pub mod announcement;
pub mod build;
pub mod configuration;
pub mod control;
pub mod element_kind;
pub mod ending;
pub mod events;
pub mod pattern;
pub mod rehearsal;
pub mod rules;
pub mod version;
pub mod wire;

pub use announcement::{Announcement, Role};
pub use build::{Build, BuildMismatch};
pub use configuration::{Configuration, ProcessMismatch};
