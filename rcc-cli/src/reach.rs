//! Selects the cell of a verb by `--url` or `--cell`; a verb that cannot serve the given address refuses it. Pure; run
//! once by the main thread.

use clap::ArgMatches;
use clap::parser::ValueSource;
use rcc_api::codes;

use crate::failure::Failure;
use crate::verbs::Verb;

/// How a verb uses the address of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Serves the cell at the address over HTTP.
    Cell,
    /// Works on processes, files or settings of the machine on which it runs.
    Machine {
        /// Predicate of the refusal: it follows the verb's name.
        does: &'static str,
        /// Remedy for a cell on another machine.
        instead: &'static str,
    },
    /// Works on files that are given to it.
    Files,
}

impl Verb {
    /// Returns how the verb uses the address of a cell.
    #[must_use]
    pub fn reach(&self) -> Reach {
        let machine = |does, instead| Reach::Machine { does, instead };
        match self {
            Verb::Replay(arguments) if arguments.is_of_a_cell() => machine(
                "replays incidents that are kept on this machine",
                "`rcc-cli incidents fetch NAME` downloads one of the cell at the address; replay that file",
            ),
            Verb::Load(_)
            | Verb::Start(_)
            | Verb::Run(_)
            | Verb::Set(_)
            | Verb::Rules(_)
            | Verb::Task(_)
            | Verb::Watch(_)
            | Verb::Wait(_)
            | Verb::Cancel(_)
            | Verb::Abort(_)
            | Verb::Unload(_)
            | Verb::State(_)
            | Verb::Ls(_)
            | Verb::Topics(_)
            | Verb::Devices(_)
            | Verb::Primitives(_)
            | Verb::Schema(_)
            | Verb::Status(_)
            | Verb::Top(_)
            | Verb::Tail(_)
            | Verb::Events(_)
            | Verb::Incidents(_)
            | Verb::Explain(_)
            | Verb::Graph(_) => Reach::Cell,
            Verb::Check(_)
            | Verb::Fmt(_)
            | Verb::Convert(_)
            | Verb::Robot(_)
            | Verb::Simulate(_)
            | Verb::Plot(_)
            | Verb::Replay(_)
            | Verb::Import(_)
            | Verb::Wrench(_)
            | Verb::Completions(_)
            | Verb::Man(_) => Reach::Files,
            Verb::Demo(_) => machine(
                "runs a cell of its own on this machine",
                "`rcc-cli run FILE` runs a net in the cell at the address",
            ),
            Verb::Up(_) => machine(
                "starts a cell on this machine",
                "start it there: `ssh HOST rcc-cli up FILE`",
            ),
            Verb::Down(_) => machine(
                "ends a cell on this machine",
                "run it there: `ssh HOST rcc-cli down`",
            ),
            Verb::Costs(_) => machine(
                "measures this machine",
                "`rcc-cli top` shows the measured times of the cell at the address",
            ),
            Verb::Fault(_) => machine(
                "signals processes and simulators of this machine",
                "run it there: `ssh HOST rcc-cli fault …`",
            ),
            Verb::Sim(_) => machine(
                "asks simulators of this machine",
                "run it there: `ssh HOST rcc-cli sim …`",
            ),
            Verb::Doctor(_) => machine(
                "checks this machine and the cells on it",
                "run it there: `ssh HOST rcc-cli doctor`; `rcc-cli status`, `devices` and `events` serve the address",
            ),
            Verb::Serve(_) => machine(
                "serves the dashboard of a cell on this machine",
                "run it there and forward its port: `ssh -L 7426:127.0.0.1:7426 HOST rcc-cli serve --port 7426`",
            ),
            Verb::Fleet(_) => machine(
                "reaches cells over Zenoh",
                "`rcc-cli fleet cells --connect ENDPOINT` lists them",
            ),
            Verb::Record(_) => machine(
                "reads shared memory of this machine",
                "run it there: `ssh HOST rcc-cli record FILE`, then copy the file",
            ),
            Verb::InstallUnits(_) => machine(
                "installs units on this machine",
                "run it there: `ssh HOST rcc-cli install-units FILE`",
            ),
            Verb::RtSetup(_) => machine(
                "changes settings of this machine",
                "run it there: `ssh HOST rcc-cli rt-setup`",
            ),
        }
    }
}

/// A value and whether the command line gives it; otherwise the environment does.
type Given = Option<(String, bool)>;

/// The selected cell: at most one of both.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SelectedAddress {
    /// Address of its loader.
    pub url: Option<String>,
    /// Name on this machine.
    pub cell: Option<String>,
}

impl SelectedAddress {
    /// Selects by the arguments of the command line, else by `RCC_URL` and `RCC_CELL`.
    ///
    /// # Errors
    /// Fails if both are given, or if the verb cannot serve the address.
    pub fn of(matches: &ArgMatches, reach: Reach) -> Result<SelectedAddress, Failure> {
        let given = |name: &str| -> Given {
            let value = matches.get_one::<String>(name)?;
            let on_command_line = matches.value_source(name) == Some(ValueSource::CommandLine);
            // An empty variable is one that is not set.
            (!value.is_empty()).then(|| (value.clone(), on_command_line))
        };
        let verb = matches.subcommand_name().unwrap_or_default();
        select(verb, reach, given("url"), given("cell"))
    }
}

fn select(verb: &str, reach: Reach, url: Given, cell: Given) -> Result<SelectedAddress, Failure> {
    let refuse =
        |message: String, help: String| Err(Failure::new(codes::BAD_REQUEST, message, help));
    let local = |cell: Given| {
        Ok(SelectedAddress {
            cell: cell.map(|cell| cell.0),
            url: None,
        })
    };
    let Some((address, on_command_line)) = url else {
        return local(cell);
    };
    let omit = match on_command_line {
        true => "omit --url",
        false => "unset RCC_URL",
    };
    match (reach, &cell) {
        (Reach::Files, _) if on_command_line => {
            let message = format!("`{verb}` needs no cell, and cannot use --url {address}");
            return refuse(message, omit.to_owned());
        }
        (Reach::Files, _) => return local(cell),
        // The command line takes precedence over the environment.
        (_, Some((_, true))) if !on_command_line => return local(cell),
        (Reach::Machine { does, instead }, _) => {
            let message = format!("`{verb}` {does}, and cannot serve the cell at {address}");
            return refuse(message, format!("{instead}; for this machine, {omit}"));
        }
        (Reach::Cell, Some((name, true))) => {
            let message = format!("two cells are given: --url {address} and --cell {name}");
            return refuse(message, "omit one of them".to_owned());
        }
        (Reach::Cell, Some((name, false))) if !on_command_line => {
            let message = format!("two cells are given: RCC_URL={address} and RCC_CELL={name}");
            return refuse(
                message,
                "unset one of them, or use --url or --cell".to_owned(),
            );
        }
        (Reach::Cell, _) => {}
    }
    Ok(SelectedAddress {
        url: Some(address),
        cell: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MACHINE: Reach = Reach::Machine {
        does: "checks this machine",
        instead: "run it there",
    };

    fn given(text: &str) -> Given {
        match text.split_once(' ') {
            Some(("line", value)) => Some((value.to_owned(), true)),
            Some((_, value)) => Some((value.to_owned(), false)),
            None => None,
        }
    }

    /// Returns the selected address or cell, or the message and help.
    fn selected(reach: Reach, url: &str, cell: &str) -> String {
        match select("doctor", reach, given(url), given(cell)) {
            Ok(SelectedAddress {
                url: Some(url),
                cell: None,
            }) => url,
            Ok(SelectedAddress { url: None, cell }) => cell.unwrap_or_else(|| "default".into()),
            Ok(both) => panic!("{both:?}"),
            Err(failure) => {
                assert_eq!(failure.exit, codes::exit::USAGE);
                let help = failure.body.help.clone().unwrap_or_default();
                format!("{}: {help}", failure.body.message)
            }
        }
    }

    #[test]
    fn the_command_line_is_preferred_to_the_environment() {
        for (url, cell, wanted) in [
            ("", "", "default"),
            ("", "env lab", "lab"),
            ("env http://a", "", "http://a"),
            ("line http://a", "env lab", "http://a"),
            ("env http://a", "line lab", "lab"),
        ] {
            assert_eq!(selected(Reach::Cell, url, cell), wanted, "{url} {cell}");
        }
        for (url, cell) in [("line http://a", "line lab"), ("env http://a", "env lab")] {
            let refused = selected(Reach::Cell, url, cell);
            assert!(refused.starts_with("two cells are given"), "{refused}");
        }
    }

    #[test]
    fn a_verb_that_cannot_serve_an_address_refuses_it() {
        let refused = selected(MACHINE, "line http://a", "");
        let words = "`doctor` checks this machine, and cannot serve the cell at http://a: run it there; for this machine, omit --url";
        assert_eq!(refused, words);
        let refused = selected(MACHINE, "env http://a", "");
        assert!(refused.ends_with("unset RCC_URL"), "{refused}");
        assert_eq!(selected(MACHINE, "env http://a", "line lab"), "lab");
        assert_eq!(selected(MACHINE, "", "env lab"), "lab");
        // Files have no address: only an explicit one is refused.
        let refused = selected(Reach::Files, "line http://a", "");
        assert!(refused.ends_with("omit --url"), "{refused}");
        assert_eq!(selected(Reach::Files, "env http://a", "env lab"), "lab");
    }
}
