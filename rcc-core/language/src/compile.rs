//! The pipeline from text to plan: read, expand, resolve, infer, check, lower. All errors of the text are reported at
//! once. Runs on the loader's threads and in `rcc-cli check`; never on the real-time thread.

use rcc_config::CellConfig;
use rcc_config::diagnostic::{Diagnostic, Faults, Severity, Span};
use rcc_config::yaml;
use rcc_protocol::control::PlanData;

use crate::check::{Typed, check};
use crate::codes;
use crate::devices::DeviceTable;
use crate::directionet;
use crate::expand::{ExpandedNet, expand};
use crate::infer::infer;
use crate::library::{self, LibrarySource, NoLibraries};
use crate::lower::{Lowered, lower};
use crate::names::{Names, names};
use crate::resolve::resolve;
use crate::source_map::SourceMap;
use crate::structure::{NetStructure, structure};
use crate::syntax;

/// A net that passed all checks.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// Name of the net.
    pub net: String,
    /// Description for users; may be empty.
    pub description: String,
    /// The plan.
    pub plan: PlanData,
    /// Names and slots of all ports.
    pub names: Names,
    /// Warnings.
    pub warnings: Faults,
}

/// Compiles a text for the cell of a configuration. `file` is the name that diagnostics show.
///
/// # Errors
/// Returns all errors of the text, and its warnings.
pub fn compile(text: &str, file: &str, cell: &CellConfig) -> Result<Compiled, Faults> {
    compile_for(text, file, &DeviceTable::from(cell))
}

/// Compiles a text for a table of devices.
///
/// # Errors
/// Returns all errors of the text, and its warnings.
pub fn compile_for(text: &str, file: &str, cell: &DeviceTable) -> Result<Compiled, Faults> {
    compile_with(text, file, cell, &NoLibraries)
}

/// Compiles a text that may use libraries. `file` is also the path of the net's own file, relative to which libraries
/// are looked up.
///
/// # Errors
/// Returns all errors of the text and its libraries, and their warnings.
pub fn compile_with(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    libraries: &dyn LibrarySource,
) -> Result<Compiled, Faults> {
    compile_then(text, file, cell, libraries, |_, _| ()).map(|(compiled, ())| compiled)
}

/// Compiles a text that may use libraries, and returns the structure of the net as well.
///
/// # Errors
/// As [`compile_with`].
pub fn compile_with_structure(
    text: &str,
    file: &str,
    cell: &CellConfig,
    libraries: &dyn LibrarySource,
) -> Result<(Compiled, NetStructure), Faults> {
    compile_then(text, file, &DeviceTable::from(cell), libraries, structure)
}

/// Compiles a text and calls `inspect` with the lowered net.
fn compile_then<T>(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    libraries: &dyn LibrarySource,
    inspect: impl FnOnce(Typed<'_>, &Lowered) -> T,
) -> Result<(Compiled, T), Faults> {
    let mut diagnostics = Vec::new();
    let (flat, sources) = flatten(text, file, cell, libraries, &mut diagnostics);
    let Some(flat) = flat else {
        return Err(sources.finish(diagnostics));
    };
    let graph = resolve(&flat, cell, &mut diagnostics);
    let inferred = infer(&graph);
    let typed = Typed {
        graph: &graph,
        inferred: &inferred,
    };
    check(typed, &mut diagnostics);
    if diagnostics
        .iter()
        .any(|diagnostic| diagnostic.severity == Severity::Error)
    {
        return Err(sources.finish(diagnostics));
    }
    let lowered = match lower(typed) {
        Ok(lowered) => lowered,
        Err(diagnostic) => {
            diagnostics.push(*diagnostic);
            return Err(sources.finish(diagnostics));
        }
    };
    if let Err(error) = lowered.plan.plan().check(&cell.models(), cell.fingerprint) {
        // A net that passed every rule must lower to a valid plan. If not, this is a bug of the compiler, and it is
        // reported here instead of sending the plan.
        let message = format!("internal error: the plan of this net is invalid: {error:?}");
        let diagnostic = Diagnostic::error(codes::NET_TOO_LARGE, Span::default(), message);
        diagnostics.push(
            diagnostic
                .anywhere()
                .help("this is a bug of the compiler: report it with the net"),
        );
        return Err(sources.finish(diagnostics));
    }
    let seen = inspect(typed, &lowered);
    let compiled = Compiled {
        names: names(typed, &lowered),
        net: flat.net.name.name.clone(),
        description: flat.net.description.clone(),
        plan: lowered.plan,
        warnings: sources.finish(diagnostics),
    };
    Ok((compiled, seen))
}

/// Reads a text in any notation: YAML, JSON or DirectIONet. Returns `None` if the errors leave no net.
pub fn read(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<syntax::Net> {
    if directionet::looks_like(text) {
        return directionet::read(text, file, cell, diagnostics);
    }
    let (root, found) = yaml::read(text);
    diagnostics.extend(found);
    syntax::read(&root?, diagnostics)
}

/// Reads a text and its libraries and expands the instances of fragments. Returns no net if the text is not one, or if
/// it is far too large. The source map resolves all spans.
pub fn flatten(
    text: &str,
    file: &str,
    cell: &DeviceTable,
    libraries: &dyn LibrarySource,
    diagnostics: &mut Vec<Diagnostic>,
) -> (Option<ExpandedNet>, SourceMap) {
    let mut sources = SourceMap::new(file, text);
    let net = read(text, file, cell, diagnostics);
    let flat = net.and_then(|net| {
        let library = library::read_all(&net.uses, file, libraries, &mut sources, diagnostics);
        expand(net, &library, &mut sources, diagnostics)
    });
    (flat, sources)
}
