//! Carries out rules that are due, by the core's own atomic operations: `POST /switch` and START where a net starts, an
//! input that ends a net where one only stops. Run by the engine.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use rcc_api::codes;
use serde_json::{Map, Value};

use crate::gateway::Gateway;
use crate::loader::{CellClient, LoaderError};
use crate::mirror::ensure_loaded;
use crate::net_text::STOP_INPUT;
use crate::net_watch::look_at;
use crate::pushes::NetState;
use crate::state::{RuleState, ScheduleRule};

/// Time for an arm to come to rest before a rule that starts a net fails.
const REST_TIME_MAX: Duration = Duration::from_secs(3);
/// Time between two attempts to take over an arm in motion.
const TAKE_OVER_EVERY: Duration = Duration::from_millis(20);

/// A rule as commands of the core.
#[derive(Debug, Default)]
struct RuleCommands {
    /// Nets that run and are stopped.
    stop: Vec<String>,
    /// Nets that never ran and are stopped.
    discard: Vec<String>,
    /// Nets that are canceled.
    cancel: Vec<String>,
    /// Nets that start.
    start: Vec<String>,
}

/// Decides every rule: fires those whose condition is true, the newest first, and ends those that cannot fire any more.
pub fn fire_due(gateway: &Gateway, loader: &mut CellClient) {
    let due: Vec<u64> = {
        let mut state = gateway.state();
        let now = Instant::now();
        let mut due = Vec::new();
        let mut impossible = Vec::new();
        for (number, rule) in state
            .rules
            .iter()
            .rev()
            .filter(|(_, rule)| rule.state == RuleState::Active)
        {
            match rule
                .condition
                .value(&|net, key| state.condition_value(net, key))
            {
                Some(true) if rule.not_before.is_some_and(|then| now < then) => {}
                Some(true) => due.push(*number),
                _ if !state.is_possible(&rule.condition) => impossible.push(*number),
                _ => {}
            }
        }
        impossible
            .into_iter()
            .for_each(|number| state.decide(number, RuleState::Inactive, now));
        due
    };
    for number in due {
        fire(gateway, loader, number);
    }
}

fn fire(gateway: &Gateway, loader: &mut CellClient, number: u64) {
    // The stream tells values one by one: those of several ports may be of different cycles.
    let several: BTreeSet<String> = {
        let state = gateway.state();
        let reads = state
            .rules
            .get(&number)
            .map(|rule| rule.condition.reads())
            .filter(|reads| reads.len() > 1);
        let nets = reads.into_iter().flatten();
        nets.map(|(net, _)| net.to_owned()).collect()
    };
    for name in &several {
        look_at(gateway, loader, name);
    }
    let rule = {
        let state = gateway.state();
        let rule = state
            .rules
            .get(&number)
            .filter(|rule| rule.state == RuleState::Active);
        // A rule that fired before may have changed what it reads.
        rule.filter(|rule| {
            rule.condition
                .value(&|net, key| state.condition_value(net, key))
                == Some(true)
        })
        .cloned()
    };
    let Some(rule) = rule else { return };
    // While the cell is started again the rule waits.
    let _cell = gateway.keep_cell();
    let now = Instant::now();
    let result = carry_out(gateway, loader, number, &rule);
    let mut state = gateway.state();
    match result {
        Ok(()) => state.decide(number, RuleState::Fired, now),
        Err(RuleRefusal::Later(reason)) => {
            let since = rule.trying_since.unwrap_or(now);
            if now.duration_since(since) > REST_TIME_MAX {
                tracing::warn!(rule = number, reason, "rule failed");
                state.decide(number, RuleState::FireFailed, now);
            } else if let Some(rule) = state.rules.get_mut(&number) {
                rule.trying_since = Some(since);
            }
        }
        Err(RuleRefusal::InMotion(reason)) => {
            if let Some(rule) = state.rules.get_mut(&number) {
                if rule.not_before.is_none() {
                    tracing::info!(rule = number, reason, "the arm is taken over when it rests");
                }
                rule.not_before = Some(now + TAKE_OVER_EVERY);
            }
        }
        Err(RuleRefusal::Never(reason)) => {
            tracing::warn!(rule = number, reason, "rule failed");
            state.decide(number, RuleState::FireFailed, now);
        }
    }
}

/// Why a rule was not carried out; nothing has changed.
enum RuleRefusal {
    /// An arm is still coming to rest, or a net has just ended.
    Later(String),
    /// The net cannot continue the motion: it can take over when the one before it has ended.
    InMotion(String),
    /// It is impossible.
    Never(String),
}

fn carry_out(
    gateway: &Gateway,
    loader: &mut CellClient,
    number: u64,
    rule: &ScheduleRule,
) -> Result<(), RuleRefusal> {
    for name in &rule.start {
        ensure_loaded(gateway, loader, name).map_err(RuleRefusal::Never)?;
    }
    let commands = commands(gateway, rule)?;
    if !commands.start.is_empty() {
        start(loader, &commands).map_err(|error| refusal(gateway, &commands, &error))?;
    }
    for name in &commands.cancel {
        cancel(gateway, loader, name);
    }
    if commands.start.is_empty() {
        commands
            .stop
            .iter()
            .for_each(|name| end(gateway, loader, name));
    }
    let mut state = gateway.state();
    for name in &commands.discard {
        if let Some(net) = state.nets.get_mut(name) {
            net.state = NetState::Terminated;
        }
    }
    for name in &commands.stop {
        // Its last values are pushed together with its last state.
        if let Some(net) = state.nets.get_mut(name) {
            net.is_ending = true;
        }
    }
    let now = Instant::now();
    commands
        .start
        .iter()
        .for_each(|name| state.started(name, Some(number), now));
    Ok(())
}

/// Returns what a rule means for the core.
fn commands(gateway: &Gateway, rule: &ScheduleRule) -> Result<RuleCommands, RuleRefusal> {
    let state = gateway.state();
    let mut commands = RuleCommands::default();
    let nets = |names: &[String]| -> Vec<(String, NetState, Option<u64>)> {
        let found = names
            .iter()
            .filter_map(|name| Some((name.clone(), state.nets.get(name)?)));
        found
            .map(|(name, net)| (name, net.state, net.command))
            .collect()
    };
    for (name, state, command) in nets(&rule.start) {
        match (state, command) {
            (NetState::Ready | NetState::Scheduled, Some(_)) => commands.start.push(name),
            _ => return Err(RuleRefusal::Never(format!("{name} is {}", state.name()))),
        }
    }
    if commands.start.len() < rule.start.len() {
        return Err(RuleRefusal::Never(
            "a net to be started is unloaded".to_owned(),
        ));
    }
    for (name, state, command) in nets(&rule.stop) {
        match (state, command) {
            (state, Some(_)) if state.is_active() => commands.stop.push(name),
            (NetState::Ready | NetState::Scheduled, _) => commands.discard.push(name),
            // It has ended already.
            _ => {}
        }
    }
    let cancel = nets(&rule.cancel)
        .into_iter()
        .filter(|(_, state, _)| *state == NetState::Running);
    commands.cancel = cancel
        .filter_map(|(name, _, command)| command.map(|_| name))
        .collect();
    Ok(commands)
}

fn start(loader: &mut CellClient, commands: &RuleCommands) -> Result<(), LoaderError> {
    match (commands.stop.as_slice(), commands.start.as_slice()) {
        ([], [name]) => loader.operate(name, "start"),
        (stop, start) => loader.switch(stop, start),
    }
}

/// Returns whether a start may succeed a little later.
fn refusal(gateway: &Gateway, commands: &RuleCommands, error: &LoaderError) -> RuleRefusal {
    let mut state = gateway.state();
    let words = error.to_string();
    // A net that was prepared for another place has no inverse kinematics here; START prepares it again.
    if [codes::DISCONTINUOUS.code, codes::LETS_GO.code].contains(&error.code()) {
        return RuleRefusal::InMotion(words);
    }
    let is_passing = match error.code() {
        code if [codes::DEVICE_NOT_READY.code, codes::TOO_MANY.code].contains(&code) => true,
        // The net that holds the arm has been told to end, and its arm is coming to rest.
        code if code == codes::BUSY.code => state
            .nets
            .values()
            .any(|net| net.is_ending && net.state.is_active()),
        // A net that was to be stopped has just ended.
        code if code == codes::WRONG_STATE.code => !commands.stop.is_empty(),
        // The executor was started again, and with it its table.
        code if code == codes::UNKNOWN_COMMAND.code => {
            for name in &commands.start {
                if let Some(net) = state.nets.get_mut(name) {
                    net.command = None;
                }
            }
            true
        }
        _ => error.is_unreachable(),
    };
    match is_passing {
        true => RuleRefusal::Later(words),
        false => RuleRefusal::Never(words),
    }
}

/// Cancels a net; one that has just ended needs no cancel.
pub fn cancel(gateway: &Gateway, loader: &mut CellClient, name: &str) {
    match loader.operate(name, "cancel") {
        Ok(()) => {
            if let Some(net) = gateway
                .state()
                .nets
                .get_mut(name)
                .filter(|net| net.state == NetState::Running)
            {
                net.state = NetState::Cancelling;
            }
        }
        Err(error) => tracing::info!(net = name, %error, "not canceled"),
    }
}

/// Ends a net as its `Termination` does: its arm plays its last set-points. One that cannot be ended so is aborted.
pub fn end(gateway: &Gateway, loader: &mut CellClient, name: &str) {
    if let Some(net) = gateway.state().nets.get_mut(name) {
        net.is_ending = true;
    }
    let stop = Map::from_iter([(STOP_INPUT.to_owned(), Value::Bool(true))]);
    match loader.set(name, &stop) {
        Ok(()) => {}
        // It has ended already.
        Err(error)
            if [codes::WRONG_STATE.code, codes::UNKNOWN_COMMAND.code].contains(&error.code()) => {}
        Err(error) => {
            tracing::warn!(net = name, %error, "the net cannot be ended and is aborted");
            if let Err(error) = loader.operate(name, "abort") {
                tracing::error!(net = name, %error, "not aborted");
            }
        }
    }
}
