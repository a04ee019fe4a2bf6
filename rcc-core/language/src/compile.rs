//! The whole way from a text to a plan, with all faults of the text at once.
//! Run by the loader's threads and by `rcc-cli check`; never by the real-time thread.

use rcc_config::CellConfig;
use rcc_config::diagnostic::{Diagnostic, Faults, Severity, Span};
use rcc_config::yaml;
use rcc_ipc::control::PlanData;

use crate::anatomy::{Anatomy, anatomy};
use crate::check::{Typed, check};
use crate::devices::DeviceTable;
use crate::directionet;
use crate::expand::{Flat, expand};
use crate::fault;
use crate::infer::infer;
use crate::library::{self, Libraries, NoFiles};
use crate::lower::{Lowered, lower};
use crate::names::{Names, names};
use crate::resolve::resolve;
use crate::sources::Sources;
use crate::syntax;

/// A net that the language accepts.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// Name of the net.
    pub net: String,
    /// What people should know about it; may be empty.
    pub description: String,
    /// Its plan.
    pub plan: PlanData,
    /// Where everything lies in the plan.
    pub names: Names,
    /// What should be looked at.
    pub warnings: Faults,
}

/// Compiles a text for the cell of a configuration; `file` is the name that faults mention.
///
/// # Errors
/// All faults of the text, and its warnings.
pub fn compile(text: &str, file: &str, cell: &CellConfig) -> Result<Compiled, Faults> {
    compile_for(text, file, &DeviceTable::from(cell))
}

/// Compiles a text for a table of devices.
///
/// # Errors
/// All faults of the text, and its warnings.
pub fn compile_for(text: &str, file: &str, cell: &DeviceTable) -> Result<Compiled, Faults> {
    compile_with(text, file, cell, &NoFiles)
}

/// Compiles a text that may use libraries. `file` is also the path of the net's own file, beside which libraries are
/// looked for.
///
/// # Errors
/// All faults of the text and its libraries, and their warnings.
pub fn compile_with(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    libraries: &dyn Libraries,
) -> Result<Compiled, Faults> {
    compile_and(text, file, cell, libraries, |_, _| ()).map(|(compiled, ())| compiled)
}

/// Compiles a text that may use libraries, and takes the net apart.
///
/// # Errors
/// As [`compile_with`].
pub fn dissect(
    text: &str,
    file: &str,
    cell: &CellConfig,
    libraries: &dyn Libraries,
) -> Result<(Compiled, Anatomy), Faults> {
    compile_and(text, file, &DeviceTable::from(cell), libraries, anatomy)
}

/// Compiles a text and shows the net that it was to `see`.
fn compile_and<T>(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    libraries: &dyn Libraries,
    see: impl FnOnce(Typed<'_>, &Lowered) -> T,
) -> Result<(Compiled, T), Faults> {
    let mut faults = Vec::new();
    let (flat, sources) = flatten(text, file, cell, libraries, &mut faults);
    let Some(flat) = flat else {
        return Err(sources.finished(faults));
    };
    let graph = resolve(&flat, cell, &mut faults);
    let inferred = infer(&graph);
    let typed = Typed {
        graph: &graph,
        inferred: &inferred,
    };
    check(typed, &mut faults);
    if faults.iter().any(|fault| fault.severity == Severity::Error) {
        return Err(sources.finished(faults));
    }
    let lowered = match lower(typed) {
        Ok(lowered) => lowered,
        Err(fault) => {
            faults.push(*fault);
            return Err(sources.finished(faults));
        }
    };
    if let Err(error) = lowered.plan.plan().check(&cell.models(), cell.fingerprint) {
        // Every rule passed, so this is our mistake; better said than sent.
        let message = format!("the plan of this net does not check: {error:?}");
        let fault = Diagnostic::error(fault::NET_TOO_LARGE, Span::default(), message);
        faults.push(
            fault
                .anywhere()
                .help("this is a mistake of the loader: report it with the net"),
        );
        return Err(sources.finished(faults));
    }
    let seen = see(typed, &lowered);
    let compiled = Compiled {
        names: names(typed, &lowered),
        net: flat.net.name.name.clone(),
        description: flat.net.description.clone(),
        plan: lowered.plan,
        warnings: sources.finished(faults),
    };
    Ok((compiled, seen))
}

/// Reads a text in whatever form it is: YAML, JSON or DirectIONet. `None`: too much is wrong to go on.
pub fn read(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    faults: &mut Vec<Diagnostic>,
) -> Option<syntax::Net> {
    if directionet::looks_like(text) {
        return directionet::read(text, file, cell, faults);
    }
    let (root, found) = yaml::read(text);
    faults.extend(found);
    syntax::read(&root?, faults)
}

/// Reads a text and its libraries and replaces the instances of fragments; `None`: it is no net, or far too large. The
/// sources know the place of everything.
pub fn flatten(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    libraries: &dyn Libraries,
    faults: &mut Vec<Diagnostic>,
) -> (Option<Flat>, Sources) {
    let mut sources = Sources::new(file, text);
    let net = read(text, file, cell, faults);
    let flat = net.and_then(|net| {
        let library = library::read_all(&net.uses, file, libraries, &mut sources, faults);
        expand(net, &library, &mut sources, faults)
    });
    (flat, sources)
}
