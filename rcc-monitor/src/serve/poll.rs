//! Asks the loader for the cell's state twice a second while a page is open, and sends what changed. Run by the serving
//! thread.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use rcc_api::bodies::ErrorBody;
use serde_json::{Map, Value, json};

use super::Server;
use super::devices;
use super::hub::{Hub, Update};
use super::loader::encoded;

/// Interval of the poll.
const EVERY: Duration = Duration::from_millis(500);
/// Number of events that a page gets when it is opened.
pub const EVENTS_MAX: usize = 500;
/// Fields of a net's row that a page does not show.
const LONG_FIELDS: [&str; 2] = ["diagnostics", "rehearsal"];

/// Polls until the server ends.
pub async fn run(server: Arc<Server>) {
    let mut poll = Poll::default();
    loop {
        if server.hub.is_viewed() {
            poll.turn(&server).await;
        }
        tokio::select! {
            () = tokio::time::sleep(EVERY) => {}
            () = server.hub.poll.notified() => {}
        }
    }
}

#[derive(Default)]
struct Poll {
    /// Position in the event log.
    next_event: Option<String>,
    executor: String,
}

impl Poll {
    async fn turn(&mut self, server: &Server) {
        let (status, rows, found) = tokio::join!(
            server.loader.get("/status"),
            server.loader.get("/commands"),
            server.loader.get("/devices")
        );
        let executor = status.as_ref().ok();
        let executor = executor.and_then(|status| status["executor"]["incarnation"].as_str());
        // While the loader or the executor is dead, its last known state is shown, marked as old.
        if let Some(executor) = executor.filter(|executor| *executor != self.executor) {
            self.executor = executor.to_owned();
            // Ids begin anew with each executor.
            server.hub.newest(|newest| newest.nets.clear());
            let none = nets_text(executor, [].iter(), [].iter());
            server.hub.send(Update::Shared("nets", none.into()));
        }
        self.cell(server, status, found).await;
        if let Ok(Value::Array(rows)) = rows {
            nets(&server.hub, &self.executor, &rows);
            server.follow_arms(&self.executor, &rows).await;
        }
        self.events(server).await;
    }

    async fn cell(
        &self,
        server: &Server,
        status: Result<Value, ErrorBody>,
        found: Result<Value, ErrorBody>,
    ) {
        let hub = &server.hub;
        let number = |value: &Value, name: &str| value["executor"][name].as_u64();
        if let Ok(status) = &status {
            if let Some(cycle) = number(status, "cycle") {
                hub.cycle.store(cycle, Ordering::Relaxed);
            }
            if let Some(period) = number(status, "period_ns").filter(|period| *period > 0) {
                hub.period_ns.store(period, Ordering::Relaxed);
            }
            if let Some(config) = status["config"].as_str() {
                server.read_configuration(config, &self.executor).await;
            }
        }
        let trouble = status.as_ref().err().or(found.as_ref().err()).cloned();
        let found = match found {
            Ok(rows) => devices::with_history(&server.cell, rows),
            Err(_) => Value::Null,
        };
        let message = json!({
            "cell": server.cell, "trouble": trouble, "status": status.ok(), "devices": found,
            "arms": server.arm_names(), "viewers_may_start": server.may_start,
        });
        let text: Arc<str> = message.to_string().into();
        let same =
            hub.newest(|newest| newest.cell.replace(Arc::clone(&text)).as_ref() == Some(&text));
        if !same {
            hub.send(Update::Shared("cell", text));
        }
    }

    async fn events(&mut self, server: &Server) {
        let path = match &self.next_event {
            None => format!("/events?limit={EVENTS_MAX}"),
            Some(next) => format!("/events?limit={EVENTS_MAX}&after={}", encoded(next)),
        };
        let page = match server.loader.get(&path).await {
            Ok(page) => page,
            Err(_) => return,
        };
        let anew = self.next_event.is_none() || page["continues"] == json!(false);
        self.next_event = page["next"].as_str().map(str::to_owned);
        let rows = page["events"].as_array().cloned().unwrap_or_default();
        if rows.is_empty() && !anew {
            return;
        }
        server.hub.newest(|newest| {
            if anew {
                newest.events.clear();
            }
            newest
                .events
                .extend(rows.iter().map(|row| row.to_string().into()));
            while newest.events.len() > EVENTS_MAX {
                newest.events.pop_front();
            }
        });
        let message = json!({"anew": anew, "events": rows});
        server
            .hub
            .send(Update::Shared("events", message.to_string().into()));
    }
}

/// Sends the rows of nets that changed, and the ids of all.
fn nets(hub: &Hub, executor: &str, rows: &[Value]) {
    let mut all = BTreeMap::new();
    for row in rows {
        let (Some(id), Some(fields)) = (row["id"].as_u64(), row.as_object()) else {
            continue;
        };
        all.insert(id, row_text(fields));
    }
    let changed = hub.newest(|newest| {
        let same_ids = newest.nets.keys().eq(all.keys());
        let is_new = |(id, text): &(&u64, &Arc<str>)| newest.nets.get(id) != Some(text);
        let changed: Vec<Arc<str>> = all
            .iter()
            .filter(is_new)
            .map(|(_, text)| Arc::clone(text))
            .collect();
        newest.nets = all;
        (!same_ids || !changed.is_empty())
            .then(|| nets_text(executor, newest.nets.keys(), changed.iter()))
    });
    if let Some(text) = changed {
        hub.send(Update::Shared("nets", text.into()));
    }
}

/// Returns the data of the event `nets`: the rows that changed, and all ids.
pub fn nets_text<'a>(
    executor: &str,
    ids: impl Iterator<Item = &'a u64>,
    rows: impl Iterator<Item = &'a Arc<str>>,
) -> String {
    let ids: Vec<String> = ids.map(u64::to_string).collect();
    let rows: Vec<&str> = rows.map(|row| &**row).collect();
    let executor = json!(executor);
    format!(
        "{{\"executor\":{executor},\"ids\":[{}],\"rows\":[{}]}}",
        ids.join(","),
        rows.join(",")
    )
}

/// Returns the row of a net without what the page does not show: with 200 nets it is sent twice a second.
fn row_text(fields: &Map<String, Value>) -> Arc<str> {
    let mut row = fields.clone();
    let rehearsed = row
        .get("rehearsal")
        .map(|rehearsal| rehearsal["words"].clone());
    let findings = row
        .get("diagnostics")
        .and_then(Value::as_array)
        .cloned()
        .unwrap_or_default();
    for name in LONG_FIELDS {
        row.remove(name);
    }
    row.retain(|_, value| !value.is_null() && *value != json!("") && *value != json!([]));
    if let Some(words) = rehearsed.filter(|words| !words.is_null()) {
        row.insert("rehearsed".to_owned(), words);
    }
    if let Some(first) = findings.first() {
        row.insert("finding".to_owned(), first["message"].clone());
    }
    Value::Object(row).to_string().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_rows_that_changed_are_sent_and_ids_tell_what_is_gone() {
        let hub = Arc::new(Hub::default());
        let Some((_viewer, mut updates)) = hub.connect() else {
            panic!("no room");
        };
        let mut sent = |rows: &[Value]| {
            nets(&hub, "e", rows);
            match updates.try_recv() {
                Ok(Update::Shared("nets", text)) => serde_json::from_str(&text).expect("JSON"),
                _ => Value::Null,
            }
        };
        let (one, two) = (
            json!({"id": 1, "state": "ready"}),
            json!({"id": 2, "state": "ready"}),
        );
        let first = sent(&[one.clone(), two.clone()]);
        assert_eq!(
            first,
            json!({"executor": "e", "ids": [1, 2], "rows": [one, two]})
        );
        assert_eq!(sent(&[one.clone(), two.clone()]), Value::Null);
        let running = json!({"id": 2, "state": "running"});
        assert_eq!(sent(&[one, running.clone()])["rows"], json!([running]));
        assert_eq!(sent(&[running])["ids"], json!([2]));
    }

    #[test]
    fn a_row_has_the_words_of_its_rehearsal_and_its_first_finding() {
        let row = json!({
            "id": 1, "reason": null, "uses": [], "rehearsal": {"words": "2 s", "peaks": []},
            "diagnostics": [{"message": "bad", "rendered": "long"}],
        });
        let text = row_text(row.as_object().expect("an object"));
        let row: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(row, json!({"id": 1, "rehearsed": "2 s", "finding": "bad"}));
    }
}
