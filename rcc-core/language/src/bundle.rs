//! A net as one text: what uses libraries becomes a net that has their fragments, because a cell is sent texts, not files.
//! Run by the command line.

use std::borrow::Cow;

use rcc_config::diagnostic::{Faults, Severity};
use rcc_config::yaml;

use crate::library::{self, Libraries};
use crate::sources::Sources;
use crate::{syntax, write};

/// The text of a net that needs no library; one without `use` stays as it is, with its faults. `file` is the path of the
/// net's own file.
///
/// # Errors
/// What is wrong with a text that uses libraries, or with these.
pub fn bundle<'a>(
    text: &'a str,
    file: &str,
    libraries: &dyn Libraries,
) -> Result<Cow<'a, str>, Faults> {
    let (root, mut faults) = yaml::read(text);
    let Some(root) = root.filter(|root| root.get("use").is_some()) else {
        return Ok(Cow::Borrowed(text));
    };
    let mut sources = Sources::new(file, text);
    let net = syntax::read(&root, &mut faults).map(|mut net| {
        let used = std::mem::take(&mut net.uses);
        let fragments = library::read_all(&used, file, libraries, &mut sources, &mut faults);
        net.fragments.extend(fragments);
        net
    });
    let faulty = faults.iter().any(|fault| fault.severity == Severity::Error);
    match net {
        Some(net) if !faulty => Ok(Cow::Owned(write::yaml(&net))),
        _ => Err(sources.finished(faults)),
    }
}
