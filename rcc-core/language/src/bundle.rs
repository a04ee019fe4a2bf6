//! Bundles a net with its libraries: the fragments of the libraries become fragments of the net, because a cell
//! receives texts, not files. Runs in the command line.

use std::borrow::Cow;

use rcc_config::diagnostic::{Faults, Severity};
use rcc_config::yaml;

use crate::library::{LibrarySource, read_libraries};
use crate::parse::read_net;
use crate::source_map::SourceMap;
use crate::write;

/// Returns the text of a net that needs no library. A net without `use` is returned unchanged, even if it has errors.
/// `file` is the path of the net's own file.
///
/// # Errors
/// Returns the diagnostics if the text uses libraries, and it or one of them has errors.
pub fn bundle<'a>(
    text: &'a str,
    file: &str,
    libraries: &dyn LibrarySource,
) -> Result<Cow<'a, str>, Faults> {
    let (root, mut diagnostics) = yaml::read(text);
    let Some(root) = root.filter(|root| root.get("use").is_some()) else {
        return Ok(Cow::Borrowed(text));
    };
    let mut sources = SourceMap::new(file, text);
    let net = read_net(&root, &mut diagnostics).map(|mut net| {
        let used = std::mem::take(&mut net.uses);
        let fragments = read_libraries(&used, file, libraries, &mut sources, &mut diagnostics);
        net.fragments.extend(fragments);
        net
    });
    let faulty = diagnostics
        .iter()
        .any(|diagnostic| diagnostic.severity == Severity::Error);
    match net {
        Some(net) if !faulty => Ok(Cow::Owned(write::yaml(&net))),
        _ => Err(sources.finish(diagnostics)),
    }
}
