//! The terminal as programs for people use it: texts and tables fitted to its size, and live views of the whole screen. Used
//! by `rcc-cli` and `rcc-link`.

pub mod columns;
pub mod live;
pub mod text;
