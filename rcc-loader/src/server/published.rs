//! Values that CANCEL and ABORT read: a reader never waits for another thread, which may be preempted.

use std::sync::{Arc, Mutex, PoisonError};

use arc_swap::{ArcSwap, Guard};

/// A value that is replaced as a whole.
#[derive(Debug)]
pub struct Published<T> {
    current: ArcSwap<T>,
    changing: Mutex<()>,
}

impl<T> Published<T> {
    /// Publishes a first value.
    pub fn new(value: T) -> Published<T> {
        Published {
            current: ArcSwap::from_pointee(value),
            changing: Mutex::new(()),
        }
    }

    /// Returns the value as it is now; later changes do not show in it. Never waits.
    pub fn get(&self) -> Guard<Arc<T>> {
        self.current.load()
    }
}

impl<T: Clone> Published<T> {
    /// Changes a copy of the value and publishes it. Changes wait for one another.
    pub fn change<R>(&self, change: impl FnOnce(&mut T) -> R) -> R {
        // It protects no data; a panic in `change` publishes nothing.
        let _changing = self.changing.lock().unwrap_or_else(PoisonError::into_inner);
        let mut next = T::clone(&self.get());
        let result = change(&mut next);
        self.current.store(Arc::new(next));
        result
    }
}

impl<T: Default> Default for Published<T> {
    fn default() -> Published<T> {
        Published::new(T::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_does_not_wait_for_a_change_and_no_change_is_lost() {
        let value = Published::new(0);
        value.change(|next| {
            *next = 1;
            assert_eq!(
                **value.get(),
                0,
                "a change is not seen before it is complete"
            );
        });
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..1000).for_each(|_| value.change(|next| *next += 1)));
            }
        });
        assert_eq!(**value.get(), 4001);
    }

    #[test]
    fn a_panic_publishes_nothing_and_does_not_hinder_the_next_change() {
        let value = Published::new(vec![1]);
        let panics = || {
            value.change(|next| -> () {
                next.clear();
                panic!("on purpose")
            })
        };
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(panics));
        assert!(panicked.is_err());
        value.change(|next| next.push(2));
        assert_eq!(**value.get(), [1, 2]);
    }
}
