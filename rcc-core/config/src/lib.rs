//! The common YAML and JSON parser, diagnostics with positions, and the configuration of a cell. Used by every process
//! at start-up and by the loader; nothing here is real-time.

pub mod access;
pub mod article;
mod base;
pub mod cell;
pub mod change;
pub mod codes;
pub mod device;
pub mod diagnostic;
pub mod driver;
mod file;
pub mod file_kind;
pub mod fingerprint;
pub mod link;
pub mod ports;
pub mod quantity;
mod reader;
pub mod recorder;
pub mod robot;
pub mod schema;
mod workspace;
pub mod yaml;

pub use access::{AccessConfig, TcpAccess};
pub use cell::{CellConfig, ExecutorConfig, SimulatorConfig};
pub use change::{ConfigChange, FileWatch};
pub use device::{ChannelConfig, DeviceConfig, OnRelease};
pub use driver::{DriverConfig, DriverNeed, DriverProgram, OWN_PROGRAMS, OwnProgram};
pub use file_kind::FileKind;
pub use link::{LinkConfig, LinkRights};
pub use ports::{Protocol, auto_ports, free_port};
pub use recorder::RecorderConfig;
pub use robot::{JointConfig, LinkDynamics, RobotConfig};
