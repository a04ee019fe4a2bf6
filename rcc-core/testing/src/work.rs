//! Growth of work with the size of its input: the processor time of the calling thread, which other programs on the
//! machine do not change much, for one size and for a multiple of it.

use std::time::Duration;

/// Returns the processor time of the calling thread; `None` if the kernel does not count it (`CONFIG_SCHED_INFO`).
#[must_use]
pub fn processor_time() -> Option<Duration> {
    // proc(5): time on a processor (ns), time waiting for one, number of time slices.
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let ns = text.split_whitespace().next()?.parse().ok()?;
    Some(Duration::from_nanos(ns))
}

/// Returns how many times as long `run` takes for `factor * size` as for `size`, the least of some tries each; `None` if it
/// cannot be measured. `run` gets the size and returns what must not be optimised away.
pub fn growth<T>(size: usize, factor: usize, mut run: impl FnMut(usize) -> T) -> Option<f64> {
    let mut least = |size: usize, tries: usize| {
        let tries = (0..tries).map(|_| {
            let before = processor_time()?;
            std::hint::black_box(run(size));
            Some(processor_time()?.saturating_sub(before))
        });
        let times: Option<Vec<Duration>> = tries.collect();
        times?.into_iter().min()
    };
    // The first tries warm up caches and the allocator.
    let (small, large) = (least(size, 9)?, least(factor * size, 3)?);
    // A tick of the clock, so that work that takes no time does not grow infinitely.
    let tick = Duration::from_micros(50);
    Some((large + tick).as_secs_f64() / (small + tick).as_secs_f64())
}
