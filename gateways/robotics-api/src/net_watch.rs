//! Looks at nets that run: their values, and whether and how they have ended. Run by the engine.

use std::collections::BTreeMap;

use rcc_api::codes;

use crate::gateway::Gateway;
use crate::loader::{CellClient, LoaderError};
use crate::net_values::read_values;
use crate::pushes::NetState;
use crate::state::GatewayNet;

/// Reads values and state of a net that runs.
pub fn look_at(gateway: &Gateway, loader: &mut CellClient, name: &str) {
    let net = gateway.state().nets.get(name).cloned();
    if let Some(net) = net.filter(|net| net.state.is_active() && net.command.is_some()) {
        look_at_net(gateway, loader, name, &net);
    }
}

/// Asks what became of a net whose START was not answered: true if it runs or has run.
///
/// # Errors
/// Returns an error if that is still not known.
pub fn has_started(loader: &mut CellClient, name: &str) -> Result<bool, LoaderError> {
    match loader.state(name) {
        Ok(detail) => Ok(detail.command.is_active() || detail.command.state == "terminated"),
        Err(error) if error.code() == codes::UNKNOWN_COMMAND.code => Ok(false),
        Err(error) => Err(error),
    }
}

/// Reads values and state of a net.
pub fn look_at_net(gateway: &Gateway, loader: &mut CellClient, name: &str, net: &GatewayNet) {
    let mut values: BTreeMap<String, String> = net.values.clone();
    let read = read_values(loader, net, name, &mut values);
    let cycle = read.as_ref().map_or(0, |read| read.cycle);
    let state = match read {
        Ok(read) if read.net != name => lost(name, "the executor was started again"),
        Ok(read) => match read.state.as_str() {
            "terminated" => how_it_ended(loader, name),
            "canceling" => NetState::Cancelling,
            "ready" => return,
            _ => net.state,
        },
        Err(error) if error.code() == codes::UNKNOWN_COMMAND.code => lost(name, &error.to_string()),
        // The loader or the executor is being started again: later looks tell what became of the net.
        Err(_) => return,
    };
    let mut gateway_state = gateway.state();
    if let Some(net) = gateway_state.nets.get_mut(name) {
        net.values = values;
        net.values_cycle = cycle;
        // A cancel may have been carried out meanwhile.
        if !(net.state == NetState::Cancelling && state == NetState::Running) {
            net.state = state;
        }
    }
}

fn lost(name: &str, reason: &str) -> NetState {
    tracing::warn!(net = name, reason, "the net is lost");
    NetState::Error
}

fn how_it_ended(loader: &mut CellClient, name: &str) -> NetState {
    let Ok(detail) = loader.state(name) else {
        return NetState::Terminated;
    };
    let words = detail.command.words.unwrap_or_default();
    match detail.command.reason.as_deref() {
        Some("fault") => {
            tracing::warn!(net = name, words, "the net has ended by a fault");
            NetState::Error
        }
        _ => {
            tracing::info!(net = name, words, "the net has ended");
            NetState::Terminated
        }
    }
}
