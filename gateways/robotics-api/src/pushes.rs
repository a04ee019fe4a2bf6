//! In which order and at what rate the states and values of a net are pushed to a client, so that none of the races of
//! the library is lost. Pure functions of time; run by the engine and by the threads of connections.
//!
//! 1. Nothing of a net that a rule started is pushed before the client knows that the rule fired.
//! 2. States are sampled: at most one each 10 ms, of which those in between are left out.
//! 3. RUNNING comes before values, and the last values directly before TERMINATED, in the same batch.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::dio::{DioMessage, DioValue};

/// Shortest time between two states.
pub const STATE_EVERY: Duration = Duration::from_millis(10);
/// Time between FIRED and the first push of a net that the rule started.
pub const AFTER_FIRED: Duration = Duration::from_millis(20);
/// Time after which a client that does not subscribe to the rule is not waited for any longer.
pub const HOLD_BACK_MAX: Duration = Duration::from_millis(300);

/// The state of a net as the library knows it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NetState {
    /// It is ready, and no rule would start it.
    #[default]
    Ready,
    /// A rule may start it.
    Scheduled,
    /// It is evaluated.
    Running,
    /// Its `Cancel` is true.
    Cancelling,
    /// It has ended.
    Terminated,
    /// It has ended by a fault.
    Error,
    /// It is gone.
    Unloaded,
}

impl NetState {
    /// Returns the name of the protocol.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            NetState::Ready => "READY",
            NetState::Scheduled => "SCHEDULED",
            NetState::Running => "RUNNING",
            NetState::Cancelling => "CANCELLING",
            NetState::Terminated => "TERMINATED",
            NetState::Error => "ERROR",
            NetState::Unloaded => "UNLOADED",
        }
    }

    /// Returns true while the net is evaluated.
    #[must_use]
    pub fn is_active(self) -> bool {
        matches!(self, NetState::Running | NetState::Cancelling)
    }

    /// Returns true if the net will never be evaluated again.
    #[must_use]
    pub fn is_over(self) -> bool {
        matches!(
            self,
            NetState::Terminated | NetState::Error | NetState::Unloaded
        )
    }
}

/// The values of a net that a subscription shows.
#[derive(Clone, Copy, Debug)]
pub struct NetPicture<'n> {
    /// Its state.
    pub state: NetState,
    /// Its values by key; null values are missing.
    pub values: &'n BTreeMap<String, String>,
    /// True while the client does not know that the net was started.
    pub is_held_back: bool,
    /// True while it is about to end: the values are kept for the batch with its last state.
    pub is_ending: bool,
}

/// A client's subscription to a net, and what it has been told.
#[derive(Clone, Debug)]
pub struct NetSubscription {
    tag: String,
    interval: Duration,
    state: Option<(NetState, Instant)>,
    values: BTreeMap<String, String>,
    values_at: Option<Instant>,
}

impl NetSubscription {
    /// Returns a subscription with this shortest time between two sets of values.
    #[must_use]
    pub fn new(tag: &str, interval: Duration) -> NetSubscription {
        NetSubscription {
            tag: tag.to_owned(),
            interval,
            state: None,
            values: BTreeMap::new(),
            values_at: None,
        }
    }

    /// Returns true if nothing may follow: the client has forgotten the tag.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.state
            .is_some_and(|(state, _)| state == NetState::Unloaded)
    }

    /// Returns what is to be pushed now, as one batch.
    pub fn due(&mut self, picture: &NetPicture<'_>, now: Instant) -> Vec<DioMessage> {
        let Some((state, since)) = self.state else {
            // The first state at once: the client does nothing with a net before.
            let first = match picture.is_held_back {
                true => NetState::Scheduled,
                false => picture.state,
            };
            return self.with_state(first, picture, now);
        };
        if picture.is_held_back || self.is_over() {
            return Vec::new();
        }
        if picture.state != state {
            return match now.duration_since(since) >= STATE_EVERY {
                true => self.with_state(picture.state, picture, now),
                // The values wait for the state with which they belong together.
                false => Vec::new(),
            };
        }
        let is_due = self
            .values_at
            .is_none_or(|at| now.duration_since(at) >= self.interval);
        match state.is_active() && !picture.is_ending && is_due {
            true => self.changed(picture, now).into_iter().collect(),
            false => Vec::new(),
        }
    }

    fn with_state(
        &mut self,
        state: NetState,
        picture: &NetPicture<'_>,
        now: Instant,
    ) -> Vec<DioMessage> {
        self.state = Some((state, now));
        let text = DioValue::Text(state.name().to_owned());
        let message = DioMessage::new(&self.tag, "ns", vec![text]);
        match state {
            NetState::Running | NetState::Cancelling if picture.is_ending => vec![message],
            NetState::Running | NetState::Cancelling => {
                let values = self.changed(picture, now);
                std::iter::once(message).chain(values).collect()
            }
            NetState::Terminated | NetState::Error => {
                let values = self.changed(picture, now);
                values.into_iter().chain([message]).collect()
            }
            NetState::Ready | NetState::Scheduled | NetState::Unloaded => vec![message],
        }
    }

    /// Returns the values that differ from those that were sent.
    fn changed(&mut self, picture: &NetPicture<'_>, now: Instant) -> Option<DioMessage> {
        let changed = picture.values.iter();
        // The client reads an empty text as two quotes.
        let changed = changed
            .filter(|(key, value)| !value.is_empty() && self.values.get(*key) != Some(value));
        let changed: Vec<(String, String)> = changed
            .map(|(key, value)| (key.clone(), value.clone()))
            .collect();
        if changed.is_empty() {
            return None;
        }
        self.values_at = Some(now);
        self.values.extend(changed.iter().cloned());
        let entries = changed
            .into_iter()
            .map(|(key, value)| (key, DioValue::Text(value)));
        Some(DioMessage::new(
            &self.tag,
            "nc",
            vec![DioValue::Map(entries.collect())],
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: Duration = Duration::from_millis(20);

    struct Client {
        subscription: NetSubscription,
        begun: Instant,
        values: BTreeMap<String, String>,
    }

    impl Client {
        fn new() -> Client {
            Client {
                subscription: NetSubscription::new("c1", INTERVAL),
                begun: Instant::now(),
                values: BTreeMap::new(),
            }
        }

        fn set(&mut self, key: &str, value: &str) -> &mut Client {
            self.values.insert(key.to_owned(), value.to_owned());
            self
        }

        fn at(&mut self, ms: u64, state: NetState) -> String {
            self.seen(ms, state, false, false)
        }

        fn seen(
            &mut self,
            ms: u64,
            state: NetState,
            is_held_back: bool,
            is_ending: bool,
        ) -> String {
            let picture = NetPicture {
                state,
                values: &self.values,
                is_held_back,
                is_ending,
            };
            let due = self
                .subscription
                .due(&picture, self.begun + Duration::from_millis(ms));
            due.iter()
                .map(|message| message.to_string().replace("c1=", ""))
                .collect::<Vec<_>>()
                .join(" ")
        }
    }

    use NetState::{Error, Ready, Running, Scheduled, Terminated, Unloaded};

    #[test]
    fn running_comes_before_values_and_values_before_terminated() {
        let mut client = Client::new();
        assert_eq!(client.at(0, Ready), r#"ns("READY")"#);
        client.set("out_1", "false");
        assert_eq!(client.at(5, Ready), "", "no value before the net runs");
        assert_eq!(
            client.at(10, Running),
            r#"ns("RUNNING") nc({out_1:"false"})"#
        );
        assert_eq!(client.at(40, Running), "", "only what changes");
        client.set("out_1", "true");
        assert_eq!(
            client.at(50, Terminated),
            r#"nc({out_1:"true"}) ns("TERMINATED")"#
        );
        assert_eq!(client.at(99, Terminated), "");
    }

    #[test]
    fn states_are_sampled_and_those_in_between_left_out() {
        let mut client = Client::new();
        client.at(0, Ready);
        client.set("out_1", "true");
        assert_eq!(
            client.at(4, Running),
            "",
            "less than 10 ms after the last state"
        );
        assert_eq!(client.at(9, Terminated), "");
        assert_eq!(
            client.at(10, Terminated),
            r#"nc({out_1:"true"}) ns("TERMINATED")"#
        );
    }

    #[test]
    fn a_net_that_is_held_back_shows_nothing_but_its_first_state() {
        let mut client = Client::new();
        client.set("out_1", "true");
        assert_eq!(client.seen(0, Running, true, false), r#"ns("SCHEDULED")"#);
        assert_eq!(client.seen(100, Terminated, true, false), "");
        assert_eq!(
            client.at(101, Terminated),
            r#"nc({out_1:"true"}) ns("TERMINATED")"#
        );
    }

    #[test]
    fn values_of_a_net_that_is_about_to_end_wait_for_its_last_state() {
        let mut client = Client::new();
        client.at(0, Scheduled);
        client.at(20, Running);
        client.set("out_2", "true");
        assert_eq!(client.seen(60, Running, false, true), "");
        assert_eq!(
            client.at(70, Terminated),
            r#"nc({out_2:"true"}) ns("TERMINATED")"#
        );
    }

    #[test]
    fn values_come_at_the_rate_that_was_asked_for() {
        let mut client = Client::new();
        client.at(0, Ready);
        assert_eq!(
            client.set("out_x", "1.0").at(10, Running),
            r#"ns("RUNNING") nc({out_x:"1.0"})"#
        );
        assert_eq!(client.set("out_x", "2.0").at(20, Running), "");
        assert_eq!(
            client.set("out_x", "3.0").at(30, Running),
            r#"nc({out_x:"3.0"})"#
        );
    }

    #[test]
    fn a_second_subscription_of_a_net_that_ended_gets_its_values_and_state() {
        let mut client = Client::new();
        client.set("out_2", "true");
        assert_eq!(
            client.at(0, Terminated),
            r#"nc({out_2:"true"}) ns("TERMINATED")"#
        );
        assert_eq!(client.at(20, Unloaded), r#"ns("UNLOADED")"#);
        client.set("out_3", "true");
        assert_eq!(
            client.at(60, Unloaded),
            "",
            "the client has forgotten the tag"
        );
        let mut lost = Client::new();
        assert_eq!(lost.at(0, Error), r#"ns("ERROR")"#);
    }

    #[test]
    fn an_empty_text_is_never_sent() {
        let mut client = Client::new();
        client.set("out_1", "");
        assert_eq!(client.at(0, Running), r#"ns("RUNNING")"#);
    }
}
