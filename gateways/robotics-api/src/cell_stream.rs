//! The messages that the cell sends by itself: states of commands, values of monitors and events, as one stream of the
//! loader. One thread reads it, notes what concerns the gateway's nets, and wakes the engine.

use std::time::Duration;

use rcc_api::streams::{StreamMonitored, StreamState};
use rcc_client::segment;
use rcc_protocol::events::{Event, EventKind};
use serde::de::DeserializeOwned;

use crate::gateway::{Gateway, net_prefix};
use crate::loader::{CellClient, LoaderError};
use crate::state::{GatewayNet, GatewayState};
use crate::values::to_library;

/// How often the loader looks for states and values, Hz, unless the cell is slower: often enough for rules that the core
/// does not judge.
const RATE_MAX_HZ: f64 = 250.0;
/// Pause before the stream is opened again. Without a stream the engine requests the values that it needs.
const AGAIN_AFTER: Duration = Duration::from_millis(200);

/// Why a stream ended.
#[derive(Debug, thiserror::Error)]
enum StreamEnd {
    #[error(transparent)]
    Loader(#[from] LoaderError),
    #[error("event `{event}` is not understood: {cause}")]
    NotUnderstood {
        event: String,
        cause: serde_json::Error,
    },
    #[error("the loader ended it")]
    Over,
}

/// Runs for ever.
pub fn run(gateway: &Gateway) -> ! {
    let mut loader = gateway.loader();
    loop {
        let end = follow(gateway, &mut loader);
        tracing::debug!(%end, "the cell's stream has ended");
        gateway.state().is_streaming = false;
        gateway.wake();
        std::thread::sleep(AGAIN_AFTER);
    }
}

/// Reads a stream to its end.
fn follow(gateway: &Gateway, loader: &mut CellClient) -> StreamEnd {
    match read(gateway, loader) {
        Ok(()) => StreamEnd::Over,
        Err(end) => end,
    }
}

fn read(gateway: &Gateway, loader: &mut CellClient) -> Result<(), StreamEnd> {
    let monitors = segment(&format!("{}*/*", net_prefix()));
    let rate = RATE_MAX_HZ.min(1e9 / loader.status()?.executor.period_ns.max(1) as f64);
    let path = format!("/stream?states=true&events=true&monitors={monitors}&rate={rate}");
    let mut lines = loader.stream(&path)?;
    {
        let mut state = gateway.state();
        state.is_streaming = true;
        // Earlier events are requested; ids of the core's rules may belong to another executor.
        state.devices_asked = None;
        state.nets.values_mut().for_each(|net| net.asked = None);
        state.rules.values_mut().for_each(|rule| rule.core = None);
    }
    gateway.wake();
    let mut event = String::new();
    while let Some(line) = lines.next_line().map_err(LoaderError::from)? {
        if let Some(name) = line.strip_prefix("event: ") {
            name.clone_into(&mut event);
        } else if let Some(data) = line.strip_prefix("data: ")
            && note(gateway, &event, data)?
        {
            gateway.wake();
        }
    }
    Ok(())
}

/// Notes an event of the stream; returns true if the engine has something to do.
fn note(gateway: &Gateway, event: &str, data: &str) -> Result<bool, StreamEnd> {
    Ok(match event {
        "state" => {
            let told: StreamState = parsed(event, data)?;
            note_state(&mut gateway.state(), &told)
        }
        "monitored" => {
            let told: StreamMonitored = parsed(event, data)?;
            note_values(&mut gateway.state(), &told)
        }
        "event" => {
            let told: Event = parsed(event, data)?;
            note_event(&mut gateway.state(), &told.what)
        }
        "lost" => {
            let mut state = gateway.state();
            state.nets.values_mut().for_each(|net| net.asked = None);
            true
        }
        _ => false,
    })
}

fn parsed<T: DeserializeOwned>(event: &str, data: &str) -> Result<T, StreamEnd> {
    serde_json::from_str(data).map_err(|cause| StreamEnd::NotUnderstood {
        event: event.to_owned(),
        cause,
    })
}

/// Notes the state of a command. The last values of one that has ended, and how it ended, are asked for.
fn note_state(state: &mut GatewayState, told: &StreamState) -> bool {
    let net = state.nets.get_mut(&told.net);
    let Some(net) = net.filter(|net| net.command == Some(told.id)) else {
        return false;
    };
    match (told.state.as_str(), net.state.is_active()) {
        ("canceling" | "terminated" | "unloaded", true) => net.asked = None,
        ("unloaded", false) => {
            // Not by the gateway: the executor was started again, and with it its table of rules.
            net.command = None;
            state.rules.values_mut().for_each(|rule| rule.core = None);
        }
        _ => return false,
    }
    true
}

/// Notes the newest values of monitors, for the engine's next turn: within a turn, rules and pushes see the same values.
fn note_values(state: &mut GatewayState, told: &StreamMonitored) -> bool {
    let mut is_new = false;
    for batch in &told.batches {
        let net = state.nets.get_mut(&batch.net);
        let net = net.filter(|net| net.command == Some(batch.id) && net.state.is_active());
        let (Some(net), Some(value), Some(cycle)) = (net, batch.values.last(), batch.cycles.last())
        else {
            continue;
        };
        let GatewayNet {
            reported, fresh, ..
        } = net;
        for reported in reported.iter().filter(|one| one.source == batch.port) {
            let text = to_library(&reported.type_name, value);
            fresh.insert(reported.key.clone(), (*cycle, text));
            is_new = true;
        }
    }
    is_new
}

/// Notes an event: a change of a device, or that the core has fired a rule.
fn note_event(state: &mut GatewayState, told: &EventKind) -> bool {
    match told {
        EventKind::DeviceState { .. }
        | EventKind::DeviceFound { .. }
        | EventKind::DeviceLost { .. } => {
            state.devices_asked = None;
            false
        }
        EventKind::Rule {
            rule, state: how, ..
        } if how == "fired" => state.core_fired(*rule),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pushes::NetState;
    use crate::rules::{RuleState, ScheduleRule};
    use crate::state::ReportedValue;
    use rcc_api::streams::MonitorBatch;

    /// A net `n` that runs as command 7, with the value `out_a` of the port `a.out`.
    fn state() -> GatewayState {
        let reported = ReportedValue {
            port: "out_a.value".to_owned(),
            source: "a.out".to_owned(),
            type_name: "Bool".to_owned(),
            key: "out_a".to_owned(),
        };
        let net = GatewayNet {
            state: NetState::Running,
            command: Some(7),
            reported: vec![reported],
            values_cycle: 100,
            asked: Some(std::time::Instant::now()),
            ..GatewayNet::default()
        };
        let mut state = GatewayState::default();
        state.nets.insert("n".to_owned(), net);
        state
    }

    fn told(id: u64, cycles: &[u64], values: &[serde_json::Value]) -> StreamMonitored {
        let batch = MonitorBatch {
            id,
            net: "n".to_owned(),
            port: "a.out".to_owned(),
            cycles: cycles.to_vec(),
            values: values.to_vec(),
            ..MonitorBatch::default()
        };
        StreamMonitored {
            batches: vec![batch],
            ..StreamMonitored::default()
        }
    }

    #[test]
    fn the_newest_value_counts_from_the_next_turn_on() {
        let mut state = state();
        let value = |state: &GatewayState| state.nets["n"].values.get("out_a").cloned();
        assert!(note_values(
            &mut state,
            &told(7, &[101, 106], &[false.into(), true.into()])
        ));
        assert_eq!(value(&state), None, "not within a turn");
        state.take_fresh();
        assert_eq!(value(&state).as_deref(), Some("true"));
        // A complete reading is newer than a message about an earlier cycle.
        note_values(&mut state, &told(7, &[99], &[false.into()]));
        state.take_fresh();
        assert_eq!(value(&state).as_deref(), Some("true"));
        note_values(&mut state, &told(7, &[111], &[serde_json::Value::Null]));
        state.take_fresh();
        assert_eq!(value(&state), None, "null has no value");
        assert!(
            !note_values(&mut state, &told(8, &[116], &[true.into()])),
            "another command"
        );
    }

    #[test]
    fn a_net_that_ends_is_asked_for_and_one_that_is_gone_is_loaded_again() {
        let told = |id: u64, what: &str| StreamState {
            id,
            net: "n".to_owned(),
            state: what.to_owned(),
            ..StreamState::default()
        };
        let mut running = state();
        assert!(!note_state(&mut running, &told(7, "running")));
        assert!(!note_state(&mut running, &told(6, "terminated")));
        assert!(running.nets["n"].asked.is_some());
        assert!(note_state(&mut running, &told(7, "terminated")));
        assert!(running.nets["n"].asked.is_none());
        let mut ready = state();
        ready
            .nets
            .values_mut()
            .for_each(|net| net.state = NetState::Ready);
        assert!(note_state(&mut ready, &told(7, "unloaded")));
        assert_eq!(ready.nets["n"].command, None);
    }

    #[test]
    fn a_rule_that_the_core_has_fired_has_fired() {
        let mut state = state();
        let rule = ScheduleRule {
            core: Some(3),
            ..ScheduleRule::default()
        };
        state.rules.insert(1, rule);
        let fired = |rule: u64, how: &str| EventKind::Rule {
            rule,
            state: how.to_owned(),
            command: None,
            why: String::new(),
        };
        assert!(!note_event(&mut state, &fired(4, "fired")));
        assert!(!note_event(&mut state, &fired(3, "expired")));
        assert_eq!(state.rules[&1].state, RuleState::Active);
        assert!(note_event(&mut state, &fired(3, "fired")));
        assert_eq!(state.rules[&1].state, RuleState::Fired);
    }
}
