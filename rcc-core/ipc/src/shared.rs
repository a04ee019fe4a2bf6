//! The wrapper in which plain data crosses to other processes; the only file of this package with `unsafe`. Used by the
//! threads that create and open services; the wrapper has no cost at run time.
#![allow(unsafe_code)]

use std::any::TypeId;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Mutex, PoisonError};

use bytemuck::Pod;
use iceoryx2::prelude::ZeroCopySend;

/// iceoryx2 reserves 256 bytes for a type's name and panics on longer ones.
const TYPE_NAME_MAX: usize = 200;

/// Plain data in shared memory. Every bit pattern is a valid [`Pod`], so a broken peer can cause wrong data at worst,
/// never undefined behaviour.
#[derive(Clone, Copy)]
#[repr(transparent)]
pub(crate) struct Shared<T: Pod>(pub T);

impl<T: Pod> fmt::Debug for Shared<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Shared")
    }
}

// SAFETY: a Pod holds no pointer, reference, padding or handle, may have any bit pattern, and the wrapper is
// transparent; its derive demands repr(C) or repr(transparent). All by bytemuck's contract for `Pod`.
unsafe impl<T: Pod> ZeroCopySend for Shared<T> {
    unsafe fn type_name() -> &'static str {
        layout_name::<T>()
    }
}

/// Returns size, alignment and name of `T`, which two processes must agree on before one opens what the other created.
fn layout_name<T: Pod>() -> &'static str {
    static NAMES: Mutex<BTreeMap<TypeId, &'static str>> = Mutex::new(BTreeMap::new());
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    names.entry(TypeId::of::<T>()).or_insert_with(|| {
        let full = std::any::type_name::<T>();
        let from = (full.len().saturating_sub(TYPE_NAME_MAX)..=full.len())
            .find(|&at| full.is_char_boundary(at))
            .unwrap_or(full.len());
        let name = format!(
            "rcc {} {} {}",
            size_of::<T>(),
            align_of::<T>(),
            &full[from..]
        );
        // One short text per shared type, so the leak is bounded.
        Box::leak(name.into_boxed_str())
    })
}
