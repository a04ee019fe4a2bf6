//! Steps over values of several elements. Null is per element in arrays and matrices; a value counts as null as a whole
//! if any element is null. Run by the real-time thread.

use super::{Element, Slot};
use crate::frame::Frame;

/// Copies `width` elements; `None` if a slot is outside the arena.
#[inline(always)]
pub fn copy<E: Element>(
    frame: &mut Frame<'_>,
    from: Slot<E>,
    to: Slot<E>,
    width: u32,
) -> Option<()> {
    for i in 0..width {
        let value = frame.get(from + i)?;
        frame.put(to + i, value)?;
    }
    Some(())
}

/// Writes null into `width` elements; `None` if a slot is outside the arena.
#[inline(always)]
pub fn fill_null<E: Element>(frame: &mut Frame<'_>, to: Slot<E>, width: u32) -> Option<()> {
    (0..width).try_for_each(|i| frame.put(to + i, E::NULL))
}

/// Returns true if any of `width` elements is null; `None` if a slot is outside the arena.
#[inline(always)]
pub fn is_null<E: Element>(frame: &Frame<'_>, slot: Slot<E>, width: u32) -> Option<bool> {
    let mut null = false;
    for i in 0..width {
        null |= frame.get(slot + i)?.is_null();
    }
    Some(null)
}
