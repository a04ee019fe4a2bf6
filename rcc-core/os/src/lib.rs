//! Safe access to the operating system: files whose path or content comes from others, the wall clock, which may show
//! any time, and memory that is returned to the system. Runs on threads that are not real-time.

pub mod file;
pub mod memory;
pub mod wall;
