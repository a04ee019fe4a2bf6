//! Errors of expressions, with their place in the text. Runs on the loader's threads.

use std::ops::Range;

use thiserror::Error;

/// A problem of an expression and its place in the text, bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpressionError {
    /// The place.
    pub place: Range<usize>,
    /// The problem.
    pub problem: Problem,
    /// The remedy, if the general one is not enough.
    pub help: Option<String>,
}

/// A problem of an expression.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Problem {
    /// A character that begins no token.
    #[error("unexpected `{found}`")]
    Character {
        /// The character.
        found: String,
    },
    /// A token at a place where another is needed.
    #[error("expected {wanted}, found {found}")]
    Token {
        /// The expected token.
        wanted: &'static str,
        /// The token.
        found: String,
    },
    /// A parenthesis or bracket without its counterpart.
    #[error("`{opening}` is never closed")]
    Unclosed {
        /// The opening one.
        opening: &'static str,
    },
    /// A comparison of a comparison.
    #[error("comparisons cannot be chained")]
    Chained,
    /// A number that cannot be read.
    #[error("{reason}")]
    Number {
        /// The reason.
        reason: String,
    },
    /// A name that is not that of an output.
    #[error("`{name}` is not a reference to an output")]
    Reference {
        /// The name.
        name: String,
    },
    /// A word that is neither an input nor an output.
    #[error("the formula has no input `{name}`")]
    Input {
        /// The word.
        name: String,
    },
    /// A function that does not exist.
    #[error("unknown function `{name}`")]
    Function {
        /// The name.
        name: String,
    },
    /// A function with too few or too many arguments.
    #[error("`{name}` takes {wanted}, found {found}")]
    Arguments {
        /// The function.
        name: String,
        /// The number of arguments, in words.
        wanted: String,
        /// The number that was given.
        found: usize,
    },
    /// A function with several outputs of which none is named.
    #[error("`{name}` has several outputs")]
    Outputs {
        /// The function.
        name: String,
    },
    /// A part of a value that has none.
    #[error("`{part}` cannot be read from this value")]
    Part {
        /// The part.
        part: String,
    },
    /// A start value of `prev` that is not a constant.
    #[error("the second argument of `prev` must be a constant")]
    Initial,
    /// A value that an expression cannot contain.
    #[error("`{name}` is a mapping of conditions, which has no value")]
    Outcomes {
        /// The input.
        name: String,
    },
    /// More than [`super::LENGTH_MAX`] bytes.
    #[error("the formula is too long: at most {} characters", super::LENGTH_MAX)]
    TooLong,
    /// More than [`super::DEPTH_MAX`] levels.
    #[error(
        "the formula is nested too deeply: at most {} levels",
        super::DEPTH_MAX
    )]
    TooDeep,
    /// More than [`super::LIST_ELEMENTS_MAX`] elements in the lists of all expressions of a net.
    #[error(
        "the lists in the formulas of a net have more than {} elements together",
        super::LIST_ELEMENTS_MAX
    )]
    ListElements,
}

impl Problem {
    /// Returns the error at a place, without a remedy of its own.
    #[must_use]
    pub fn at(self, place: Range<usize>) -> ExpressionError {
        ExpressionError {
            place,
            problem: self,
            help: None,
        }
    }

    /// Returns the code of the diagnostic.
    #[must_use]
    pub fn code(&self) -> &'static str {
        use crate::codes;
        match self {
            Problem::Number { .. } => codes::BAD_QUANTITY,
            Problem::Input { .. } => codes::UNKNOWN_INPUT,
            Problem::Function { .. } => codes::UNKNOWN_FUNCTION,
            Problem::Part { .. } => codes::BAD_ELEMENT,
            Problem::ListElements => codes::NET_TOO_LARGE,
            _ => codes::BAD_FORMULA,
        }
    }
}

impl ExpressionError {
    /// Sets the remedy.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> ExpressionError {
        ExpressionError {
            help: Some(help.into()),
            ..self
        }
    }
}
