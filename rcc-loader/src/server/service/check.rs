//! Checks a text without loading it: a net as LOAD compiles it, the configuration of a cell as a restart reads it. Run by
//! blocking threads of the server.

use std::path::Path;

use rcc_api::bodies::Checked;
use rcc_api::compile::{self, findings};
use rcc_api::error::ApiError;
use rcc_config::CellConfig;
use rcc_config::file_kind::FileKind;
use rcc_core::message::COMMANDS_MAX;
use rcc_protocol::control::Refusal;

use super::Service;

impl Service {
    /// Checks a net with the devices of this cell, or the configuration of a cell with the files beside this cell's own.
    /// Nothing is loaded, so nothing is rehearsed.
    ///
    /// # Errors
    /// Returns an error if this cell would refuse every net: there is no executor, it has another configuration, or its
    /// table is full.
    pub fn check(&self, text: &str, file: &str) -> Result<Checked, ApiError> {
        if FileKind::of_text(text) == Some(FileKind::Cell) {
            return Ok(self.check_cell(text, file));
        }
        let (attached, _) = self.attach()?;
        self.require_agreement(&attached)?;
        let rows = attached.tables().commands.len();
        if rows >= COMMANDS_MAX {
            return Err(self.with_names(None, |names| names.refusal(0, Refusal::TableFull)));
        }
        let checked = Checked {
            kind: "net".to_owned(),
            name: compile::name_of(text),
            ..Checked::default()
        };
        Ok(match compile::compile(text, file, &self.devices) {
            Ok(compiled) => Checked {
                valid: true,
                diagnostics: compiled.warnings,
                uses: self.named_uses(0, compiled.uses, &compiled.topics),
                ..checked
            },
            Err(diagnostics) => Checked {
                diagnostics,
                ..checked
            },
        })
    }

    fn check_cell(&self, text: &str, file: &str) -> Checked {
        let folder = self.config.source.parent().unwrap_or(Path::new(""));
        let read = CellConfig::parse_offline(text, file, folder);
        let diagnostics = read.map_or_else(|faults| findings(&faults), |_| Vec::new());
        Checked {
            kind: "cell".to_owned(),
            valid: diagnostics.is_empty(),
            diagnostics,
            ..Checked::default()
        }
    }
}
