//! What programs ask of the operating system with care: files whose path or content comes from somebody else, and the
//! wall clock, which may show anything. Run by threads that are not real-time.

pub mod file;
pub mod wall;
