//! The tokens of an expression with their places in its text. Runs on the loader's threads.

use std::ops::Range;

use rcc_core::unit::Unit;

use super::error::{ExpressionError, Problem};

/// Words with a meaning of their own; neither a named input nor a function can have such a name.
pub const KEYWORDS: &[&str] = &[
    "if", "then", "else", "and", "or", "not", "true", "false", "null", "prev",
];

/// A token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Token<'t> {
    /// A number with its unit, if it has one: `2`, `1 mm/s/K`, `deg(30)`.
    Number(&'t str),
    /// Names joined by points: `t`, `temperature.out`, `move.pose.x`. Keywords are words as well.
    Word(&'t str),
    /// A parameter of the fragment, with its sign: `$gain`.
    Parameter(&'t str),
    /// An operator or a bracket.
    Symbol(&'static str),
    /// The end of the text.
    End,
}

/// Operators and brackets, longer ones first.
const SYMBOLS: &[&str] = &[
    "<=", ">=", "==", "!=", "+", "-", "*", "/", "<", ">", "(", ")", "[", "]", ",", ".",
];

/// Operators of other languages, and what is written here.
const FOREIGN: &[(&str, &str)] = &[
    ("&&", "write `and`"),
    ("||", "write `or`"),
    ("=", "write `==` to compare"),
    ("!", "write `not`"),
    ("^", "write `power(x, 2)`, or `x * x`"),
    (
        "%",
        "a percentage follows a number, as in `50 %`; write `remainder(a, b)`",
    ),
    ("?", "write `if … then … else …`"),
    ("'", "an expression has no texts"),
    ("\"", "an expression has no texts"),
];

/// Reads tokens from a text.
pub struct Lexer<'t> {
    text: &'t str,
    at: usize,
}

impl<'t> Lexer<'t> {
    /// Begins at `at`.
    pub fn new(text: &'t str, at: usize) -> Lexer<'t> {
        Lexer { text, at }
    }

    fn rest(&self) -> &'t str {
        self.text.get(self.at..).unwrap_or("")
    }

    fn take(&mut self, length: usize) -> (&'t str, Range<usize>) {
        let from = self.at;
        self.at = (from + length).min(self.text.len());
        (self.text.get(from..self.at).unwrap_or(""), from..self.at)
    }

    /// Returns the next token and its place.
    ///
    /// # Errors
    /// Fails at a character that begins no token, and at an angle without its closing parenthesis.
    pub fn next(&mut self) -> Result<(Token<'t>, Range<usize>), ExpressionError> {
        self.at += leading(self.rest(), char::is_whitespace);
        let rest = self.rest();
        let Some(first) = rest.chars().next() else {
            return Ok((Token::End, self.at..self.at));
        };
        if first.is_ascii_digit() || decimal_point_begins(rest) {
            let (text, place) = self.take(quantity_length(rest));
            return Ok((Token::Number(text), place));
        }
        if rest.starts_with("deg(") || rest.starts_with("rad(") {
            return self.angle();
        }
        if first.is_alphabetic() || first == '_' {
            let (text, place) = self.take(path_length(rest));
            return Ok((Token::Word(text), place));
        }
        if first == '$' {
            let (text, place) = self.take(1 + leading(&rest[1..], is_name));
            return Ok((Token::Parameter(text), place));
        }
        if let Some(symbol) = SYMBOLS.iter().find(|symbol| rest.starts_with(**symbol)) {
            let (_, place) = self.take(symbol.len());
            return Ok((Token::Symbol(symbol), place));
        }
        let foreign = FOREIGN.iter().find(|row| rest.starts_with(row.0));
        let length = foreign.map_or(first.len_utf8(), |row| row.0.len());
        let (found, place) = self.take(length);
        Err(ExpressionError {
            place,
            problem: Problem::Character {
                found: found.to_owned(),
            },
            help: foreign.map(|row| row.1.to_owned()),
        })
    }

    /// Takes the text up to and including the next `]`; the opening bracket has been read.
    ///
    /// # Errors
    /// Returns an error if the bracket is never closed.
    pub fn bracket(&mut self, opening: &Range<usize>) -> Result<usize, ExpressionError> {
        let Some(length) = self.rest().find(']') else {
            return Err(Problem::Unclosed { opening: "[" }.at(opening.clone()));
        };
        let (_, place) = self.take(length + 1);
        Ok(place.end)
    }

    /// `deg(…)` or `rad(…)`: constants only.
    fn angle(&mut self) -> Result<(Token<'t>, Range<usize>), ExpressionError> {
        let mut depth = 0_usize;
        for (at, c) in self.rest().char_indices() {
            match c {
                '(' => depth += 1,
                ')' if depth == 1 => {
                    let (text, place) = self.take(at + 1);
                    return Ok((Token::Number(text), place));
                }
                ')' => depth -= 1,
                _ => {}
            }
        }
        let opening = self.at + 3..self.at + 4;
        Err(Problem::Unclosed { opening: "(" }.at(opening))
    }
}

/// Returns the length of the beginning that consists of such characters.
fn leading(text: &str, wanted: impl Fn(char) -> bool) -> usize {
    text.find(|c| !wanted(c)).unwrap_or(text.len())
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn decimal_point_begins(text: &str) -> bool {
    let mut bytes = text.bytes();
    bytes.next() == Some(b'.') && bytes.next().is_some_and(|byte| byte.is_ascii_digit())
}

/// Returns the length of names joined by points.
fn path_length(text: &str) -> usize {
    let mut end = leading(text, is_name);
    loop {
        let more = text.get(end..).and_then(|rest| rest.strip_prefix('.'));
        let length = more.map_or(0, |more| leading(more, is_name));
        if length == 0 {
            return end;
        }
        end += 1 + length;
    }
}

/// Returns the length of a number and its unit. A unit is one word: `2 mm/s` has a unit, `2 mm / s` is a division.
fn quantity_length(text: &str) -> usize {
    let number = number_length(text);
    let after = &text[number..];
    let blank = leading(after, |c| c == ' ' || c == '\t' || c == '\n');
    let unit = unit_length(&after[blank..]);
    number + if unit == 0 { 0 } else { blank + unit }
}

/// Returns the length of the unit that a text begins with, 0 if it begins with a keyword or an operator. The first word
/// after a number is taken for a unit even if no unit has that name.
fn unit_length(text: &str) -> usize {
    if text.starts_with('%') {
        return 1;
    }
    let mut end = unit_word_length(text);
    let word = &text[..leading(text, is_name)];
    if end == 0 || KEYWORDS.contains(&word) {
        return 0;
    }
    while let Some(rest) = text[end..].strip_prefix(['*', '/', '·']) {
        let length = unit_word_length(rest);
        let name = rest[..length].split('^').next().unwrap_or("");
        let continues = rest[length..].starts_with(['.', '(', '[']);
        if length == 0 || continues || Unit::parse(name).is_none() {
            break;
        }
        end = text.len() - rest.len() + length;
    }
    end
}

/// Returns the length of the name of a unit and its power: `m`, `s^2`, `s^-1`.
fn unit_word_length(text: &str) -> usize {
    let name = match text.chars().next() {
        Some(first) if first.is_alphabetic() => leading(text, is_name),
        _ => return 0,
    };
    let Some(power) = text[name..].strip_prefix('^') else {
        return name;
    };
    let sign = usize::from(power.starts_with('-'));
    match leading(&power[sign..], |c| c.is_ascii_digit()) {
        0 => name,
        digits => name + 1 + sign + digits,
    }
}

/// Returns the length of an unsigned number.
pub fn number_length(text: &str) -> usize {
    let digits = |from: usize| from + leading(&text[from..], |c| c.is_ascii_digit());
    let mut end = digits(0);
    if text[end..].starts_with('.') && !text[end..].starts_with("..") {
        end = digits(end + 1);
    }
    if text[end..].starts_with(['e', 'E']) {
        let signed = usize::from(text[end + 1..].starts_with(['+', '-']));
        let exponent = digits(end + 1 + signed);
        if exponent > end + 1 + signed {
            return exponent;
        }
    }
    end
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tokens(text: &str) -> Vec<String> {
        let mut lexer = Lexer::new(text, 0);
        let mut found = Vec::new();
        loop {
            match lexer.next() {
                Ok((Token::End, _)) => return found,
                Ok((_, place)) => found.push(text[place].to_owned()),
                Err(error) => {
                    found.push(format!("! {}", error.problem));
                    return found;
                }
            }
        }
    }

    #[test]
    fn a_number_takes_the_unit_that_follows_it_without_spaces_in_it() {
        assert_eq!(tokens("1 mm/s/K*x"), ["1 mm/s/K", "*", "x"]);
        assert_eq!(tokens("1 mm / s"), ["1 mm", "/", "s"]);
        assert_eq!(tokens("2 m/t.out"), ["2 m", "/", "t.out"]);
        assert_eq!(tokens("2 m/s^2-1"), ["2 m/s^2", "-", "1"]);
        assert_eq!(tokens("50 %"), ["50 %"]);
        assert_eq!(tokens("1e3mm"), ["1e3mm"]);
        assert_eq!(tokens("2 and 3 then 4"), ["2", "and", "3", "then", "4"]);
        assert_eq!(tokens("2 * N"), ["2", "*", "N"]);
    }

    #[test]
    fn words_operators_and_angles() {
        assert_eq!(tokens("-a.b.x<=.5"), ["-", "a.b.x", "<=", ".5"]);
        assert_eq!(tokens("deg(30*(1+1))+$g"), ["deg(30*(1+1))", "+", "$g"]);
        assert_eq!(tokens("(a).x"), ["(", "a", ")", ".", "x"]);
        assert_eq!(tokens("a-b"), ["a", "-", "b"]);
    }

    #[test]
    fn a_character_without_meaning_is_refused() {
        assert_eq!(tokens("a && b"), ["a", "! unexpected `&&`"]);
        assert_eq!(tokens("a § b"), ["a", "! unexpected `§`"]);
        assert_eq!(tokens("deg(3"), ["! `(` is never closed"]);
    }
}
