//! What programs ask of the operating system with care: files whose path or content comes from somebody else, the
//! wall clock, which may show anything, and memory that is given back. Run by threads that are not real-time.

pub mod file;
pub mod memory;
pub mod wall;
