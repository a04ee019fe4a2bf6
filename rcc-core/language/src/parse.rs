//! The parse pass, text → [`Net`]: YAML and JSON are read here, other notations by readers that the caller hands in. It
//! checks the syntax of the language and of names, and reports all errors at once. Runs on the loader's threads.

mod fragment;
pub mod literal;
mod net;
mod primitive;
pub mod reference;
mod shape;
mod source;

use rcc_config::diagnostic::Diagnostic;
use rcc_config::yaml;

use crate::devices::DeviceTable;
use crate::syntax::Net;

pub use fragment::read_library;
pub use net::read_net;

/// A notation of nets besides YAML and JSON.
#[derive(Clone, Copy, Debug)]
pub struct Notation {
    /// Returns true for a text in this notation.
    pub recognises: fn(&str) -> bool,
    /// Reads a net from its text, for a cell; the second text is the name of its file.
    pub read: fn(&str, &str, &DeviceTable, &mut Vec<Diagnostic>) -> Option<Net>,
}

/// Reads a net from its text. Returns `None` if the errors leave no net. `file` may give the net its name; `notations`
/// are those that the caller knows besides YAML and JSON.
pub fn parse(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    notations: &[Notation],
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<Net> {
    let mut notations = notations.iter();
    if let Some(notation) = notations.find(|notation| (notation.recognises)(text)) {
        return (notation.read)(text, file, cell, diagnostics);
    }
    let (root, found) = yaml::read(text);
    diagnostics.extend(found);
    read_net(&root?, diagnostics)
}
