//! What several verbs do with one command: load and wait, follow until it is over, tell its states.
//! Runs on the caller's thread and asks the loader at a person's pace.

use std::path::Path;
use std::time::{Duration, Instant};

use rcc_language::bundle::bundle;
use rcc_language::library::FileLibraries;
use rcc_loader::server::api::{CommandDetail, CommandView, Done, Loaded, CommandRef, Switch, Switched};
use rcc_loader::server::codes::{self, RequestedEnd, exit};
use rcc_loader::server::compile::findings;

use rcc_os::file;

use crate::client::{Client, segment};
use crate::failure::Failure;
use crate::output::print_note;

/// How often a state is asked for.
pub const POLL: Duration = Duration::from_millis(20);
/// How long a net may take from `loading` to `ready`.
pub const LOAD_LIMIT: Duration = Duration::from_secs(30);

/// The text of a net, `-` is the standard input; with the name that diagnostics use.
///
/// # Errors
/// The file cannot be read.
pub fn read_text(path: &str) -> Result<(String, String), Failure> {
    let name = if path == "-" { "standard input" } else { path };
    given(path, TEXT_MAX)
        .map(|text| (name.to_owned(), text))
        .map_err(|error| Failure::unreadable(name, &error))
}

/// A text that was named on the command line, of at most `max` bytes; `-` is the standard input. A pipe is read (`<(…)`
/// is one), something without end is not.
///
/// # Errors
/// It cannot be read, is too long or is no text.
pub fn given(path: &str, max: u64) -> std::io::Result<String> {
    match path {
        "-" => file::read_stream(std::io::stdin(), max),
        path => file::read_given(Path::new(path), max),
    }
}

/// Reads a net as one text: with the fragments of the libraries that it uses, which a cell could not read.
///
/// # Errors
/// The file cannot be read, or a library is missing or not valid.
pub fn read_net(path: &str) -> Result<(String, String), Failure> {
    let (name, text) = read_text(path)?;
    let bundled = bundle(&text, &name, &FileLibraries).map_err(|faults| {
        let what = format!("{name} is not valid");
        Failure::invalid(&what, findings(&faults), (name.clone(), text.clone()))
    })?;
    Ok((name, bundled.into_owned()))
}

/// Longest text of a net, bytes; more is refused by the loader, too.
pub const TEXT_MAX: u64 = rcc_loader::server::bodies::TEXT_MAX as u64;

/// What becomes of a command that is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnRejection {
    /// It stays, so that STATE shows why.
    Keep,
    /// It is unloaded: its diagnostics are shown, and nobody knows its id.
    Unload,
}

/// LOAD: gives the text to the core and waits until it is `ready`.
///
/// # Errors
/// Not reachable, or rejected, with the diagnostics.
pub fn load(
    client: &Client,
    name: &str,
    text: &str,
    rejected: OnRejection,
) -> Result<CommandView, Failure> {
    let path = format!("/commands?file={}", segment(name));
    let Loaded { id, .. } = client.post(&path, text.to_owned())?;
    let limit = Instant::now() + LOAD_LIMIT;
    loop {
        let command = brief(client, &id.to_string())?;
        match command.state.as_str() {
            "loading" if Instant::now() < limit => std::thread::sleep(POLL),
            "loading" => {
                return Err(Failure::new(
                    codes::LOADER_SILENT,
                    format!("command {id} is still loading after {LOAD_LIMIT:?}"),
                    "check it with `rcc-cli state`",
                ));
            }
            "rejected" => {
                let source = (name.to_owned(), text.to_owned());
                let what = format!("{name} is rejected");
                if rejected == OnRejection::Unload {
                    // Failing leaves it in the table, where `unload` finds it.
                    let _ = unload(client, id);
                }
                return Err(Failure::invalid(&what, command.diagnostics, source));
            }
            _ => return Ok(command),
        }
    }
}

/// UNLOAD.
///
/// # Errors
/// Not reachable, or refused.
pub fn unload(client: &Client, id: u64) -> Result<Done, Failure> {
    client.delete(&format!("/commands/{id}"))
}

/// One command, without its text and names: to be asked for often.
///
/// # Errors
/// Not reachable, or no such command.
pub fn brief(client: &Client, name: &str) -> Result<CommandView, Failure> {
    client.get(&format!("/commands/{}?brief=true", segment(name)))
}

/// One command with its text and names.
///
/// # Errors
/// Not reachable, or no such command.
pub fn state(client: &Client, name: &str) -> Result<CommandDetail, Failure> {
    client.get(&format!("/commands/{}", segment(name)))
}

/// `start`, `cancel` or `abort`.
///
/// # Errors
/// Not reachable, or refused.
pub fn operate(client: &Client, name: &str, what: &str) -> Result<Done, Failure> {
    client.post(
        &format!("/commands/{}/{what}", segment(name)),
        String::new(),
    )
}

/// START of some commands after stopping others, between the same two cycles.
///
/// # Errors
/// Not reachable, or refused: then nothing has changed.
pub fn switch(client: &Client, stop: &[String], start: &[String]) -> Result<Switched, Failure> {
    let named = |names: &[String]| names.iter().cloned().map(CommandRef::Name).collect();
    let switch = Switch {
        stop: named(stop),
        start: named(start),
    };
    let body = serde_json::to_string(&switch).map_err(|error| {
        Failure::new(
            codes::BAD_REQUEST,
            error.to_string(),
            "write the names as UTF-8",
        )
    })?;
    client.post("/switch", body)
}

/// `net#id`.
#[must_use]
pub fn title(command: &CommandView) -> String {
    format!("{}#{}", command.net, command.id)
}

/// The state with its reason and fault: `terminated (fault: device lost)`.
#[must_use]
pub fn state_words(command: &CommandView) -> String {
    match (&command.fault, &command.reason) {
        (Some(fault), _) => format!("{} (fault: {})", command.state, fault.fault),
        (None, Some(reason)) => format!("{} ({reason})", command.state),
        (None, None) => command.state.clone(),
    }
}

/// True when nothing will change any more.
#[must_use]
pub fn is_over(command: &CommandView) -> bool {
    matches!(command.state.as_str(), "terminated" | "rejected")
}

/// The exit code of a command that is over, by how it ended and what was asked of it. What is no success is told.
///
/// # Errors
/// Everything that was not asked for, with its words on stderr.
pub fn judge(command: &CommandView, asked: RequestedEnd) -> Result<(), Failure> {
    let code = codes::outcome(asked, command.reason.as_deref());
    if code == exit::OK {
        return Ok(());
    }
    let title = title(command);
    if let Some(fault) = &command.fault {
        print_note(&format!("{title}: {}", fault.words));
    } else if code == exit::CANCELED {
        print_note(&format!(
            "{title} was canceled before it finished, and not by this command (see `rcc-cli events`); exit code {code}"
        ));
    }
    Err(Failure::said(code))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_loader::server::api::FaultView;

    fn command(reason: &str) -> CommandView {
        CommandView {
            state: "terminated".into(),
            reason: Some(reason.into()),
            ..CommandView::default()
        }
    }

    #[test]
    fn only_what_was_asked_for_is_a_success() {
        for (reason, finish, cancel) in [
            ("finished", Ok(()), Ok(())),
            ("canceled", Err(Failure::said(8)), Ok(())),
            ("aborted", Err(Failure::said(1)), Err(Failure::said(1))),
            ("fault", Err(Failure::said(1)), Err(Failure::said(1))),
        ] {
            assert_eq!(judge(&command(reason), RequestedEnd::Finish), finish, "{reason}");
            assert_eq!(judge(&command(reason), RequestedEnd::Cancel), cancel, "{reason}");
        }
    }

    #[test]
    fn a_fault_is_named_with_the_state() {
        let mut lost = command("fault");
        lost.fault = Some(FaultView {
            fault: "device lost".into(),
            ..FaultView::default()
        });
        assert_eq!(state_words(&lost), "terminated (fault: device lost)");
        assert_eq!(state_words(&command("finished")), "terminated (finished)");
    }
}
