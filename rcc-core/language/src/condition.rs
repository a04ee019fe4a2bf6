//! Conditions of rules: text over states, outcomes and values of commands, to terms in postfix notation. Names stay
//! names; the installation of the rule resolves them. Runs on the loader's threads and in the command line.

use rcc_config::diagnostic::closest;
use rcc_core::message::{CommandState, EndReason};
use rcc_protocol::rules::Relation;
use tokens::{Token, tokens};

mod tokens;

/// One element of a condition in postfix notation.
#[derive(Clone, Debug, PartialEq)]
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
    /// `line.ft.fz > 30`.
    Compare {
        /// Name of the command.
        command: String,
        /// Id of the primitive.
        primitive: String,
        /// Name of its output, with an index if it has several elements.
        port: String,
        /// The comparison.
        relation: Relation,
        /// The limit that the value is compared with, in the unit of the port; finite.
        limit: f64,
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
            | ConditionTerm::Value { command, .. }
            | ConditionTerm::Compare { command, .. } => Some(command),
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
    parse_text(text, false)
}

/// As [`parse`], but an output may also be named as `primitive.port`: its command is the empty name, for whoever knows
/// which commands there are.
///
/// # Errors
/// Returns the first fault with its place.
pub fn parse_short(text: &str) -> Result<Vec<ConditionTerm>, ConditionError> {
    parse_text(text, true)
}

fn parse_text(text: &str, short: bool) -> Result<Vec<ConditionTerm>, ConditionError> {
    let tokens = tokens(text)?;
    let mut parser = Parser {
        tokens: &tokens,
        at: 0,
        end: text.chars().count() + 1,
        terms: Vec::new(),
        depth: 0,
        short,
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
        // The limit of a comparison is not a command, nor is the name of a topic.
        let is_value = matches!(
            before(1),
            Some(Token::Equal | Token::Unequal | Token::Compare(_))
        );
        let called = |name: &str| name == "topic" || name == "deg";
        let is_topic = matches!(before(2), Some(Token::Word(word)) if called(word))
            && matches!(before(1), Some(Token::Open));
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

struct Parser<'t> {
    tokens: &'t [(usize, Token)],
    at: usize,
    end: usize,
    terms: Vec<ConditionTerm>,
    depth: usize,
    /// Outputs may be named without their command.
    short: bool,
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
        let Some((first, what)) = word.split_once('.') else {
            return Err(self.fault(
                format!("`{word}` is not a condition"),
                format!(
                    "say what about it: `{word}.outcome == …`, `{word}.state == …`, `{word}.reason == …` or an output \
                     `{word}.primitive.port`"
                ),
            ));
        };
        let command = first.to_owned();
        if ["state", "reason", "outcome"].contains(&what) {
            self.at += 1;
            return self.comparison(command, what);
        }
        let is_compared = matches!(
            self.tokens.get(self.at + 1),
            Some((_, Token::Equal | Token::Unequal))
        );
        let (command, primitive, port) = match what.rsplit_once('.') {
            Some((primitive, port)) => (command, primitive, port),
            None if self.short && !is_compared => (String::new(), first, what),
            None => return Err(self.neither_state_nor_output(word, &command, what)),
        };
        if word.starts_with('.') || primitive.is_empty() || port.is_empty() {
            return Err(self.fault(
                format!("`{word}` lacks a name"),
                "write `net.primitive.port`",
            ));
        }
        let (primitive, port) = (primitive.to_owned(), port.to_owned());
        self.at += 1;
        let term = match self.peek().cloned() {
            Some(Token::Equal | Token::Unequal) => {
                return Err(self.fault(
                    "an output is not compared by `==` or `!=`",
                    format!("write `{word}` or `not {word}` for a Bool, `{word} > …` or `{word} < …` for a number"),
                ));
            }
            Some(Token::Compare(relation)) => {
                self.at += 1;
                ConditionTerm::Compare {
                    command,
                    primitive,
                    port,
                    relation,
                    limit: self.limit()?,
                }
            }
            _ => ConditionTerm::Value {
                command,
                primitive,
                port,
            },
        };
        self.terms.push(term);
        Ok(())
    }

    fn neither_state_nor_output(&self, word: &str, command: &str, what: &str) -> ConditionError {
        let known = ["state", "reason", "outcome"];
        let help = match closest(what, known) {
            Some(near) => format!("did you mean `{command}.{near}`?"),
            None => format!(
                "write `{command}.outcome`, `.state` or `.reason`, or an output `{command}.{what}.out`"
            ),
        };
        self.fault(format!("`{word}` is neither a state nor an output"), help)
    }

    /// A number, or an angle as `deg(30)`.
    fn limit(&mut self) -> Result<f64, ConditionError> {
        let in_degrees = self.take_word("deg");
        if in_degrees && !self.take(&Token::Open) {
            return Err(self.fault("expected `(` after `deg`", "for example `deg(30)`"));
        }
        let value = match self.peek() {
            Some(Token::Word(word)) => word.parse::<f64>().ok(),
            _ => None,
        };
        let Some(value) = value.filter(|value| value.is_finite()) else {
            return Err(self.fault(
                "expected a number after the comparison",
                "in the unit of the port: `line.ft.fz > 30`, `line.arm.position[3] < deg(-20)`",
            ));
        };
        self.at += 1;
        if in_degrees && !self.take(&Token::Close) {
            return Err(self.fault("expected `)` after the angle", "for example `deg(30)`"));
        }
        Ok(if in_degrees {
            value.to_radians()
        } else {
            value
        })
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
mod tests;
