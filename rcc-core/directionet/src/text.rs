//! The parser of DirectIONet: a tree in which everything has a span. It knows no types. Text after the first syntax
//! error is not parsed, so there is at most one diagnostic. Runs on the loader's threads.
//!
//! ```text
//! fragment  = "{" [ item { "," item } ] "}"
//! item      = name [debug] "=" primitive [ "." port ]
//! primitive = name | name "(" [ argument { "," argument } ] ")" | fragment "(" [ argument { "," argument } ] ")"
//! argument  = name [debug] "=" ( "'" text "'" | primitive "." port )
//! debug     = "[" digits [ "." digits ] "]"
//! name      = one or more of A-Z a-z 0-9 : _
//! ```

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::{BYTES_MAX, Key, TOO_LARGE};
use rcc_language::codes;

/// Deepest nesting of fragments and inline primitives.
pub const DEPTH_MAX: usize = 64;

/// A net, or a fragment of one.
#[derive(Clone, Debug, Default)]
pub struct AstFragment {
    /// Its contents and outputs, in the order of the text.
    pub items: Vec<AstItem>,
}

impl AstFragment {
    /// Returns true if something in it reads `parent.port`.
    #[must_use]
    pub fn mentions(&self, port: &str) -> bool {
        let mut items = self.items.iter();
        items.any(|item| item.primitive.mentions(port, item.port.as_ref()))
    }
}

impl AstPrimitive {
    fn mentions(&self, port: &str, read: Option<&Key>) -> bool {
        let arguments = match self {
            AstPrimitive::Named(name) => {
                return name.name == "parent" && read.is_some_and(|read| read.name == port);
            }
            AstPrimitive::Typed(_, arguments) | AstPrimitive::Fragment(_, arguments, _) => {
                arguments
            }
        };
        arguments.iter().any(|argument| match &argument.value {
            AstValue::Link(from, read) => from.mentions(port, Some(read)),
            AstValue::Text(..) => false,
        })
    }
}

/// A named primitive or fragment, or an output of the enclosing fragment.
#[derive(Clone, Debug)]
pub struct AstItem {
    /// Its name.
    pub name: Key,
    /// The primitive or fragment.
    pub primitive: AstPrimitive,
    /// The port of `primitive` that the fragment exports under the name; `None` if the name is that of the primitive.
    pub port: Option<Key>,
}

/// A primitive as the source of a link or as a definition.
#[derive(Clone, Debug)]
pub enum AstPrimitive {
    /// A reference to a name in the same fragment, or `parent`: the fragment itself, seen from inside.
    Named(Key),
    /// A primitive of a type.
    Typed(Key, Vec<AstArgument>),
    /// A fragment.
    Fragment(AstFragment, Vec<AstArgument>, Span),
}

/// A parameter or link of a primitive.
#[derive(Clone, Debug)]
pub struct AstArgument {
    /// Parameter or input.
    pub name: Key,
    /// Span of a request for a debug history.
    pub debug: Option<Span>,
    /// Its value.
    pub value: AstValue,
}

/// The value of a parameter or input.
#[derive(Clone, Debug)]
pub enum AstValue {
    /// A parameter's text without quotes, and the span inside of them.
    Text(String, Span),
    /// A link from an output.
    Link(Box<AstPrimitive>, Key),
}

/// The header lines `# key: value` before the net. They are an RCC extension: the predecessor had no comments.
#[derive(Clone, Debug, Default)]
pub struct HeaderLines {
    /// Keys and values with their spans.
    pub entries: Vec<(Key, Key)>,
}

/// Returns true if a text begins as DirectIONet does and no YAML or JSON net can: `{`, a name, `=`.
#[must_use]
pub fn looks_like(text: &str) -> bool {
    let mut reader = TextParser::new(text);
    reader.header();
    if !reader.take(b'{') {
        return false;
    }
    let Some(name) = reader.name() else {
        return false;
    };
    !name.name.is_empty() && (reader.debug().is_ok() && reader.take(b'='))
}

/// Parses a text.
///
/// # Errors
/// Returns a diagnostic at the first position that is not DirectIONet.
pub fn parse(text: &str) -> Result<(HeaderLines, AstFragment), Box<Diagnostic>> {
    if text.len() > BYTES_MAX {
        let message = format!(
            "the text has {} bytes, at most {BYTES_MAX} are allowed",
            text.len()
        );
        return Err(Box::new(
            Diagnostic::error(TOO_LARGE, Span::default(), message).anywhere(),
        ));
    }
    let mut reader = TextParser::new(text);
    let header = reader.header();
    let fragment = reader.fragment(0)?;
    reader.blanks();
    if reader.at < text.len() {
        return Err(reader.wanted("the end of the text"));
    }
    Ok((header, fragment))
}

type ParseResult<T> = Result<T, Box<Diagnostic>>;

struct TextParser<'t> {
    text: &'t str,
    at: usize,
}

impl<'t> TextParser<'t> {
    /// A parser behind the byte order mark, if there is one.
    fn new(text: &'t str) -> TextParser<'t> {
        let at = if text.starts_with('\u{feff}') { 3 } else { 0 };
        TextParser { text, at }
    }

    fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    fn blanks(&mut self) {
        while self.peek().is_some_and(|byte| byte.is_ascii_whitespace()) {
            self.at += 1;
        }
    }

    fn take(&mut self, byte: u8) -> bool {
        self.blanks();
        let there = self.peek() == Some(byte);
        self.at += usize::from(there);
        there
    }

    fn sees(&mut self, byte: u8) -> bool {
        self.blanks();
        self.peek() == Some(byte)
    }

    fn header(&mut self) -> HeaderLines {
        let mut header = HeaderLines::default();
        while self.sees(b'#') {
            let rest = self.text.get(self.at..).unwrap_or_default();
            let line = rest.lines().next().unwrap_or_default();
            if let Some((key, value)) = line.trim_start_matches('#').split_once(':') {
                let part = |part: &str| {
                    // Both are slices of the text.
                    let start = part.trim().as_ptr() as usize - self.text.as_ptr() as usize;
                    Key {
                        name: part.trim().into(),
                        span: Span::new(start, start + part.trim().len()),
                    }
                };
                header.entries.push((part(key), part(value)));
            }
            self.at += line.len();
        }
        header
    }

    /// Returns the diagnostic that `what` is expected here.
    fn wanted(&mut self, what: &str) -> Box<Diagnostic> {
        self.blanks();
        let found = self
            .text
            .get(self.at..)
            .and_then(|rest| rest.chars().next());
        let (message, length) = match found {
            Some(c) => (format!("expected {what}, found `{c}`"), c.len_utf8()),
            None => (format!("expected {what}, found the end of the text"), 0),
        };
        let span = Span::new(self.at, self.at + length);
        let diagnostic = Diagnostic::error(codes::BROKEN, span, message);
        Box::new(diagnostic.help("DirectIONet: `{name=Type(inPort=other.outPort,Parameter='text'),outTerminate=name.outPort}`"))
    }

    fn want(&mut self, byte: u8, what: &str) -> ParseResult<()> {
        if self.take(byte) {
            return Ok(());
        }
        Err(self.wanted(what))
    }

    fn name(&mut self) -> Option<Key> {
        self.blanks();
        let rest = self.text.get(self.at..).unwrap_or_default();
        let is_name = |byte: u8| byte.is_ascii_alphanumeric() || byte == b':' || byte == b'_';
        let length = rest.bytes().take_while(|byte| is_name(*byte)).count();
        let name = rest.get(..length).filter(|name| !name.is_empty())?;
        let span = Span::new(self.at, self.at + length);
        self.at += length;
        Some(Key {
            name: name.into(),
            span,
        })
    }

    fn want_name(&mut self, what: &str) -> ParseResult<Key> {
        self.name().ok_or_else(|| self.wanted(what))
    }

    fn digits(&mut self) -> bool {
        let start = self.at;
        while self.peek().is_some_and(|byte| byte.is_ascii_digit()) {
            self.at += 1;
        }
        self.at > start
    }

    fn debug(&mut self) -> ParseResult<Option<Span>> {
        self.blanks();
        let start = self.at;
        if !self.take(b'[') {
            return Ok(None);
        }
        self.blanks();
        let mut good = self.digits();
        if self.peek() == Some(b'.') {
            self.at += 1;
            good &= self.digits();
        }
        if !good {
            return Err(self.wanted("a number of seconds such as `[2.0]`"));
        }
        self.want(b']', "`]`")?;
        Ok(Some(Span::new(start, self.at)))
    }

    fn deeper(&mut self, depth: usize) -> ParseResult<usize> {
        if depth < DEPTH_MAX {
            return Ok(depth + 1);
        }
        let message = format!("fragments are nested more than {DEPTH_MAX} deep");
        let span = Span::new(self.at, self.at + 1);
        Err(Box::new(Diagnostic::error(TOO_LARGE, span, message)))
    }

    fn fragment(&mut self, depth: usize) -> ParseResult<AstFragment> {
        let depth = self.deeper(depth)?;
        self.want(b'{', "`{`")?;
        let mut fragment = AstFragment::default();
        if self.take(b'}') {
            return Ok(fragment);
        }
        loop {
            fragment.items.push(self.item(depth)?);
            if self.take(b'}') {
                return Ok(fragment);
            }
            self.want(b',', "`,` or `}`")?;
        }
    }

    fn item(&mut self, depth: usize) -> ParseResult<AstItem> {
        let name = self.want_name("the name of a primitive or output")?;
        // Intended for outputs, where it has no more meaning than at an input.
        self.debug()?;
        self.want(b'=', "`=`")?;
        let primitive = self.primitive(depth)?;
        let port = match self.take(b'.') {
            true => Some(self.want_name("the name of a port")?),
            false => None,
        };
        Ok(AstItem {
            name,
            primitive,
            port,
        })
    }

    fn primitive(&mut self, depth: usize) -> ParseResult<AstPrimitive> {
        if self.sees(b'{') {
            let start = self.at;
            let fragment = self.fragment(depth)?;
            let span = Span::new(start, self.at);
            self.want(b'(', "`(` behind a fragment")?;
            return Ok(AstPrimitive::Fragment(
                fragment,
                self.arguments(depth)?,
                span,
            ));
        }
        let name = self.want_name("a primitive, a type or `{`")?;
        if self.take(b'(') {
            return Ok(AstPrimitive::Typed(name, self.arguments(depth)?));
        }
        Ok(AstPrimitive::Named(name))
    }

    /// Parses the arguments up to `)`; the `(` is consumed already.
    fn arguments(&mut self, depth: usize) -> ParseResult<Vec<AstArgument>> {
        let depth = self.deeper(depth)?;
        let mut arguments = Vec::new();
        if self.take(b')') {
            return Ok(arguments);
        }
        loop {
            let name = self.want_name("the name of a parameter or input")?;
            let debug = self.debug()?;
            self.want(b'=', "`=`")?;
            let value = self.value(depth)?;
            arguments.push(AstArgument { name, debug, value });
            if self.take(b')') {
                return Ok(arguments);
            }
            self.want(b',', "`,` or `)`")?;
        }
    }

    fn value(&mut self, depth: usize) -> ParseResult<AstValue> {
        if self.take(b'\'') {
            return self.quoted();
        }
        let primitive = self.primitive(depth)?;
        self.want(b'.', "`.` and the port that is read")?;
        let port = self.want_name("the name of a port")?;
        Ok(AstValue::Link(Box::new(primitive), port))
    }

    /// Parses a text up to the closing quote; the opening one is consumed already.
    fn quoted(&mut self) -> ParseResult<AstValue> {
        let start = self.at;
        let mut text = String::new();
        let rest = self.text.get(start..).unwrap_or_default();
        let mut chars = rest.char_indices();
        while let Some((offset, c)) = chars.next() {
            match c {
                '\'' => {
                    self.at = start + offset + 1;
                    return Ok(AstValue::Text(text, Span::new(start, start + offset)));
                }
                '\\' => match chars.next() {
                    Some((_, c @ ('\'' | '\\'))) => text.push(c),
                    _ => {
                        self.at = start + offset;
                        return Err(self.wanted("`\\'` or `\\\\` as the only escapes"));
                    }
                },
                c => text.push(c),
            }
        }
        self.at = self.text.len();
        Err(self.wanted("the `'` that ends a text"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(text: &str) -> (usize, String) {
        let diagnostic = parse(text).unwrap_err();
        assert_eq!(diagnostic.code, codes::BROKEN, "{text}");
        (diagnostic.place.unwrap().start, diagnostic.message)
    }

    #[test]
    fn the_whole_grammar_is_read() {
        let text = "# devices: a=b\n { f [2.5] = { a=Core::DoubleAdd(inFirst[2] = parent.inX, Second='1'), outY=a.outValue }\n\
            (inX=Core::DoubleValue(Value='it\\'s \\\\').outValue), outTerminate=f.outY } ";
        let (header, net) = parse(text).unwrap();
        assert_eq!(header.entries[0].0.name, "devices");
        assert_eq!(header.entries[0].1.name, "a=b");
        assert_eq!(net.items.len(), 2);
        assert_eq!(net.items[1].port.as_ref().unwrap().name, "outY");
        let AstPrimitive::Fragment(fragment, arguments, _) = &net.items[0].primitive else {
            panic!("a fragment");
        };
        assert_eq!(fragment.items.len(), 2);
        let AstValue::Link(primitive, port) = &arguments[0].value else {
            panic!("a link");
        };
        assert_eq!(port.name, "outValue");
        let AstPrimitive::Typed(name, inner) = &**primitive else {
            panic!("a primitive without a name");
        };
        assert_eq!(name.name, "Core::DoubleValue");
        assert!(matches!(&inner[0].value, AstValue::Text(text, _) if text == "it's \\"));
    }

    #[test]
    fn a_mistake_is_told_with_its_place() {
        for (text, at) in [
            ("", 0),
            ("{", 1),
            ("{a", 2),
            ("{a=}", 3),
            ("{a=b(}", 5),
            ("{a=b(c='x)}", 11),
            ("{a=b(c='\\n')}", 8),
            ("{a=b()} x", 8),
            ("{a=b(c=d)}", 8),
            ("{a={}}", 5),
            ("{a=b(),}", 7),
            ("{a=b(c[x]=d.e)}", 7),
        ] {
            assert_eq!(place(text).0, at, "{text}: {}", place(text).1);
        }
    }

    #[test]
    fn nesting_has_a_limit_and_no_text_overflows_the_stack() {
        for open in ["{a=", "{a=b(c="] {
            let diagnostic = parse(&open.repeat(100_000)).unwrap_err();
            assert_eq!(diagnostic.code, TOO_LARGE, "{open}");
        }
        let diagnostic = parse(&format!("{{x={}", "a(b=".repeat(1000))).unwrap_err();
        assert_eq!(diagnostic.code, TOO_LARGE);
    }

    #[test]
    fn yaml_and_json_are_not_taken_for_it() {
        for (text, is) in [
            ("{a=b()}", true),
            (" \n# end: _1\n{ 1 [2.0] = X() }", true),
            ("{\"net\": \"x\"}", false),
            ("{net: x, primitives: {}}", false),
            ("{}", false),
            ("net: x\n", false),
            ("# a comment\nnet: x\n", false),
            ("", false),
        ] {
            assert_eq!(looks_like(text), is, "{text}");
        }
    }
}
