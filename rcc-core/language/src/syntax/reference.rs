//! References to an output or a part of its value. Runs on the loader's threads.

use std::fmt;

use rcc_config::diagnostic::Span;
use rcc_config::yaml::ShortText;

use super::part::ValuePart;

/// A reference to an output or a part of its value; in a fragment also to an input of the fragment or a part of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reference {
    /// Id of the primitive, or name of the fragment's input.
    pub primitive: ShortText,
    /// Name of the output. Empty for an input of a fragment, and if only a primitive is named, which is refused with a
    /// list of its outputs.
    pub port: ShortText,
    /// The selected part of the value; `None` for all of it.
    pub part: Option<ValuePart>,
    /// Span of the reference.
    pub span: Span,
    /// Span of the primitive's id.
    pub primitive_span: Span,
    /// Span of the port's name, with the part.
    pub port_span: Span,
}

impl fmt::Display for Reference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.primitive)?;
        if !self.port.is_empty() {
            write!(f, ".{}", self.port)?;
        }
        match self.part {
            Some(part) => write!(f, "{part}"),
            None => Ok(()),
        }
    }
}
