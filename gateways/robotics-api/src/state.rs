//! State of the gateway: sessions, nets, rules, devices, and their subscribers. Locked for short times by the engine
//! and by the threads of connections; nothing in here waits.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandList, CommandRef, OnClientLoss, RuleBody};
use serde_json::{Map, Value};

use crate::condition::{Condition, core_text};
use crate::devices::DeviceKind;
use crate::dio::{DioMessage, DioValue};
use crate::net_text::NetText;
use crate::outbox::Outbox;
use crate::pushes::{AFTER_FIRED, HOLD_BACK_MAX, NetPicture, NetState, NetSubscription};
use crate::rules::{RuleState, ScheduleRule};
use crate::stop_kind::StopKind;

/// Most nets and rules that are remembered; of those that are over the oldest are forgotten.
pub const REMEMBERED_MAX: usize = 4096;

/// A session of the library: nets and rules that are cleaned up together.
#[derive(Clone, Debug, Default)]
pub struct Session {
    /// Main class and host.
    pub description: String,
    /// Since when no connection belongs to it.
    pub left: Option<Instant>,
    /// True once its nets are being stopped.
    pub is_ending: bool,
}

/// A value that a net reports, as the core names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportedValue {
    /// The monitor's input: `out_2.value`.
    pub port: String,
    /// The port that the monitor observes; that of a constant is its own input.
    pub source: String,
    /// Type in the core.
    pub type_name: String,
    /// Key of the library.
    pub key: String,
}

/// A net of the library.
#[derive(Clone, Debug, Default)]
pub struct GatewayNet {
    /// Its session.
    pub session: String,
    /// Its text, with which it can be loaded again.
    pub text: Arc<NetText>,
    /// Its state.
    pub state: NetState,
    /// Its command in the core; `None` while it is not loaded there.
    pub command: Option<u64>,
    /// The values that it reports.
    pub reported: Vec<ReportedValue>,
    /// Types of its inputs by id.
    pub inputs: BTreeMap<String, String>,
    /// Values that were written, for a net that is loaded again.
    pub written: Map<String, Value>,
    /// Unique resources of the core.
    pub uses: BTreeSet<String>,
    /// True if it has a `Cancel`.
    pub can_cancel: bool,
    /// Newest values by key; null values are missing.
    pub values: BTreeMap<String, String>,
    /// Cycle in which all values were read together; what the stream tells of earlier ones is out of date.
    pub values_cycle: u64,
    /// Values by key that the stream has told since the engine's last turn, with their cycles; `None` is null.
    pub fresh: BTreeMap<String, (u64, Option<String>)>,
    /// When its state was last asked for; `None` if it must be asked for now.
    pub asked: Option<Instant>,
    /// True once another net has taken its arm or outputs: conditions no longer see its values.
    pub is_overtaken: bool,
    /// A rule that started it and that its client may not know to have fired, and when that was.
    pub held_by: Option<(u64, Instant)>,
    /// True while START has been sent and is not answered.
    pub is_starting: bool,
    /// True if START was sent and its answer was lost: the net may run.
    pub may_run: bool,
    /// A stop that the core has yet to take; no rule starts the net any more.
    pub owed_stop: Option<StopKind>,
    /// True once it was told to end.
    pub is_ending: bool,
    /// When it was told to end with its session.
    pub canceled_at: Option<Instant>,
}

impl GatewayNet {
    /// Notes that the core must still take a stop of this kind, or a stronger one.
    pub fn owe_stop(&mut self, kind: StopKind) {
        // A net without `Cancel` would run on.
        let kind = kind.max(StopKind::gentlest(self.can_cancel));
        self.owed_stop = self.owed_stop.max(Some(kind));
    }
}

/// A device as it is reported.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportedDevice {
    /// Type in the library.
    pub type_name: String,
    /// Kind of the device.
    pub kind: DeviceKind,
    /// Name in the cell.
    pub cell_name: String,
    /// `op`, `safeop` or `off`.
    pub state: &'static str,
}

/// A subscription to all devices.
#[derive(Clone, Debug)]
pub struct DeviceSubscription {
    outbox: Outbox,
    tag: String,
    told: BTreeMap<String, (DioValue, &'static str)>,
}

/// The whole state.
#[derive(Debug, Default)]
pub struct GatewayState {
    /// Sessions by name.
    pub sessions: BTreeMap<String, Session>,
    /// Nets by name.
    pub nets: BTreeMap<String, GatewayNet>,
    /// Rules by number.
    pub rules: BTreeMap<u64, ScheduleRule>,
    /// Devices by their name in the library.
    pub devices: BTreeMap<String, ReportedDevice>,
    /// Sessions that each connection belongs to.
    pub connections: BTreeMap<u64, BTreeSet<String>>,
    /// True while the cell's stream tells what happens.
    pub is_streaming: bool,
    /// When the devices were last asked for; `None` if they must be asked for now.
    pub devices_asked: Option<Instant>,
    net_subscriptions: Vec<(String, Outbox, NetSubscription)>,
    device_subscriptions: Vec<DeviceSubscription>,
    numbers: BTreeMap<&'static str, u64>,
}

impl GatewayState {
    /// Returns the next number of a kind, from 1.
    pub fn number(&mut self, kind: &'static str) -> u64 {
        let number = self.numbers.entry(kind).or_default();
        *number += 1;
        *number
    }

    /// Notes that a connection belongs to a session.
    pub fn bind(&mut self, connection: u64, session: &str) {
        if let Some(sessions) = self.connections.get_mut(&connection) {
            sessions.insert(session.to_owned());
        }
        if let Some(session) = self
            .sessions
            .get_mut(session)
            .filter(|session| !session.is_ending)
        {
            session.left = None;
        }
    }

    /// Forgets a connection and its subscriptions.
    pub fn disconnect(&mut self, connection: u64, now: Instant) {
        let sessions = self.connections.remove(&connection).unwrap_or_default();
        self.net_subscriptions
            .retain(|(_, outbox, _)| outbox.connection != connection);
        self.device_subscriptions
            .retain(|one| one.outbox.connection != connection);
        for rule in self.rules.values_mut() {
            rule.subscribers
                .retain(|(outbox, _)| outbox.connection != connection);
        }
        for name in sessions {
            let is_held = self.connections.values().any(|held| held.contains(&name));
            if let Some(session) = self.sessions.get_mut(&name).filter(|_| !is_held) {
                session.left.get_or_insert(now);
            }
        }
    }

    /// Returns the boolean value that a condition sees; `None` if it is indeterminate.
    #[must_use]
    pub fn condition_value(&self, net: &str, key: &str) -> Option<bool> {
        let net = self.nets.get(net).filter(|net| !net.is_overtaken)?;
        match net.values.get(key)?.as_str() {
            "true" => Some(true),
            "false" => Some(false),
            _ => None,
        }
    }

    /// Returns true if a condition can still become true.
    #[must_use]
    pub fn is_possible(&self, condition: &Condition) -> bool {
        let reads = condition.reads();
        let lives = |(net, _): &(&str, &str)| {
            let net = self.nets.get(*net);
            net.is_some_and(|net| !net.state.is_over())
        };
        reads.is_empty() || reads.iter().any(lives)
    }

    /// Returns true if an active rule may start this net.
    #[must_use]
    pub fn is_scheduled(&self, name: &str) -> bool {
        let mut rules = self.rules.values();
        rules.any(|rule| {
            rule.state == RuleState::Active && rule.start.iter().any(|start| start == name)
        })
    }

    /// Notes that a net has been started by a rule.
    pub fn started(&mut self, name: &str, rule: u64, now: Instant) {
        self.runs(name);
        if let Some(net) = self.nets.get_mut(name) {
            net.held_by = Some((rule, now));
        }
    }

    /// Notes that a net runs: it takes arms and outputs from those that ended.
    pub fn runs(&mut self, name: &str) {
        let Some(net) = self.nets.get_mut(name) else {
            return;
        };
        net.state = NetState::Running;
        net.asked = None;
        net.may_run = false;
        let uses = net.uses.clone();
        for (other, net) in &mut self.nets {
            if other != name && net.state.is_over() && !net.uses.is_disjoint(&uses) {
                net.is_overtaken = true;
            }
        }
    }

    /// Subscribes to a net and pushes its state.
    pub fn subscribe_net(&mut self, outbox: &Outbox, tag: &str, name: &str, interval: Duration) {
        let subscription = NetSubscription::new(tag, interval);
        self.net_subscriptions
            .push((name.to_owned(), outbox.clone(), subscription));
        self.push_nets(Instant::now());
    }

    /// Subscribes to a rule and pushes its state; false if there is none with this number.
    pub fn subscribe_rule(&mut self, outbox: &Outbox, tag: &str, number: u64) -> bool {
        let Some(rule) = self.rules.get_mut(&number) else {
            return false;
        };
        outbox.send(&[rule_message(tag, rule.state)]);
        match rule.state {
            RuleState::Active => rule.subscribers.push((outbox.clone(), tag.to_owned())),
            RuleState::Fired => rule.told = Some(rule.told.unwrap_or_else(Instant::now)),
            RuleState::FireFailed | RuleState::Inactive => {}
        }
        true
    }

    /// Changes the state of a rule and tells its subscribers.
    pub fn decide(&mut self, number: u64, state: RuleState, now: Instant) {
        let Some(rule) = self.rules.get_mut(&number) else {
            return;
        };
        rule.state = state;
        for (outbox, tag) in std::mem::take(&mut rule.subscribers) {
            outbox.send(&[rule_message(&tag, state)]);
            rule.told = Some(now);
        }
    }

    /// Returns the rule of the core that does the same as a rule which cancels on a condition; `None` for other rules, and
    /// for those of which a net is not in the core or was never there.
    #[must_use]
    pub fn core_rule(&self, number: u64) -> Option<RuleBody> {
        let rule = self.rules.get(&number)?;
        let loaded = |name: &str| {
            let net = self.nets.get(name)?;
            (net.command.is_some() && !net.state.is_over()).then_some(net)
        };
        let port = |net: &str, key: &str| {
            let mut reported = loaded(net)?.reported.iter();
            let found = reported.find(|value| value.key == key)?;
            // A constant has no port that the core could read.
            (found.source != found.port).then(|| found.source.clone())
        };
        let is_cancel = rule.state == RuleState::Active
            && rule.condition != Condition::Always
            && rule.stop.is_empty()
            && rule.start.is_empty()
            && !rule.cancel.is_empty()
            && rule
                .cancel
                .iter()
                .all(|name| loaded(name).is_some_and(|net| net.can_cancel));
        if !is_cancel {
            return None;
        }
        let cancel = rule.cancel.iter().cloned().map(CommandRef::Name).collect();
        Some(RuleBody {
            name: Some(format!("gateway rule {number}")),
            when: core_text(&rule.condition, &port)?,
            cancel: CommandList::Several(cancel),
            // A guard stays when its client is gone: it only ever cancels.
            on_client_loss: OnClientLoss::GoOn,
            ..RuleBody::default()
        })
    }

    /// Notes that the core has fired a rule; returns true if it is one of the gateway's.
    pub fn core_fired(&mut self, core: u64) -> bool {
        let mut rules = self.rules.iter();
        let rule = rules
            .find(|(_, rule)| rule.core == Some(core) && rule.state == RuleState::Active)
            .map(|(number, _)| *number);
        if let Some(number) = rule {
            self.decide(number, RuleState::Fired, Instant::now());
        }
        rule.is_some()
    }

    /// Subscribes to the devices and pushes them.
    pub fn subscribe_devices(&mut self, outbox: &Outbox, tag: &str) {
        self.device_subscriptions.push(DeviceSubscription {
            outbox: outbox.clone(),
            tag: tag.to_owned(),
            told: BTreeMap::new(),
        });
        self.devices_asked = None;
        self.push_devices();
    }

    /// Returns true if anybody wants to know the devices.
    #[must_use]
    pub fn are_devices_watched(&self) -> bool {
        !self.device_subscriptions.is_empty()
    }

    /// Pushes what has changed of the devices.
    pub fn push_devices(&mut self) {
        let current = self.devices.iter().map(|(name, device)| {
            let description = crate::devices::describe(&device.type_name, &device.kind);
            (name.clone(), (description, device.state))
        });
        let current: BTreeMap<String, (DioValue, &'static str)> = current.collect();
        for subscription in &mut self.device_subscriptions {
            let messages = subscription.changes(&current);
            subscription.told.clone_from(&current);
            subscription.outbox.send(&messages);
        }
    }

    /// Takes over the values that the stream has told since the last turn.
    pub fn take_fresh(&mut self) {
        for net in self.nets.values_mut() {
            for (key, (cycle, value)) in std::mem::take(&mut net.fresh) {
                match value {
                    _ if cycle < net.values_cycle => None,
                    Some(value) => net.values.insert(key, value),
                    None => net.values.remove(&key),
                };
            }
        }
    }

    /// Pushes what is due of all nets.
    pub fn push_nets(&mut self, now: Instant) {
        let rules = &self.rules;
        for net in self.nets.values_mut() {
            let is_known = |(number, fired): (u64, Instant)| {
                let told = rules.get(&number).and_then(|rule| rule.told);
                told.is_some_and(|told| now.duration_since(told) >= AFTER_FIRED)
                    || now.duration_since(fired) >= HOLD_BACK_MAX
            };
            if net.held_by.is_some_and(is_known) {
                net.held_by = None;
            }
        }
        for (name, outbox, subscription) in &mut self.net_subscriptions {
            let gone = BTreeMap::new();
            let picture = match self.nets.get(name) {
                Some(net) => NetPicture {
                    state: net.state,
                    values: &net.values,
                    is_held_back: net.held_by.is_some(),
                    is_ending: net.is_ending,
                },
                None => NetPicture {
                    state: NetState::Unloaded,
                    values: &gone,
                    is_held_back: false,
                    is_ending: false,
                },
            };
            outbox.send(&subscription.due(&picture, now));
        }
        self.net_subscriptions
            .retain(|(_, _, subscription)| !subscription.is_over());
    }

    /// Forgets the oldest nets and rules that are over, where there are too many.
    pub fn forget(&mut self) {
        let excess = self.nets.len().saturating_sub(REMEMBERED_MAX);
        let over = self
            .nets
            .iter()
            .filter(|(_, net)| net.state.is_over() && net.command.is_none());
        // Names are numbered: the shorter and then the smaller one is older.
        let mut over: Vec<String> = over.map(|(name, _)| name.clone()).collect();
        over.sort_by_key(|name| (name.len(), name.clone()));
        for name in over.into_iter().take(excess) {
            self.nets.remove(&name);
        }
        let excess = self.rules.len().saturating_sub(REMEMBERED_MAX);
        let over = self
            .rules
            .iter()
            .filter(|(_, rule)| rule.state != RuleState::Active);
        let over: Vec<u64> = over.map(|(number, _)| *number).take(excess).collect();
        for number in over {
            self.rules.remove(&number);
        }
    }
}

impl DeviceSubscription {
    /// Returns messages for what differs from what was told.
    fn changes(&self, current: &BTreeMap<String, (DioValue, &'static str)>) -> Vec<DioMessage> {
        let gone = self.told.keys().filter(|name| !current.contains_key(*name));
        let gone: Vec<DioValue> = gone.map(|name| DioValue::Text(name.clone())).collect();
        let described = |name: &String| self.told.get(name).map(|(description, _)| description);
        let new = current
            .iter()
            .filter(|(name, (description, _))| described(name) != Some(description));
        let new: Vec<(String, DioValue)> = new
            .map(|(name, (description, _))| (name.clone(), description.clone()))
            .collect();
        let stated = |name: &String| self.told.get(name).map(|(_, state)| *state);
        let changed = current
            .iter()
            .filter(|(name, (_, state))| stated(name) != Some(*state));
        let changed: Vec<(String, DioValue)> = changed
            .map(|(name, (_, state))| (name.clone(), DioValue::Text((*state).to_owned())))
            .collect();
        let mut messages = Vec::new();
        let mut push = |command: &str, value: DioValue| {
            messages.push(DioMessage::new(&self.tag, command, vec![value]));
        };
        if !gone.is_empty() {
            push("dr", DioValue::List(gone));
        }
        if !new.is_empty() {
            push("da", DioValue::Map(new));
        }
        if !changed.is_empty() {
            push("ds", DioValue::Map(changed));
        }
        messages
    }
}

fn rule_message(tag: &str, state: RuleState) -> DioMessage {
    DioMessage::new(tag, "rs", vec![DioValue::Text(state.name().to_owned())])
}
