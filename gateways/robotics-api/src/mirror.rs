//! The gateway's nets and rules in the core: a net is loaded again when it is needed, and a rule that has the same
//! meaning there is installed in the core too. Run by the engine and by the threads of connections.

use std::sync::Arc;

use crate::gateway::Gateway;
use crate::loader::CellClient;
use crate::rules::{RuleState, ScheduleRule};

/// Loads a net again that is not in the core at the moment.
///
/// # Errors
/// Returns why it was rejected.
pub fn ensure_loaded(gateway: &Gateway, loader: &mut CellClient, name: &str) -> Result<(), String> {
    let text = match gateway.state().nets.get(name) {
        Some(net) if net.command.is_none() && !net.state.is_over() => Arc::clone(&net.text),
        _ => return Ok(()),
    };
    let (command, _) = gateway.install(loader, &text)?;
    let written = {
        let mut state = gateway.state();
        let Some(net) = state.nets.get_mut(name) else {
            drop(state);
            // It was unloaded meanwhile.
            return loader.unload(name).map_err(|error| error.to_string());
        };
        net.command = Some(command);
        net.written.clone()
    };
    if !written.is_empty() {
        let set = loader.set(name, &written);
        set.map_err(|error| error.to_string())?;
    }
    mirror_all(gateway, loader, name);
    Ok(())
}

/// Installs a rule in the core too, where that has the same meaning, so that it takes effect in the next cycle: a rule
/// that cancels on a condition, such as the guard of a motion. All others are the gateway's alone: a rule that stops ends a
/// net as its `Termination` does, and one that starts tries again while an arm comes to rest.
pub fn mirror(gateway: &Gateway, loader: &mut CellClient, number: u64) {
    let Some(rule) = gateway.state().core_rule(number) else {
        return;
    };
    match loader.install(rule) {
        Ok(core) => {
            if let Some(rule) = gateway.state().rules.get_mut(&number) {
                rule.core = Some(core);
            }
        }
        // The gateway judges it, as it would have done anyway.
        Err(error) => tracing::debug!(rule = number, %error, "the core does not judge a rule"),
    }
}

/// Installs the rules again that name a net which was loaded again.
fn mirror_all(gateway: &Gateway, loader: &mut CellClient, net: &str) {
    let naming: Vec<u64> = {
        let state = gateway.state();
        let active = state
            .rules
            .iter()
            .filter(|(_, rule)| rule.state == RuleState::Active);
        let names = |rule: &ScheduleRule| {
            rule.cancel.iter().any(|name| name == net)
                || rule.condition.reads().iter().any(|(name, _)| *name == net)
        };
        active
            .filter(|(_, rule)| names(rule))
            .map(|(number, _)| *number)
            .collect()
    };
    for number in naming {
        mirror(gateway, loader, number);
    }
}
