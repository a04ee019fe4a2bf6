//! `rcc-janitor --cell NAME [--runtime-dir DIR [--state-dir DIR]] [--wipe]`: cleans up after dead processes of one cell,
//! and exits. A separate process, because this work may hang in iceoryx2; its parent kills it after a second.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use rcc_core::counted::Counted;
use rcc_ipc::cell::person;
use rcc_ipc::{Cell, clean, events};
use rcc_protocol::version::version;

const USAGE: &str = "usage: rcc-janitor --cell NAME [--runtime-dir DIR [--state-dir DIR]] [--wipe]
Removes the shared memory that dead processes of the cell left behind; with --wipe, everything of a dead cell.
Exit code 0: success. 1: failure, with the reason. 2: invalid arguments.";

struct Arguments {
    name: String,
    runtime_dir: Option<PathBuf>,
    state_dir: Option<PathBuf>,
    wipe: bool,
}

fn arguments(given: impl IntoIterator<Item = OsString>) -> Option<Arguments> {
    let mut name = None;
    let mut runtime_dir = None;
    let mut state_dir = None;
    let mut wipe = false;
    let mut given = given.into_iter();
    while let Some(argument) = given.next() {
        match argument.to_str() {
            Some("--cell") => name = Some(given.next()?.into_string().ok()?),
            Some("--runtime-dir") => runtime_dir = Some(PathBuf::from(given.next()?)),
            Some("--state-dir") => state_dir = Some(PathBuf::from(given.next()?)),
            Some("--wipe") => wipe = true,
            _ => return None,
        }
    }
    // Alone it would be ignored: the runtime folder of a cell determines its state folder otherwise.
    if state_dir.is_some() && runtime_dir.is_none() {
        return None;
    }
    Some(Arguments {
        name: name?,
        runtime_dir,
        state_dir,
        wipe,
    })
}

fn main() -> ExitCode {
    let asked: Vec<_> = std::env::args_os().skip(1).take(2).collect();
    match asked.as_slice() {
        [one] if one == "--version" => return print(&format!("rcc-janitor {}", version())),
        [one] if one == "--help" => return print(USAGE),
        _ => {}
    }
    let Some(arguments) = arguments(std::env::args_os().skip(1)) else {
        remark(USAGE);
        return ExitCode::from(2);
    };
    match run(&arguments) {
        Ok(words) => print(&words),
        Err(error) => {
            remark(&error.to_string());
            ExitCode::FAILURE
        }
    }
}

/// Prints on stdout. The cleaning is done; the parent may be dead.
fn print(words: &str) -> ExitCode {
    let _ = writeln!(std::io::stdout(), "{words}");
    ExitCode::SUCCESS
}

/// Prints on stderr; if that fails, the exit code still tells.
fn remark(words: &str) {
    let _ = writeln!(std::io::stderr(), "{words}");
}

fn run(arguments: &Arguments) -> Result<String, Box<dyn std::error::Error>> {
    let cell = match (&arguments.runtime_dir, &arguments.state_dir) {
        (Some(folder), Some(state)) => Cell::in_folders(&arguments.name, folder, state.clone())?,
        (Some(folder), None) => Cell::at(&arguments.name, folder)?,
        (None, _) => Cell::new(&arguments.name)?,
    };
    if arguments.wipe {
        let report = clean::wipe(&cell)?;
        let files = Counted::of(report.shared_memory, "shared-memory file");
        let announcements = Counted::of(report.announcements, "announcement");
        let mut words = format!(
            "cell `{}`: removed {files} and {announcements}",
            cell.name()
        );
        // The next start uses another prefix, so these files block nothing.
        for foreign in cell.foreign()? {
            let (path, owner) = (foreign.path.display(), person(foreign.owner));
            words += &format!("\nskipped: {path} belongs to {owner}; it does not block the cell");
        }
        return Ok(words);
    }
    let report = clean::clean_as_janitor(&cell)?;
    events::log_cleaning(&cell, &report);
    Ok(serde_json::to_string(&report)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_folder_without_a_runtime_folder_is_refused() {
        let read = |words: &str| arguments(words.split(' ').map(OsString::from));
        let both = read("--cell demo --runtime-dir /run/x --state-dir /var/x --wipe");
        let both = both.expect("valid");
        assert_eq!(both.state_dir, Some(PathBuf::from("/var/x")));
        assert!(both.wipe && read("--cell demo --runtime-dir /run/x").is_some());
        assert!(read("--cell demo --state-dir /var/x").is_none());
        assert!(read("--cell demo --state-dir").is_none() && read("--wipe").is_none());
    }
}
