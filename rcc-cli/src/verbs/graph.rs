//! `graph NET|FILE`: a picture of a net, with the values of a running one on demand.

use std::path::PathBuf;

use rcc_graph::scene::{BOXES_MAX, scene};
use rcc_graph::{dot::dot, mermaid::mermaid, svg::svg};
use rcc_loader::server::codes;

use super::source::{self, Found};
use crate::context::{Context, say};
use crate::failure::Failure;

/// Of what, and as what.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// A file (YAML or JSON; - is the standard input), or a loaded net by name or id.
    net: String,
    /// As what.
    #[arg(long, value_enum, default_value = "svg")]
    format: Kind,
    /// Write to this file instead of the standard output.
    #[arg(short = 'o', long, value_name = "FILE")]
    file: Option<PathBuf>,
    /// The cell's configuration whose devices the net uses (default: the running cell's, else the demo cell's).
    #[arg(long)]
    config: Option<PathBuf>,
}

/// Forms of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// A picture for browsers and documents.
    Svg,
    /// For Graphviz.
    Dot,
    /// For Markdown.
    Mermaid,
}

/// Does it.
///
/// # Errors
/// The file is not there or not valid, there is no such net, it is too large for a picture, or nothing can be written.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let Found { anatomy, .. } = source::find(context, &arguments.net, arguments.config)?;
    let picture = match arguments.format {
        Kind::Dot => dot(&anatomy, None),
        Kind::Mermaid => mermaid(&anatomy, None),
        Kind::Svg => {
            let scene = scene(&anatomy, None).map_err(|many| {
                let message = format!("the net would be {} boxes, {BOXES_MAX} are a picture", many.boxes);
                let help = "use `--format dot`, which Graphviz draws at any size (`sfdp`), or `rcc-cli explain`";
                Failure::new(codes::BAD_REQUEST, message, help)
            })?;
            svg(&anatomy, &scene)
        }
    };
    match arguments.file {
        None => say(&picture),
        Some(path) => std::fs::write(&path, picture)
            .map_err(|error| Failure::new(codes::NOT_STORED, format!("{}: {error}", path.display()), ""))?,
    }
    Ok(())
}
