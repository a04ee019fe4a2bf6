//! The requests of the protocol on a connection. Run by the thread that reads the connection; loading a net, which takes
//! longest, by a thread of its own, so that a cancel never waits for it.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use serde_json::Map;

use crate::condition::Condition;
use crate::dio::{DioMessage, DioValue};
use crate::gateway::Gateway;
use crate::loader::CellClient;
use crate::mirror;
use crate::outbox::Outbox;
use crate::pushes::NetState;
use crate::rules::{RuleState, ScheduleRule};
use crate::state::Session;
use crate::stop_kind::StopKind;
use crate::stops;
use crate::values::from_library;

/// Maximum number of nets that one connection loads at the same time; further LOADs wait, and so do the requests after
/// them.
const LOADING_MAX: usize = 4;
/// Shortest time between two sets of values that a client may ask for.
const INTERVAL_MIN: Duration = Duration::from_millis(5);

/// A connection that speaks the protocol.
#[derive(Debug)]
pub struct Dialogue {
    gateway: Arc<Gateway>,
    outbox: Outbox,
    loader: CellClient,
    has_shaken_hands: bool,
    loading: Arc<AtomicUsize>,
}

/// An answer: the values of `ok`, or the reason of `err`. `None` if it was sent already, or will be.
type Answer = Result<Option<Vec<DioValue>>, String>;

fn ok(value: &str) -> Answer {
    Ok(Some(vec![DioValue::Text(value.to_owned())]))
}

const OK: Answer = Ok(Some(Vec::new()));

impl Dialogue {
    /// Begins a dialogue.
    #[must_use]
    pub fn new(gateway: Arc<Gateway>, outbox: Outbox) -> Dialogue {
        gateway
            .state()
            .connections
            .insert(outbox.connection, BTreeSet::new());
        let loader = gateway.paced_loader();
        Dialogue {
            gateway,
            outbox,
            loader,
            has_shaken_hands: false,
            loading: Arc::default(),
        }
    }

    /// Answers a message.
    pub fn answer(&mut self, text: &str) {
        let message = match crate::dio::parse(text) {
            Ok(message) => message,
            Err(error) => return self.send("none", Err(format!("invalid syntax: {error}"))),
        };
        let answer = self.request(&message);
        self.send(&message.tag, answer);
        self.gateway.wake();
    }

    fn send(&self, tag: &str, answer: Answer) {
        send_answer(&self.outbox, tag, answer);
    }

    fn request(&mut self, message: &DioMessage) -> Answer {
        let DioMessage {
            tag,
            command,
            values,
        } = message;
        if command == "ver" {
            return self.version(values);
        }
        if !self.has_shaken_hands {
            return Err("bad handshake".to_owned());
        }
        let name = values.first().and_then(DioValue::text);
        let name = || name.ok_or_else(|| format!("{command} needs a name"));
        match command.as_str() {
            "nse" => self.new_session(name()?),
            "ase" => self.end_session(name()?),
            "gde" => {
                self.send(tag, OK);
                self.gateway.state().subscribe_devices(&self.outbox, tag);
                Ok(None)
            }
            "nene" => self.load(tag, values),
            "gne" => self.subscribe_net(tag, name()?, values),
            "nesc" => self.schedule(values),
            "gsy" => self.subscribe_rule(tag, name()?),
            "snc" => self.set_values(values),
            "neun" => self.unload(name()?),
            "neca" => self.stop(name()?, StopKind::Cancel),
            "neab" => self.stop(name()?, StopKind::Abort),
            "nest" => {
                let start = vec![name()?.to_owned()];
                self.add_rule(Condition::Always, Vec::new(), Vec::new(), start)
                    .map(|_| Some(Vec::new()))
            }
            "quit" => {
                self.send(tag, OK);
                self.outbox.close();
                Ok(None)
            }
            other => Err(format!("unknown command {other}")),
        }
    }

    fn version(&mut self, values: &[DioValue]) -> Answer {
        match values {
            [DioValue::Text(version)] if version == "2.0" => {
                self.has_shaken_hands = true;
                ok("handshake ok")
            }
            _ => Err("bad handshake".to_owned()),
        }
    }

    fn new_session(&self, description: &str) -> Answer {
        let mut state = self.gateway.state();
        let name = format!("s{}", state.number("session"));
        tracing::info!(
            session = name,
            client = description,
            "a client has begun a session"
        );
        let session = Session {
            description: description.to_owned(),
            ..Session::default()
        };
        state.sessions.insert(name.clone(), session);
        state.bind(self.outbox.connection, &name);
        ok(&name)
    }

    fn end_session(&self, name: &str) -> Answer {
        match self.gateway.state().sessions.get_mut(name) {
            Some(session) => {
                // The engine stops its nets and unloads them.
                session.left = Some(Instant::now());
                session.is_ending = true;
                OK
            }
            None => Err("invalid session".to_owned()),
        }
    }

    fn load(&mut self, tag: &str, values: &[DioValue]) -> Answer {
        let text = values
            .first()
            .and_then(DioValue::text)
            .ok_or("nene needs a net")?
            .to_owned();
        if let Some(period) = values.get(3) {
            // 0 is the core's own; 0.05 is that of nets which are not real-time, and is a rate limit there.
            period
                .number()
                .ok_or("the period of nene is not a number")?;
        }
        let named = values.get(1).and_then(DioValue::text).unwrap_or_default();
        let session = self.session(named);
        if self.loading.load(Ordering::Acquire) >= LOADING_MAX {
            let loaded = self.gateway.load(&mut self.loader, &session, &text)?;
            return ok(&loaded);
        }
        let (gateway, outbox, loading) = (
            Arc::clone(&self.gateway),
            self.outbox.clone(),
            Arc::clone(&self.loading),
        );
        let tag = tag.to_owned();
        loading.fetch_add(1, Ordering::AcqRel);
        let load = move || {
            let loaded = gateway.load(&mut gateway.paced_loader(), &session, &text);
            loading.fetch_sub(1, Ordering::AcqRel);
            if let Err(reason) = &loaded {
                tracing::warn!(session, reason, "a net was rejected");
            }
            send_answer(&outbox, &tag, loaded.and_then(|name| ok(&name)));
        };
        match std::thread::Builder::new()
            .name("load".to_owned())
            .spawn(load)
        {
            Ok(_) => Ok(None),
            Err(error) => Err(format!("no thread can be started: {error}")),
        }
    }

    /// Returns a session that exists; a net of none belongs to its connection.
    fn session(&self, named: &str) -> String {
        let mut state = self.gateway.state();
        let name = match state.sessions.contains_key(named) {
            true => named.to_owned(),
            false => format!("connection{}", self.outbox.connection),
        };
        state.sessions.entry(name.clone()).or_default();
        state.bind(self.outbox.connection, &name);
        name
    }

    fn subscribe_net(&self, tag: &str, name: &str, values: &[DioValue]) -> Answer {
        let interval = values.get(1).map_or(Some(0.0), DioValue::number);
        let interval = interval.ok_or("the interval of gne is not a number")?;
        let interval = Duration::try_from_secs_f64(interval)
            .unwrap_or(Duration::ZERO)
            .max(INTERVAL_MIN);
        let mut state = self.gateway.state();
        let Some(session) = state.nets.get(name).map(|net| net.session.clone()) else {
            return Err("invalid net".to_owned());
        };
        state.bind(self.outbox.connection, &session);
        self.send(tag, OK);
        state.subscribe_net(&self.outbox, tag, name, interval);
        Ok(None)
    }

    fn schedule(&mut self, values: &[DioValue]) -> Answer {
        let condition = values
            .first()
            .and_then(DioValue::text)
            .ok_or("nesc needs a condition")?;
        let condition =
            Condition::parse(condition).map_err(|error| format!("invalid condition: {error}"))?;
        let mut lists = Vec::new();
        for list in values.iter().skip(1).take(3) {
            lists.push(
                list.texts()
                    .ok_or("the nets of nesc are not lists of names")?,
            );
        }
        let Ok([stop, cancel, start]) = <[Vec<String>; 3]>::try_from(lists) else {
            return Err("nesc needs three lists: stop, cancel, start".to_owned());
        };
        let number = self.add_rule(condition, stop, cancel, start)?;
        ok(&number.to_string())
    }

    /// Adds a rule; returns its number.
    fn add_rule(
        &mut self,
        condition: Condition,
        stop: Vec<String>,
        cancel: Vec<String>,
        start: Vec<String>,
    ) -> Result<u64, String> {
        // A net that made room for others is loaded again before the rule waits for a condition of some cycle.
        for name in &start {
            let gateway = Arc::clone(&self.gateway);
            let _cell = gateway.keep_cell();
            mirror::ensure_loaded(&gateway, &mut self.loader, name)?;
        }
        let mut state = self.gateway.state();
        let reads = condition.reads();
        let named = reads.iter().map(|(net, _)| *net).chain(
            [&stop, &cancel, &start]
                .into_iter()
                .flatten()
                .map(String::as_str),
        );
        let mut session = String::new();
        for name in named {
            let net = state
                .nets
                .get(name)
                .ok_or_else(|| format!("invalid netname {name}"))?;
            session.clone_from(&net.session);
        }
        for (name, key) in &reads {
            let is_reported = |net: &crate::state::GatewayNet| {
                net.reported
                    .iter()
                    .any(|value| value.key == *key && value.type_name == "Bool")
            };
            if !state.nets.get(*name).is_some_and(is_reported) {
                return Err(format!(
                    "scheduling not possible: {name} reports no boolean value {key}"
                ));
            }
        }
        let mut used = BTreeSet::new();
        for name in &start {
            let Some(net) = state.nets.get(name) else {
                continue;
            };
            if net.state.is_over() {
                return Err(format!(
                    "scheduling not possible: {name} is {}",
                    net.state.name()
                ));
            }
            if let Some(shared) = net
                .uses
                .iter()
                .find(|resource| !used.insert((*resource).clone()))
            {
                return Err(format!(
                    "scheduling not possible: two nets to be started command {shared}"
                ));
            }
        }
        for name in &start {
            if let Some(net) = state
                .nets
                .get_mut(name)
                .filter(|net| net.state == NetState::Ready)
            {
                net.state = NetState::Scheduled;
            }
        }
        state.bind(self.outbox.connection, &session);
        let number = state.number("rule");
        let rule = ScheduleRule {
            session,
            condition,
            stop,
            cancel,
            start,
            state: RuleState::Active,
            told: None,
            trying_since: None,
            not_before: None,
            core: None,
            subscribers: Vec::new(),
        };
        state.rules.insert(number, rule);
        drop(state);
        mirror::mirror(&self.gateway, &mut self.loader, number);
        Ok(number)
    }

    fn subscribe_rule(&self, tag: &str, number: &str) -> Answer {
        let number = number
            .parse()
            .map_err(|_| format!("invalid rule {number}"))?;
        let mut state = self.gateway.state();
        if !state.rules.contains_key(&number) {
            return Err(format!("invalid rule {number}"));
        }
        self.send(tag, OK);
        state.subscribe_rule(&self.outbox, tag, number);
        Ok(None)
    }

    fn set_values(&mut self, values: &[DioValue]) -> Answer {
        let Some(DioValue::Map(nets)) = values.first() else {
            return Err("snc needs a mapping from nets to values".to_owned());
        };
        for (name, inputs) in nets {
            let DioValue::Map(inputs) = inputs else {
                return Err(format!("the values of {name} are not a mapping"));
            };
            let (command, set) = self.inputs(name, inputs)?;
            if command.is_some() && !set.is_empty() {
                self.loader
                    .set(name, &set)
                    .map_err(|error| error.to_string())?;
            }
        }
        OK
    }

    /// Notes the values of a net, and returns its command with the values as the core takes them. Keys that the net does
    /// not have are skipped, as by the predecessor: the library writes one value to all nets of a group.
    fn inputs(
        &self,
        name: &str,
        inputs: &[(String, DioValue)],
    ) -> Result<(Option<u64>, Map<String, serde_json::Value>), String> {
        let mut state = self.gateway.state();
        let net = state
            .nets
            .get_mut(name)
            .ok_or_else(|| format!("invalid net {name}"))?;
        if net.state.is_over() {
            return Err(format!("{name} is {}", net.state.name()));
        }
        let mut set = Map::new();
        for (key, value) in inputs {
            let text = value
                .text()
                .ok_or_else(|| format!("the value of {key} is not a text"))?;
            let id = net
                .text
                .inputs
                .iter()
                .find(|(_, known)| *known == key)
                .map(|(id, _)| id.clone());
            let Some((id, ty)) = id.and_then(|id| Some((id.clone(), net.inputs.get(&id)?))) else {
                tracing::debug!(net = name, key, "no such input");
                continue;
            };
            let value = from_library(ty, text).map_err(|error| format!("{name}.{key}: {error}"))?;
            set.insert(id, value);
        }
        net.written.extend(set.clone());
        Ok((net.command, set))
    }

    /// Notes that this connection belongs to the session of a net.
    fn bind(&self, name: &str) -> Result<(), String> {
        let mut state = self.gateway.state();
        let net = state.nets.get(name).ok_or("invalid net")?;
        let session = net.session.clone();
        state.bind(self.outbox.connection, &session);
        Ok(())
    }

    fn unload(&mut self, name: &str) -> Answer {
        self.bind(name)?;
        let command = {
            let mut state = self.gateway.state();
            let net = state.nets.get(name).ok_or("invalid net")?;
            if net.state.is_active() {
                return Err(format!("{name} is {}: abort it first", net.state.name()));
            }
            if net.owed_stop.is_some() {
                return Err(format!("{name} is being stopped"));
            }
            if net.may_run {
                return Err(format!("{name} may run: abort it first"));
            }
            if state.is_scheduled(name) {
                return Err(format!("a rule waits to start {name}"));
            }
            let command = net.command;
            state.nets.remove(name);
            // Those who subscribed see that it is gone.
            state.push_nets(Instant::now());
            command
        };
        match command {
            Some(_) => self
                .loader
                .unload(name)
                .map(|()| Some(Vec::new()))
                .map_err(|error| error.to_string()),
            None => OK,
        }
    }

    /// CANCEL or ABORT.
    fn stop(&mut self, name: &str, kind: StopKind) -> Answer {
        self.bind(name)?;
        let sent = self.gateway.state().stop(name, kind);
        if let Some(kind) = sent {
            stops::send(&self.gateway, &mut self.loader, name, kind)
                .map_err(|error| error.to_string())?;
        }
        OK
    }
}

impl Drop for Dialogue {
    fn drop(&mut self) {
        self.gateway
            .state()
            .disconnect(self.outbox.connection, Instant::now());
    }
}

fn send_answer(outbox: &Outbox, tag: &str, answer: Answer) {
    let (command, values) = match answer {
        Ok(Some(values)) => ("ok", values),
        Ok(None) => return,
        // The client reads an empty text as two quotes.
        Err(reason) if reason.is_empty() => ("err", vec![DioValue::Text("refused".to_owned())]),
        Err(reason) => ("err", vec![DioValue::Text(reason)]),
    };
    outbox.send(&[DioMessage::new(tag, command, values)]);
}
