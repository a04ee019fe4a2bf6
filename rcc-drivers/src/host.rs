//! Everything around a driver: boards, life, set-points in time, rest, release. A driver only speaks its wire.
//! One thread plays; a helper thread watches the announcements and opens boards.

pub mod blend;
pub mod limits;
pub mod pace;
pub mod player;
pub mod reason;
pub mod track;
