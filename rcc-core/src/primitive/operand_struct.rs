//! Typed operands: a kernel names its operands in a struct, in the order of [`super::Spec::operands`], and reads and
//! writes them through the frame by their types. Run by the real-time thread.

use core::convert::identity;

use super::{Operand, Width};
use crate::frame::{
    Channel, Device, Element, Frame, MotionIndex, Preparation, PrepareFault, Slot, Value,
};
use crate::types::Store;

/// A field of a struct of operands; `u32` is a size.
pub trait Field: Copy {
    /// Kind of operand that the field takes.
    const KIND: FieldKind;

    /// Creates the field from a number of the operand list.
    fn of(operand: u32) -> Self;
}

/// Kind of operand that a field of a struct of operands takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldKind {
    /// A slot with the number of elements of its type.
    Slot(Store, u32),
    /// A device.
    Device,
    /// A channel.
    Channel,
    /// The index of a motion, which is also that of its path clock.
    Clock,
    /// A size.
    Size,
}

impl FieldKind {
    /// Returns true if the field reads this operand, or the first part of its elements.
    pub fn fits(self, operand: Operand) -> bool {
        match (self, operand) {
            (
                FieldKind::Slot(store, elements),
                Operand::Slot {
                    store: here, width, ..
                },
            ) => {
                let fixed = width == Width::fixed(width.times);
                store == here && (!fixed || elements <= width.times)
            }
            (FieldKind::Device, Operand::Arm | Operand::Device)
            | (FieldKind::Channel, Operand::Channel(_))
            | (FieldKind::Clock, Operand::Clock)
            | (FieldKind::Size, Operand::Size(_)) => true,
            _ => false,
        }
    }
}

impl<T: Value> Field for Slot<T> {
    const KIND: FieldKind = FieldKind::Slot(<T::Element as Element>::STORE, T::WIDTH);

    #[inline(always)]
    fn of(operand: u32) -> Slot<T> {
        Slot::at(operand)
    }
}

macro_rules! field {
    ($field:ty, $kind:ident, $of:expr) => {
        impl Field for $field {
            const KIND: FieldKind = FieldKind::$kind;

            #[inline(always)]
            fn of(operand: u32) -> $field {
                $of(operand)
            }
        }
    };
}

field!(Device, Device, Device);
field!(Channel, Channel, Channel);
field!(MotionIndex, Clock, MotionIndex);
field!(u32, Size, identity);

/// A struct of operands; made by `operands!`.
pub trait Operands: Copy {
    /// The arena of the open ports; `None` if there are none.
    const STORE: Option<Store>;
    /// Name and kind of each field.
    const FIELDS: &'static [(&'static str, FieldKind)];

    /// Reads the struct from the beginning of the list, and returns the rest; `None` at the end of the list.
    fn split(list: &[u32]) -> Option<(Self, &[u32])>;
}

/// A kernel as a struct of its operands.
pub trait Step: Operands {
    /// Evaluates one primitive. `None`, for a slot outside its arena, ends the run; `Plan::check` excludes it.
    fn step(self, frame: &mut Frame<'_>) -> Option<()>;
}

/// A kernel that does the same for each element of a value.
pub trait ByElement: Step {
    /// Returns the operands of element `i`.
    #[must_use]
    fn element(self, i: u32) -> Self;
}

/// A primitive whose start values are computed when its command becomes ready, off the real-time thread.
pub trait Prepare: Operands {
    /// Computes the start values.
    ///
    /// # Errors
    /// Returns the reason why they cannot be computed.
    fn prepare(self, preparation: &mut Preparation<'_>) -> Result<(), PrepareFault>;
}

/// Defines a struct of operands: each field has the name of its port or parameter (`input` for `in`), in the order
/// inputs, outputs, parameters, state, memory, motion, sizes. `struct Name<E>` is for every type of open ports,
/// `struct Name for Real` for one of them.
macro_rules! operands {
    ($(#[$meta:meta])* $vis:vis struct $name:ident $(for $store:ident)? {
        $($(#[$doc:meta])* $field:ident: $kind:ty),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy)]
        $vis struct $name {
            $($(#[$doc])* $field: $kind),+
        }

        impl $crate::primitive::Operands for $name {
            const STORE: Option<$crate::types::Store> = [$(Some($crate::types::Store::$store),)? None][0];
            $crate::primitive::operands!(@fields $name, $($field: $kind),+);
        }
    };
    ($(#[$meta:meta])* $vis:vis struct $name:ident<$element:ident> {
        $($(#[$doc:meta])* $field:ident: $kind:ty),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy)]
        $vis struct $name<$element: $crate::primitive::Element> {
            $($(#[$doc])* $field: $kind),+
        }

        impl<$element: $crate::primitive::Element> $crate::primitive::Operands for $name<$element> {
            const STORE: Option<$crate::types::Store> =
                Some(<$element as $crate::primitive::Element>::STORE);
            $crate::primitive::operands!(@fields $name, $($field: $kind),+);
        }
    };
    (@fields $name:ident, $($field:ident: $kind:ty),+) => {
        const FIELDS: &'static [(&'static str, $crate::primitive::FieldKind)] = &[
            $((stringify!($field), <$kind as $crate::primitive::Field>::KIND)),+
        ];

        #[inline(always)]
        fn split(list: &[u32]) -> Option<(Self, &[u32])> {
            let [$($field,)+ rest @ ..] = list else {
                return None;
            };
            let operands = $name {
                $($field: <$kind as $crate::primitive::Field>::of(*$field)),+
            };
            Some((operands, rest))
        }
    };
}
pub(crate) use operands;
