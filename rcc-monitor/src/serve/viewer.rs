//! The stream of one page: server-sent events, as fast as the page takes them. A task of the serving thread for each page.

use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use hyper::body::Frame;
use rcc_protocol::pattern::Pattern;
use serde_json::{Value, json};
use tokio::sync::{broadcast, mpsc};

use super::Server;
use super::hub::{Update, Viewer, Watch};
use super::values::Column;

/// Number of pieces that a page has not taken, besides those in the kernel.
const PIECES_MAX: usize = 4;
/// Interval of a sign of life.
const ALIVE_EVERY: Duration = Duration::from_secs(5);
/// A page that takes nothing for this time is disconnected; its browser connects again when it is shown.
const TAKES_NOTHING_MAX: Duration = Duration::from_secs(30);

/// Answers with the stream of a new page. `last_cycle` is the newest cycle that it saw before its connection broke.
pub fn answer(
    server: Arc<Server>,
    viewer: Viewer,
    updates: broadcast::Receiver<Update>,
    last_cycle: Option<u64>,
) -> Response {
    let (pieces, taken) = mpsc::channel(PIECES_MAX);
    let page = Page {
        filter: Filter::default(),
        server,
        viewer,
        pieces,
    };
    tokio::spawn(page.run(updates, last_cycle));
    let headers = [
        (header::CONTENT_TYPE, "text/event-stream"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    (headers, Body::new(PageBody { taken })).into_response()
}

struct PageBody {
    taken: mpsc::Receiver<Bytes>,
}

impl hyper::body::Body for PageBody {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        let piece = self.taken.poll_recv(context);
        piece.map(|piece| piece.map(|bytes| Ok(Frame::data(bytes))))
    }
}

/// The page is gone or takes nothing.
struct PageClosed;

struct Page {
    filter: Filter,
    server: Arc<Server>,
    viewer: Viewer,
    pieces: mpsc::Sender<Bytes>,
}

impl Page {
    async fn run(mut self, mut updates: broadcast::Receiver<Update>, last_cycle: Option<u64>) {
        let hello = json!({
            "viewer": self.viewer.id, "cell": self.server.cell, "version": rcc_protocol::version::version(),
            "may_start": self.server.may_start, "last_cycle": last_cycle,
        });
        if self.send("hello", &hello.to_string()).await.is_err() || self.everything().await.is_err()
        {
            return;
        }
        loop {
            let sent = tokio::select! {
                update = updates.recv() => match update {
                    Ok(update) => self.forward(update).await,
                    Err(broadcast::error::RecvError::Lagged(lost)) => self.after_loss(lost).await,
                    Err(broadcast::error::RecvError::Closed) => return,
                },
                () = tokio::time::sleep(ALIVE_EVERY) => self.piece(": alive\n\n".to_owned()).await,
                () = self.pieces.closed() => return,
            };
            if sent.is_err() {
                return;
            }
        }
    }

    async fn forward(&mut self, update: Update) -> Result<(), PageClosed> {
        match update {
            Update::Shared(event, data) => self.send(event, &data).await,
            Update::Values(columns) => {
                let watch = self.server.hub.watch_of(self.viewer.id);
                let period_ns = self.server.hub.period_ns.load(Ordering::Relaxed);
                match self.filter.chosen(&watch, &columns, period_ns) {
                    Some(data) => self.send("values", &data).await,
                    None => Ok(()),
                }
            }
        }
    }

    /// Sends the number of lost updates, and the newest state instead of them.
    async fn after_loss(&mut self, lost: u64) -> Result<(), PageClosed> {
        self.send("lost", &json!({"updates": lost}).to_string())
            .await?;
        self.everything().await
    }

    /// Sends the newest state.
    async fn everything(&mut self) -> Result<(), PageClosed> {
        let (cell, nets, events) = self.server.hub.newest(|newest| {
            let nets = super::poll::nets_text("", newest.nets.keys(), newest.nets.values());
            let events: Vec<&str> = newest.events.iter().map(|event| &**event).collect();
            let events = format!("{{\"anew\":true,\"events\":[{}]}}", events.join(","));
            (newest.cell.clone(), nets, events)
        });
        if let Some(cell) = cell {
            self.send("cell", &cell).await?;
        }
        self.send("nets", &nets).await?;
        self.send("events", &events).await
    }

    async fn send(&mut self, event: &str, data: &str) -> Result<(), PageClosed> {
        let cycle = self.server.hub.cycle.load(Ordering::Relaxed);
        self.piece(format!("id: {cycle}\nevent: {event}\ndata: {data}\n\n"))
            .await
    }

    async fn piece(&mut self, piece: String) -> Result<(), PageClosed> {
        let sent = tokio::time::timeout(TAKES_NOTHING_MAX, self.pieces.send(piece.into())).await;
        match sent {
            Ok(Ok(())) => Ok(()),
            _ => Err(PageClosed),
        }
    }
}

/// The values of one page: those that it watches, at most at its rate, each port described once.
#[derive(Default)]
struct Filter {
    watch: Watch,
    patterns: Vec<Pattern>,
    /// Newest cycle sent of each port, by command and port.
    sent: std::collections::HashMap<(u64, String), u64>,
}

impl Filter {
    fn chosen(&mut self, watch: &Watch, columns: &[Column], period_ns: u64) -> Option<String> {
        if self.watch != *watch {
            self.patterns = watch
                .ports
                .iter()
                .filter_map(|port| port.parse().ok())
                .collect();
            self.watch = watch.clone();
            self.sent.clear();
        }
        // Samples come with jitter: one that is a little early is not left out.
        let spacing = (0.75e9 / (watch.rate.max(0.1) * period_ns.max(1) as f64)).round() as u64;
        let (mut series, mut data) = (Vec::new(), Vec::new());
        for column in columns {
            if !self
                .patterns
                .iter()
                .any(|pattern| column.series.is_meant_by(pattern))
            {
                continue;
            }
            let place = (column.series.id, column.series.port.clone());
            let mut newest = self.sent.get(&place).copied();
            if newest.is_none() {
                series.push(column.series.described());
            }
            let (mut cycles, mut values) = (Vec::new(), Vec::new());
            for (cycle, value) in column.cycles.iter().zip(&column.values) {
                if newest.is_none_or(|newest| *cycle >= newest + spacing.max(1)) {
                    newest = Some(*cycle);
                    cycles.push(*cycle);
                    values.push(value);
                }
            }
            if let (Some(newest), false) = (newest, cycles.is_empty()) {
                self.sent.insert(place, newest);
                data.push(json!({"key": column.series.key(), "c": cycles, "v": values}));
            }
        }
        let empty = data.is_empty() && series.is_empty();
        (!empty).then(|| {
            Value::from_iter([("series", json!(series)), ("data", json!(data))]).to_string()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::values::{Series, Source};

    fn column(port: &str, cycles: &[u64]) -> Column {
        let series = Series {
            id: 1,
            net: "line".into(),
            port: port.into(),
            ty: "Real".into(),
            unit: Some("m".into()),
            source: Source::Monitor,
        };
        Column {
            series,
            cycles: cycles.to_vec(),
            values: cycles.iter().map(|cycle| json!(cycle)).collect(),
        }
    }

    #[test]
    fn a_page_gets_its_ports_at_its_rate_and_each_description_once() {
        let mut filter = Filter::default();
        let watch = Watch {
            ports: vec!["line/a.*".into()],
            rate: 100.0,
            arms: false,
        };
        let columns = [column("a.out", &[1, 2, 11, 12, 21]), column("b.out", &[1])];
        let mut chosen = || -> Value {
            let text = filter.chosen(&watch, &columns, 1_000_000);
            text.map_or(Value::Null, |text| {
                serde_json::from_str(&text).expect("JSON")
            })
        };
        let first = chosen();
        assert_eq!(first["series"][0]["key"], "line#1/a.out");
        assert_eq!(
            first["data"],
            json!([{"key": "line#1/a.out", "c": [1, 11, 21], "v": [1, 11, 21]}])
        );
        // The same cycles are never sent twice.
        assert_eq!(chosen(), Value::Null);
    }
}
