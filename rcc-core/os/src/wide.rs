//! Work on long arrays, compiled once more for the wide vectors that most processors have. Any thread, also real-time
//! threads: what the processor has is found out once, without a system call.
// Unsafe only here: calls of functions compiled for processor features that were detected first.
#![allow(unsafe_code)]

/// Work that gives the same result whatever it is compiled for; `run` is to be `#[inline(always)]`, or it runs as compiled
/// for every processor.
pub trait WideWork {
    /// Its result.
    type Result;

    /// Does it.
    fn run(self) -> Self::Result;
}

/// Does the work with the widest vectors of this processor.
#[inline(always)]
pub fn with_wide_vectors<W: WideWork>(work: W) -> W::Result {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx512dq")
        && std::arch::is_x86_feature_detected!("avx512vl")
    {
        // SAFETY: this processor has these parts of AVX-512, and the function needs nothing else.
        return unsafe { with_avx512(work) };
    }
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: this processor has AVX2, and the function needs nothing else.
        return unsafe { with_avx2(work) };
    }
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512dq,avx512vl")]
fn with_avx512<W: WideWork>(work: W) -> W::Result {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<W: WideWork>(work: W) -> W::Result {
    work.run()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [u64]);

    impl WideWork for Sum<'_> {
        type Result = u64;

        #[inline(always)]
        fn run(self) -> u64 {
            self.0.iter().fold(0, |sum, word| sum.wrapping_add(*word))
        }
    }

    #[test]
    fn the_result_is_that_of_the_work_itself() {
        let words: Vec<u64> = (0..1000u64)
            .map(|word| word.wrapping_mul(0x9e37_79b9_7f4a_7c15))
            .collect();
        for length in 0..words.len() {
            let words = &words[..length];
            assert_eq!(with_wide_vectors(Sum(words)), Sum(words).run());
        }
    }
}
