//! Carries out rules that are due, by the core's own atomic operations: `POST /switch` and START where a net starts, an
//! input that ends a net where one only stops. Run by the engine.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use rcc_api::codes;

use crate::gateway::Gateway;
use crate::loader::{CellClient, LoaderError};
use crate::mirror::ensure_loaded;
use crate::net_watch::{has_started, look_at};
use crate::pushes::NetState;
use crate::rules::{RuleState, ScheduleRule};
use crate::state::GatewayState;
use crate::stop_kind::StopKind;
use crate::stops;

/// Time for an arm to come to rest before a rule that starts a net fails.
const REST_TIME_MAX: Duration = Duration::from_secs(3);
/// Time between two attempts to take over an arm in motion, or to deliver a stop.
const AGAIN_AFTER: Duration = Duration::from_millis(20);

/// A rule as commands of the core.
#[derive(Debug, Default)]
struct RuleCommands {
    /// Nets that run and are stopped.
    stop: Vec<String>,
    /// Nets that never ran and are stopped, or canceled before a rule could start them.
    discard: Vec<String>,
    /// Nets that are canceled.
    cancel: Vec<String>,
    /// Nets that may run, because a START of them was not answered, and are stopped or canceled.
    unsure: Vec<String>,
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
            match value(&state, rule) {
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

/// Returns the value of a rule's condition, which is true for ever once a stop of it was not delivered.
fn value(state: &GatewayState, rule: &ScheduleRule) -> Option<bool> {
    let of = |net: &str, key: &str| state.condition_value(net, key);
    match rule.owes_stop() {
        true => Some(true),
        false => rule.condition.value(&of),
    }
}

fn fire(gateway: &Gateway, loader: &mut CellClient, number: u64) {
    // The stream tells values one by one: those of several ports may be of different cycles.
    let several: BTreeSet<String> = {
        let state = gateway.state();
        let reads = state
            .rules
            .get(&number)
            .filter(|rule| !rule.owes_stop())
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
        rule.filter(|rule| value(&state, rule) == Some(true))
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
                rule.not_before = Some(now + AGAIN_AFTER);
            }
        }
        Err(RuleRefusal::Undelivered(reason)) => {
            if let Some(rule) = state.rules.get_mut(&number) {
                if rule.trying_since.is_none() {
                    tracing::warn!(
                        rule = number,
                        reason,
                        "a stop is sent until the core takes it"
                    );
                }
                rule.trying_since.get_or_insert(now);
                rule.not_before = Some(Instant::now() + AGAIN_AFTER);
            }
        }
        Err(RuleRefusal::Never(reason)) => {
            tracing::warn!(rule = number, reason, "rule failed");
            state.decide(number, RuleState::FireFailed, now);
        }
    }
}

/// Why a rule was not carried out; nothing has started.
enum RuleRefusal {
    /// An arm is still coming to rest, or a net has just ended.
    Later(String),
    /// The net cannot continue the motion: it can take over when the one before it has ended.
    InMotion(String),
    /// The core did not take a stop. It is never given up: the net may be moving.
    Undelivered(String),
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
    if commands.start.is_empty() {
        discard(&mut gateway.state(), &commands);
        return deliver_stops(gateway, loader, &commands);
    }
    let mut started = start(loader, &commands);
    if let Err(error) = &started
        && has_begun(gateway, loader, &commands, error)
    {
        owe_stops(gateway, &commands);
        started = Ok(());
    }
    note_started(gateway, number, &commands, &started);
    stops::send_owed(gateway, loader);
    started.map_err(|error| refusal(gateway, &commands, &error))
}

/// Delivers every stop of a rule that starts nothing, even if one of them fails.
fn deliver_stops(
    gateway: &Gateway,
    loader: &mut CellClient,
    commands: &RuleCommands,
) -> Result<(), RuleRefusal> {
    let mut delivered = Ok(());
    for name in &commands.cancel {
        delivered = delivered.and(stops::send(gateway, loader, name, StopKind::Cancel));
    }
    for name in &commands.stop {
        delivered = delivered.and(stops::end(gateway, loader, name));
    }
    for name in &commands.unsure {
        let owed = gateway.state().nets.get(name).and_then(|net| net.owed_stop);
        if let Some(kind) = owed {
            delivered = delivered.and(stops::deliver(gateway, loader, name, kind));
        }
    }
    delivered.map_err(|error| RuleRefusal::Undelivered(error.to_string()))
}

/// Returns true if a START was refused because an earlier one, whose answer was lost, was taken.
fn has_begun(
    gateway: &Gateway,
    loader: &mut CellClient,
    commands: &RuleCommands,
    error: &LoaderError,
) -> bool {
    let may_run = {
        let state = gateway.state();
        let mut nets = commands.start.iter().map(|name| state.nets.get(name));
        nets.all(|net| net.is_some_and(|net| net.may_run))
    };
    error.code() == codes::WRONG_STATE.code
        && may_run
        && commands
            .start
            .iter()
            .all(|name| has_started(loader, name).unwrap_or(false))
}

/// Owes the stops of a rule whose nets run already: another rule may have started them.
fn owe_stops(gateway: &Gateway, commands: &RuleCommands) {
    let mut state = gateway.state();
    for name in &commands.stop {
        if let Some(net) = state.nets.get_mut(name) {
            net.owe_stop(StopKind::Cancel);
        }
    }
}

/// Notes the answer to START, or that there was none.
fn note_started(
    gateway: &Gateway,
    number: u64,
    commands: &RuleCommands,
    started: &Result<(), LoaderError>,
) {
    let mut state = gateway.state();
    let is_started = started.is_ok();
    let now = Instant::now();
    if is_started {
        discard(&mut state, commands);
        for name in &commands.stop {
            // Its last values are pushed together with its last state.
            if let Some(net) = state.nets.get_mut(name) {
                net.is_ending = true;
            }
        }
        // START cannot be taken back: a cancel that the core does not take is sent again.
        for name in &commands.cancel {
            if let Some(net) = state.nets.get_mut(name) {
                net.owed_stop = net.owed_stop.max(Some(StopKind::Cancel));
            }
        }
    }
    for name in &commands.start {
        if let Some(net) = state.nets.get_mut(name) {
            net.is_starting = false;
            net.may_run = match started {
                Ok(()) => false,
                // The earlier START may be what made this one wrong.
                Err(error) if error.code() == codes::WRONG_STATE.code => net.may_run,
                Err(error) => error.is_unanswered(),
            };
        }
        if is_started {
            state.started(name, number, now);
        }
    }
}

/// Ends the nets that a rule stops before they ever ran.
fn discard(state: &mut GatewayState, commands: &RuleCommands) {
    for name in &commands.discard {
        if let Some(net) = state.nets.get_mut(name) {
            net.state = NetState::Terminated;
        }
    }
}

/// Returns what a rule means for the core. Until [`note_started`], the nets that it starts count as starting.
fn commands(gateway: &Gateway, rule: &ScheduleRule) -> Result<RuleCommands, RuleRefusal> {
    let mut state = gateway.state();
    let mut commands = RuleCommands::default();
    for name in &rule.start {
        let Some(net) = state.nets.get(name) else {
            let reason = "a net to be started is unloaded".to_owned();
            return Err(RuleRefusal::Never(reason));
        };
        match (net.state, net.command, net.owed_stop) {
            (NetState::Ready | NetState::Scheduled, Some(_), None) => {
                commands.start.push(name.clone());
            }
            (state, _, None) => {
                return Err(RuleRefusal::Never(format!("{name} is {}", state.name())));
            }
            (_, _, Some(_)) => {
                return Err(RuleRefusal::Never(format!("{name} is being stopped")));
            }
        }
    }
    commands.unsure = owe_unsure(&mut state, rule);
    for name in &rule.stop {
        match state.nets.get(name).map(|net| (net.state, net.command)) {
            Some((state, Some(_))) if state.is_active() => commands.stop.push(name.clone()),
            Some((NetState::Ready | NetState::Scheduled, _)) => commands.discard.push(name.clone()),
            // It has ended already.
            _ => {}
        }
    }
    for name in &rule.cancel {
        match state.nets.get(name).map(|net| (net.state, net.command)) {
            Some((NetState::Running, Some(_))) => commands.cancel.push(name.clone()),
            // A rule that would start it later must not.
            Some((NetState::Scheduled, _)) if state.is_scheduled(name) => {
                commands.discard.push(name.clone());
            }
            _ => {}
        }
    }
    let RuleCommands {
        discard, unsure, ..
    } = &mut commands;
    discard.retain(|name| !rule.start.contains(name) && !unsure.contains(name));
    for name in &commands.start {
        if let Some(net) = state.nets.get_mut(name) {
            net.is_starting = true;
        }
    }
    Ok(commands)
}

/// Owes the stops of nets that may run, and returns these. They are stopped even if the rule fails: nothing else tells whether
/// they run.
fn owe_unsure(state: &mut GatewayState, rule: &ScheduleRule) -> Vec<String> {
    let mut unsure = Vec::new();
    for name in rule.stop.iter().chain(&rule.cancel) {
        let net = state.nets.get_mut(name);
        if let Some(net) = net.filter(|net| net.may_run && !net.state.is_over())
            && !rule.start.contains(name)
        {
            net.owe_stop(StopKind::Cancel);
            unsure.push(name.clone());
        }
    }
    unsure
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
            .any(|net| net.is_ending && net.state.is_active() || net.owed_stop.is_some()),
        // A net that was to be stopped has just ended, or it is not known yet whether one runs already.
        code if code == codes::WRONG_STATE.code => {
            let mut nets = commands.start.iter().map(|name| state.nets.get(name));
            !commands.stop.is_empty() || nets.any(|net| net.is_some_and(|net| net.may_run))
        }
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
