//! What the gateway knows: sessions, nets, rules, devices, and who subscribed to them. Locked for short times by the
//! engine and by the threads of connections; nothing in here waits.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Map, Value};

use crate::condition::Condition;
use crate::devices::DeviceKind;
use crate::dio::{DioMessage, DioValue};
use crate::net_text::NetText;
use crate::outbox::Outbox;
use crate::pushes::{AFTER_FIRED, HOLD_BACK_MAX, NetPicture, NetState, NetSubscription};

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
    /// `out_2.value`.
    pub port: String,
    /// Type in the core.
    pub type_name: String,
    /// Key of the library.
    pub key: String,
}

/// A net of the library.
#[derive(Clone, Debug)]
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
    /// True once another net has taken its arm or outputs: conditions no longer see its values.
    pub is_overtaken: bool,
    /// A rule that started it and that its client may not know to have fired, and when that was.
    pub held_by: Option<(u64, Instant)>,
    /// True once it was told to end.
    pub is_ending: bool,
    /// When it was told to end with its session.
    pub cancelled_at: Option<Instant>,
}

/// The state of a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RuleState {
    /// It waits for its condition.
    Active,
    /// It has fired.
    Fired,
    /// Its condition was true, but the core refused; nothing happened.
    FireFailed,
    /// Its condition cannot become true any more.
    Inactive,
}

impl RuleState {
    /// Returns the name of the protocol.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            RuleState::Active => "ACTIVE",
            RuleState::Fired => "FIRED",
            RuleState::FireFailed => "FIREFAILED",
            RuleState::Inactive => "INACTIVE",
        }
    }
}

/// A synchronization rule.
#[derive(Clone, Debug)]
pub struct ScheduleRule {
    /// Session of its first net.
    pub session: String,
    /// When it fires.
    pub condition: Condition,
    /// Nets that it stops.
    pub stop: Vec<String>,
    /// Nets that it cancels.
    pub cancel: Vec<String>,
    /// Nets that it starts.
    pub start: Vec<String>,
    /// Its state.
    pub state: RuleState,
    /// When a client was told that it has fired.
    pub told: Option<Instant>,
    /// When the core first refused because an arm was still coming to rest.
    pub trying_since: Option<Instant>,
    /// When the next attempt is due, after one in which the motion did not continue within the arm's limits.
    pub not_before: Option<Instant>,
    /// Subscriptions that have not seen its last state.
    pub subscribers: Vec<(Outbox, String)>,
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

    /// Notes that a net has been started by a rule: it takes arms and outputs from those that ended.
    pub fn started(&mut self, name: &str, rule: Option<u64>, now: Instant) {
        let Some(net) = self.nets.get_mut(name) else {
            return;
        };
        net.state = NetState::Running;
        net.held_by = rule.map(|rule| (rule, now));
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

    /// Subscribes to the devices and pushes them.
    pub fn subscribe_devices(&mut self, outbox: &Outbox, tag: &str) {
        self.device_subscriptions.push(DeviceSubscription {
            outbox: outbox.clone(),
            tag: tag.to_owned(),
            told: BTreeMap::new(),
        });
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
