//! Hand-over by name: some commands end and others start between the same two cycles, or nothing changes. Run by
//! blocking threads of the server.

use rcc_api::bodies::{CommandRef, Done, Switch, Switched};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_core::message::CommandState;
use rcc_protocol::control::{Answer, Call, SWITCH_MAX};

use super::rules::is_refusal;
use super::{Operation, Service, unexpected};
use crate::server::caller::Caller;
use crate::server::executor::ExecutorConnection;
use crate::server::store::CommandStore;

impl Service {
    /// Stops some commands and starts others.
    ///
    /// # Errors
    /// Returns an error if there is no executor, a name is unknown, or the executor refuses; nothing has changed then.
    pub fn switch(&self, caller: &Caller, switch: &Switch) -> Result<Switched, ApiError> {
        let (attached, store) = self.attach()?;
        if switch.stop.is_empty() && switch.start.is_empty() {
            return Err(ApiError::new(
                codes::BAD_REQUEST,
                "the hand-over names no command to stop or to start",
                "send for example `{\"stop\": [\"a\"], \"start\": [\"b\"]}`",
            ));
        }
        if !switch.start.is_empty() {
            self.require_agreement(&attached)?;
        }
        let stop = self.named(&attached, &store, &switch.stop, |state| state.is_active())?;
        let start = self.named(&attached, &store, &switch.start, |state| {
            Operation::START.suits(state)
        })?;
        let lease = self.checked_lease(switch.lease)?;
        let installed = self.rules_of_start(caller, &switch.rules, switch.lease)?;
        let call = Call::Switch {
            stop: stop.clone(),
            start: start.clone(),
            lease,
        };
        let refused = |id, refusal| {
            let mut error = self.refused(&store, id, refusal);
            error
                .message
                .push_str("; no command was stopped or started");
            error
        };
        let answer = self.executor.call_for(caller, &call);
        let refused_now = match &answer {
            Ok(answer) => !matches!(answer, Answer::Done { .. }),
            Err(error) => is_refusal(error),
        };
        if refused_now {
            self.remove_rules(&installed);
        }
        match answer? {
            Answer::Done { cycle } => {
                let done = |ids: &[u64]| {
                    ids.iter()
                        .map(|id| Done {
                            id: *id,
                            net: self.net(&store, *id),
                            cycle,
                        })
                        .collect()
                };
                Ok(Switched {
                    cycle,
                    stopped: done(&stop),
                    started: done(&start),
                })
            }
            Answer::Refused(refusal) => Err(refused(0, refusal)),
            Answer::RefusedFor { id, refusal } => Err(refused(id, refusal)),
            _ => Err(unexpected()),
        }
    }

    /// Starts one command in place of others.
    ///
    /// # Errors
    /// As for [`Service::switch`].
    pub fn start_after(&self, caller: &Caller, switch: &Switch) -> Result<Done, ApiError> {
        let mut switched = self.switch(caller, switch)?;
        switched.started.pop().ok_or_else(unexpected)
    }

    pub(super) fn named(
        &self,
        attached: &ExecutorConnection,
        store: &CommandStore,
        names: &[CommandRef],
        suits: impl Fn(CommandState) -> bool,
    ) -> Result<Vec<u64>, ApiError> {
        if names.len() > SWITCH_MAX {
            let max = SWITCH_MAX as u32;
            let refusal = rcc_protocol::control::Refusal::SwitchTooLarge { max };
            return Err(self.with_names(None, |names| names.refusal(0, refusal)));
        }
        let ids = names.iter().map(|name| match name {
            CommandRef::Id(id) => Ok(*id),
            CommandRef::Name(name) => self.resolve(|| attached.tables(), store, name, &suits),
        });
        ids.collect()
    }
}
