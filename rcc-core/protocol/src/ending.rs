//! How a net ended, for people: the reason, its named outcome, and whether it had time to do anything. Pure functions.

/// Returns reason and outcome as a phrase: `finished: arrived`, `finished in its first cycle: touched`, `canceled`.
///
/// `evaluations` is the number of cycles in which the net was evaluated.
#[must_use]
pub fn ending(reason: &str, outcome: Option<&str>, evaluations: u64) -> String {
    let first = match is_at_once(reason, evaluations) {
        true => " in its first cycle",
        false => "",
    };
    match outcome {
        Some(outcome) => format!("{reason}{first}: {outcome}"),
        None => format!("{reason}{first}"),
    }
}

/// Returns why a net finished in its first cycle, and the remedy; `None` if it did not.
#[must_use]
pub fn why_at_once(reason: &str, outcome: Option<&str>, evaluations: u64) -> Option<String> {
    let condition = match outcome {
        Some(outcome) => format!("the outcome `{outcome}`"),
        None => "the condition of its Termination".to_owned(),
    };
    is_at_once(reason, evaluations).then(|| {
        format!(
            "{condition} was true from the start, so nothing moved: it began where it ends, or waits for what was already so"
        )
    })
}

fn is_at_once(reason: &str, evaluations: u64) -> bool {
    reason == "finished" && evaluations == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outcome_follows_the_reason() {
        for (reason, outcome, evaluations, words) in [
            ("finished", None, 2104, "finished"),
            ("finished", Some("touched"), 2104, "finished: touched"),
            (
                "finished",
                Some("arrived"),
                1,
                "finished in its first cycle: arrived",
            ),
            ("finished", None, 1, "finished in its first cycle"),
            ("canceled", Some("arrived"), 1, "canceled: arrived"),
            ("aborted", None, 1, "aborted"),
        ] {
            assert_eq!(ending(reason, outcome, evaluations), words);
            let at_once = reason == "finished" && evaluations == 1;
            let why = why_at_once(reason, outcome, evaluations);
            assert_eq!(why.is_some(), at_once, "{words}");
            let named = outcome.is_none_or(|outcome| why.is_none_or(|why| why.contains(outcome)));
            assert!(named, "{words}");
        }
    }
}
