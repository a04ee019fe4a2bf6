//! The compiler: its passes in order, from text to plan. All errors of the text are reported at once. Runs on the
//! loader's threads and in `rcc-cli check`; never on the real-time thread.
//!
//! | pass | result |
//! |---|---|
//! | [`parse`](mod@crate::parse) | [`Net`](crate::syntax::Net): the text as a tree |
//! | [`library`](crate::library) | the fragments of the libraries that it names |
//! | [`leg_conditions`](mod@crate::leg_conditions) | `wait` and `until` of legs as inputs |
//! | [`formula`](mod@crate::formula) | primitives instead of expressions |
//! | [`expand`](mod@crate::expand) | [`ExpandedNet`](crate::expand::ExpandedNet): primitives instead of instances |
//! | [`resolve`](mod@crate::resolve) | [`NetGraph`](crate::resolve::NetGraph): numbers instead of names |
//! | [`infer`](mod@crate::infer) | [`Inferred`](crate::infer::Inferred): types and units of all ports |
//! | [`check`](mod@crate::check) | [`Checked`](crate::check::Checked): a net that keeps every rule |
//! | [`lower`](mod@crate::lower) | [`Lowered`]: the plan and its slots |
//! | [`names`](mod@crate::names) | [`Names`] of the slots, for users |

use rcc_config::CellConfig;
use rcc_config::diagnostic::{Diagnostic, Faults};
use rcc_core::plan::CheckedPlan;
use rcc_protocol::control::PlanData;

use crate::check::check;
use crate::devices::DeviceTable;
use crate::expand::expand;
use crate::formula::{self, PortWords};
use crate::infer::{Typed, infer};
use crate::leg_conditions;
use crate::library::{LibrarySource, NoLibraries, read_libraries};
use crate::lower::{Lowered, lower, prove};
use crate::names::{Names, names};
use crate::parse::{Notation, parse};
use crate::resolve::resolve;
use crate::source_map::SourceMap;
use crate::structure::{NetStructure, structure};

/// Compiles nets for the devices of a cell.
#[derive(Clone, Copy)]
pub struct Compiler<'a> {
    /// Devices of the cell.
    pub cell: &'a DeviceTable,
    /// Libraries that the text may name.
    pub libraries: &'a dyn LibrarySource,
    /// Notations of the text besides YAML and JSON.
    pub notations: &'a [Notation],
}

/// A net that passed all checks.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// Name of the net.
    pub net: String,
    /// Description for users; may be empty.
    pub description: String,
    /// The plan.
    pub plan: PlanData,
    /// Its resources, and what else its check found.
    pub checked: CheckedPlan,
    /// Names and slots of all ports.
    pub names: Names,
    /// Warnings.
    pub warnings: Faults,
    /// Number of entries of `primitives:` in the text: a formula or an instance of a fragment counts once.
    pub primitives: u32,
}

/// Diagnostics so far, and the texts and words that they quote.
struct Reports {
    sources: SourceMap,
    diagnostics: Vec<Diagnostic>,
    words: PortWords,
}

impl<'a> Compiler<'a> {
    /// Compiles for a cell, without libraries and other notations.
    #[must_use]
    pub fn of(cell: &'a DeviceTable) -> Compiler<'a> {
        Compiler {
            cell,
            libraries: &NoLibraries,
            notations: &[],
        }
    }

    /// The passes in order. `inspect` is called with the lowered net.
    fn passes<T>(
        self,
        (text, file): (&str, &str),
        Reports {
            sources,
            diagnostics,
            words,
        }: &mut Reports,
        inspect: impl FnOnce(Typed<'_>, &Lowered) -> T,
    ) -> Option<(Compiled, T)> {
        let mut net = parse(text, file, self.cell, self.notations, diagnostics)?;
        // Before formulas and fragments become primitives.
        let primitives = u32::try_from(net.primitives.len()).unwrap_or(u32::MAX);
        let mut library = read_libraries(&net.uses, file, self.libraries, sources, diagnostics);
        leg_conditions::connect(&mut net, &mut library, diagnostics);
        *words = formula::lower(&mut net, &mut library, sources, diagnostics);
        let expanded = expand(net, &library, sources, diagnostics)?;
        let graph = resolve(&expanded, self.cell, diagnostics);
        let typed = Typed {
            graph: &graph,
            inferred: &infer(&graph),
        };
        let checked = check(typed, diagnostics)?;
        let lowered = lower(checked)
            .map_err(|error| diagnostics.push(*error))
            .ok()?;
        let proved = prove(&lowered.plan, self.cell);
        let proved = proved.map_err(|error| diagnostics.push(*error)).ok()?;
        let seen = inspect(typed, &lowered);
        words.put_into(diagnostics);
        let compiled = Compiled {
            names: names(typed, &lowered),
            net: expanded.net.name.name.to_string(),
            description: expanded.net.description.clone(),
            plan: lowered.plan,
            checked: proved,
            warnings: sources.finish(std::mem::take(diagnostics)),
            primitives,
        };
        Some((compiled, seen))
    }

    fn run<T>(
        self,
        text: &str,
        file: &str,
        inspect: impl FnOnce(Typed<'_>, &Lowered) -> T,
    ) -> Result<(Compiled, T), Faults> {
        let mut reports = Reports {
            sources: SourceMap::new(file, text),
            diagnostics: Vec::new(),
            words: PortWords::default(),
        };
        let passed = self.passes((text, file), &mut reports, inspect);
        passed.ok_or_else(|| {
            reports.words.put_into(&mut reports.diagnostics);
            reports.sources.finish(reports.diagnostics)
        })
    }

    /// Compiles a text. `file` is the name that diagnostics show, and the path relative to which libraries are looked
    /// up.
    ///
    /// # Errors
    /// Returns all errors of the text and its libraries, and their warnings.
    pub fn compile(self, text: &str, file: &str) -> Result<Compiled, Faults> {
        self.run(text, file, |_, _| ())
            .map(|(compiled, ())| compiled)
    }

    /// Compiles a text, and returns the structure of the net as well.
    ///
    /// # Errors
    /// As [`Compiler::compile`].
    pub fn compile_with_structure(
        self,
        text: &str,
        file: &str,
    ) -> Result<(Compiled, NetStructure), Faults> {
        self.run(text, file, structure)
    }
}

/// Compiles a YAML or JSON text without libraries for the cell of a configuration.
///
/// # Errors
/// As [`Compiler::compile`].
pub fn compile(text: &str, file: &str, cell: &CellConfig) -> Result<Compiled, Faults> {
    compile_for(text, file, &DeviceTable::from(cell))
}

/// Compiles a YAML or JSON text without libraries for a table of devices.
///
/// # Errors
/// As [`Compiler::compile`].
pub fn compile_for(text: &str, file: &str, cell: &DeviceTable) -> Result<Compiled, Faults> {
    Compiler::of(cell).compile(text, file)
}
