//! Rolling deployment: nets and configuration files to cells. First every cell checks everything; only if all of them would
//! take it, it is loaded cell by cell, up to the first that fails. Nothing is started. Run by the main thread of `rcc-link`.

use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::path::Path;

use rcc_api::compile::name_of;
use rcc_api::routes::TEXT_MAX;
use rcc_config::diagnostic::Faults;
use rcc_config::file_kind::{FileKind, root_entries};
use rcc_language::bundle::bundle;
use rcc_language::library::FileLibraries;
use rcc_os::file;
use rcc_protocol::pattern::wildcard;
use serde_json::Value;
use zenoh::Session;

use crate::fleet::{CellRequest, FleetError, FoundCell};
use crate::keys::{DeployStep, Operation};

/// The destination of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TextKind {
    /// A net: to every cell.
    Net,
    /// The configuration of a cell: to the cell of that name.
    Cell,
}

/// A text that is deployed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeployText {
    /// The file, for messages.
    file: String,
    kind: TextKind,
    /// Name of the net or cell.
    name: String,
    text: String,
}

/// Why nothing was deployed.
#[derive(Debug, thiserror::Error)]
pub enum DeployError {
    /// A file cannot be read.
    #[error("{file}: {cause}")]
    Read {
        /// The file.
        file: String,
        /// Why.
        cause: io::Error,
    },
    /// A net's libraries cannot be read.
    #[error("{0}")]
    Libraries(Faults),
    /// A file is neither a net nor the configuration of a cell.
    #[error(
        "{0} is neither a net nor the configuration of a cell: a valid name after `net:` or `cell:` says which"
    )]
    Kind(String),
    /// No cell has this name.
    #[error("no cell answers to `{pattern}`; those that are there: {there}")]
    NoCell {
        /// As it was asked for.
        pattern: String,
        /// Names of the cells that are there.
        there: String,
    },
    /// Cells are missing.
    #[error("{expected} cells were expected, and {found} are there: {there}")]
    Count {
        /// Number that was given.
        expected: usize,
        /// Number of cells that were found.
        found: usize,
        /// Their names.
        there: String,
    },
    /// A configuration is that of no cell that was named.
    #[error("{file} is the configuration of cell `{cell}`, which is none of {cells}")]
    OtherCell {
        /// The file.
        file: String,
        /// Its cell.
        cell: String,
        /// Those that were named.
        cells: String,
    },
    /// At least one cell refuses, so nothing was changed.
    #[error("nothing was changed on any cell:\n{}", rows(.0))]
    Refused(Vec<Refusal>),
    /// The network refuses a request.
    #[error(transparent)]
    Fleet(#[from] FleetError),
    /// A cell failed after others had taken it.
    #[error("{0}")]
    Stopped(Box<StoppedDeployment>),
}

/// The reason why one cell refuses one text.
#[derive(Debug)]
pub struct Refusal {
    file: String,
    error: FleetError,
}

impl fmt::Display for Refusal {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}: {}", self.file, self.error)
    }
}

/// The result of one step of a deployment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Deployed {
    /// A net is loaded and ready.
    Net {
        /// `SITE/CELL`.
        cell: String,
        /// `NET#ID`.
        name: String,
    },
    /// The file of the configuration is replaced; a restart of the cell reads it.
    File {
        /// `SITE/CELL`.
        cell: String,
        /// Path of the previous file on that cell.
        previous: String,
    },
}

impl fmt::Display for Deployed {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Deployed::Net { cell, name } => write!(formatter, "{cell}  {name} is ready"),
            Deployed::File { cell, previous } => write!(
                formatter,
                "{cell}  has the file; it holds from the cell's next start; the previous one is {previous}"
            ),
        }
    }
}

/// A deployment that ended in the middle.
#[derive(Debug)]
pub struct StoppedDeployment {
    /// The steps that were carried out, in order.
    done: Vec<Deployed>,
    refusal: Refusal,
    /// The cells that were not asked.
    left: Vec<String>,
}

impl fmt::Display for StoppedDeployment {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(formatter, "stopped: {}", self.refusal)?;
        if let FleetError::NoAnswer { cell } | FleetError::Silent { cell, .. } = &self.refusal.error
        {
            writeln!(
                formatter,
                "whether {cell} has it is not known: `rcc-cli ls` there says so"
            )?;
        }
        for deployed in &self.done {
            writeln!(formatter, "has it: {deployed}")?;
        }
        for cell in &self.left {
            writeln!(formatter, "has it not: {cell}")?;
        }
        let mut nets = String::new();
        for deployed in &self.done {
            match deployed {
                Deployed::Net { cell, name } => nets.push_str(&format!(" '{cell}/{name}'")),
                Deployed::File { .. } => {}
            }
        }
        match nets.is_empty() {
            true => write!(formatter, "the way back: no net is to be withdrawn"),
            false => write!(
                formatter,
                "the way back, with the same endpoints and certificate: rcc-link withdraw{nets}"
            ),
        }
    }
}

/// One line for each.
fn rows(refusals: &[Refusal]) -> String {
    let rows: Vec<String> = refusals.iter().map(Refusal::to_string).collect();
    rows.join("\n")
}

fn joined<'a>(cells: impl Iterator<Item = &'a String>) -> String {
    let cells: Vec<&str> = cells.map(String::as_str).collect();
    match cells.is_empty() {
        true => "none".to_owned(),
        false => cells.join(", "),
    }
}

impl DeployText {
    /// Reads a file; a net gets the fragments of its libraries, which a cell could not read.
    ///
    /// # Errors
    /// Fails if it cannot be read, or is neither a net nor a configuration.
    pub fn read(path: &str) -> Result<DeployText, DeployError> {
        let text = file::read_given(Path::new(path), TEXT_MAX as u64);
        let text = text.map_err(|cause| DeployError::Read {
            file: path.to_owned(),
            cause,
        })?;
        DeployText::of(path, &text)
    }

    /// As [`DeployText::read`], from a text.
    ///
    /// # Errors
    /// As [`DeployText::read`].
    pub fn of(path: &str, text: &str) -> Result<DeployText, DeployError> {
        let kind = match FileKind::of_text(text) {
            Some(FileKind::Net) | None => TextKind::Net,
            Some(FileKind::Cell) => TextKind::Cell,
            Some(_) => return Err(DeployError::Kind(path.to_owned())),
        };
        let name = match kind {
            TextKind::Net => name_of(text),
            TextKind::Cell => {
                let entries = root_entries(text).into_iter();
                let mut names = entries.filter(|(key, _)| *key == "cell");
                names.next().map_or("", |(_, name)| name).to_owned()
            }
        };
        // It becomes a part of a key.
        if !crate::keys::is_topic(&name) || name.contains('/') {
            return Err(DeployError::Kind(path.to_owned()));
        }
        let text = match kind {
            TextKind::Net => bundle(text, path, &FileLibraries).map_err(DeployError::Libraries)?,
            TextKind::Cell => text.into(),
        };
        Ok(DeployText {
            file: path.to_owned(),
            kind,
            name,
            text: text.into_owned(),
        })
    }

    /// Returns true if it goes to that cell.
    fn is_for(&self, cell: &str) -> bool {
        let name = cell.rsplit('/').next();
        self.kind == TextKind::Net || name == Some(&self.name)
    }

    fn request<'a>(&'a self, peer: &'a str, cell: &'a str, step: DeployStep) -> CellRequest<'a> {
        CellRequest {
            peer,
            cell,
            operation: Operation::Deploy(step),
            net: &self.name,
            text: &self.text,
        }
    }
}

/// Returns the cells that the patterns name, sorted. A name without `*` and `?` must be there; a pattern has only the cells
/// that are there, so that `expected` is the way to miss one.
///
/// # Errors
/// Fails if a pattern names no cell, or if the number is not the expected one.
pub fn select(
    found: &BTreeMap<String, FoundCell>,
    patterns: &[String],
    expected: Option<usize>,
) -> Result<Vec<String>, DeployError> {
    let missing = |pattern: &&String| !found.keys().any(|cell| wildcard(pattern, cell));
    if let Some(pattern) = patterns.iter().find(missing) {
        return Err(DeployError::NoCell {
            pattern: pattern.clone(),
            there: joined(found.keys()),
        });
    }
    let named = |cell: &&String| patterns.iter().any(|pattern| wildcard(pattern, cell));
    let cells: Vec<String> = found.keys().filter(named).cloned().collect();
    match expected {
        Some(expected) if expected != cells.len() => Err(DeployError::Count {
            expected,
            found: cells.len(),
            there: joined(cells.iter()),
        }),
        _ => Ok(cells),
    }
}

/// A deployment of texts to cells, as a peer.
#[derive(Clone, Copy, Debug)]
pub struct Deployment<'a> {
    /// Session over which the cells are reached.
    pub session: &'a Session,
    /// The own name, `SITE/NAME`: that of the certificate.
    pub peer: &'a str,
    /// The cells, `SITE/CELL`, in the order in which they get it.
    pub cells: &'a [String],
    /// The texts that are deployed to them.
    pub texts: &'a [DeployText],
}

impl Deployment<'_> {
    /// Asks every cell whether it would take everything: all cells at the same time, each about one text after the other, since
    /// a gateway refuses what it has no room for. A cell that does not answer is not asked again. Returns what they say of
    /// valid texts, a line for each.
    ///
    /// # Errors
    /// Fails with what every cell says that refuses or does not answer. Nothing has changed anywhere.
    pub fn check(&self) -> Result<Vec<String>, DeployError> {
        for text in self.texts {
            if !self.cells.iter().any(|cell| text.is_for(cell)) {
                return Err(DeployError::OtherCell {
                    file: text.file.clone(),
                    cell: text.name.clone(),
                    cells: joined(self.cells.iter()),
                });
            }
        }
        let mut checks: Vec<CellCheck<'_>> =
            self.cells.iter().map(|cell| self.check_of(cell)).collect();
        loop {
            let mut sent = Vec::new();
            for check in &mut checks {
                if let Some(text) = check.left.next() {
                    let request = text.request(self.peer, check.cell, DeployStep::Check);
                    sent.push((check, text, request.send(self.session)?));
                }
            }
            if sent.is_empty() {
                break;
            }
            for (check, text, pending) in sent {
                check.take(text, pending.answer());
            }
        }
        let (mut valid, mut refused) = (Vec::new(), Vec::new());
        for check in checks {
            valid.extend(check.valid);
            refused.extend(check.refused);
        }
        match refused.is_empty() {
            true => Ok(valid),
            false => Err(DeployError::Refused(refused)),
        }
    }

    fn check_of<'a>(&'a self, cell: &'a str) -> CellCheck<'a> {
        CellCheck {
            cell,
            left: self.texts_for(cell).into_iter(),
            valid: Vec::new(),
            refused: Vec::new(),
        }
    }

    /// Loads cell by cell, and tells each result; call it after [`Deployment::check`].
    ///
    /// # Errors
    /// Stops at the first cell that fails, with what every cell has then.
    pub fn roll(&self, mut told: impl FnMut(&Deployed)) -> Result<(), DeployError> {
        let mut done = Vec::new();
        for (cell, text) in self.steps() {
            let step = match text.kind {
                TextKind::Net => DeployStep::Load,
                TextKind::Cell => DeployStep::Replace,
            };
            let answer = text.request(self.peer, cell, step).ask(self.session);
            let answer = match answer {
                Ok(answer) => answer,
                Err(error) => {
                    let after = self.cells.iter().skip_while(|one| *one != cell).skip(1);
                    let stopped = StoppedDeployment {
                        done,
                        refusal: text.refusal(error),
                        left: after.cloned().collect(),
                    };
                    return Err(DeployError::Stopped(Box::new(stopped)));
                }
            };
            let given = |key: &str| answer[key].as_str().unwrap_or("?").to_owned();
            let cell = cell.to_owned();
            let deployed = match text.kind {
                TextKind::Net => Deployed::Net {
                    cell,
                    name: given("name"),
                },
                TextKind::Cell => Deployed::File {
                    cell,
                    previous: given("previous"),
                },
            };
            told(&deployed);
            done.push(deployed);
        }
        Ok(())
    }

    /// Returns the steps in their order.
    fn steps(&self) -> Vec<(&str, &DeployText)> {
        let cells = self.cells.iter().map(String::as_str);
        let steps = cells.flat_map(|cell| {
            self.texts_for(cell)
                .into_iter()
                .map(move |text| (cell, text))
        });
        steps.collect()
    }

    /// Returns the texts of a cell in their order: nets, then its file.
    fn texts_for(&self, cell: &str) -> Vec<&DeployText> {
        let of = |kind| {
            let texts = self.texts.iter();
            texts.filter(move |text| text.kind == kind && text.is_for(cell))
        };
        of(TextKind::Net).chain(of(TextKind::Cell)).collect()
    }
}

/// The check of one cell.
struct CellCheck<'a> {
    /// `SITE/CELL`.
    cell: &'a str,
    /// The texts about which it was not asked yet.
    left: std::vec::IntoIter<&'a DeployText>,
    /// Messages about valid texts.
    valid: Vec<String>,
    refused: Vec<Refusal>,
}

impl CellCheck<'_> {
    /// Takes what the cell says of a text.
    fn take(&mut self, text: &DeployText, answer: Result<Value, FleetError>) {
        match answer {
            Ok(answer) => {
                let uses = answer["uses"].as_array().into_iter().flatten();
                let uses: Vec<&str> = uses.filter_map(|one| one.as_str()).collect();
                let uses = match (text.kind, uses.is_empty()) {
                    (TextKind::Cell, _) => String::new(),
                    (TextKind::Net, true) => "  uses: nothing".to_owned(),
                    (TextKind::Net, false) => format!("  uses: {}", uses.join(", ")),
                };
                let line = format!("{}  {} is valid{uses}", self.cell, text.file);
                self.valid.push(line);
                let words = answer["words"].as_str().unwrap_or_default();
                self.valid
                    .extend(Some(words.to_owned()).filter(|words| !words.is_empty()));
            }
            Err(error) => {
                if matches!(error, FleetError::NoAnswer { .. }) {
                    self.left = Vec::new().into_iter();
                }
                self.refused.push(text.refusal(error));
            }
        }
    }
}

impl DeployText {
    fn refusal(&self, error: FleetError) -> Refusal {
        let file = self.file.clone();
        Refusal { file, error }
    }
}

/// Unloads a net that was deployed: `NET#ID` of a cell.
///
/// # Errors
/// Fails if the cell refuses, or does not answer.
pub fn withdraw(session: &Session, peer: &str, cell: &str, name: &str) -> Result<(), FleetError> {
    let request = CellRequest {
        peer,
        cell,
        operation: Operation::Deploy(DeployStep::Unload),
        net: name.split('#').next().unwrap_or(name),
        text: name,
    };
    request.ask(session).map(drop)
}
