//! Stops of nets, by their clients, by rules and at the end of the gateway. A stop that was acknowledged holds: a net whose
//! START is under way is stopped when that has been answered, or when the cell tells what became of it. Run by the engine
//! and by the threads of connections.

use rcc_api::codes;
use serde_json::{Map, Value};

use crate::gateway::Gateway;
use crate::loader::{CellClient, LoaderError};
use crate::net_text::STOP_INPUT;
use crate::net_watch::has_started;
use crate::pushes::NetState;
use crate::state::GatewayState;
use crate::stop_kind::StopKind;

impl GatewayState {
    /// Stops a net; returns what the caller must send to the core, if anything. The core may refuse it while START is under
    /// way: the engine sends it again when START has been answered.
    #[must_use]
    pub fn stop(&mut self, name: &str, kind: StopKind) -> Option<StopKind> {
        let is_scheduled = self.is_scheduled(name);
        let net = self.nets.get_mut(name)?;
        if net.state.is_over() {
            return None;
        }
        if net.state.is_active() && net.command.is_some() {
            return Some(kind);
        }
        if net.is_starting || net.may_run || net.owed_stop.is_some() {
            net.owe_stop(kind);
            return net.owed_stop;
        }
        // As in the predecessor, a CANCEL does nothing to a net that nothing is about to start.
        if kind == StopKind::Abort || is_scheduled {
            net.state = NetState::Terminated;
        }
        None
    }
}

/// Sends a stop to the core. One that it does not need – the net has ended or is ending, or has no `Cancel` – is done.
///
/// # Errors
/// Returns an error if the core did not take it; the net may run on.
pub fn send(
    gateway: &Gateway,
    loader: &mut CellClient,
    name: &str,
    kind: StopKind,
) -> Result<(), LoaderError> {
    match loader.operate(name, kind.operation()) {
        Ok(()) => {
            let mut state = gateway.state();
            match (state.nets.get_mut(name), kind) {
                (Some(net), StopKind::Cancel) if net.state == NetState::Running => {
                    net.state = NetState::Cancelling;
                }
                (Some(net), StopKind::Abort) => net.is_ending = true,
                _ => {}
            }
            Ok(())
        }
        Err(error) if has_ended(&error) || error.code() == codes::NOT_CANCELABLE.code => {
            tracing::info!(net = name, %error, "needs no {}", kind.operation());
            Ok(())
        }
        Err(error) => Err(error),
    }
}

/// Ends a net as its `Termination` does: its arm plays its last set-points. One that cannot be ended so is aborted.
///
/// # Errors
/// Returns an error if the core took neither; the net may run on.
pub fn end(gateway: &Gateway, loader: &mut CellClient, name: &str) -> Result<(), LoaderError> {
    let note = |is_ending: bool| {
        let mut state = gateway.state();
        let net = state.nets.get_mut(name);
        net.is_some_and(|net| std::mem::replace(&mut net.is_ending, is_ending))
    };
    // Before the core knows it: values that come from now on belong to the net's last state.
    let was_ending = note(true);
    let stop = Map::from_iter([(STOP_INPUT.to_owned(), Value::Bool(true))]);
    let ended = match loader.set(name, &stop) {
        Err(error) if has_ended(&error) => Ok(()),
        // Nobody takes an ABORT either.
        Err(error) if error.code() == codes::NO_LOADER.code => Err(error),
        Err(error) => {
            tracing::debug!(net = name, %error, "the net cannot be ended");
            send(gateway, loader, name, StopKind::Abort).inspect(|()| {
                tracing::warn!(net = name, %error, "the net cannot be ended and is aborted");
            })
        }
        Ok(()) => Ok(()),
    };
    if ended.is_err() {
        note(was_ending);
    }
    ended
}

/// Sends all stops that are owed, except to nets whose START is not answered. What the core does not take stays owed.
pub fn send_owed(gateway: &Gateway, loader: &mut CellClient) {
    let owed: Vec<(String, StopKind)> = {
        let state = gateway.state();
        let nets = state.nets.iter().filter(|(_, net)| !net.is_starting);
        nets.filter_map(|(name, net)| Some((name.clone(), net.owed_stop?)))
            .collect()
    };
    for (name, kind) in owed {
        if let Err(error) = deliver(gateway, loader, &name, kind) {
            tracing::debug!(net = name, %error, "not stopped: it is tried again");
        }
    }
}

/// Sends a stop that is owed. A net whose START was not answered is stopped first, then asked for, and stopped again if it
/// runs.
///
/// # Errors
/// Returns an error if the core did not take it, or does not tell whether the net runs; the stop stays owed.
pub fn deliver(
    gateway: &Gateway,
    loader: &mut CellClient,
    name: &str,
    kind: StopKind,
) -> Result<(), LoaderError> {
    send(gateway, loader, name, kind)?;
    let may_run = {
        let state = gateway.state();
        state.nets.get(name).is_some_and(|net| net.may_run)
    };
    let has_started = may_run && has_started(loader, name)?;
    if has_started {
        // START may have been taken after the first stop.
        send(gateway, loader, name, kind)?;
    }
    let mut state = gateway.state();
    let Some(net) = state.nets.get_mut(name) else {
        return Ok(());
    };
    net.owed_stop = None;
    net.may_run = false;
    if net.state.is_active() || net.state.is_over() {
        return Ok(());
    }
    match has_started {
        // Its end is seen as that of every net that runs.
        true => state.runs(name),
        // Its START was refused, or never arrived.
        false => net.state = NetState::Terminated,
    }
    Ok(())
}

/// Looks for nets whose START was not answered and whose rule has failed: what runs of them is stopped, because nothing
/// happens when a rule fails.
pub fn stop_unnoticed(gateway: &Gateway, loader: &mut CellClient) {
    let unnoticed: Vec<String> = {
        let state = gateway.state();
        let nets = state.nets.iter().filter(|(name, net)| {
            net.may_run
                && !net.is_starting
                && net.owed_stop.is_none()
                && !net.state.is_over()
                && !state.is_scheduled(name)
        });
        nets.map(|(name, _)| name.clone()).collect()
    };
    for name in unnoticed {
        let has_started = match has_started(loader, &name) {
            Ok(has_started) => has_started,
            // It is asked for again later.
            Err(error) if error.is_unreachable() => return,
            Err(_) => continue,
        };
        let mut state = gateway.state();
        if has_started {
            tracing::warn!(
                net = name,
                "it runs although its rule has failed: it is stopped"
            );
            state.runs(&name);
        }
        if let Some(net) = state.nets.get_mut(&name) {
            net.may_run = false;
            if has_started {
                net.owe_stop(StopKind::Cancel);
            }
        }
    }
}

/// Returns true if the core refused because the net has ended, or is ending.
fn has_ended(error: &LoaderError) -> bool {
    [codes::WRONG_STATE.code, codes::UNKNOWN_COMMAND.code].contains(&error.code())
}

#[cfg(test)]
mod tests;
