//! Conditions of rules: text over states, outcomes and values of commands, to terms in postfix notation. Names stay
//! names; whoever installs the rule resolves them. Runs on the loader's threads and in the command line.

use rcc_config::diagnostic::closest;
use rcc_core::message::{CommandState, EndReason};

/// One element of a condition in postfix notation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ConditionTerm {
    /// `true`.
    True,
    /// `line.state == running`.
    State {
        /// Name of the command: `line`, `line#7` or `#7`.
        command: String,
        /// The state.
        state: CommandState,
    },
    /// `line.reason == fault`.
    Reason {
        /// Name of the command.
        command: String,
        /// The reason.
        reason: EndReason,
    },
    /// `line.outcome == touched`.
    Outcome {
        /// Name of the command.
        command: String,
        /// Name of the outcome.
        outcome: String,
    },
    /// `line.touch.out`.
    Value {
        /// Name of the command.
        command: String,
        /// Id of the primitive.
        primitive: String,
        /// Name of its output.
        port: String,
    },
    /// `topic(flange/touches)`.
    Topic {
        /// Name of the topic.
        topic: String,
    },
    /// Negates the last operand.
    Not,
    /// Both of the last two operands.
    And,
    /// At least one of the last two operands.
    Or,
}

impl ConditionTerm {
    /// Returns the name of the command that the term looks at.
    #[must_use]
    pub fn command(&self) -> Option<&str> {
        match self {
            ConditionTerm::State { command, .. }
            | ConditionTerm::Reason { command, .. }
            | ConditionTerm::Outcome { command, .. }
            | ConditionTerm::Value { command, .. } => Some(command),
            _ => None,
        }
    }
}

/// Why a text is not a condition.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}, at character {column}")]
pub struct ConditionError {
    /// Character, counted from 1.
    pub column: usize,
    /// The fault.
    pub message: String,
    /// The remedy.
    pub help: String,
}

/// Deepest nesting of parentheses and negations.
const DEPTH_MAX: usize = 32;

/// States that a condition can name.
const STATES: [CommandState; 4] = [
    CommandState::Ready,
    CommandState::Running,
    CommandState::Canceling,
    CommandState::Terminated,
];
/// Reasons that a condition can name.
const REASONS: [EndReason; 4] = [
    EndReason::Finished,
    EndReason::Canceled,
    EndReason::Aborted,
    EndReason::Fault,
];

/// Parses a condition into postfix notation.
///
/// # Errors
/// Returns the first fault with its place.
pub fn parse(text: &str) -> Result<Vec<ConditionTerm>, ConditionError> {
    let tokens = tokens(text)?;
    let mut parser = Parser {
        tokens: &tokens,
        at: 0,
        end: text.chars().count() + 1,
        terms: Vec::new(),
        depth: 0,
    };
    parser.either()?;
    match parser.peek() {
        None => Ok(parser.terms),
        Some(_) => Err(parser.fault(
            "expected `and`, `or` or the end",
            "join comparisons by `and` or `or`: `a.outcome == done and not b.grip.out`",
        )),
    }
}

/// Returns the condition with the names of its commands replaced; a text that is not a condition stays as it is.
#[must_use]
pub fn with_commands(text: &str, name_of: &dyn Fn(&str) -> String) -> String {
    let Ok(tokens) = tokens(text) else {
        return text.to_owned();
    };
    let mut out = String::new();
    let mut rest = text.chars();
    let mut at = 1;
    for (place, (column, token)) in tokens.iter().enumerate() {
        let Token::Word(word) = token else {
            continue;
        };
        let before = |distance: usize| {
            let token = tokens.get(place.checked_sub(distance)?);
            token.map(|(_, token)| token)
        };
        // What is compared with is no command, and neither is the name of a topic.
        let is_value = matches!(before(1), Some(Token::Equal | Token::Unequal));
        let is_topic = matches!(before(2), Some(Token::Word(word)) if word == "topic");
        let Some((command, what)) = word.split_once('.').filter(|_| !is_value && !is_topic) else {
            continue;
        };
        out.extend(rest.by_ref().take(column - at));
        out.push_str(&name_of(command));
        out.push('.');
        out.push_str(what);
        rest.by_ref().take(word.chars().count()).for_each(drop);
        at = column + word.chars().count();
    }
    out.extend(rest);
    out
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Token {
    Word(String),
    Equal,
    Unequal,
    Open,
    Close,
}

fn is_word(character: char) -> bool {
    character.is_alphanumeric() || "_-#./[]".contains(character)
}

fn tokens(text: &str) -> Result<Vec<(usize, Token)>, ConditionError> {
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
                    help: "a condition has names, `==`, `!=`, `and`, `or`, `not`, `topic(…)` and parentheses"
                        .to_owned(),
                });
            }
        };
        tokens.push((column, token));
    }
    Ok(tokens)
}

struct Parser<'t> {
    tokens: &'t [(usize, Token)],
    at: usize,
    end: usize,
    terms: Vec<ConditionTerm>,
    depth: usize,
}

impl Parser<'_> {
    fn peek(&self) -> Option<&Token> {
        self.tokens.get(self.at).map(|(_, token)| token)
    }

    fn fault(&self, message: impl Into<String>, help: impl Into<String>) -> ConditionError {
        let place = self.tokens.get(self.at);
        ConditionError {
            column: place.map_or(self.end, |(column, _)| *column),
            message: message.into(),
            help: help.into(),
        }
    }

    fn take_word(&mut self, wanted: &str) -> bool {
        let found = matches!(self.peek(), Some(Token::Word(word)) if word == wanted);
        self.at += usize::from(found);
        found
    }

    fn take(&mut self, wanted: &Token) -> bool {
        let found = self.peek() == Some(wanted);
        self.at += usize::from(found);
        found
    }

    fn either(&mut self) -> Result<(), ConditionError> {
        self.both()?;
        while self.take_word("or") {
            self.both()?;
            self.terms.push(ConditionTerm::Or);
        }
        Ok(())
    }

    fn both(&mut self) -> Result<(), ConditionError> {
        self.negation()?;
        while self.take_word("and") {
            self.negation()?;
            self.terms.push(ConditionTerm::And);
        }
        Ok(())
    }

    fn negation(&mut self) -> Result<(), ConditionError> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            return Err(self.fault("nested too deeply", "write it with fewer parentheses"));
        }
        if self.take_word("not") {
            self.negation()?;
            self.terms.push(ConditionTerm::Not);
        } else if self.take(&Token::Open) {
            self.either()?;
            if !self.take(&Token::Close) {
                return Err(self.fault("expected `)`", "close the parenthesis"));
            }
        } else {
            self.term()?;
        }
        self.depth -= 1;
        Ok(())
    }

    fn term(&mut self) -> Result<(), ConditionError> {
        let Some(Token::Word(word)) = self.peek().cloned() else {
            return Err(self.fault(
                "expected a comparison, an output or a topic",
                "for example `line.outcome == touched`, `line.touch.out` or `topic(part/there)`",
            ));
        };
        if ["and", "or", "not"].contains(&word.as_str()) {
            return Err(self.fault(
                format!("expected a comparison before `{word}`"),
                "for example `line.outcome == touched`",
            ));
        }
        let term = match word.as_str() {
            "true" => {
                self.at += 1;
                ConditionTerm::True
            }
            "topic" => self.topic()?,
            _ => return self.about_command(&word),
        };
        self.terms.push(term);
        Ok(())
    }

    fn topic(&mut self) -> Result<ConditionTerm, ConditionError> {
        self.at += 1;
        let help = "for example `topic(part/there)`";
        if !self.take(&Token::Open) {
            return Err(self.fault("expected `(` after `topic`", help));
        }
        let Some(Token::Word(topic)) = self.peek().cloned() else {
            return Err(self.fault("expected the name of a topic", help));
        };
        self.at += 1;
        if !self.take(&Token::Close) {
            return Err(self.fault("expected `)` after the name of the topic", help));
        }
        Ok(ConditionTerm::Topic { topic })
    }

    /// `line.outcome == touched`, `line.touch.out`.
    fn about_command(&mut self, word: &str) -> Result<(), ConditionError> {
        let Some((command, what)) = word.split_once('.') else {
            return Err(self.fault(
                format!("`{word}` is not a condition"),
                format!(
                    "say what about it: `{word}.outcome == …`, `{word}.state == …`, `{word}.reason == …` or an output \
                     `{word}.primitive.port`"
                ),
            ));
        };
        let command = command.to_owned();
        if ["state", "reason", "outcome"].contains(&what) {
            self.at += 1;
            return self.comparison(command, what);
        }
        let Some((primitive, port)) = what.rsplit_once('.') else {
            let known = ["state", "reason", "outcome"];
            let help = match closest(what, known) {
                Some(near) => format!("did you mean `{command}.{near}`?"),
                None => format!(
                    "write `{command}.outcome`, `.state` or `.reason`, or an output `{command}.{what}.out`"
                ),
            };
            return Err(self.fault(format!("`{word}` is neither a state nor an output"), help));
        };
        if command.is_empty() || primitive.is_empty() || port.is_empty() {
            return Err(self.fault(
                format!("`{word}` lacks a name"),
                "write `net.primitive.port`",
            ));
        }
        let (primitive, port) = (primitive.to_owned(), port.to_owned());
        self.at += 1;
        if matches!(self.peek(), Some(Token::Equal | Token::Unequal)) {
            return Err(self.fault(
                "an output of type Bool is not compared",
                format!("write `{word}` or `not {word}`"),
            ));
        }
        self.terms.push(ConditionTerm::Value {
            command,
            primitive,
            port,
        });
        Ok(())
    }

    fn comparison(&mut self, command: String, what: &str) -> Result<(), ConditionError> {
        let negated = match self.peek() {
            Some(Token::Equal) => false,
            Some(Token::Unequal) => true,
            _ => {
                return Err(self.fault(
                    format!("expected `==` or `!=` after `{what}`"),
                    format!("for example `{command}.{what} == …`"),
                ));
            }
        };
        self.at += 1;
        let Some(Token::Word(value)) = self.peek().cloned() else {
            return Err(self.fault(
                format!("expected the {what} after the comparison"),
                format!("for example `{command}.{what} == …`"),
            ));
        };
        let term = match what {
            "state" => {
                let state = STATES.into_iter().find(|state| state.name() == value);
                let state = state
                    .ok_or_else(|| self.no_such(what, &value, STATES.map(CommandState::name)))?;
                ConditionTerm::State { command, state }
            }
            "reason" => {
                let reason = REASONS.into_iter().find(|reason| reason.name() == value);
                let reason = reason
                    .ok_or_else(|| self.no_such(what, &value, REASONS.map(EndReason::name)))?;
                ConditionTerm::Reason { command, reason }
            }
            _ => ConditionTerm::Outcome {
                command,
                outcome: value,
            },
        };
        self.at += 1;
        self.terms.push(term);
        if negated {
            self.terms.push(ConditionTerm::Not);
        }
        Ok(())
    }

    fn no_such(&self, what: &str, value: &str, known: [&'static str; 4]) -> ConditionError {
        let help = match closest(value, known) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("it is one of {}", known.join(", ")),
        };
        self.fault(format!("`{value}` is not a {what}"), help)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(command: &str, outcome: &str) -> ConditionTerm {
        ConditionTerm::Outcome {
            command: command.to_owned(),
            outcome: outcome.to_owned(),
        }
    }

    fn value(command: &str, primitive: &str, port: &str) -> ConditionTerm {
        ConditionTerm::Value {
            command: command.to_owned(),
            primitive: primitive.to_owned(),
            port: port.to_owned(),
        }
    }

    #[test]
    fn a_condition_becomes_postfix() {
        let topic = ConditionTerm::Topic {
            topic: "part/there".to_owned(),
        };
        let cases = [
            ("true", vec![ConditionTerm::True]),
            (
                "guarded-move.outcome == touched",
                vec![outcome("guarded-move", "touched")],
            ),
            (
                "a#7.outcome != touched",
                vec![outcome("a#7", "touched"), ConditionTerm::Not],
            ),
            (
                "a.t.out or a.t.out and not topic(part/there)",
                vec![
                    value("a", "t", "out"),
                    value("a", "t", "out"),
                    topic.clone(),
                    ConditionTerm::Not,
                    ConditionTerm::And,
                    ConditionTerm::Or,
                ],
            ),
            (
                "(a.t.out or #3.state == running) and a.arm.t.out",
                vec![
                    value("a", "t", "out"),
                    ConditionTerm::State {
                        command: "#3".to_owned(),
                        state: CommandState::Running,
                    },
                    ConditionTerm::Or,
                    value("a", "arm.t", "out"),
                    ConditionTerm::And,
                ],
            ),
            (
                "a.reason == fault",
                vec![ConditionTerm::Reason {
                    command: "a".to_owned(),
                    reason: EndReason::Fault,
                }],
            ),
        ];
        for (text, terms) in cases {
            assert_eq!(parse(text), Ok(terms), "{text}");
        }
    }

    #[test]
    fn names_of_commands_are_replaced_and_nothing_else() {
        let named = |name: &str| format!("{name}#1");
        for (text, expected) in [
            (
                "a.outcome == b.c  or(d.e.f)",
                "a#1.outcome == b.c  or(d#1.e.f)",
            ),
            (
                "not topic(a.b) and x.state != ready",
                "not topic(a.b) and x#1.state != ready",
            ),
            ("ä.t.out and true", "ä#1.t.out and true"),
            ("a.outcome = b", "a.outcome = b"),
        ] {
            assert_eq!(with_commands(text, &named), expected);
        }
    }

    #[test]
    fn a_fault_has_its_place_and_a_remedy() {
        for (text, column, part) in [
            ("", 1, "outcome =="),
            ("a.outcome", 10, "=="),
            ("a.outcome = done", 11, "`==`"),
            ("a.outcome == done b.t.out", 19, "`and`"),
            ("a.outcme == done", 1, "a.outcome"),
            ("a.state == runing", 12, "running"),
            ("a.reason == touched", 13, "finished"),
            ("line", 1, "line.outcome"),
            ("a.t.out == true", 9, "not a.t.out"),
            ("(a.t.out", 9, "close"),
            ("topic part/there", 7, "topic(part/there)"),
            ("not and", 5, "outcome =="),
            ("a.t.out & b.t.out", 9, "`and`"),
            ("a..out", 1, "net.primitive.port"),
        ] {
            let fault = parse(text).expect_err(text);
            assert_eq!(fault.column, column, "{text}: {fault:?}");
            assert!(fault.help.contains(part), "{text}: {fault:?}");
        }
        let deep = format!("{}true", "not ".repeat(100_000));
        assert!(parse(&deep).is_err());
    }
}
