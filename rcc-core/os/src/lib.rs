//! Safe access to the operating system: the clocks, files whose path or content comes from others, private Unix sockets,
//! processes that may be dead, and memory that is returned to the system. Runs on threads that are not real-time,
//! except for the monotonic clock.

pub mod clock;
pub mod file;
pub mod memory;
pub mod process_instance;
pub mod socket;
pub mod wall;
