//! Compiled structures and drawings of loaded nets, kept for as long as their executor lives. Compiled by blocking
//! threads, one at a time.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

use rcc_api::bodies::ErrorBody;
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_config::CellConfig;
use rcc_graph::scene::{BOXES_MAX, scene};
use rcc_graph::svg::svg;
use rcc_language::Compiler;
use rcc_language::devices::DeviceTable;
use rcc_language::library::NoLibraries;
use rcc_language::structure::NetStructure;

use super::locked::locked;

/// Number of nets that are kept.
const KEPT_MAX: usize = 64;

/// Structures of nets, by executor and id.
#[derive(Debug, Default)]
pub struct Drawings {
    kept: Mutex<HashMap<(String, u64), Arc<NetStructure>>>,
}

impl Drawings {
    /// Returns a structure that is kept.
    #[must_use]
    pub fn known(&self, executor: &str, id: u64) -> Option<Arc<NetStructure>> {
        locked(&self.kept).get(&(executor.to_owned(), id)).cloned()
    }

    /// Compiles a net's text. Not for the serving thread.
    ///
    /// # Errors
    /// Returns an error if the text cannot be compiled for this configuration, which then is not the cell's any more.
    pub fn compile(
        &self,
        (executor, id): (&str, u64),
        (name, text): (&str, &str),
        config: &CellConfig,
    ) -> Result<Arc<NetStructure>, ErrorBody> {
        let cell = DeviceTable::from(config);
        let compiler = Compiler {
            libraries: &NoLibraries,
            ..rcc_directionet::compiler(&cell)
        };
        let compiled = compiler.compile_with_structure(text, name);
        let (_, structure) = compiled.map_err(|_| {
            let message = format!(
                "{name}#{id} cannot be compiled for {}",
                config.source.display()
            );
            let help = "the configuration changed after the cell was started: restart the cell";
            ApiError::new(codes::BAD_REQUEST, message, help).body()
        })?;
        let structure = Arc::new(structure);
        let mut kept = locked(&self.kept);
        if kept.len() >= KEPT_MAX {
            kept.clear();
        }
        kept.insert((executor.to_owned(), id), Arc::clone(&structure));
        Ok(structure)
    }
}

/// Draws a net as SVG. Not for the serving thread.
///
/// # Errors
/// Returns an error if it has too many boxes.
pub fn draw(structure: &NetStructure) -> Result<String, ErrorBody> {
    let scene = scene(structure, None).map_err(|many| {
        let message = format!(
            "the net has {} boxes; at most {BOXES_MAX} can be drawn",
            many.boxes
        );
        ApiError::new(
            codes::BAD_REQUEST,
            message,
            "`rcc-cli graph --format dot` draws nets of any size",
        )
        .body()
    })?;
    Ok(svg(structure, &scene))
}

/// Reads a cell's configuration; its automatic ports do not matter here.
///
/// # Errors
/// Returns an error if the file cannot be read or is invalid.
pub fn configuration(path: &Path) -> Result<CellConfig, ErrorBody> {
    CellConfig::load_offline(path).map_err(|_| {
        let message = format!("{} cannot be read", path.display());
        let help = "`rcc-cli check` shows its faults; graphs and arms need it";
        ApiError::new(codes::BAD_REQUEST, message, help).body()
    })
}
