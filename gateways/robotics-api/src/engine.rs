//! The engine: reads the nets that run, decides rules, pushes what has changed, and cleans up. One thread.

use std::time::{Duration, Instant};

use rcc_api::codes;

use crate::firing;
use crate::gateway::Gateway;
use crate::loader::{CellClient, LoaderError};
use crate::net_watch::look_at_net;
use crate::rules::RuleState;
use crate::state::GatewayNet;
use crate::stop_kind::StopKind;
use crate::stops;

/// Time between two turns while something runs or waits: what is pushed at an interval becomes due by itself.
const TURN_EVERY: Duration = Duration::from_millis(4);
/// The same while nothing runs and no rule waits.
const IDLE_TURN_EVERY: Duration = Duration::from_millis(50);
/// Time after which a running net, or the devices, are asked for beside the cell's stream.
const ASK_AGAIN: Duration = Duration::from_secs(1);
/// Time between two questions about each running net while there is no stream: the loader takes at most 1000 requests a
/// second from one process.
const ASK_EVERY: Duration = Duration::from_millis(4);
/// Time between two looks at the devices without a stream, and at sessions that nobody belongs to.
const TIDY_EVERY: Duration = Duration::from_millis(100);
/// Time for a net of a session that ended to come to rest before it is aborted.
const CANCEL_TIME_MAX: Duration = Duration::from_secs(3);

/// Runs for ever.
pub fn run(gateway: &Gateway) -> ! {
    let mut loader = gateway.loader();
    let mut tidied = None::<Instant>;
    loop {
        let busy = step(gateway, &mut loader);
        if tidied.is_none_or(|at| at.elapsed() > TIDY_EVERY) {
            tidied = Some(Instant::now());
            look_at_devices(gateway, &mut loader);
            stops::stop_unnoticed(gateway, &mut loader);
            stops::send_owed(gateway, &mut loader);
            end_sessions(gateway, &mut loader);
            gateway.state().forget();
        }
        gateway.sleep(match busy {
            true => TURN_EVERY,
            false => IDLE_TURN_EVERY,
        });
    }
}

/// Returns the nets whose state and values must be asked for: those that the stream has said to end, and all of them now
/// and then.
fn due_nets(gateway: &Gateway) -> Vec<(String, GatewayNet)> {
    let mut state = gateway.state();
    let is_streaming = state.is_streaming;
    let nets = state.nets.iter_mut();
    let active: Vec<(&String, &mut GatewayNet)> = nets
        .filter(|(_, net)| net.state.is_active() && net.command.is_some())
        .collect();
    let count = u32::try_from(active.len()).unwrap_or(u32::MAX);
    let every = match is_streaming {
        true => ASK_AGAIN,
        false => ASK_EVERY * count,
    };
    let now = Instant::now();
    let is_due = |asked: Instant| now.duration_since(asked) >= every;
    let due = active
        .into_iter()
        .filter(|(_, net)| net.asked.is_none_or(is_due));
    due.map(|(name, net)| {
        net.asked = Some(now);
        (name.clone(), net.clone())
    })
    .collect()
}

/// One turn. Returns false if nothing can happen by itself.
fn step(gateway: &Gateway, loader: &mut CellClient) -> bool {
    gateway.state().take_fresh();
    for (name, net) in &due_nets(gateway) {
        look_at_net(gateway, loader, name, net);
    }
    firing::fire_due(gateway, loader);
    let ended = {
        let mut state = gateway.state();
        state.push_nets(Instant::now());
        let ended = state.nets.iter_mut().filter(|(_, net)| net.state.is_over());
        let ended: Vec<String> = ended
            .filter_map(|(name, net)| net.command.take().map(|_| name.clone()))
            .collect();
        ended
    };
    // The core's table is small; what the application may still read is remembered here.
    for name in ended {
        let gone = |error: &LoaderError| error.code() == codes::UNKNOWN_COMMAND.code;
        if let Err(error) = loader.unload(&name)
            && !gone(&error)
        {
            tracing::warn!(net = name, %error, "a net that has ended cannot be unloaded");
        }
    }
    let state = gateway.state();
    let waits = |net: &GatewayNet| net.state.is_active() || net.held_by.is_some();
    let mut rules = state.rules.values();
    rules.any(|rule| rule.state == RuleState::Active) || state.nets.values().any(waits)
}

/// Reads the states of the devices.
fn look_at_devices(gateway: &Gateway, loader: &mut CellClient) {
    if gateway.own.as_ref().is_some_and(|own| own.is_restarting()) {
        // While the gateway starts its cell again, devices keep the state that they had.
        return;
    }
    {
        let mut state = gateway.state();
        let is_recent = |asked: Instant| state.is_streaming && asked.elapsed() < ASK_AGAIN;
        if !state.are_devices_watched() || state.devices_asked.is_some_and(is_recent) {
            return;
        }
        state.devices_asked = Some(Instant::now());
    }
    let devices = loader.devices().unwrap_or_default();
    let mut state = gateway.state();
    for reported in state.devices.values_mut() {
        let device = devices
            .iter()
            .find(|device| device.name == reported.cell_name);
        reported.state = match device.map(|device| device.state.as_str()) {
            Some("ready" | "commanded" | "stopping") => "op",
            Some("online") => "safeop",
            _ => "off",
        };
    }
    state.push_devices();
}

/// Stops the nets of sessions that nobody has belonged to for some time, and forgets them.
pub(crate) fn end_sessions(gateway: &Gateway, loader: &mut CellClient) {
    let now = Instant::now();
    let mut stop = Vec::new();
    let mut unload = Vec::new();
    {
        let mut state = gateway.state();
        let timeout = gateway.options.session_timeout;
        let is_left =
            |left: Option<Instant>| left.is_some_and(|left| now.duration_since(left) > timeout);
        let ended: Vec<String> = state
            .sessions
            .iter()
            .filter(|(_, session)| session.is_ending || is_left(session.left))
            .map(|(name, _)| name.clone())
            .collect();
        for name in ended {
            if let Some(session) = state
                .sessions
                .get_mut(&name)
                .filter(|session| !session.is_ending)
            {
                tracing::info!(
                    session = name,
                    client = session.description,
                    "the client is gone: its nets end"
                );
                session.is_ending = true;
            }
            // First of all nothing starts any more.
            state.rules.retain(|_, rule| rule.session != name);
            let of_session = |net: &GatewayNet| net.session == name;
            let may_run = state.nets.values_mut().filter(|net| net.may_run);
            for net in may_run.filter(|net| of_session(net) && !net.state.is_active()) {
                // It stays owed until the cell has told what became of the net.
                net.owe_stop(StopKind::Cancel);
            }
            let nets = state.nets.iter_mut().filter(|(_, net)| of_session(net));
            for (name, net) in nets.filter(|(_, net)| net.state.is_active()) {
                let since = *net.canceled_at.get_or_insert(now);
                let is_first = since == now;
                let is_late = now.duration_since(since) > CANCEL_TIME_MAX;
                if net.command.is_some() && (is_first || is_late) {
                    let operation = if net.can_cancel && is_first {
                        "cancel"
                    } else {
                        "abort"
                    };
                    stop.push((name.clone(), operation));
                }
            }
            if state
                .nets
                .values()
                .all(|net| !of_session(net) || !net.state.is_active() && net.owed_stop.is_none())
            {
                let over = state.nets.iter().filter(|(_, net)| net.session == name);
                unload.extend(over.filter_map(|(name, net)| net.command.map(|_| name.clone())));
                state.nets.retain(|_, net| net.session != name);
                state.sessions.remove(&name);
            }
        }
    }
    for (name, operation) in stop {
        if let Err(error) = loader.operate(&name, operation) {
            tracing::warn!(net = name, %error, "{operation} was refused");
        }
    }
    for name in unload {
        if let Err(error) = loader.unload(&name) {
            tracing::warn!(net = name, %error, "a net of a session that ended cannot be unloaded");
        }
    }
}

/// Stops every net when the gateway ends: its clients are no longer served.
pub fn end_all(gateway: &Gateway) {
    let stopped: Vec<(String, StopKind)> = {
        let mut state = gateway.state();
        state.rules.clear();
        let nets = state.nets.iter();
        let nets: Vec<(String, StopKind)> = nets
            .map(|(name, net)| (name.clone(), StopKind::gentlest(net.can_cancel)))
            .collect();
        nets.into_iter()
            .filter_map(|(name, kind)| state.stop(&name, kind).map(|kind| (name, kind)))
            .collect()
    };
    let mut loader = gateway.loader();
    for (name, kind) in stopped {
        if let Err(error) = stops::send(gateway, &mut loader, &name, kind) {
            tracing::warn!(net = name, %error, "{} was refused", kind.operation());
        }
    }
}
