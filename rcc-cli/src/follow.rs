//! Operations on one command that several verbs share: load and wait, follow until it ends, describe its state. Runs on
//! the caller's thread and polls the loader at 20 ms.

use std::path::Path;
use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandDetail, CommandRef, CommandView, Done, Switch, Switched};
use rcc_api::codes::{self, RequestedEnd, exit};
use rcc_api::compile::findings;
use rcc_language::bundle::bundle;
use rcc_language::library::FileLibraries;
use rcc_protocol::ending::{ending, why_at_once};

use rcc_os::file;

use crate::client::{LoaderClient, segment};
use crate::failure::Failure;
use crate::output::print_note;

/// Interval between two polls of a command's state.
pub const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Longest time that a net may take from `loading` to `ready`.
pub const LOAD_TIMEOUT: Duration = Duration::from_secs(30);

/// Reads the text of a net (`-` is the standard input); returns the name used in diagnostics, and the text.
///
/// # Errors
/// Fails if the file cannot be read.
pub fn read_text(path: &str) -> Result<(String, String), Failure> {
    let name = if path == "-" { "standard input" } else { path };
    read_named_text(path, TEXT_MAX)
        .map(|text| (name.to_owned(), text))
        .map_err(|error| Failure::unreadable(name, &error))
}

/// Reads a text named on the command line, of at most `max` bytes; `-` is the standard input. Pipes such as `<(…)` are
/// read; endless streams are not.
///
/// # Errors
/// Fails if it cannot be read, is too long or is not UTF-8 text.
pub fn read_named_text(path: &str, max: u64) -> std::io::Result<String> {
    match path {
        "-" => file::read_stream(std::io::stdin(), max),
        path => file::read_given(Path::new(path), max),
    }
}

/// Reads a net as one text that includes the fragments of its libraries, which a cell could not read.
///
/// # Errors
/// Fails if the file cannot be read, or if a library is missing or invalid.
pub fn read_net(path: &str) -> Result<(String, String), Failure> {
    let (name, text) = read_text(path)?;
    let bundled = bundle(&text, &name, &FileLibraries).map_err(|faults| {
        let what = format!("{name} is invalid");
        Failure::invalid(&what, findings(&faults), (name.clone(), text.clone()))
    })?;
    Ok((name, bundled.into_owned()))
}

/// Longest text of a net, bytes; the loader refuses longer texts as well.
pub const TEXT_MAX: u64 = rcc_api::routes::TEXT_MAX as u64;

/// Treatment of a command that the loader rejects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnRejection {
    /// Keep it, so that STATE shows the reason.
    Keep,
    /// Unload it: its diagnostics are printed, and nobody knows its id.
    Unload,
}

/// LOAD: sends the text to the core and waits until the net is `ready`.
///
/// # Errors
/// Fails if the loader cannot be reached or rejects the net; includes the diagnostics.
pub fn load(
    client: &LoaderClient,
    name: &str,
    text: &str,
    rejected: OnRejection,
) -> Result<CommandView, Failure> {
    let command = client.load(name, text, LOAD_TIMEOUT)?;
    let id = command.id;
    match command.state.as_str() {
        "loading" => Err(Failure::new(
            codes::LOADER_SILENT,
            format!("command {id} is still loading after {LOAD_TIMEOUT:?}"),
            "check it with `rcc-cli state`",
        )),
        "rejected" => {
            let source = (name.to_owned(), text.to_owned());
            let what = format!("{name} is rejected");
            if rejected == OnRejection::Unload {
                // If this fails, the command stays in the table, where `unload` can remove it.
                let _ = unload(client, &id.to_string());
            }
            Err(Failure::invalid(&what, command.diagnostics, source))
        }
        _ => Ok(command),
    }
}

/// UNLOAD: removes a command that is not active.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses.
pub fn unload(client: &LoaderClient, name: &str) -> Result<Done, Failure> {
    client.delete(&format!("/commands/{}", segment(name)))
}

/// Returns one command without its text and names, or how it had ended when it was unloaded; cheap enough for polling.
///
/// # Errors
/// Fails if the loader cannot be reached, or if the command does not exist and is none of the last that were unloaded.
pub fn even_unloaded(client: &LoaderClient, id: &str) -> Result<CommandView, Failure> {
    client.get(&format!("/commands/{}?unloaded=true", segment(id)))
}

/// Returns one command with its text and names.
///
/// # Errors
/// Fails if the loader cannot be reached or the command does not exist.
pub fn state(client: &LoaderClient, name: &str) -> Result<CommandDetail, Failure> {
    client.get(&format!("/commands/{}", segment(name)))
}

/// Sends `start`, `cancel` or `abort`.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses.
pub fn operate(client: &LoaderClient, name: &str, what: &str) -> Result<Done, Failure> {
    client.post(
        &format!("/commands/{}/{what}", segment(name)),
        String::new(),
    )
}

/// Starts some commands and stops others between the same two cycles.
///
/// # Errors
/// Fails if the loader cannot be reached or refuses; then nothing has changed.
pub fn switch(
    client: &LoaderClient,
    stop: &[String],
    start: &[String],
) -> Result<Switched, Failure> {
    let named = |names: &[String]| names.iter().cloned().map(CommandRef::Name).collect();
    let switch = Switch {
        stop: named(stop),
        start: named(start),
        ..Switch::default()
    };
    let body = serde_json::to_string(&switch)
        .map_err(|error| Failure::new(codes::BAD_REQUEST, error.to_string(), "use UTF-8 names"))?;
    client.post("/switch", body)
}

/// Longest time to wait for a loader that died while a command is followed.
const LOADER_RESTART_TIMEOUT: Duration = Duration::from_secs(5);

/// Follows one command; tolerates a loader that dies and is restarted, because the net runs on meanwhile.
#[derive(Debug)]
pub struct CommandPoll {
    id: String,
    answered: Instant,
}

impl CommandPoll {
    /// Follows the command with this id, whatever is loaded under its name later.
    #[must_use]
    pub fn new(id: u64) -> CommandPoll {
        CommandPoll {
            id: id.to_string(),
            answered: Instant::now(),
        }
    }

    /// Returns the state of the command, also after somebody unloaded it; `None` while the loader is being restarted.
    ///
    /// # Errors
    /// Fails if the loader stays away, or if the command was unloaded before it had run.
    pub fn state(&mut self, client: &LoaderClient) -> Result<Option<CommandView>, Failure> {
        match even_unloaded(client, &self.id) {
            Err(failure)
                if failure.exit == exit::UNREACHABLE
                    && self.answered.elapsed() < LOADER_RESTART_TIMEOUT =>
            {
                Ok(None)
            }
            state => {
                self.answered = Instant::now();
                state.map(Some)
            }
        }
    }
}

/// Formats a command as `net#id`.
#[must_use]
pub fn title(command: &CommandView) -> String {
    format!("{}#{}", command.net, command.id)
}

/// Formats the state with its fault, or its reason and outcome: `terminated (fault: device lost)`, `terminated
/// (finished: arrived)`.
#[must_use]
pub fn state_text(command: &CommandView) -> String {
    match (&command.fault, &command.reason) {
        (Some(fault), _) => format!("{} (fault: {})", command.state, fault.fault),
        (None, Some(reason)) => {
            let ending = ending(reason, command.outcome.as_deref(), command.cycles);
            format!("{} ({ending})", command.state)
        }
        (None, None) => command.state.clone(),
    }
}

/// Returns true if the command's state is final.
#[must_use]
pub fn is_over(command: &CommandView) -> bool {
    matches!(command.state.as_str(), "terminated" | "rejected")
}

/// Judges a command that has ended by how it ended and by what was requested of it; prints the reason of a failure.
///
/// # Errors
/// Fails with the exit code of every outcome that was not requested.
pub fn exit_result(command: &CommandView, asked: RequestedEnd) -> Result<(), Failure> {
    let reason = command.reason.as_deref();
    let code = codes::outcome(asked, reason);
    let title = title(command);
    if code == exit::OK {
        let outcome = command.outcome.as_deref();
        if let Some(why) = why_at_once(reason.unwrap_or_default(), outcome, command.cycles) {
            print_note(&format!("{title} finished in its first cycle: {why}"));
        }
        return Ok(());
    }
    if let Some(fault) = &command.fault {
        print_note(&format!("{title}: {}", fault.words));
    } else if code == exit::CANCELED {
        print_note(&format!(
            "{title} was canceled before it finished (see `rcc-cli events`); exit code {code}"
        ));
    }
    Err(Failure::reported(code))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_api::bodies::FaultView;

    fn command(reason: &str) -> CommandView {
        CommandView {
            state: "terminated".into(),
            reason: Some(reason.into()),
            ..CommandView::default()
        }
    }

    #[test]
    fn only_the_requested_outcome_is_a_success() {
        for (reason, finish, cancel) in [
            ("finished", Ok(()), Ok(())),
            ("canceled", Err(Failure::reported(8)), Ok(())),
            (
                "aborted",
                Err(Failure::reported(1)),
                Err(Failure::reported(1)),
            ),
            (
                "fault",
                Err(Failure::reported(1)),
                Err(Failure::reported(1)),
            ),
        ] {
            assert_eq!(
                exit_result(&command(reason), RequestedEnd::Finish),
                finish,
                "{reason}"
            );
            assert_eq!(
                exit_result(&command(reason), RequestedEnd::Cancel),
                cancel,
                "{reason}"
            );
        }
    }

    #[test]
    fn a_fault_is_named_with_the_state() {
        let mut lost = command("fault");
        lost.fault = Some(FaultView {
            fault: "device lost".into(),
            ..FaultView::default()
        });
        assert_eq!(state_text(&lost), "terminated (fault: device lost)");
        assert_eq!(state_text(&command("finished")), "terminated (finished)");
    }
}
