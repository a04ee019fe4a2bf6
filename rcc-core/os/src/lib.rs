//! Safe access to the operating system: the clocks, files whose path or content comes from others, private Unix sockets,
//! processes that may be dead, memory that is returned to the system, and the vectors of the processor. Runs on threads that
//! are not real-time, except for the monotonic clock and the vectors.

pub mod clock;
pub mod file;
pub mod memory;
pub mod process_instance;
pub mod socket;
pub mod wall;
pub mod wide;
