//! KUKA LWR 4+ over its Fast Research Interface, version 1.0: what both ends of that wire share.
//! Plain data and functions; they run on whatever thread calls them.

pub mod wire;
