//! A list of cores in the notation of systemd and the kernel: `0-2,5`. Pure; used by the main thread of `install-units`
//! and `rt-setup`.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

/// Largest core number, far beyond any machine.
const CORE_MAX: usize = 4095;

/// A non-empty set of core numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cores(BTreeSet<usize>);

/// A text that is not a list of cores.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("invalid list of cores `{given}`: write numbers and ranges, for example 0-2,5")]
pub struct CoresError {
    /// The text as given.
    pub given: String,
}

impl Cores {
    /// Returns the cores 0 to `count` - 1 except `taken`; `None` if none remain.
    #[must_use]
    pub fn all_but(count: usize, taken: &BTreeSet<usize>) -> Option<Cores> {
        let rest: BTreeSet<usize> = (0..count).filter(|core| !taken.contains(core)).collect();
        (!rest.is_empty()).then_some(Cores(rest))
    }

    /// Returns true if the core is in the list.
    #[must_use]
    pub fn contains(&self, core: usize) -> bool {
        self.0.contains(&core)
    }

    /// Returns the core numbers.
    #[must_use]
    pub fn numbers(&self) -> &BTreeSet<usize> {
        &self.0
    }
}

impl FromStr for Cores {
    type Err = CoresError;

    fn from_str(given: &str) -> Result<Cores, CoresError> {
        let wrong = || CoresError {
            given: given.to_owned(),
        };
        let number = |text: &str| {
            let number = text.trim().parse::<usize>().ok();
            number.filter(|core| *core <= CORE_MAX).ok_or_else(wrong)
        };
        let mut all = BTreeSet::new();
        for part in given.split(',') {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let (first, last) = (number(first)?, number(last)?);
            if first > last {
                return Err(wrong());
            }
            all.extend(first..=last);
        }
        Ok(Cores(all))
    }
}

impl fmt::Display for Cores {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut ranges: Vec<(usize, usize)> = Vec::new();
        for &core in &self.0 {
            match ranges.last_mut() {
                Some((_, last)) if *last + 1 == core => *last = core,
                _ => ranges.push((core, core)),
            }
        }
        let texts = ranges.iter().map(|(first, last)| match first == last {
            true => first.to_string(),
            false => format!("{first}-{last}"),
        });
        f.write_str(&texts.collect::<Vec<_>>().join(","))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_reads_as_it_is_written() {
        for (given, shown) in [
            ("3", "3"),
            ("0-2,5", "0-2,5"),
            ("5,0,1,2", "0-2,5"),
            (" 1 - 2 ", "1-2"),
        ] {
            assert_eq!(given.parse::<Cores>().unwrap().to_string(), shown);
        }
        for bad in ["", "a", "2-1", "1,,2", "-1", "99999"] {
            assert!(bad.parse::<Cores>().is_err(), "{bad}");
        }
    }
}
