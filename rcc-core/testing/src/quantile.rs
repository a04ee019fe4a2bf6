//! Quantiles of measured values.

/// Returns the value of a sorted list at this share of it, 0 to 1; `None` if the list is empty.
#[must_use]
pub fn quantile<T: Copy>(sorted: &[T], share: f64) -> Option<T> {
    let last = sorted.len().saturating_sub(1);
    sorted.get((last as f64 * share).round() as usize).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantile_is_a_value_of_the_list() {
        let sorted = [1, 2, 3, 10];
        for (share, value) in [(0.0, 1), (0.5, 3), (0.99, 10), (1.0, 10)] {
            assert_eq!(quantile(&sorted, share), Some(value), "{share}");
        }
        assert_eq!(quantile::<u8>(&[], 0.5), None);
    }
}
