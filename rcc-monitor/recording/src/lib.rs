//! Recordings as MCAP files with `ros2msg` schemas and CDR messages, which Foxglove, Lichtblick, PlotJuggler, Rerun and
//! Python read without ROS; also their messages alone, for live views. Used by recorders, by `replay`, and by `import`
//! and `plot`, which read recordings; never by a real-time thread.

pub mod arm;
pub mod cdr;
pub mod device;
pub mod file;
pub mod messages;
pub mod read;
pub mod recording;
pub mod schemas;
pub mod sink;
pub mod table;
mod texts;
