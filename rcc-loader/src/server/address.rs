//! Parses the address of a loaded net: `7`, `line`, or `line#7`. Pure; used by the server's threads.
//!
//! A number is always an id, because a net's name neither begins with a digit nor contains a `#`
//! ([`rcc_language::syntax::is_net_name`]). If both are given, both must match.

use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::messages;

/// The address of a loaded net.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandAddress<'a> {
    /// `7` or `#7`: the command with this id.
    Id(u64),
    /// `line`: a command of the net with this name.
    Name(&'a str),
    /// `line#7`: the command with this id, if its net has this name.
    Both(&'a str, u64),
}

impl CommandAddress<'_> {
    /// Parses an address. Returns `None` for a text that cannot name a net, such as `line#x` or `07`.
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

/// Parses an id in its printed form: digits without a sign or leading zeros.
fn id(digits: &str) -> Option<u64> {
    let number: u64 = digits.parse().ok()?;
    (number.to_string() == digits).then_some(number)
}

/// Returns the error for `wanted#id` when the command of that id belongs to another net.
#[must_use]
pub fn other_name(wanted: &str, id: u64, is: Option<&str>) -> ApiError {
    let is = match is.filter(|is| !is.is_empty()) {
        Some(is) => format!("command {id} is `{is}`"),
        None => return messages::unknown(&format!("{wanted}#{id}")),
    };
    ApiError::new(
        codes::UNKNOWN_COMMAND,
        format!("command `{wanted}#{id}` not found: {is}"),
        format!(
            "use `{wanted}` for the newest command of that name, or `{id}` for the command with that id; `rcc-cli ls` shows both"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_an_id_and_anything_else_a_name() {
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
        // A sign is not a digit: the text is looked up as a name, which no net has.
        assert_eq!(CommandAddress::read("+7"), Some(CommandAddress::Name("+7")));
    }
}
