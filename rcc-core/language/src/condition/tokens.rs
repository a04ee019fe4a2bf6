//! The words and signs of a condition. Runs on the loader's threads and in the command line.

use rcc_protocol::rules::Relation;

use super::ConditionError;

/// A word or sign.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Token {
    Word(String),
    Equal,
    Unequal,
    Compare(Relation),
    Open,
    Close,
}

fn is_word(character: char) -> bool {
    character.is_alphanumeric() || "_-#./[]".contains(character)
}

pub(super) fn tokens(text: &str) -> Result<Vec<(usize, Token)>, ConditionError> {
    let mut tokens = Vec::new();
    let mut characters = text.chars().zip(1..).peekable();
    while let Some((character, column)) = characters.next() {
        let next = characters.peek().map(|(next, _)| *next);
        let token = match (character, next) {
            ('=', Some('=')) | ('!', Some('=')) => {
                characters.next();
                match character {
                    '=' => Token::Equal,
                    _ => Token::Unequal,
                }
            }
            ('<' | '>', next) => {
                let or_equal = next == Some('=');
                if or_equal {
                    characters.next();
                }
                Token::Compare(match (character, or_equal) {
                    ('<', false) => Relation::Below,
                    ('<', true) => Relation::AtMost,
                    (_, false) => Relation::Above,
                    (_, true) => Relation::AtLeast,
                })
            }
            ('(', _) => Token::Open,
            (')', _) => Token::Close,
            (space, _) if space.is_whitespace() => continue,
            (first, _) if is_word(first) => {
                let mut word = String::from(first);
                while let Some((next, _)) = characters.next_if(|(next, _)| is_word(*next)) {
                    word.push(next);
                }
                Token::Word(word)
            }
            (other, _) => {
                return Err(ConditionError {
                    column,
                    message: format!("unexpected `{}`", other.escape_debug()),
                    help: "a condition has names, `==`, `!=`, `<`, `<=`, `>`, `>=`, `and`, `or`, `not`, `topic(…)` and parentheses"
                        .to_owned(),
                });
            }
        };
        tokens.push((column, token));
    }
    Ok(tokens)
}
