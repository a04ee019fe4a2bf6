//! How a loaded net is addressed: `7`, `line`, or `line#7`. Pure; used by the server's threads.
//!
//! A number is always an id, because no name of a net begins with a digit or has a `#`
//! ([`rcc_language::syntax::is_net_name`]); with both, both must be right.

use super::codes;
use super::error::ApiError;
use super::messages;

/// What names a loaded net.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandAddress<'a> {
    /// `7`, or `#7`: the one with this id.
    Id(u64),
    /// `line`: one of this name.
    Name(&'a str),
    /// `line#7`: the one with this id, if that is its name.
    Both(&'a str, u64),
}

impl CommandAddress<'_> {
    /// Reads an address; nothing for a text that can name no net, such as `line#x` or `07`.
    #[must_use]
    pub fn read(text: &str) -> Option<CommandAddress<'_>> {
        match text.rsplit_once('#') {
            Some((name, digits)) => match (name, id(digits)?) {
                ("", id) => Some(CommandAddress::Id(id)),
                (name, _) if name.contains('#') => None,
                (name, id) => Some(CommandAddress::Both(name, id)),
            },
            None if text.starts_with(|c: char| c.is_ascii_digit()) => {
                id(text).map(CommandAddress::Id)
            }
            None => (!text.is_empty()).then_some(CommandAddress::Name(text)),
        }
    }
}

/// An id as it is printed: digits, without a sign or leading zeros.
fn id(digits: &str) -> Option<u64> {
    let number: u64 = digits.parse().ok()?;
    (number.to_string() == digits).then_some(number)
}

/// `wanted#id`, and the command of that id has another name: nothing is done to it.
#[must_use]
pub fn other_name(wanted: &str, id: u64, is: Option<&str>) -> ApiError {
    let is = match is.filter(|is| !is.is_empty()) {
        Some(is) => format!("command {id} is `{is}`"),
        None => return messages::unknown(&format!("{wanted}#{id}")),
    };
    ApiError::new(
        codes::UNKNOWN_COMMAND,
        format!("there is no command `{wanted}#{id}`: {is}"),
        format!(
            "`{wanted}` means the newest of that name, `{id}` the command of that id; `rcc-cli ls` shows both"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_an_id_and_a_name_is_none() {
        for (text, address) in [
            ("7", Some(CommandAddress::Id(7))),
            ("#7", Some(CommandAddress::Id(7))),
            ("18446744073709551615", Some(CommandAddress::Id(u64::MAX))),
            ("line", Some(CommandAddress::Name("line"))),
            ("line-7", Some(CommandAddress::Name("line-7"))),
            ("line#7", Some(CommandAddress::Both("line", 7))),
            ("7#7", Some(CommandAddress::Both("7", 7))),
            ("18446744073709551616", None),
            ("", None),
            ("#", None),
            ("line#", None),
            ("line#x", None),
            ("line#+7", None),
            ("line#07", None),
            ("line#7#7", None),
            ("07", None),
            ("7x", None),
            ("7 ", None),
        ] {
            assert_eq!(CommandAddress::read(text), address, "{text}");
        }
        // A sign is no digit: it is looked for as a name, which no net has.
        assert_eq!(CommandAddress::read("+7"), Some(CommandAddress::Name("+7")));
    }
}
