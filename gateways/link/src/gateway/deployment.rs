//! Nets and configuration files that peers send to this cell: checks and loads a net by the cell's own loader, unloads what
//! was loaded in this way, and replaces the cell's file. Nothing is started, and nothing that runs is replaced. Run by a
//! thread of its own.

use rcc_api::bodies::{Checked, CommandView};
use rcc_api::routes::TEXT_MAX;
use rcc_client::{Cell, ClientError};
use rcc_config::LinkRights;
use serde_json::{Value, json};

use super::GatewayOptions;
use crate::cell_file::{self, CellFileError};
use crate::keys::{DeployStep, RequestKey};

/// A right that a peer lacks.
#[derive(Clone, Copy)]
struct Missing<'a> {
    peer: &'a str,
    /// Key of the link that would give it.
    key: &'static str,
}

/// Why a peer's text is not taken.
#[derive(Debug, thiserror::Error)]
pub(super) enum DeploymentError {
    #[error(
        "{peer} must not {key} here: the cell's configuration allows it by `link: {{{key}: [{peer}]}}`"
    )]
    NotAllowed { peer: String, key: &'static str },
    #[error("the text is not UTF-8: send a net or the configuration of a cell")]
    Text,
    #[error("the text has {0} bytes, the limit is {TEXT_MAX}")]
    TooLong(usize),
    #[error("{0}")]
    Invalid(String),
    #[error("{net}#{id} runs: cancel it before another configuration is written")]
    Running { net: String, id: u64 },
    #[error(
        "`{0}` was not loaded over the link since its gateway and executor have started: unload it on the cell"
    )]
    NotLoadedHere(String),
    #[error(transparent)]
    File(#[from] CellFileError),
    #[error(transparent)]
    Cell(#[from] ClientError),
}

impl From<Missing<'_>> for DeploymentError {
    fn from(Missing { peer, key }: Missing<'_>) -> DeploymentError {
        let peer = peer.to_owned();
        DeploymentError::NotAllowed { peer, key }
    }
}

/// A net that was loaded for a peer.
struct LoadedNet {
    /// Incarnation of the executor that has it.
    incarnation: String,
    /// `NET#ID`.
    name: String,
}

pub(super) struct Deployment {
    cell: String,
    rights: LinkRights,
    /// The cell's file.
    file: std::path::PathBuf,
    loaded: Vec<LoadedNet>,
}

impl Deployment {
    pub fn new(options: &GatewayOptions) -> Deployment {
        Deployment {
            cell: options.cell.clone(),
            rights: options.link.rights.clone(),
            file: options.config.source.clone(),
            loaded: Vec::new(),
        }
    }

    /// Answers a request, or says why not.
    pub fn answer(
        &mut self,
        step: DeployStep,
        key: &RequestKey,
        payload: &[u8],
    ) -> Result<Value, String> {
        let RequestKey {
            peer,
            operation,
            net,
        } = key;
        let operation = operation.name();
        let answer = self.carry_out(step, key, payload);
        match &answer {
            Ok(_) => tracing::info!(peer, net, operation, "done for a peer"),
            Err(error) => tracing::warn!(peer, net, operation, "refused: {error}"),
        }
        answer.map_err(|error| error.to_string())
    }

    fn carry_out(
        &mut self,
        step: DeployStep,
        key: &RequestKey,
        payload: &[u8],
    ) -> Result<Value, DeploymentError> {
        let peer = key.peer.as_str();
        if payload.len() > TEXT_MAX {
            return Err(DeploymentError::TooLong(payload.len()));
        }
        // Before anything is read for a peer that may do nothing.
        let may = |key, peers: &[String]| match peers.iter().any(|one| one == peer) {
            true => Ok(()),
            false => Err(Missing { peer, key }),
        };
        let deploys = may("deploy", &self.rights.deploy);
        let configures = may("configure", &self.rights.configure);
        if configures.is_err() {
            deploys?;
        }
        let text = std::str::from_utf8(payload).map_err(|_| DeploymentError::Text)?;
        match step {
            DeployStep::Check => {
                let checked = self.checked(text, &key.net)?;
                match checked.kind.as_str() {
                    "cell" => {
                        configures?;
                        self.check_file(text)?;
                    }
                    _ => deploys?,
                }
                Ok(json!({"kind": checked.kind, "uses": checked.uses, "words": words(&checked)}))
            }
            DeployStep::Load => {
                deploys?;
                self.load(text)
            }
            DeployStep::Unload => {
                deploys?;
                self.unload(text)
            }
            DeployStep::Replace => {
                configures?;
                self.checked(text, &key.net)?;
                self.check_file(text)?;
                let previous = cell_file::replace(&self.file, text)?;
                Ok(json!({"file": self.file, "previous": previous}))
            }
        }
    }

    fn cell(&self) -> Result<Cell, ClientError> {
        Cell::local(&self.cell)
    }

    /// Asks the loader what it would say of the text.
    fn checked(&self, text: &str, name: &str) -> Result<Checked, DeploymentError> {
        let checked = self.cell()?.check(text, name)?;
        match checked.valid {
            true => Ok(checked),
            false => Err(DeploymentError::Invalid(words(&checked))),
        }
    }

    /// Checks what the loader does not: that the new file is one of this cell, gives nobody more rights, and is not written
    /// while a net runs. A process that is restarted reads the new file, and would then not fit the others.
    fn check_file(&self, text: &str) -> Result<(), DeploymentError> {
        cell_file::check(&self.file, text)?;
        match self
            .cell()?
            .commands()?
            .into_iter()
            .find(CommandView::is_active)
        {
            None => Ok(()),
            Some(CommandView { net, id, .. }) => Err(DeploymentError::Running { net, id }),
        }
    }

    fn incarnation(cell: &Cell) -> Result<String, ClientError> {
        Ok(cell.status()?.executor.incarnation)
    }

    /// Loads a net and waits until it is ready. One that is rejected leaves nothing behind.
    fn load(&mut self, text: &str) -> Result<Value, DeploymentError> {
        let cell = self.cell()?;
        let incarnation = Deployment::incarnation(&cell)?;
        let view = cell.load(text)?.state()?;
        let name = format!("{}#{}", view.net, view.id);
        self.loaded.retain(|net| net.incarnation == incarnation);
        self.loaded.push(LoadedNet {
            incarnation,
            name: name.clone(),
        });
        Ok(json!({"name": name}))
    }

    fn unload(&mut self, name: &str) -> Result<Value, DeploymentError> {
        let cell = self.cell()?;
        let incarnation = Deployment::incarnation(&cell)?;
        let own = |net: &LoadedNet| net.incarnation == incarnation && net.name == name;
        if !self.loaded.iter().any(own) {
            return Err(DeploymentError::NotLoadedHere(name.to_owned()));
        }
        cell.command(name)?.unload()?;
        self.loaded.retain(|net| !own(net));
        Ok(json!({"name": name}))
    }
}

/// Returns everything that was found in a text, for people.
fn words(checked: &Checked) -> String {
    let rows = checked.diagnostics.iter();
    let rows: Vec<&str> = rows.map(|row| row.rendered.trim_end()).collect();
    rows.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keys::Operation;

    /// No cell runs: whoever may do nothing is told so before the loader is asked.
    #[test]
    fn a_peer_without_the_right_is_told_which_key_gives_it() {
        let mut deployment = Deployment {
            cell: "no-such-cell".to_owned(),
            rights: LinkRights {
                configure: vec!["lab/chief".to_owned()],
                ..LinkRights::default()
            },
            file: "/no/such.yaml".into(),
            loaded: Vec::new(),
        };
        let mut words = |peer: &str, step, text: &[u8]| {
            let key = RequestKey {
                peer: peer.to_owned(),
                operation: Operation::Deploy(step),
                net: "line".to_owned(),
            };
            deployment.answer(step, &key, text).expect_err("refused")
        };
        let none = "lab/a must not deploy here: the cell's configuration allows it by `link: {deploy: [lab/a]}`";
        for step in [
            DeployStep::Check,
            DeployStep::Load,
            DeployStep::Unload,
            DeployStep::Replace,
        ] {
            assert_eq!(words("lab/a", step, b"net: line"), none);
        }
        let other = words("lab/chief", DeployStep::Load, b"net: line");
        assert!(
            other.starts_with("lab/chief must not deploy here"),
            "{other}"
        );
        let loader = words("lab/chief", DeployStep::Check, b"cell: a");
        assert!(loader.contains("no-such-cell"), "{loader}");
        let bytes = words("lab/chief", DeployStep::Check, b"\xff");
        assert!(bytes.contains("is not UTF-8"), "{bytes}");
        let long = words("lab/a", DeployStep::Check, &vec![b' '; TEXT_MAX + 1]);
        assert!(long.contains("the limit is 4194304"), "{long}");
    }
}
