//! The expanded net, the result of the expand pass. Runs on the loader's threads.

use rcc_config::diagnostic::Span;
use rcc_config::yaml::Key;
use rcc_core::types::Type;
use rcc_core::unit::Unit;

use crate::syntax::reference::Reference;
use crate::syntax::{Net, Source};

/// A net without instances.
#[derive(Clone, Debug)]
pub struct ExpandedNet {
    /// The net; its fragments are expanded.
    pub net: Net,
    /// Regions, outer ones first.
    pub regions: Vec<ExpandedRegion>,
    /// Innermost region, by primitive. Empty if there are no regions.
    pub region_of: Vec<Option<usize>>,
    /// Outputs that count as read: those that fragments export, and those that refused inputs read.
    pub read: Vec<Reference>,
    /// Declared types and units of fragment inputs.
    pub declarations: Vec<InputDeclaration>,
    /// Ids of all instances.
    pub instances: Vec<String>,
    /// True if an instance was refused, so that missing definitions may belong to it.
    pub is_incomplete: bool,
}

/// Primitives that are evaluated only while a condition is true.
#[derive(Clone, Debug)]
pub struct ExpandedRegion {
    /// Id of the instance or primitive that has the condition.
    pub id: Key,
    /// The condition.
    pub condition: Source,
    /// Index of the enclosing region.
    pub parent: Option<usize>,
}

/// The type and unit that a fragment declares for its input, applied to an input that it feeds.
#[derive(Clone, Debug)]
pub struct InputDeclaration {
    /// Index of the primitive.
    pub primitive: usize,
    /// Name of the primitive's input.
    pub input: String,
    /// Name of the fragment's input.
    pub name: String,
    /// The declared type and its span.
    pub ty: Option<(Type, Span)>,
    /// The declared unit and its span.
    pub unit: Option<(Unit, Span)>,
}

impl ExpandedNet {
    /// Wraps a net that has no instances and no conditions.
    #[must_use]
    pub fn plain(net: Net) -> ExpandedNet {
        ExpandedNet {
            net,
            regions: Vec::new(),
            region_of: Vec::new(),
            read: Vec::new(),
            declarations: Vec::new(),
            instances: Vec::new(),
            is_incomplete: false,
        }
    }
}
