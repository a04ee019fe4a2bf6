//! The parser of expressions: precedence climbing (Pratt, "Top down operator precedence", POPL 1973), text →
//! [`Expression`]. Runs on the loader's threads.

use std::ops::Range;

use rcc_config::diagnostic::closest;
use rcc_config::quantity;
use rcc_core::primitive::Spec;

use super::error::{ExpressionError, Problem};
use super::functions::{COMPARISON, INFIX, Infix, NOT, REPEATED, SIGN, functions, spec};
use super::lexer::{KEYWORDS, Lexer, Token};
use super::{DEPTH_MAX, LENGTH_MAX};
use crate::syntax::literal::LiteralShape;

/// An expression: its terms in the order of evaluation, each after its operands. The last one is the result.
#[derive(Clone, Debug, Default)]
pub struct Expression {
    /// The terms.
    pub terms: Vec<Term>,
}

/// A term and its place in the text, bytes.
#[derive(Clone, Debug)]
pub struct Term {
    /// Operation, constant or name.
    pub kind: TermKind,
    /// The place.
    pub place: Range<usize>,
}

/// The kinds of terms. Operands are numbers of earlier terms.
#[derive(Clone, Debug)]
pub enum TermKind {
    /// A constant.
    Constant(LiteralShape),
    /// A parameter of the fragment, `$gain`.
    Parameter(String),
    /// A named input, an output, or an input of the fragment.
    Name(String),
    /// A primitive of the catalogue.
    Apply(Application),
    /// `a * b`: `Multiply` or `Scale`, depending on the types.
    Product(usize, usize),
    /// `prev(x, initial)`.
    Previous(usize, Option<usize>),
    /// `[a, b, c]`.
    List(Vec<usize>),
    /// `(…).x` or `(…)[2]`, with the part as written.
    Part(usize, String),
}

/// A primitive with its operands.
#[derive(Clone, Debug)]
pub struct Application {
    /// The primitive.
    pub spec: &'static Spec,
    /// The operator or function as written.
    pub symbol: String,
    /// Operands in the order of the inputs; optional inputs at the end may be missing.
    pub operands: Vec<usize>,
}

struct Parser<'t> {
    text: &'t str,
    lexer: Lexer<'t>,
    token: Token<'t>,
    place: Range<usize>,
    terms: Vec<Term>,
    depth: usize,
}

type Parsed = Result<usize, ExpressionError>;

/// Parses an expression that begins at the byte `from` of a text.
///
/// # Errors
/// Returns the first problem. An expression is short, and what follows a problem is guesswork.
pub fn parse(text: &str, from: usize) -> Result<Expression, ExpressionError> {
    if text.len() > LENGTH_MAX {
        return Err(Problem::TooLong.at(0..text.len()));
    }
    let mut parser = Parser {
        text,
        lexer: Lexer::new(text, from),
        token: Token::End,
        place: 0..0,
        terms: Vec::new(),
        depth: 0,
    };
    parser.advance()?;
    parser.expression(0)?;
    match parser.token {
        Token::End => Ok(Expression {
            terms: parser.terms,
        }),
        Token::Symbol(")" | "]") => Err(parser.unexpected("an operator or the end")),
        _ => Err(parser.unexpected("an operator")),
    }
}

impl<'t> Parser<'t> {
    fn advance(&mut self) -> Result<(), ExpressionError> {
        (self.token, self.place) = self.lexer.next()?;
        Ok(())
    }

    fn unexpected(&self, wanted: &'static str) -> ExpressionError {
        let found = match self.token {
            Token::End => "the end of the formula".to_owned(),
            Token::Symbol(text) => format!("`{text}`"),
            Token::Number(text) | Token::Word(text) | Token::Parameter(text) => format!("`{text}`"),
        };
        Problem::Token { wanted, found }.at(self.place.clone())
    }

    /// Skips a symbol; returns false if another token is next.
    fn skip(&mut self, symbol: &str) -> Result<bool, ExpressionError> {
        let is_it = matches!(self.token, Token::Symbol(found) if found == symbol);
        if is_it {
            self.advance()?;
        }
        Ok(is_it)
    }

    /// Skips a keyword of `if`.
    fn keyword(&mut self, word: &str, wanted: &'static str) -> Result<(), ExpressionError> {
        if self.token != Token::Word(word) {
            return Err(self.unexpected(wanted));
        }
        self.advance()
    }

    fn add(&mut self, kind: TermKind, place: Range<usize>) -> usize {
        self.terms.push(Term { kind, place });
        self.terms.len() - 1
    }

    fn apply(
        &mut self,
        primitive: &str,
        symbol: &str,
        operands: Vec<usize>,
        place: Range<usize>,
    ) -> usize {
        let application = Application {
            spec: spec(primitive),
            symbol: symbol.to_owned(),
            operands,
        };
        self.add(TermKind::Apply(application), place)
    }

    fn start_of(&self, term: usize) -> usize {
        self.terms.get(term).map_or(0, |term| term.place.start)
    }

    fn end_of(&self, term: usize) -> usize {
        self.terms.get(term).map_or(0, |term| term.place.end)
    }

    /// Parses an expression of operators that bind more strongly than `power`.
    fn expression(&mut self, power: u8) -> Parsed {
        if self.depth >= DEPTH_MAX {
            return Err(Problem::TooDeep.at(self.place.clone()));
        }
        self.depth += 1;
        let start = self.place.start;
        let mut left = self.operand()?;
        let mut compared = false;
        while let Some(infix) = self.infix().filter(|infix| infix.power > power) {
            if compared && infix.power == COMPARISON {
                let help = "combine them: `a < b and b < c`";
                return Err(Problem::Chained.at(self.place.clone()).help(help));
            }
            compared = infix.power == COMPARISON;
            self.advance()?;
            let right = self.expression(infix.power)?;
            left = self.join(infix, left, right, start);
        }
        self.depth -= 1;
        Ok(left)
    }

    fn infix(&self) -> Option<&'static Infix> {
        let (Token::Symbol(symbol) | Token::Word(symbol)) = self.token else {
            return None;
        };
        INFIX.iter().find(|infix| infix.symbol == symbol)
    }

    fn join(&mut self, infix: &Infix, left: usize, right: usize, start: usize) -> usize {
        let place = start..self.end_of(right);
        if infix.primitive.is_empty() {
            return self.add(TermKind::Product(left, right), place);
        }
        let operands = vec![left, right];
        let joined = self.apply(infix.primitive, infix.symbol, operands, place.clone());
        match infix.inverted {
            true => self.apply("Not", infix.symbol, vec![joined], place),
            false => joined,
        }
    }

    /// Parses an operand with the parts that are selected from it.
    fn operand(&mut self) -> Parsed {
        let mut operand = self.primary()?;
        let start = self.start_of(operand);
        loop {
            let opening = self.place.clone();
            let end = match self.token {
                Token::Symbol("[") => self.lexer.bracket(&opening)?,
                Token::Symbol(".") => {
                    self.advance()?;
                    let Token::Word(_) = self.token else {
                        return Err(self.unexpected("the name of a part"));
                    };
                    self.place.end
                }
                _ => return Ok(operand),
            };
            let part = self.text.get(opening.start..end).unwrap_or("").to_owned();
            operand = self.add(TermKind::Part(operand, part), start..end);
            self.advance()?;
        }
    }

    fn primary(&mut self) -> Parsed {
        let place = self.place.clone();
        match self.token {
            Token::Number(text) => {
                self.advance()?;
                let shape = number(text, &place)?;
                Ok(self.add(TermKind::Constant(shape), place))
            }
            Token::Parameter(text) => {
                self.advance()?;
                Ok(self.add(TermKind::Parameter(text.to_owned()), place))
            }
            Token::Word(word) => self.word(word),
            Token::Symbol("(") => self.parentheses(),
            Token::Symbol("[") => {
                self.advance()?;
                let (elements, end) = self.arguments("]", &place)?;
                Ok(self.add(TermKind::List(elements), place.start..end))
            }
            Token::Symbol("-") => {
                self.advance()?;
                let operand = self.expression(SIGN)?;
                let place = place.start..self.end_of(operand);
                Ok(self.apply("Negate", "-", vec![operand], place))
            }
            Token::Symbol("+") => Err(self.unexpected("a value").help("remove the `+`")),
            _ => Err(self.unexpected("a value")),
        }
    }

    fn parentheses(&mut self) -> Parsed {
        let opening = self.place.clone();
        self.advance()?;
        let inside = self.expression(0)?;
        let end = self.place.end;
        self.close(")", &opening)?;
        if let Some(term) = self.terms.get_mut(inside) {
            term.place = opening.start..end;
        }
        Ok(inside)
    }

    /// Skips a closing parenthesis or bracket.
    fn close(&mut self, closing: &str, opening: &Range<usize>) -> Result<(), ExpressionError> {
        if self.skip(closing)? {
            return Ok(());
        }
        if self.token == Token::End {
            let opening_symbol = if closing == ")" { "(" } else { "[" };
            let problem = Problem::Unclosed {
                opening: opening_symbol,
            };
            return Err(problem.at(opening.clone()));
        }
        Err(self.unexpected(match closing {
            ")" => "an operator or `)`",
            _ => "an operator, `,` or `]`",
        }))
    }

    /// Parses expressions separated by commas; returns them and the end of the closing parenthesis or bracket.
    fn arguments(
        &mut self,
        closing: &str,
        opening: &Range<usize>,
    ) -> Result<(Vec<usize>, usize), ExpressionError> {
        let mut arguments = Vec::new();
        loop {
            let end = self.place.end;
            if arguments.is_empty() && self.skip(closing)? {
                return Ok((arguments, end));
            }
            arguments.push(self.expression(0)?);
            let end = self.place.end;
            if !self.skip(",")? {
                self.close(closing, opening)?;
                return Ok((arguments, end));
            }
        }
    }

    fn word(&mut self, word: &'t str) -> Parsed {
        let place = self.place.clone();
        let constant = match word {
            "true" => Some(LiteralShape::Bool(true)),
            "false" => Some(LiteralShape::Bool(false)),
            "null" => Some(LiteralShape::Null),
            "if" => return self.choice(),
            "not" => {
                self.advance()?;
                let operand = self.expression(NOT)?;
                let place = place.start..self.end_of(operand);
                return Ok(self.apply("Not", "not", vec![operand], place));
            }
            "and" | "or" | "then" | "else" => return Err(self.unexpected("a value")),
            _ => None,
        };
        self.advance()?;
        if let Some(shape) = constant {
            return Ok(self.add(TermKind::Constant(shape), place));
        }
        if self.token == Token::Symbol("(") {
            return self.call(word, place);
        }
        if self.token == Token::Symbol("[") {
            let opening = self.place.clone();
            let end = self.lexer.bracket(&opening)?;
            self.advance()?;
            let name = self.text.get(place.start..end).unwrap_or("");
            return Ok(self.add(TermKind::Name(name.to_owned()), place.start..end));
        }
        if word == "prev" {
            return Err(self.unexpected("`(`").help("write `prev(x, initial)`"));
        }
        Ok(self.add(TermKind::Name(word.to_owned()), place))
    }

    fn choice(&mut self) -> Parsed {
        let start = self.place.start;
        self.advance()?;
        let condition = self.expression(0)?;
        self.keyword("then", "an operator or `then`")?;
        let yes = self.expression(0)?;
        self.keyword("else", "an operator or `else`")?;
        let no = self.expression(0)?;
        let place = start..self.end_of(no);
        Ok(self.apply("Select", "if", vec![condition, yes, no], place))
    }

    fn call(&mut self, name: &str, name_place: Range<usize>) -> Parsed {
        let opening = self.place.clone();
        self.advance()?;
        let (operands, end) = self.arguments(")", &opening)?;
        let place = name_place.start..end;
        let wrong = |wanted: String| Problem::Arguments {
            name: name.to_owned(),
            wanted,
            found: operands.len(),
        };
        if name == "prev" {
            return match *operands.as_slice() {
                [value] => Ok(self.add(TermKind::Previous(value, None), place)),
                [value, initial] => Ok(self.add(TermKind::Previous(value, Some(initial)), place)),
                _ => Err(wrong("a value and its initial value".to_owned()).at(place)),
            };
        }
        let Some(&spec) = functions().get(name) else {
            return Err(unknown_function(name, name_place));
        };
        let most = spec.inputs.len();
        let least = spec.inputs.iter().filter(|port| port.default.is_none());
        let least = least.count();
        let repeats = REPEATED.contains(&spec.name) && operands.len() >= most;
        if !repeats && !(least..=most).contains(&operands.len()) {
            let names: Vec<&str> = spec.inputs.iter().map(|port| port.name).collect();
            let wanted = match (REPEATED.contains(&spec.name), least == most, most) {
                (true, ..) => format!("at least {most} arguments"),
                (_, true, 1) => "1 argument".to_owned(),
                (_, true, _) => format!("{most} arguments"),
                (_, false, _) => format!("{least} to {most} arguments"),
            };
            let help = format!("write `{name}({})`", names.join(", "));
            return Err(wrong(wanted).at(place).help(help));
        }
        let (first, others) = match repeats {
            true => operands.split_at(most),
            false => operands.split_at(operands.len()),
        };
        let mut result = self.apply(spec.name, name, first.to_vec(), place.clone());
        for other in others {
            result = self.apply(spec.name, name, vec![result, *other], place.clone());
        }
        Ok(result)
    }
}

fn unknown_function(name: &str, place: Range<usize>) -> ExpressionError {
    let error = Problem::Function {
        name: name.to_owned(),
    };
    let names = functions().keys().map(String::as_str);
    let help = match closest(name, names) {
        _ if name.contains('.') => "a function has no point in its name".to_owned(),
        Some(near) if !KEYWORDS.contains(&near) => format!("did you mean `{near}`?"),
        _ => "functions are the primitives without memory and parameters, in lower case: `square_root`; anything else is a primitive of its own".to_owned(),
    };
    error.at(place).help(help)
}

/// Reads a number, with its unit if it has one.
fn number(text: &str, place: &Range<usize>) -> Result<LiteralShape, ExpressionError> {
    let refused = |reason: String| Problem::Number { reason }.at(place.clone());
    let is_plain = |c: char| c.is_ascii_digit() || matches!(c, '.' | 'e' | 'E' | '+' | '-');
    if !text.chars().all(is_plain) {
        let quantity = quantity::parse(text).map_err(|error| {
            let error = refused(error.to_string());
            match text.contains(['*', '/']) {
                true => error.help(
                    "a unit has no spaces in it; put spaces around `*` and `/` that are operators",
                ),
                false => error,
            }
        })?;
        return Ok(LiteralShape::Real(quantity.value, quantity.unit));
    }
    if let Ok(whole) = text.parse() {
        return Ok(LiteralShape::Int(whole));
    }
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(LiteralShape::Real(value, None)),
        Ok(_) => Err(refused(format!("`{text}` is too large"))),
        Err(_) => Err(refused(format!("`{text}` is not a number"))),
    }
}
