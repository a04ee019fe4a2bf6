//! The incident files of the cell's flight recorder: a list, and the content of each. Run by blocking threads of the
//! server.

use std::fs::File;
use std::io;
use std::path::PathBuf;

use rcc_api::bodies::IncidentView;
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_api::incidents::{IncidentFolder, is_file_name};

use super::Service;

impl Service {
    fn incidents_dir(&self) -> PathBuf {
        self.executor.cell().state().incidents_dir()
    }

    /// Returns the incidents, oldest first.
    ///
    /// # Errors
    /// Returns an error if their folder cannot be read.
    pub fn incidents(&self) -> Result<Vec<IncidentView>, ApiError> {
        let folder = self.incidents_dir();
        let found = IncidentFolder::read(&folder).map_err(|error| {
            let message = format!("cannot read {}: {error}", folder.display());
            let help = "make the folder of incidents readable for the cell's user";
            ApiError::new(codes::PROCESS_FAILED, message, help)
        })?;
        for (path, error) in &found.unreadable {
            tracing::warn!("{}: {error}", path.display());
        }
        Ok(found.incidents)
    }

    /// Opens an incident file; returns it with its length in bytes.
    ///
    /// # Errors
    /// Returns an error if there is no such file, or if it cannot be read.
    pub fn open_incident(&self, name: &str) -> Result<(File, u64), ApiError> {
        let unknown = || {
            let shown: String = name.chars().take(200).collect();
            ApiError::new(
                codes::UNKNOWN_INCIDENT,
                format!("incident file `{shown}` not found"),
                "`GET /incidents` and `rcc-cli incidents` list the files; the recorder removes the oldest ones",
            )
        };
        if !is_file_name(name) {
            return Err(unknown());
        }
        let path = self.incidents_dir().join(name);
        let opened = rcc_os::file::open(&path).and_then(|file| {
            let length = file.metadata()?.len();
            Ok((file, length))
        });
        opened.map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => unknown(),
            _ => {
                let message = format!("cannot read {}: {error}", path.display());
                let help = "make the folder of incidents readable for the cell's user";
                ApiError::new(codes::PROCESS_FAILED, message, help)
            }
        })
    }
}
