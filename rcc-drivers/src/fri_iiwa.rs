//! KUKA LBR iiwa and LBR Med over their Fast Robot Interface, versions 1.11 to 2.7: definitions shared by both ends of
//! the wire.
//! Plain data and functions; run by whichever thread calls them.

pub mod wire;
