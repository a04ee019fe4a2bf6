//! The whole way from a text to a plan, with all faults of the text at once.
//! Run by the loader's threads and by `rcc-cli check`; never by the real-time thread.

use rcc_config::CellConfig;
use rcc_config::diagnostic::{Diagnostic, Faults, Severity, Span};
use rcc_config::yaml;
use rcc_ipc::control::PlanData;

use crate::check::{Typed, check};
use crate::devices::DeviceTable;
use crate::directionet;
use crate::expand;
use crate::fault;
use crate::infer::infer;
use crate::lower::lower;
use crate::names::{Names, names};
use crate::resolve::resolve;
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
    let mut faults = Vec::new();
    let Some(net) = read(text, file, cell, &mut faults) else {
        return Err(finished(file, text, faults));
    };
    expand::refuse(&net, &mut faults);
    let graph = resolve(&net, cell, &mut faults);
    let inferred = infer(&graph);
    let typed = Typed {
        graph: &graph,
        inferred: &inferred,
    };
    check(typed, &mut faults);
    if faults.iter().any(|fault| fault.severity == Severity::Error) {
        return Err(finished(file, text, faults));
    }
    let lowered = match lower(typed) {
        Ok(lowered) => lowered,
        Err(fault) => {
            faults.push(*fault);
            return Err(finished(file, text, faults));
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
        return Err(finished(file, text, faults));
    }
    Ok(Compiled {
        names: names(typed, &lowered),
        net: net.name.name,
        description: net.description,
        plan: lowered.plan,
        warnings: finished(file, text, faults),
    })
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

/// The faults of a text, each with a remedy: its own, or that of its kind.
pub(crate) fn finished(file: &str, text: &str, mut faults: Vec<Diagnostic>) -> Faults {
    for fault in &mut faults {
        if fault.help.is_none() {
            fault.help = fault::remedy(fault.code).map(str::to_owned);
        }
    }
    Faults::new(file, text, faults)
}
