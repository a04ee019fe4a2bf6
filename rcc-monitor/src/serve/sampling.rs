//! Has the loader sample the ports that pages want to see, over one stream for all pages. Run by the serving thread.

use std::sync::Arc;
use std::time::Duration;

use rcc_api::bodies::ErrorBody;
use serde_json::{Map, Value, json};

use super::Server;
use super::hub::{RATE_MAX, Update};
use super::loader::{EventStream, encoded};
use super::values::{Series, Source};

/// Changes within this time lead to one new stream.
const SETTLE: Duration = Duration::from_millis(60);
/// Pause before a stream that ended or was refused is opened again.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// Samples until the server ends.
pub async fn run(server: Arc<Server>) {
    let mut changes = server.hub.changes();
    loop {
        let wanted = server.hub.wanted();
        if wanted.ports.is_empty() {
            // An error would mean that the hub is gone.
            let _ = changes.changed().await;
            continue;
        }
        changes.mark_unchanged();
        let opened = match open(&server, &wanted.ports, wanted.rate).await {
            Ok(stream) => Some(stream),
            Err(_) => open_what_exists(&server, &wanted.ports, wanted.rate).await,
        };
        let is_open = opened.is_some();
        if let Some(stream) = opened {
            let ports = wanted.ports;
            tokio::select! {
                () = follow(&server, stream) => {}
                () = changed(&server, &mut changes, &ports, wanted.rate) => continue,
            }
        }
        // Ended by the loader or the executor, or no port exists yet.
        let pause = if is_open {
            RETRY_AFTER / 4
        } else {
            RETRY_AFTER
        };
        tokio::select! {
            () = tokio::time::sleep(pause) => {}
            _ = changes.changed() => {}
        }
    }
}

/// Waits until the wanted ports or the rate differ.
async fn changed(
    server: &Server,
    changes: &mut tokio::sync::watch::Receiver<u64>,
    ports: &[String],
    rate: f64,
) {
    loop {
        let _ = changes.changed().await;
        tokio::time::sleep(SETTLE).await;
        changes.mark_unchanged();
        let wanted = server.hub.wanted();
        if wanted.ports != ports || wanted.rate != rate {
            return;
        }
    }
}

async fn open(server: &Server, ports: &[String], rate: f64) -> Result<EventStream, ErrorBody> {
    let ports: Vec<String> = ports.iter().map(|port| encoded(port)).collect();
    let rate = rate.clamp(1.0, RATE_MAX);
    server
        .loader
        .open(&format!("/stream?ports={}&rate={rate}", ports.join(",")))
        .await
}

/// Opens a stream of those ports that exist, and tells the pages why the others do not.
async fn open_what_exists(server: &Server, ports: &[String], rate: f64) -> Option<EventStream> {
    let (mut good, mut refused) = (Vec::new(), Map::new());
    for port in ports {
        let (net, name) = port.split_once('/').unwrap_or((port, "*"));
        let path = format!("/commands/{}/values?ports={}", encoded(net), encoded(name));
        match server.loader.get(&path).await {
            Ok(_) => good.push(port.clone()),
            Err(error) => drop(refused.insert(port.clone(), json!(error.message))),
        }
    }
    let opened = match good.is_empty() {
        true => None,
        false => match open(server, &good, rate).await {
            Ok(stream) => Some(stream),
            // Too many nets or ports for one stream, for example.
            Err(error) => {
                refused.extend(good.into_iter().map(|port| (port, json!(error.message))));
                None
            }
        },
    };
    server.hub.send(Update::Shared(
        "refused",
        Value::Object(refused).to_string().into(),
    ));
    opened
}

/// Forwards a stream until the loader or the executor ends it. One that is complete is not opened again: all its
/// commands have ended.
async fn follow(server: &Server, stream: EventStream) {
    if forward(server, stream).await {
        std::future::pending::<()>().await;
    }
}

/// Forwards a stream to its end; returns true if it is complete.
async fn forward(server: &Server, mut stream: EventStream) -> bool {
    let mut described: Map<String, Value> = Map::new();
    while let Some((event, data)) = stream.next().await {
        let id = data["id"].as_u64().unwrap_or_default();
        let net = data["net"].as_str().unwrap_or_default();
        match event.as_str() {
            "ports" => {
                for port in data["ports"].as_array().into_iter().flatten() {
                    let name = port["port"].as_str().unwrap_or_default();
                    described.insert(format!("{id}/{name}"), port.clone());
                }
            }
            "values" => {
                let cycle = data["cycle"].as_u64().unwrap_or_default();
                for (port, value) in data["values"].as_object().into_iter().flatten() {
                    let about = described.get(&format!("{id}/{port}"));
                    let of = |name: &str| {
                        about
                            .and_then(|about| about[name].as_str())
                            .map(str::to_owned)
                    };
                    let series = Series {
                        id,
                        net: net.to_owned(),
                        port: port.clone(),
                        ty: of("type").unwrap_or_default(),
                        unit: of("unit"),
                        source: Source::Sample,
                    };
                    server.hub.collector.add(&series, cycle, value.clone());
                }
            }
            "lost" => {
                let lost = json!({"samples": data["samples"]});
                server
                    .hub
                    .send(Update::Shared("lost", lost.to_string().into()));
            }
            "end" => return true,
            _ => {}
        }
    }
    false
}
