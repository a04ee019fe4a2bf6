//! KUKA LWR 4+ over its Fast Research Interface, version 1.0: definitions shared by both ends of the wire.
//! Plain data and functions; run by whichever thread calls them.

pub mod wire;
