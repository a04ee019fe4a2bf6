//! Growth of work with the size of its input: the processor time of the calling thread, which other programs on the
//! machine do not change much, for one size and for a multiple of it.

use std::time::Duration;

use nix::time::{ClockId, clock_gettime};

/// Returns the processor time of the calling thread so far.
pub fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID);
    time.expect("Linux counts it").into()
}

/// Returns how many times as long `run` takes for `factor * size` as for `size`, the least of some tries each. `run` gets
/// the size and returns what must not be optimised away.
pub fn growth<T>(size: usize, factor: usize, mut run: impl FnMut(usize) -> T) -> f64 {
    let mut least = |size: usize, tries: usize| {
        let tries = (0..tries).map(|_| {
            let before = processor_time();
            std::hint::black_box(run(size));
            processor_time().saturating_sub(before)
        });
        tries.min().unwrap_or_default()
    };
    // The first tries warm up caches and the allocator.
    let (small, large) = (least(size, 9), least(factor * size, 3));
    // A tick of the clock, so that work that takes no time does not grow infinitely.
    let tick = Duration::from_micros(50);
    (large + tick).as_secs_f64() / (small + tick).as_secs_f64()
}
