//! `check FILE...`: the language's verdict, offline, with the loader's own library.

use std::path::{Path, PathBuf};

use rcc_config::{CellConfig, auto_ports};
use rcc_loader::server::api::Finding;
use rcc_loader::server::codes::exit;
use rcc_loader::server::compile::compile;
use serde::Serialize;

use crate::context::{Context, say};
use crate::failure::{Failure, draw};
use crate::follow::read_text;
use crate::supervisor::places;

/// What to check.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Nets, YAML or JSON; - is the standard input.
    #[arg(required = true)]
    files: Vec<String>,
    /// The cell's configuration whose devices the nets use (default: the demo cell's).
    #[arg(long)]
    config: Option<PathBuf>,
}

#[derive(Serialize)]
struct Verdict {
    file: String,
    valid: bool,
    net: String,
    primitives: u32,
    diagnostics: Vec<Finding>,
}

/// Does it.
///
/// # Errors
/// Exit code 3 when a net is not valid.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let config = match arguments.config {
        Some(path) => path,
        None => places::config("cells/demo.yaml")?,
    };
    let config = load_config(&config)?;
    let mut valid = true;
    for file in &arguments.files {
        let source = read_text(file)?;
        let (name, text) = &source;
        let verdict = match compile(text, name, &config) {
            Ok(compiled) => Verdict {
                file: name.clone(),
                valid: true,
                net: compiled.net,
                primitives: compiled.primitives,
                diagnostics: compiled.warnings,
            },
            Err(diagnostics) => Verdict {
                file: name.clone(),
                valid: false,
                net: String::new(),
                primitives: 0,
                diagnostics,
            },
        };
        valid &= verdict.valid;
        if context.format == crate::context::Format::Human {
            eprint!("{}", draw(&verdict.diagnostics, Some(&source), Context::colour()));
            if verdict.valid {
                say(&format!(
                    "{name}: {} is valid, {} primitives",
                    verdict.net, verdict.primitives
                ));
            }
        } else {
            context.print(&verdict, |_| String::new());
        }
    }
    if valid {
        Ok(())
    } else {
        Err(Failure::said(exit::INVALID))
    }
}

/// The configuration as far as nets are concerned: the numbers of automatic ports do not matter.
pub(super) fn load_config(path: &Path) -> Result<CellConfig, Failure> {
    let invalid = |faults| Failure::of_faults("the configuration is not valid", &faults);
    let ports = auto_ports(path).map_err(invalid)?;
    let ports = ports.into_iter().map(|(name, _)| (name, 1)).collect();
    CellConfig::load(path, &ports).map_err(invalid)
}
