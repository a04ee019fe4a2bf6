//! The connected viewers, and the channels that they may subscribe to. The thread that reads the cell writes messages here,
//! the serving thread connects clients; neither waits for a client.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rcc_recording::file::{AttachedText, ChannelInfo, RecordingError};
use rcc_recording::sink::{ChannelId, MessageSink, RecordingState};
use tokio_tungstenite::tungstenite::Message;

use crate::outbox::Outbox;
use crate::protocol::{self, Announcement, Parameter, StatusLevel, Subscription};

/// Connected viewers.
pub const VIEWERS_MAX: usize = 16;
/// Subscriptions of a viewer, and parameters whose changes it is told.
pub const SUBSCRIPTIONS_MAX: usize = 1024;
/// Channels. Beyond it the net that has been silent for longest is taken back.
pub const CHANNELS_MAX: usize = 256;
/// Types made for one net or device have names that begin so; the others are drawn, and have a rate of their own.
const TABLE_SCHEMAS: &str = "rcc/msg/";

struct LiveChannel {
    info: ChannelInfo,
    /// Time from which the next message is sent, ns since 1970.
    next_ns: u64,
    /// Newest message, for clients that come later, and its time.
    kept: Option<(u64, Vec<u8>)>,
    /// Clients with their subscriptions.
    subscribers: Vec<(u64, u32)>,
}

impl LiveChannel {
    fn announcement(&self, id: u32) -> Announcement<'_> {
        Announcement {
            id,
            topic: &self.info.topic,
            schema_name: &self.info.schema.name,
            schema: &self.info.schema.text,
        }
    }

    fn is_table(&self) -> bool {
        self.info.schema.name.starts_with(TABLE_SCHEMAS)
    }
}

struct Viewer {
    outbox: Arc<Outbox>,
    /// Parameters whose changes it is told.
    parameters: BTreeSet<String>,
}

#[derive(Default)]
struct State {
    channels: BTreeMap<u32, LiveChannel>,
    /// Ids are never used twice: a net that is gone must not write into the channel of another.
    next_channel: u32,
    viewers: BTreeMap<u64, Viewer>,
    next_viewer: u64,
    /// Messages for every new client, by id.
    statuses: BTreeMap<&'static str, String>,
}

impl State {
    fn tell_all(&self, message: &Message) {
        for viewer in self.viewers.values() {
            viewer.outbox.answer(message.clone());
        }
    }

    fn remove_channel(&mut self, id: u32) {
        self.channels.remove(&id);
        self.tell_all(&protocol::unadvertise(&[id]));
    }
}

/// Channels and clients.
#[derive(Default)]
pub struct Viewers {
    state: Mutex<State>,
    /// Time between two messages of a net or device, ns.
    every_ns: u64,
}

impl Viewers {
    /// Sends at most `rate_hz` messages a second of each net and device.
    #[must_use]
    pub fn new(rate_hz: f64) -> Viewers {
        Viewers {
            state: Mutex::default(),
            every_ns: (1e9 / rate_hz) as u64,
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Each change is complete before the lock is given back.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Connects a client, sends it `first` and what is there; `None` if there are too many.
    pub fn connect(&self, first: &[Message]) -> Option<(u64, Arc<Outbox>)> {
        let mut state = self.lock();
        if state.viewers.len() >= VIEWERS_MAX {
            return None;
        }
        let outbox = Arc::new(Outbox::default());
        for message in first {
            outbox.answer(message.clone());
        }
        for (id, words) in &state.statuses {
            outbox.answer(protocol::status(StatusLevel::Warning, Some(id), words));
        }
        let channels = state.channels.iter();
        let channels = channels.map(|(id, channel)| channel.announcement(*id));
        outbox.answer(protocol::advertise(channels));
        let id = state.next_viewer;
        state.next_viewer += 1;
        let viewer = Viewer {
            outbox: Arc::clone(&outbox),
            parameters: BTreeSet::new(),
        };
        state.viewers.insert(id, viewer);
        Some((id, outbox))
    }

    /// Forgets a client.
    pub fn disconnect(&self, viewer: u64) {
        let mut state = self.lock();
        state.viewers.remove(&viewer);
        for channel in state.channels.values_mut() {
            channel.subscribers.retain(|(one, _)| *one != viewer);
        }
    }

    /// Ends all connections.
    pub fn close(&self) {
        for viewer in self.lock().viewers.values() {
            viewer.outbox.close();
        }
    }

    /// Returns true if somebody is connected.
    #[must_use]
    pub fn is_viewed(&self) -> bool {
        !self.lock().viewers.is_empty()
    }

    /// Subscribes a client to channels. Returns the subscriptions that are not possible.
    pub fn subscribe(&self, viewer: u64, wanted: &[Subscription]) -> Vec<Subscription> {
        let mut state = self.lock();
        let Some(outbox) = state
            .viewers
            .get(&viewer)
            .map(|one| Arc::clone(&one.outbox))
        else {
            return Vec::new();
        };
        let own = |channel: &LiveChannel| {
            let own = channel.subscribers.iter();
            own.filter(|(one, _)| *one == viewer).count()
        };
        let mut count: usize = state.channels.values().map(own).sum();
        let mut refused = Vec::new();
        for wish in wanted {
            let is_new = !state
                .channels
                .values()
                .any(|one| one.subscribers.contains(&(viewer, wish.id)));
            let channel = state.channels.get_mut(&wish.channel_id);
            let Some(channel) = channel.filter(|_| is_new && count < SUBSCRIPTIONS_MAX) else {
                refused.push(*wish);
                continue;
            };
            channel.subscribers.push((viewer, wish.id));
            count += 1;
            if let Some((time_ns, message)) = &channel.kept {
                outbox.message(protocol::message_data(wish.id, *time_ns, message));
            }
        }
        refused
    }

    /// Ends subscriptions of a client.
    pub fn unsubscribe(&self, viewer: u64, subscriptions: &[u32]) {
        for channel in self.lock().channels.values_mut() {
            let ends = |(one, id): &(u64, u32)| *one == viewer && subscriptions.contains(id);
            channel.subscribers.retain(|row| !ends(row));
        }
    }

    /// Begins or ends to tell a client changes of parameters.
    pub fn watch_parameters(&self, viewer: u64, names: Vec<String>, watched: bool) {
        let mut state = self.lock();
        let Some(viewer) = state.viewers.get_mut(&viewer) else {
            return;
        };
        for name in names {
            match watched {
                true if viewer.parameters.len() < SUBSCRIPTIONS_MAX => {
                    viewer.parameters.insert(name);
                }
                true => {}
                false => {
                    viewer.parameters.remove(&name);
                }
            }
        }
    }

    /// Returns true if somebody is told changes of parameters.
    #[must_use]
    pub fn watches_parameters(&self) -> bool {
        let state = self.lock();
        state.viewers.values().any(|one| !one.parameters.is_empty())
    }

    /// Tells changed parameters to the clients that watch them.
    pub fn tell_parameters(&self, changed: &[Parameter]) {
        for viewer in self.lock().viewers.values() {
            let watched = changed.iter();
            let mut watched = watched
                .filter(|one| viewer.parameters.contains(&one.name))
                .peekable();
            if watched.peek().is_some() {
                viewer
                    .outbox
                    .answer(protocol::parameter_values(watched, None));
            }
        }
    }

    /// Shows a status to every client, also to those that come later.
    pub fn set_status(&self, id: &'static str, words: &str) {
        let mut state = self.lock();
        if state.statuses.get(id).is_none_or(|known| known != words) {
            state.statuses.insert(id, words.to_owned());
            state.tell_all(&protocol::status(StatusLevel::Warning, Some(id), words));
        }
    }

    /// Takes a status back.
    pub fn remove_status(&self, id: &'static str) {
        let mut state = self.lock();
        if state.statuses.remove(id).is_some() {
            state.tell_all(&protocol::remove_status(id));
        }
    }

    /// Keeps a message for later clients, and sends it to those that are there.
    fn send(&self, id: ChannelId, time_ns: u64, message: &[u8], is_kept: bool) {
        let mut state = self.lock();
        let state = &mut *state;
        let channel = u32::try_from(id.index()).ok();
        // A net whose channel was taken back writes into none.
        let Some(channel) = channel.and_then(|id| state.channels.get_mut(&id)) else {
            return;
        };
        if is_kept {
            channel.kept = Some((time_ns, message.to_vec()));
        } else if channel.is_table() {
            // A quarter of tolerance, so that cycles which come a little early are not left out.
            if time_ns + self.every_ns / 4 < channel.next_ns {
                return;
            }
            let next_ns = channel.next_ns + self.every_ns;
            channel.next_ns = match next_ns > time_ns {
                true => next_ns,
                // The first one, or the first after a pause.
                false => time_ns + self.every_ns,
            };
        }
        for (viewer, subscription) in &channel.subscribers {
            if let Some(viewer) = state.viewers.get(viewer) {
                let frame = protocol::message_data(*subscription, time_ns, message);
                viewer.outbox.message(frame);
            }
        }
    }

    /// Returns the channel of this topic; if it has another type, its successor.
    fn channel(&self, wanted: ChannelInfo) -> ChannelId {
        let mut state = self.lock();
        let mut rows = state.channels.iter();
        let found = rows.find(|(_, one)| one.info.topic == wanted.topic);
        let found = found.map(|(id, one)| (*id, one.info.schema == wanted.schema));
        match found {
            Some((id, true)) => return ChannelId::new(id as usize),
            Some((id, false)) => state.remove_channel(id),
            None => {}
        }
        if state.channels.len() >= CHANNELS_MAX {
            let tables = state.channels.iter().filter(|(_, one)| one.is_table());
            let silent = tables.min_by_key(|(_, one)| one.next_ns);
            if let Some(id) = silent.map(|(id, _)| *id) {
                state.remove_channel(id);
            }
        }
        let id = state.next_channel;
        state.next_channel += 1;
        let channel = LiveChannel {
            info: wanted,
            next_ns: 0,
            kept: None,
            subscribers: Vec::new(),
        };
        state.tell_all(&protocol::advertise(std::iter::once(
            channel.announcement(id),
        )));
        state.channels.insert(id, channel);
        ChannelId::new(id as usize)
    }
}

/// Sends what a recording would contain to the viewers.
pub struct LiveSink(pub Arc<Viewers>);

impl MessageSink for LiveSink {
    fn channel(&mut self, wanted: ChannelInfo) -> ChannelId {
        self.0.channel(wanted)
    }

    fn attach(&mut self, _text: AttachedText, _time_ns: u64) -> Result<(), RecordingError> {
        // Viewers have no place for texts.
        Ok(())
    }

    fn write(
        &mut self,
        channel: ChannelId,
        time_ns: u64,
        message: &[u8],
    ) -> Result<RecordingState, RecordingError> {
        self.0.send(channel, time_ns, message, false);
        Ok(RecordingState::Open)
    }

    fn write_kept(
        &mut self,
        channel: ChannelId,
        time_ns: u64,
        message: &[u8],
    ) -> Result<RecordingState, RecordingError> {
        self.0.send(channel, time_ns, message, true);
        Ok(RecordingState::Open)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcc_recording::schemas::MessageSchema;
    use serde_json::{Value, json};
    use tokio::runtime::Builder;

    fn info(topic: &str, schema: &str) -> ChannelInfo {
        ChannelInfo {
            topic: topic.into(),
            schema: MessageSchema {
                name: schema.into(),
                text: format!("float64 {}\n", topic.len()),
            },
            metadata: Default::default(),
        }
    }

    /// Takes what waits: texts as JSON, frames as the number of their subscription and the first byte of the message.
    fn taken(outbox: &Outbox) -> Vec<Value> {
        // After the marker there is nothing.
        outbox.message(vec![0xff; 14].into());
        let runtime = Builder::new_current_thread().build().expect("a runtime");
        let mut rows = Vec::new();
        loop {
            match runtime.block_on(outbox.next()).expect("not closed") {
                Message::Binary(frame) if frame[0] == 0xff => return rows,
                Message::Binary(frame) => rows.push(json!([frame[1], frame[13]])),
                text => rows.push(serde_json::from_slice(&text.into_data()).expect("JSON")),
            }
        }
    }

    fn wish(id: u32, channel: ChannelId) -> Subscription {
        Subscription {
            id,
            channel_id: channel.index() as u32,
        }
    }

    #[test]
    fn a_table_is_thinned_to_the_rate_and_other_messages_are_not() {
        let viewers = Viewers::new(100.0);
        let (client, outbox) = viewers.connect(&[]).expect("a place");
        let table = viewers.channel(info("/nets/line", "rcc/msg/Line"));
        let frames = viewers.channel(info("/tf", "tf2_msgs/msg/TFMessage"));
        assert!(
            viewers
                .subscribe(client, &[wish(1, table), wish(2, frames)])
                .is_empty()
        );
        taken(&outbox);
        for cycle in 0..1000_u64 {
            // Cycles are up to 0.2 ms early or late.
            let jitter = [0, 200_000, 100_000][cycle as usize % 3];
            let time_ns = 1_000_000_000 + cycle * 1_000_000 + jitter;
            viewers.send(table, time_ns, &[1], false);
            viewers.send(frames, time_ns, &[2], false);
        }
        let rows = taken(&outbox);
        let of = |id: u32| rows.iter().filter(|row| row[0] == id).count();
        assert!((99..=101).contains(&of(1)), "{}", of(1));
        assert_eq!(of(2), 1000);
    }

    #[test]
    fn who_comes_later_gets_what_is_kept_and_the_statuses_that_hold() {
        let viewers = Viewers::new(100.0);
        let text = viewers.channel(info("/robot_description", "std_msgs/msg/String"));
        viewers.send(text, 1, &[7], true);
        viewers.set_status("cell", "no executor");
        let (client, outbox) = viewers.connect(&[]).expect("a place");
        viewers.subscribe(client, &[wish(5, text)]);
        viewers.remove_status("cell");
        let rows = taken(&outbox);
        let ops: Vec<&Value> = rows.iter().filter_map(|row| row.get("op")).collect();
        assert_eq!(ops, ["status", "advertise", "removeStatus"]);
        assert_eq!(rows.last(), Some(&json!([5, 7])));
        viewers.disconnect(client);
        let (_, outbox) = viewers.connect(&[]).expect("a place");
        assert_eq!(taken(&outbox).len(), 1, "only the channels");
    }

    #[test]
    fn a_net_with_other_monitors_takes_the_topic_and_the_old_one_is_silent() {
        let viewers = Viewers::new(100.0);
        let (client, outbox) = viewers.connect(&[]).expect("a place");
        let first = viewers.channel(info("/nets/line", "rcc/msg/Line"));
        assert_eq!(viewers.channel(info("/nets/line", "rcc/msg/Line")), first);
        let second = viewers.channel(info("/nets/line", "rcc/msg/Other"));
        assert_ne!(first, second);
        assert_eq!(
            viewers.subscribe(client, &[wish(1, first)]),
            [wish(1, first)]
        );
        assert!(viewers.subscribe(client, &[wish(1, second)]).is_empty());
        assert_eq!(
            viewers.subscribe(client, &[wish(1, second)]).len(),
            1,
            "the id is taken"
        );
        viewers.send(first, 1, &[1], false);
        viewers.send(second, 1, &[2], false);
        let rows = taken(&outbox);
        let ops: Vec<&Value> = rows.iter().filter_map(|row| row.get("op")).collect();
        assert_eq!(ops, ["advertise", "advertise", "unadvertise", "advertise"]);
        assert_eq!(rows.last(), Some(&json!([1, 2])));
    }

    #[test]
    fn names_without_end_keep_a_bounded_number_of_channels() {
        let viewers = Viewers::new(100.0);
        let frames = viewers.channel(info("/tf", "tf2_msgs/msg/TFMessage"));
        for number in 0..3 * CHANNELS_MAX {
            let net = viewers.channel(info(&format!("/nets/n{number}"), "rcc/msg/N"));
            viewers.send(net, 1_000_000_000 + number as u64, &[1], false);
        }
        let state = viewers.lock();
        assert_eq!(state.channels.len(), CHANNELS_MAX);
        assert!(state.channels.contains_key(&(frames.index() as u32)));
        assert!(state.channels.contains_key(&(3 * CHANNELS_MAX as u32)));
    }

    #[test]
    fn there_are_places_for_a_bounded_number_of_viewers() {
        let viewers = Viewers::new(100.0);
        let all: Vec<_> = (0..=VIEWERS_MAX).map(|_| viewers.connect(&[])).collect();
        assert_eq!(all.iter().filter(|one| one.is_some()).count(), VIEWERS_MAX);
        viewers.disconnect(0);
        assert!(viewers.connect(&[]).is_some());
    }
}
