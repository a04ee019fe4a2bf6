//! The syntax tree of a net: primitives, inputs and constants, each with its span. Every notation is read into it, and
//! it knows neither the catalogue nor a cell. Runs on the loader's threads.

pub mod declaration;
pub mod fragment;
pub mod literal;
pub mod part;
pub mod reference;
pub mod stored_value;

use rcc_config::diagnostic::{Diagnostic, Span};
use rcc_config::yaml::Key;

use crate::codes;
use crate::syntax::fragment::Fragment;
use crate::syntax::literal::Literal;
use crate::syntax::reference::Reference;

/// Longest name, bytes.
pub const NAME_MAX: usize = 64;

/// A net file.
#[derive(Clone, Debug)]
pub struct Net {
    /// Name and its span.
    pub name: Key,
    /// Description for users; may be empty.
    pub description: String,
    /// `on_device_loss: null`: the net continues with null when a device that it commands is lost.
    pub survives_device_loss: bool,
    /// Period and phase.
    pub timing: Timing,
    /// `use: [library/filters.yaml]`: paths of the libraries, relative to the net's own file.
    pub uses: Vec<Key>,
    /// Fragments of the net itself, in the order of the file.
    pub fragments: Vec<Fragment>,
    /// Primitives and instances of fragments in the order of the file.
    pub primitives: Vec<Primitive>,
    /// Outputs that nothing reads.
    pub discard: Vec<Reference>,
}

/// Period and phase as written. If nothing is given, the net is evaluated in every cycle.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    /// `period: 5 ms`.
    pub period: Option<Literal>,
    /// `rate: 200 Hz`, an alternative to `period`.
    pub rate: Option<Literal>,
    /// `phase: 2 ms`, the delay after the start of the period.
    pub phase: Option<Literal>,
}

/// A primitive, or an instance of a fragment.
#[derive(Clone, Debug)]
pub struct Primitive {
    /// Id.
    pub id: Key,
    /// Whether `type_name` names a type or a fragment.
    pub kind: PrimitiveKind,
    /// Type or fragment as written; empty if it is missing.
    pub type_name: Key,
    /// Parameters in the order of the file.
    pub parameters: Vec<(Key, Literal)>,
    /// Inputs in the order of the file. In a fragment, a link without a port (`x`) reads an input of the fragment.
    pub inputs: Vec<(Key, Source)>,
    /// `active: touch.out`: while this is false or null, the primitive is not evaluated and its outputs are null.
    pub active: Option<Source>,
}

/// Kind of an entry of `primitives`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PrimitiveKind {
    /// `type: Add`: a type of the catalogue.
    #[default]
    Type,
    /// `fragment: smooth`: a fragment of the net or of a library.
    Fragment,
    /// `a * b` in a formula: `Multiply` or `Scale`, which is decided when the types are known. It occurs only between the
    /// formula pass and the end of the expand pass.
    Product,
}

/// The source of an input.
#[derive(Clone, Debug)]
pub enum Source {
    /// A link from an output.
    Link(Link),
    /// A constant.
    Literal(Literal),
    /// A list with at least one link in it.
    List(List),
    /// Conditions by their names, in the order of the text: `{arrived: move.done, touched: touch.out}`.
    Outcomes(Outcomes),
    /// An expression: `= 2 * a.out + 0.1 m`. It does not occur after the formula pass.
    Formula(Formula),
    /// Refused; the error is reported.
    Refused,
}

impl Source {
    /// Returns the links of the source.
    #[must_use]
    pub fn links(&self) -> Vec<&Link> {
        match self {
            Source::Link(link) => vec![link],
            Source::List(list) => list.elements.iter().flat_map(Source::links).collect(),
            Source::Outcomes(outcomes) => outcomes.sources().flat_map(Source::links).collect(),
            Source::Literal(_) | Source::Formula(_) | Source::Refused => Vec::new(),
        }
    }

    /// Calls `visit` with each constant of the source, including the initial values of delayed links.
    pub fn for_each_constant<'s>(&'s self, visit: &mut impl FnMut(&'s Literal)) {
        match self {
            Source::Link(link) => link.initial.as_deref().into_iter().for_each(visit),
            Source::Literal(literal) => visit(literal),
            Source::List(list) => list
                .elements
                .iter()
                .for_each(|it| it.for_each_constant(visit)),
            Source::Outcomes(outcomes) => outcomes
                .sources()
                .for_each(|it| it.for_each_constant(visit)),
            Source::Formula(_) | Source::Refused => {}
        }
    }

    /// Returns the constants of the source, including the initial values of delayed links.
    #[must_use]
    pub fn constants(&self) -> Vec<&Literal> {
        let mut constants = Vec::new();
        self.for_each_constant(&mut |literal| constants.push(literal));
        constants
    }
}

/// An expression where an input stands.
#[derive(Clone, Debug)]
pub struct Formula {
    /// The text, beginning with `=`.
    pub text: String,
    /// Span.
    pub span: Span,
}

/// Returns true for a text that is an expression.
#[must_use]
pub fn is_formula(text: &str) -> bool {
    text.trim_start().starts_with('=')
}

/// A list of links and constants that becomes one value: an array or a vector, or a matrix if its elements are lists.
#[derive(Clone, Debug)]
pub struct List {
    /// Its elements, at most [`rcc_core::types::ELEMENTS_MAX`]. Lists are nested at most twice.
    pub elements: Vec<Source>,
    /// Span of the list.
    pub span: Span,
}

/// The outcomes of a net: the first condition that is true ends it.
#[derive(Clone, Debug)]
pub struct Outcomes {
    /// Names with their conditions, each a link or a constant.
    pub rows: Vec<(Key, Source)>,
    /// Span of the mapping.
    pub span: Span,
}

impl Outcomes {
    /// Returns the conditions, in the order of the text.
    pub fn sources(&self) -> impl Iterator<Item = &Source> {
        self.rows.iter().map(|(_, source)| source)
    }
}

/// A link from an output.
#[derive(Clone, Debug)]
pub struct Link {
    /// The output.
    pub from: Reference,
    /// True if it carries the value of the previous cycle.
    pub delayed: bool,
    /// Value of a delayed link in the first cycle.
    pub initial: Option<Box<Literal>>,
    /// Span of the link.
    pub span: Span,
}

/// Returns true for a valid name of a net, `[a-z][a-z0-9-]{0,63}`, in any notation. A loaded net is also addressed by
/// its number and as `name#number`, so a name does not begin with a digit and has no `#`.
#[must_use]
pub fn is_net_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    name.len() <= NAME_MAX
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(allowed)
}

/// Returns the diagnostic of an invalid name of a net.
#[must_use]
pub fn bad_net_name(name: &Key) -> Option<Diagnostic> {
    if is_net_name(&name.name) {
        return None;
    }
    let message = format!("`{}` cannot be the name of a net", name.name);
    let mut help = format!(
        "use lowercase letters, digits and `-`, at most {NAME_MAX} characters, beginning with a letter"
    );
    let lettered = format!("net-{}", name.name);
    if is_net_name(&lettered) {
        help = format!("{help}, as in `{lettered}`; a number is the id of a loaded net");
    }
    Some(Diagnostic::error(codes::BAD_NAME, name.span, message).help(help))
}
