//! Values and their slots: what lies in the arenas of a net, by type, and where. Run by the real-time thread.

use core::convert::identity;
use core::marker::PhantomData;
use core::ops::Add;

use super::{Frame, Preparation};
use crate::branchless::{choose, finite, real_unless};
use crate::pose::Pose;
use crate::types::{NULL_BOOL, NULL_INT, NULL_REAL, Store};

/// An element of the arena of reals; null is NaN, and no element is infinite: [`Value::put`] writes null instead.
pub type Real = f64;
/// An element of the arena of Bools: 0, 1 or 2 (null).
pub type Bool = u8;
/// An element of the arena of Ints; null is `i64::MIN`.
pub type Int = i64;

/// A value that lies contiguously in one arena.
pub trait Value: Copy {
    /// Its elements.
    type Element: Element;
    /// Number of elements.
    const WIDTH: u32;
    /// Null in every element.
    const NULL: Self;

    /// Reads the value; `None` outside of the arena.
    fn get(arena: &[Self::Element], index: u32) -> Option<Self>;
    /// Writes the value, an infinite number as null; `None` outside of the arena.
    fn put(self, arena: &mut [Self::Element], index: u32) -> Option<()>;
}

/// A value of one element.
pub trait Element: Value<Element = Self> {
    /// The arena.
    const STORE: Store;

    /// Returns true for null.
    fn is_null(self) -> bool;
    /// Returns the value, or null if `null` is true, without a branch.
    #[must_use]
    fn unless(self, null: bool) -> Self;
    /// Returns the value as an arena holds it: an infinite number, which is an overflow, is null. Without a branch.
    #[must_use]
    fn stored(self) -> Self;
    /// Returns the arena of a running net.
    fn arena<'f>(frame: &'f Frame<'_>) -> &'f [Self];
    /// Returns the arena of a running net.
    fn arena_mut<'f>(frame: &'f mut Frame<'_>) -> &'f mut [Self];
    /// Returns the arena of a net that is prepared.
    fn initial<'p>(preparation: &'p Preparation<'_>) -> &'p [Self];
}

macro_rules! element {
    ($element:ident, $arena:ident, $null:expr, |$value:ident| $is_null:expr, $unless:expr, $stored:expr) => {
        impl Value for $element {
            type Element = $element;
            const WIDTH: u32 = 1;
            const NULL: $element = $null;

            #[inline(always)]
            fn get(arena: &[$element], index: u32) -> Option<$element> {
                arena.get(index as usize).copied()
            }

            #[inline(always)]
            fn put(self, arena: &mut [$element], index: u32) -> Option<()> {
                *arena.get_mut(index as usize)? = self.stored();
                Some(())
            }
        }

        impl Element for $element {
            const STORE: Store = Store::$element;

            #[inline(always)]
            fn is_null(self) -> bool {
                let $value = self;
                $is_null
            }

            #[inline(always)]
            fn unless(self, null: bool) -> $element {
                $unless(null, self)
            }

            #[inline(always)]
            fn stored(self) -> $element {
                $stored(self)
            }

            #[inline(always)]
            fn arena<'f>(frame: &'f Frame<'_>) -> &'f [$element] {
                frame.$arena
            }

            #[inline(always)]
            fn arena_mut<'f>(frame: &'f mut Frame<'_>) -> &'f mut [$element] {
                frame.$arena
            }

            fn initial<'p>(preparation: &'p Preparation<'_>) -> &'p [$element] {
                preparation.$arena
            }
        }
    };
}

element!(
    Real,
    reals,
    NULL_REAL,
    |value| value.is_nan(),
    real_unless,
    finite
);
element!(
    Bool,
    bools,
    NULL_BOOL,
    |value| value & NULL_BOOL != 0,
    |null, value| choose(null, NULL_BOOL, value),
    identity
);
element!(
    Int,
    ints,
    NULL_INT,
    |value| value == NULL_INT,
    |null, value| choose(null, NULL_INT, value),
    identity
);

/// Without interpretation.
impl<E: Element, const N: usize> Value for [E; N] {
    type Element = E;
    const WIDTH: u32 = N as u32;
    const NULL: [E; N] = [E::NULL; N];

    #[inline(always)]
    fn get(arena: &[E], index: u32) -> Option<[E; N]> {
        arena.get(index as usize..)?.first_chunk().copied()
    }

    #[inline(always)]
    fn put(self, arena: &mut [E], index: u32) -> Option<()> {
        *arena.get_mut(index as usize..)?.first_chunk_mut()? = self.map(E::stored);
        Some(())
    }
}

/// A null pose contains NaN; a pose that is not finite is written as null.
impl Value for Pose {
    type Element = Real;
    const WIDTH: u32 = 7;
    const NULL: Pose = Pose {
        position: [NULL_REAL; 3],
        orientation: [NULL_REAL; 4],
    };

    #[inline(always)]
    fn get(arena: &[Real], index: u32) -> Option<Pose> {
        <[Real; 7]>::get(arena, index).map(Pose::from_slots)
    }

    #[inline(always)]
    fn put(self, arena: &mut [Real], index: u32) -> Option<()> {
        let slots = if self.is_finite() {
            self.to_slots()
        } else {
            [NULL_REAL; 7]
        };
        slots.put(arena, index)
    }
}

/// `[x y z]`.
pub type Vector3 = [Real; 3];
/// A quaternion `[x y z w]`.
pub type Rotation = [Real; 4];
/// Six numbers: a twist or a wrench.
pub type Spatial = [Real; 6];

/// The index of a value's first element in its arena; `slot + i` is `i` elements further.
#[derive(Debug)]
pub struct Slot<T> {
    index: u32,
    value: PhantomData<T>,
}

impl<T> Slot<T> {
    /// Creates the slot of a value that begins at `index`.
    #[inline(always)]
    pub const fn at(index: u32) -> Slot<T> {
        Slot {
            index,
            value: PhantomData,
        }
    }

    /// Creates the slot of a value of another type that begins at the same element.
    #[inline(always)]
    pub const fn cast<U: Value>(self) -> Slot<U> {
        Slot::at(self.index)
    }

    /// Returns the index of the first element.
    #[inline(always)]
    pub const fn index(self) -> u32 {
        self.index
    }
}

impl<T> Clone for Slot<T> {
    #[inline(always)]
    fn clone(&self) -> Slot<T> {
        *self
    }
}

impl<T> Copy for Slot<T> {}

impl<T> Add<u32> for Slot<T> {
    type Output = Slot<T>;

    #[inline(always)]
    fn add(self, elements: u32) -> Slot<T> {
        Slot::at(self.index + elements)
    }
}

/// The index of a device.
#[derive(Clone, Copy, Debug)]
pub struct Device(pub u32);

/// The index of a channel of a device.
#[derive(Clone, Copy, Debug)]
pub struct Channel(pub u32);

/// The index of a motion of the net, which is also that of its path clock.
#[derive(Clone, Copy, Debug)]
pub struct MotionIndex(pub u32);
