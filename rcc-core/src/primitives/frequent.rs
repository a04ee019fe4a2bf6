//! The kernels that most nets consist of, in one function with the loop over the runs: their code lies on a few pages
//! beside each other, which are soon there again after the pause between two cycles, and a run of them needs no call.
//! Real-time thread.

use super::{CATALOGUE, KERNELS_MAX, RunKernel, kernel_number};
use crate::frame::Frame;

/// The function of kernel `kernel` of a primitive; a name that does not exist does not compile.
// Evaluated at compile time: an index out of bounds does not compile.
#[allow(clippy::indexing_slicing)]
const fn function(number: u16) -> RunKernel {
    let entry = CATALOGUE[number as usize / KERNELS_MAX];
    entry.kernels[number as usize % KERNELS_MAX].run
}

#[allow(clippy::indexing_slicing)]
const fn number_of(name: &str, kernel: usize) -> u16 {
    let mut entry = 0;
    while !is_same(CATALOGUE[entry].spec.name, name) {
        entry += 1;
    }
    kernel_number(entry, kernel)
}

#[allow(clippy::indexing_slicing)]
const fn is_same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut at = 0;
    while at < a.len() && at < b.len() && a[at] == b[at] {
        at += 1;
    }
    at == a.len() && at == b.len()
}

/// Lists frequent kernels as `place: name, number of the kernel`; places count from 0.
macro_rules! frequent {
    ($($place:literal: $name:literal, $kernel:literal;)+) => {
        /// The place of a kernel among the frequent ones; [`OTHER`] if it is none of them.
        pub(crate) fn place_of(number: u16) -> u8 {
            const PLACES: &[(u16, u8)] = &[$((number_of($name, $kernel), $place)),+];
            let found = PLACES.iter().find(|(known, _)| *known == number);
            found.map_or(OTHER, |(_, place)| *place)
        }

        /// Runs the kernel at a place among the frequent ones, or `other`.
        #[inline(always)]
        pub(crate) fn run(place: u8, other: RunKernel, frame: &mut Frame<'_>, operands: &[u32]) {
            match place {
                $($place => {
                    const KERNEL: RunKernel = function(number_of($name, $kernel));
                    KERNEL(frame, operands);
                })+
                _ => other(frame, operands),
            }
        }
    };
}

/// The place of a kernel that is not among the frequent ones.
pub(crate) const OTHER: u8 = u8::MAX;

frequent! {
    0: "Add", 0;
    1: "Subtract", 0;
    2: "Multiply", 0;
    3: "Divide", 0;
    4: "Negate", 0;
    5: "Abs", 0;
    6: "Min", 0;
    7: "Max", 0;
    8: "Limit", 0;
    9: "Greater", 0;
    10: "Less", 0;
    11: "And", 0;
    12: "Or", 0;
    13: "Not", 0;
    14: "Xor", 0;
    15: "Select", 0;
    16: "OrElse", 0;
    17: "IsNull", 0;
    18: "NullIf", 0;
    19: "RisingEdge", 0;
    20: "Counter", 0;
    21: "LowPass", 0;
    22: "RateLimit", 0;
    23: "SquareRoot", 0;
    24: "AnalogInput", 0;
    25: "DigitalInput", 0;
    26: "AnalogOutput", 0;
    27: "DigitalOutput", 0;
    28: "Cancel", 0;
    29: "Termination", 0;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::primitives::kernel;

    #[test]
    fn each_place_has_the_kernel_that_the_catalogue_has() {
        let all =
            (0..(CATALOGUE.len() * KERNELS_MAX) as u16).filter(|number| kernel(*number).is_some());
        let places: std::vec::Vec<u8> = all.map(place_of).filter(|place| *place != OTHER).collect();
        let mut sorted = places.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), places.len(), "a kernel has one place");
        assert!(
            sorted.iter().copied().eq(0..sorted.len() as u8),
            "{sorted:?}"
        );
    }
}
