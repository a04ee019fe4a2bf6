//! LOAD: reserves an id for a text, compiles it, and hands the plan to the executor; rejects what a dead loader was
//! loading. Run by blocking threads of the server.

use std::sync::{Arc, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use rcc_api::bodies::Finding;
use rcc_api::codes;
use rcc_api::command_file::CommandFile;
use rcc_api::compile::{self, Compiled};
use rcc_api::error::ApiError;
use rcc_core::message::CommandState;
use rcc_core::plan::Resource;
use rcc_protocol::control::{Answer, Call};
use rcc_protocol::events::{EventKind, event_text, hex_digits};

use super::{Service, unexpected};
use crate::server::caller::Caller;
use crate::server::command_summary::CommandSummary;
use crate::server::executor::ExecutorConnection;
use crate::server::store::{self, CommandStore, StoreError};

/// A net, or why a text is not one.
pub type CompiledText = Result<Compiled, Vec<Finding>>;

/// Returns the commands in the state `loading`. Before this loader has reserved an id, they are those of a dead loader.
pub(super) fn orphans(attached: &ExecutorConnection) -> Vec<u64> {
    let rows = attached.tables().commands.into_iter();
    let loading = CommandState::Loading;
    rows.filter(|row| CommandState::from_number(row.state) == loading)
        .map(|row| row.id)
        .collect()
}

impl Service {
    /// Rejects the commands that a dead loader was loading.
    pub(super) fn reject_orphans(&self, orphans: &[u64], store: &CommandStore) {
        let lost = ApiError::new(
            codes::LOADER_DIED,
            "the loader died while loading this command",
            "load the text again",
        );
        for &id in orphans {
            self.reject(id, &lost, store);
        }
    }

    /// Rejects a command that is not loaded by this loader, or not any more.
    pub(super) fn reject(&self, id: u64, why: &ApiError, store: &CommandStore) {
        let mut file = store.read(id).unwrap_or_default();
        file.id = id;
        file.diagnostics.push(why.finding());
        store::discard_excess(&mut file);
        if let Err(error) = store.write(&file) {
            tracing::warn!(%error, "cannot write the file of a rejected command");
        }
        match self.executor.call(&Call::Reject { id }) {
            Ok(_) => tracing::info!(id, "rejected: {}", why.message),
            Err(error) => tracing::warn!(id, message = error.message, "cannot reject a command"),
        }
    }

    /// Gives back an id whose client stopped waiting before it was told; nothing was loaded.
    pub fn discard(&self, id: u64) {
        self.loading.change(|loading| loading.remove(&id));
        // If either fails, the executor is gone or `maintain` finds the row.
        let freed = self
            .executor
            .call(&Call::Reject { id })
            .and_then(|_| self.executor.call(&Call::Unload { id }));
        match freed {
            Ok(_) => tracing::info!(id, "discarded a load whose client stopped waiting"),
            Err(error) => tracing::warn!(id, message = error.message, "cannot discard a load"),
        }
    }

    /// Rejects a command whose load panicked.
    pub fn fail(&self, id: u64) {
        self.loading.change(|loading| loading.remove(&id));
        let failed = ApiError::new(
            codes::PROCESS_FAILED,
            "the loader failed while loading this command",
            "this is a bug in the loader: report it together with the text",
        );
        if let Ok((_, store)) = self.attach() {
            self.reject(id, &failed, &store);
        }
    }

    /// First part of LOAD: reserves an id for the text. [`Service::compile`] may run meanwhile, then [`Service::install`].
    ///
    /// # Errors
    /// Returns an error if there is no executor, its table is full, or there is no room for the command's file.
    pub fn reserve(&self, caller: &Caller, text: &str) -> Result<u64, ApiError> {
        let (attached, store) = self.attach()?;
        self.require_agreement(&attached)?;
        store
            .has_room(text.len() as u64)
            .map_err(|error| not_stored(&error))?;
        match self.executor.call_for(caller, &Call::Reserve)? {
            Answer::Reserved { id } => {
                let summary = Arc::new(CommandSummary {
                    net: compile::name_of(text),
                    loaded_at: seconds_now(),
                    ..CommandSummary::default()
                });
                self.loading.change(|loading| loading.insert(id, summary));
                Ok(id)
            }
            Answer::Refused(refusal) => {
                Err(self.with_names(None, |names| names.refusal(0, refusal)))
            }
            _ => Err(unexpected()),
        }
    }

    /// Compiles a text; `file_name` appears in the findings.
    pub fn compile(&self, text: &str, file_name: &str) -> CompiledText {
        compile::compile(text, file_name, &self.devices)
    }

    /// Last part of LOAD: writes the names, and hands the plan over. Returns whether the command became ready or
    /// rejected; its file contains the errors.
    pub fn install(&self, id: u64, text: String, compiled: CompiledText) -> CommandState {
        let summary = self.loading.get().get(&id).map(Arc::clone);
        let file = summary.map_or_else(CommandFile::default, |loading| CommandFile {
            id,
            net: loading.net.clone(),
            text,
            loaded_at: loading.loaded_at,
            ..CommandFile::default()
        });
        let state = self.try_install(id, file, compiled);
        let state = state.unwrap_or_else(|error| {
            tracing::warn!(
                id,
                code = error.code.code,
                message = error.message,
                "load failed"
            );
            self.record_rejected(id, &error.finding(), 1);
            CommandState::Rejected
        });
        self.loading.change(|loading| loading.remove(&id));
        state
    }

    fn record_rejected(&self, id: u64, first: &Finding, count: usize) {
        let net = self
            .loading
            .get()
            .get(&id)
            .map(|loading| loading.net.clone());
        let reported_executor = *self
            .reported_executor
            .read()
            .unwrap_or_else(PoisonError::into_inner);
        self.record(EventKind::Rejected {
            command: id,
            executor: reported_executor
                .map_or_else(String::new, |(_, incarnation)| hex_digits(incarnation)),
            net: event_text(&net.unwrap_or_default()),
            code: first.code.clone(),
            words: event_text(&first.message),
            count,
        });
    }

    /// Names the resources that a net claims, and the topics that it publishes.
    pub(super) fn named_uses(
        &self,
        id: u64,
        uses: Vec<Resource>,
        topics: &[String],
    ) -> Vec<String> {
        self.with_names(None, |names| {
            let uses = uses.into_iter().map(|use_| names.resource(id, use_));
            uses.chain(topics.iter().map(|topic| format!("topic {topic}")))
                .collect()
        })
    }

    fn try_install(
        &self,
        id: u64,
        mut file: CommandFile,
        compiled: CompiledText,
    ) -> Result<CommandState, ApiError> {
        let (attached, store) = self.attach()?;
        self.require_agreement(&attached)?;
        let stored = |file: &CommandFile| store.write(file).map_err(|error| not_stored(&error));
        let Compiled {
            net,
            description,
            plan,
            names,
            warnings,
            uses,
            topics,
            primitives,
            ..
        } = match compiled {
            Ok(compiled) => compiled,
            Err(diagnostics) => {
                let errors = diagnostics.iter().filter(|row| row.severity == "error");
                if let Some(first) = errors.clone().next() {
                    self.record_rejected(id, first, errors.count());
                }
                file.diagnostics = diagnostics;
                store::discard_excess(&mut file);
                // If the file cannot be written, the findings stay in memory and the command is rejected all the same.
                let kept = stored(&file);
                self.executor.call(&Call::Reject { id })?;
                return kept.map(|()| CommandState::Rejected);
            }
        };
        file.uses = self.named_uses(id, uses, &topics);
        let outcomes = names.outcomes.clone();
        (file.net, file.description, file.names) = (net, description, Some(names));
        (file.diagnostics, file.primitives) = (warnings, primitives);
        self.record(EventKind::Loaded {
            command: id,
            executor: hex_digits(attached.announcement.incarnation),
            net: event_text(&file.net),
            primitives,
            uses: file
                .uses
                .iter()
                .map(|use_| event_text(use_))
                .take(16)
                .collect(),
            outcomes,
        });
        let handed_over =
            stored(&file).and_then(|()| self.executor.call(&Call::Install { id, plan }));
        let refused = match handed_over {
            Ok(
                Answer::RefusedFor { .. }
                | Answer::Values(_)
                | Answer::Recorded(_)
                | Answer::RulesInstalled { .. }
                | Answer::Rules(_),
            ) => unexpected(),
            Ok(Answer::Done { .. } | Answer::Reserved { .. }) => return Ok(CommandState::Ready),
            Ok(Answer::Rehearsed { rehearsed, .. }) => {
                let net = file.names.clone().unwrap_or_default();
                let view = self.with_names(None, |names| names.rehearsal(&rehearsed, &net));
                file.rehearsal = Some(view);
                if let Err(error) = stored(&file) {
                    // The net is ready all the same.
                    tracing::warn!(id, message = error.message, "the rehearsal is not kept");
                }
                return Ok(CommandState::Ready);
            }
            Ok(Answer::Refused(refusal)) => {
                self.with_names(Some(&store), |names| names.refusal(id, refusal))
            }
            Err(error) => {
                // The command must not stay `loading`; if the executor is gone, so is the command.
                let _ = self.executor.call(&Call::Reject { id });
                error
            }
        };
        let finding = refused.finding();
        self.record_rejected(id, &finding, 1);
        file.diagnostics.push(finding);
        store::discard_excess(&mut file);
        stored(&file).map(|()| CommandState::Rejected)
    }
}

fn not_stored(error: &StoreError) -> ApiError {
    let (code, help) = match error {
        StoreError::File { .. } => (
            codes::NOT_STORED,
            "free disk space there, or set RCC_RUNTIME_DIR to another folder",
        ),
        StoreError::Full { .. } => (
            codes::NOT_KEPT,
            "unload commands that have ended: `rcc-cli ls`, then `rcc-cli unload NAME`",
        ),
    };
    ApiError::new(code, error.to_string(), help)
}

fn seconds_now() -> u64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |since| since.as_secs())
}
