//! Similar names, for "did you mean …?". Used wherever names of a text are resolved, never by the real-time thread.

/// Length of the longest name that is compared, bytes: the time of a comparison grows with the product of both lengths.
const COMPARED_MAX: usize = 128;

/// Finds similar names for the errors of a text, with a bounded total cost: a text may have as many wrong names as known
/// ones, and comparing each with each would take a quadratic time.
#[derive(Clone, Copy, Debug, Default)]
pub struct NameSearch {
    compared: usize,
}

impl NameSearch {
    /// Number of comparisons after which no further search begins.
    const COMPARISONS_MAX: usize = 200_000;

    /// Returns the known name that is most similar to `name`, if any is similar enough. After many searches it looks at
    /// none of the known names.
    pub fn near<'a>(
        &mut self,
        name: &str,
        known: impl IntoIterator<Item = &'a str>,
    ) -> Option<&'a str> {
        if self.compared >= Self::COMPARISONS_MAX {
            return None;
        }
        let compared = &mut self.compared;
        closest(name, known.into_iter().inspect(|_| *compared += 1))
    }
}

/// Returns the known name that is most similar to `name`, if any is similar enough. Names of more than 128 bytes are
/// similar to none.
pub fn closest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if name.len() > COMPARED_MAX {
        return None;
    }
    let lower = name.to_lowercase();
    let known = known.into_iter();
    let known = known.filter(|candidate| candidate.len() <= COMPARED_MAX);
    let rated = known.map(|candidate| {
        let other = candidate.to_lowercase();
        let rating = strsim::jaro_winkler(&lower, &other)
            .max(strsim::normalized_damerau_levenshtein(&lower, &other));
        (rating, candidate)
    });
    // `max_by` returns the last of equal elements; the strict comparison keeps the first one.
    let best = rated.fold(None, |best: Option<(f64, &str)>, (rating, candidate)| {
        if best.is_none_or(|(highest, _)| rating > highest) {
            Some((rating, candidate))
        } else {
            best
        }
    });
    best.filter(|(rating, _)| *rating >= 0.75)
        .map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closest_name_is_near_or_none() {
        assert_eq!(closest("postion", ["position", "torque"]), Some("position"));
        assert_eq!(closest("greater", ["Greater", "Less"]), Some("Greater"));
        assert_eq!(closest("xyz", ["position", "torque"]), None);
    }

    #[test]
    fn searches_for_many_wrong_names_end() {
        let known: Vec<String> = (0..10_000).map(|number| format!("name{number}")).collect();
        let mut search = NameSearch::default();
        let looked_at = std::cell::Cell::new(0_usize);
        for number in 0..10_000 {
            let known = known.iter().map(|name| {
                looked_at.set(looked_at.get() + 1);
                name.as_str()
            });
            search.near(&format!("nome{number}"), known);
        }
        assert!(looked_at.get() <= NameSearch::COMPARISONS_MAX + known.len());
    }

    #[test]
    fn a_name_of_a_megabyte_is_compared_with_none() {
        let long = "n".repeat(1 << 20);
        assert_eq!(closest(&long, ["name", long.as_str()]), None);
        assert_eq!(closest("names", ["name", long.as_str()]), Some("name"));
    }
}
