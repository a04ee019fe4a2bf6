//! Fragments: sub-nets with parameters, inputs and outputs, in the file of a net or in a library. They are kept as
//! written; `crate::expand` replaces each instance by a copy. Runs on the loader's threads.

use rcc_config::diagnostic::Span;
use rcc_config::yaml::Key;
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use super::Primitive;
use super::literal::Literal;
use super::reference::Reference;

/// A sub-net that instances refer to.
#[derive(Clone, Debug)]
pub struct Fragment {
    /// Name and its span.
    pub name: Key,
    /// Description for users; may be empty.
    pub description: String,
    /// Parameters, in the order of the file; `$gain` in the fragment.
    pub parameters: Vec<FragmentParameter>,
    /// Inputs, in the order of the file; `x` in the fragment.
    pub inputs: Vec<FragmentInput>,
    /// Outputs, in the order of the file.
    pub outputs: Vec<FragmentOutput>,
    /// Primitives, and instances of other fragments.
    pub primitives: Vec<Primitive>,
    /// Outputs in the fragment that nothing reads.
    pub discard: Vec<Reference>,
    /// Span of the whole definition.
    pub span: Span,
}

/// A parameter of a fragment.
#[derive(Clone, Debug)]
pub struct FragmentParameter {
    /// Name, without `$`.
    pub name: Key,
    /// Description for users; may be empty.
    pub description: String,
    /// Type; `None` for that of the ports where the parameter is used. Names of devices and channels are `Text`.
    pub ty: Option<(Type, Span)>,
    /// Unit; `None` for that of the ports where the parameter is used.
    pub unit: Option<(Unit, Span)>,
    /// Default; `None` if every instance must set the parameter.
    pub default: Option<Literal>,
}

/// An input of a fragment.
#[derive(Clone, Debug)]
pub struct FragmentInput {
    /// Name.
    pub name: Key,
    /// Description for users; may be empty.
    pub description: String,
    /// Type; `None` for that of each instance's source.
    pub ty: Option<(Type, Span)>,
    /// Unit; `None` for that of each instance's source.
    pub unit: Option<(Unit, Span)>,
    /// Default; `None` if every instance must connect the input.
    pub default: Option<Literal>,
}

/// An output of a fragment.
#[derive(Clone, Debug)]
pub struct FragmentOutput {
    /// Name.
    pub name: Key,
    /// Description for users; may be empty.
    pub description: String,
    /// The output in the fragment that is exported, or an element of it.
    pub from: Reference,
}

/// A file of fragments.
#[derive(Clone, Debug)]
pub struct Library {
    /// Name.
    pub name: Key,
    /// Description for users; may be empty.
    pub description: String,
    /// Paths of other libraries that it uses, relative to its own file.
    pub uses: Vec<Key>,
    /// Fragments, in the order of the file.
    pub fragments: Vec<Fragment>,
}
