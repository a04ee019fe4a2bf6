//! Lists of numbers in a simulator's command line.
//! Read once, by the main thread.

use std::str::FromStr;

/// Numbers in one argument, separated by commas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NumberList<const N: usize>(pub [f64; N]);

/// Why a list is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ListError {
    /// The list has the wrong length.
    #[error("expected {want} numbers separated by commas, found {have}")]
    Count {
        /// Expected.
        want: usize,
        /// Given.
        have: usize,
    },
    /// An element is not a finite number.
    #[error("invalid number `{0}`: write a finite number")]
    Number(String),
}

impl<const N: usize> FromStr for NumberList<N> {
    type Err = ListError;

    fn from_str(text: &str) -> Result<Self, ListError> {
        let numbers = text
            .split(',')
            .map(|part| {
                let number = part.trim().parse::<f64>().ok();
                let number = number.filter(|number| number.is_finite());
                number.ok_or_else(|| ListError::Number(part.trim().to_owned()))
            })
            .collect::<Result<Vec<_>, _>>()?;
        let have = numbers.len();
        numbers
            .try_into()
            .map(Self)
            .map_err(|_| ListError::Count { want: N, have })
    }
}
