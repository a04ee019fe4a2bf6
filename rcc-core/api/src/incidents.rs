//! Lists the incident files of a folder. Reads files only, so that it works without any process of the cell; used by
//! blocking threads of the loader and by the command line.

use std::io;
use std::path::{Path, PathBuf};

use rcc_engine::incident::{EXTENSION, IncidentError, IncidentHead, read_head};
use serde::Deserialize;

use crate::bodies::IncidentView;

/// The incident files of a folder.
#[derive(Debug, Default)]
pub struct IncidentFolder {
    /// The incidents, oldest first.
    pub incidents: Vec<IncidentView>,
    /// Files that are named like incidents and cannot be read as one.
    pub unreadable: Vec<(PathBuf, IncidentError)>,
}

impl IncidentFolder {
    /// Reads the heads of all incident files; a folder that does not exist has none.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be read.
    pub fn read(folder: &Path) -> io::Result<IncidentFolder> {
        let mut found = IncidentFolder::default();
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(found),
            Err(error) => return Err(error),
        };
        for path in entries.flatten().map(|entry| entry.path()) {
            if path.extension().is_none_or(|is| is != EXTENSION) {
                continue;
            }
            match read_head(&path) {
                Ok((head, command)) => found.incidents.push(view(&path, head, command.as_deref())),
                // The recorder has just removed one of the oldest files.
                Err(IncidentError::Read(error)) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => found.unreadable.push((path, error)),
            }
        }
        found.incidents.sort_by(|a, b| a.time.cmp(&b.time));
        Ok(found)
    }
}

/// Returns true for a name that an incident file may have: never a path to another folder.
#[must_use]
pub fn is_file_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let stem = name
        .strip_suffix(EXTENSION)
        .and_then(|stem| stem.strip_suffix('.'));
    stem.is_some_and(|stem| !stem.is_empty() && !stem.starts_with('.')) && name.chars().all(allowed)
}

/// The part of a command file that names the net.
#[derive(Default, Deserialize)]
struct CommandName {
    net: String,
}

/// Returns an incident as clients receive it; `command` is the command file of its net.
#[must_use]
pub fn view(file: &Path, head: IncidentHead, command: Option<&[u8]>) -> IncidentView {
    let name = head.net.map(|id| {
        let known = command.and_then(|bytes| serde_json::from_slice::<CommandName>(bytes).ok());
        format!("{}#{id}", known.unwrap_or_default().net)
    });
    let cycles = (head.last_cycle + 1).saturating_sub(head.first_cycle);
    IncidentView {
        file: file.display().to_string(),
        name,
        span_s: cycles as f64 * head.period_ns as f64 * 1e-9,
        format: head.format,
        build: head.build,
        layout: head.layout,
        catalogue: head.catalogue,
        configuration: head.configuration,
        cell: head.cell,
        config: head.config,
        executor: head.executor,
        period_ns: head.period_ns,
        devices: head.devices,
        reason: head.reason,
        net: head.net,
        fault: head.fault,
        condition: head.condition,
        cycle: head.cycle,
        time: head.time,
        others: head.others,
        first_cycle: head.first_cycle,
        last_cycle: head.last_cycle,
        nets: head.nets,
        without_plan: head.without_plan,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_never_leaves_the_folder() {
        assert!(is_file_name("00ab-12-fault.rcc-incident"));
        for name in [
            "",
            ".rcc-incident",
            "..rcc-incident",
            "../x.rcc-incident",
            "a/b.rcc-incident",
            "x.rcc-incident/..",
            "x\0.rcc-incident",
            "cell.json",
            "xrcc-incident",
        ] {
            assert!(!is_file_name(name), "{name:?}");
        }
    }

    #[test]
    fn an_incident_has_the_name_of_its_net_and_its_length() {
        let head = IncidentHead {
            net: Some(3),
            first_cycle: 1001,
            last_cycle: 3000,
            period_ns: 1_000_000,
            ..IncidentHead::default()
        };
        let named = view(
            Path::new("x"),
            head.clone(),
            Some(br#"{"id": 3, "net": "line"}"#),
        );
        assert_eq!(named.name.as_deref(), Some("line#3"));
        assert!((named.span_s - 2.0).abs() < 1e-9);
        let unnamed = view(Path::new("x"), head, Some(b"{"));
        assert_eq!(unnamed.name.as_deref(), Some("#3"));
    }
}
