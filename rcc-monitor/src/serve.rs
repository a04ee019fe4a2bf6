//! `serve`: a dashboard for browsers. A process of its own that reads what monitors read and is a client of the loader, so
//! that it can do no harm: killed, hanging or overloaded, it delays neither cycle nor loader. One thread serves, one reads
//! records while a page wants them, blocking threads draw nets and replay incidents.

use std::io::{self, Write};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rcc_api::bodies::ErrorBody;
use rcc_api::token::{Token, TokenError};
use rcc_config::CellConfig;
use rcc_language::structure::NetStructure;
use serde_json::{Value, json};
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

use self::access::Access;
use self::arms::{ArmModel, Arms};
use self::drawings::Drawings;
use self::hub::{Hub, Update};
use self::loader::LoaderPeer;
use self::locked::locked;
use self::metrics::ScrapeState;
use crate::signals::Signals;

mod access;
mod answers;
mod arms;
mod assets;
mod devices;
mod drawings;
mod hub;
mod incidents;
mod loader;
mod locked;
mod metrics;
mod poll;
mod records;
mod routes;
mod sampling;
mod triggers;
mod values;
mod viewer;

/// Interval at which values are sent.
const BATCH_EVERY: Duration = Duration::from_millis(40);
/// Polling interval for signals.
const SIGNALS_EVERY: Duration = Duration::from_millis(100);
/// Port without `--port`; the next free one is taken if it is in use.
pub const PORT: u16 = 7426;

/// Options of the dashboard.
#[derive(Clone, Debug)]
pub struct ServeOptions {
    /// Name of the cell.
    pub cell: String,
    /// TCP port on 127.0.0.1; 0 for any free one, `None` for [`PORT`] or else any free one.
    pub port: Option<u16>,
    /// Pages may start nets, after a confirmation.
    pub may_start: bool,
    /// File with the token that readers of `/metrics` must send.
    pub metrics_token: Option<PathBuf>,
    /// `/metrics` needs no token.
    pub metrics_open: bool,
}

/// The reason why nothing is served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The port is in use, or the system refuses it.
    #[error("cannot listen on {0}: {1}; choose another port with --port")]
    Listen(SocketAddr, io::Error),
    /// The token for `/metrics` cannot be used.
    #[error("--metrics-token: {0}")]
    Token(#[from] TokenError),
    /// The system refuses random bits, an event queue or a thread.
    #[error("cannot start: {0}")]
    System(#[from] io::Error),
}

/// The server's state.
#[derive(Debug)]
struct Server {
    cell: String,
    may_start: bool,
    loader: LoaderPeer,
    hub: Arc<Hub>,
    drawings: Arc<Drawings>,
    /// The configuration, and the path and executor that it belongs to.
    configuration: Mutex<Option<(String, Arc<CellConfig>)>>,
    compiling: Semaphore,
    replays: Semaphore,
    scrapes: ScrapeState,
}

/// Serves until a signal arrives, and returns its number. The address, with the token, is printed as one line.
///
/// # Errors
/// Returns an error if the port cannot be used or the system refuses a thread.
pub fn serve(
    options: &ServeOptions,
    signals: &mut Signals,
    out: &mut impl Write,
) -> Result<i32, ServeError> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let hub = Arc::new(Hub::default());
    let records = records::start(&options.cell, Arc::clone(&hub))?;
    let ended = runtime.block_on(run(options, &hub, signals, out));
    hub.ends.store(true, Ordering::Release);
    hub.touch();
    // Shared memory is given back before the process ends. An error means that the thread panicked, and said so.
    let _ = records.join();
    // A replay may take seconds; nobody waits for it any more.
    runtime.shutdown_background();
    ended
}

async fn run(
    options: &ServeOptions,
    hub: &Arc<Hub>,
    signals: &mut Signals,
    out: &mut impl Write,
) -> Result<i32, ServeError> {
    let scraper = match &options.metrics_token {
        Some(path) => Some(Token::read(path)?),
        None => None,
    };
    let listener = listen(options.port).await?;
    let port = listener.local_addr()?.port();
    let access = Access::new(Token::random()?, port).for_scrapers(scraper, options.metrics_open);
    let access = Arc::new(access);
    let server = Arc::new(Server {
        cell: options.cell.clone(),
        may_start: options.may_start,
        loader: LoaderPeer::new(&options.cell),
        hub: Arc::clone(hub),
        drawings: Arc::default(),
        configuration: Mutex::default(),
        compiling: Semaphore::new(1),
        replays: Semaphore::new(1),
        scrapes: ScrapeState::default(),
    });
    tokio::spawn(poll::run(Arc::clone(&server)));
    tokio::spawn(sampling::run(Arc::clone(&server)));
    tokio::spawn(batches(Arc::clone(&server)));
    let router = routes::router(server, Arc::clone(&access));
    tokio::spawn(async move { axum::serve(listener, router).await });
    // A reader that is gone does not end the server.
    let _ = writeln!(out, "{}", access.address()).and_then(|()| out.flush());
    loop {
        if let Some(signal) = signals.pending() {
            return Ok(signal);
        }
        tokio::time::sleep(SIGNALS_EVERY).await;
    }
}

async fn listen(port: Option<u16>) -> Result<TcpListener, ServeError> {
    let at = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
    let wanted = at(port.unwrap_or(PORT));
    match TcpListener::bind(wanted).await {
        Ok(listener) => Ok(listener),
        Err(_) if port.is_none() => {
            let free = TcpListener::bind(at(0)).await;
            free.map_err(|error| ServeError::Listen(at(0), error))
        }
        Err(error) => Err(ServeError::Listen(wanted, error)),
    }
}

/// Sends gathered values in batches.
async fn batches(server: Arc<Server>) {
    loop {
        tokio::time::sleep(BATCH_EVERY).await;
        let (columns, lost) = server.hub.collector.take();
        if lost > 0 {
            server.hub.send(Update::Shared(
                "lost",
                json!({"values": lost}).to_string().into(),
            ));
        }
        if columns.is_empty() {
            continue;
        }
        let newest = columns
            .iter()
            .filter_map(|column| column.cycles.last())
            .max();
        server
            .hub
            .cycle
            .fetch_max(newest.copied().unwrap_or(0), Ordering::Relaxed);
        let placed = locked(&server.hub.arms).placed(&columns);
        server.hub.send(Update::Values(Arc::new(columns)));
        server.send_arms(placed);
    }
}

impl Server {
    fn send_arms(&self, placed: Vec<Value>) {
        if !placed.is_empty() {
            self.hub.send(Update::Shared(
                "arms",
                json!({"arms": placed}).to_string().into(),
            ));
        }
    }

    /// Reads the cell's configuration, once for each executor.
    async fn read_configuration(&self, path: &str, executor: &str) {
        let place = format!("{executor} {path}");
        if locked(&self.configuration)
            .as_ref()
            .is_some_and(|(known, _)| *known == place)
        {
            return;
        }
        let path = path.to_owned();
        let read =
            tokio::task::spawn_blocking(move || drawings::configuration(Path::new(&path))).await;
        let Ok(Ok(config)) = read else {
            return;
        };
        let models = config.devices.iter().filter_map(ArmModel::of).collect();
        *locked(&self.hub.arms) = Arms {
            models,
            ports: Vec::new(),
        };
        *locked(&self.configuration) = Some((place, Arc::new(config)));
    }

    /// Returns names, joints and ranges of the arms, for the page.
    fn arm_names(&self) -> Value {
        let arms = locked(&self.hub.arms);
        let rows = arms.models.iter().map(|arm| {
            json!({"device": arm.device, "robot": arm.robot, "joints": arm.joints, "ranges": arm.ranges, "linear": arm.linear})
        });
        rows.collect()
    }

    /// Finds the ports of running nets that show the arms, while a page shows them; arms without any are shown as their
    /// drivers tell.
    async fn follow_arms(&self, executor: &str, rows: &[Value]) {
        if !self.hub.wanted().arms {
            return;
        }
        let arms = locked(&self.hub.arms).clone();
        let mut ports = Vec::new();
        for row in rows {
            let (Some(id), Some(net)) = (row["id"].as_u64(), row["net"].as_str()) else {
                continue;
            };
            if !matches!(row["state"].as_str(), Some("running" | "canceling")) {
                continue;
            }
            let is_shown = |arm: usize| ports.iter().any(|port: &arms::ArmPort| port.arm == arm);
            if (0..arms.models.len()).all(is_shown) {
                break;
            }
            let uses = |arm: &ArmModel| {
                row["uses"]
                    .as_array()
                    .is_some_and(|uses| uses.contains(&json!(arm.device)))
            };
            let used =
                (0..arms.models.len()).filter(|arm| !is_shown(*arm) && uses(&arms.models[*arm]));
            let used: Vec<usize> = used.collect();
            if used.is_empty() {
                continue;
            }
            let Ok(structure) = self.structure_of(executor, id).await else {
                continue;
            };
            ports.extend(
                used.into_iter()
                    .filter_map(|arm| arms.port_of(arm, (id, net), &structure)),
            );
        }
        let changed = {
            let mut arms = locked(&self.hub.arms);
            let changed = arms.ports != ports;
            arms.ports = ports;
            changed
        };
        if changed {
            self.hub.touch();
        }
        let cell = self.cell.clone();
        let arms = locked(&self.hub.arms).clone();
        self.send_arms(arms.told_by_drivers(&cell));
    }

    /// Returns the structure of a loaded net of the present executor.
    async fn structure(&self, id: u64) -> Result<Arc<NetStructure>, ErrorBody> {
        let status = self.loader.get("/status").await?;
        let executor = status["executor"]["incarnation"]
            .as_str()
            .unwrap_or_default();
        self.read_configuration(status["config"].as_str().unwrap_or_default(), executor)
            .await;
        self.structure_of(executor, id).await
    }

    async fn structure_of(&self, executor: &str, id: u64) -> Result<Arc<NetStructure>, ErrorBody> {
        // The semaphore is never closed.
        let _turn = self.compiling.acquire().await;
        if let Some(known) = self.drawings.known(executor, id) {
            return Ok(known);
        }
        let row = self.loader.get(&format!("/commands/{id}")).await?;
        let of = |name: &str| row[name].as_str().unwrap_or_default().to_owned();
        let (net, text) = (of("net"), of("text"));
        let config = locked(&self.configuration)
            .as_ref()
            .map(|(_, config)| Arc::clone(config));
        let config = config.ok_or_else(|| ErrorBody {
            message: "the cell's configuration cannot be read, so nothing can be drawn".to_owned(),
            help: Some("`rcc-cli check` shows its faults".to_owned()),
            ..ErrorBody::default()
        })?;
        let (drawings, executor) = (Arc::clone(&self.drawings), executor.to_owned());
        let compiled = tokio::task::spawn_blocking(move || {
            drawings.compile((&executor, id), (&net, &text), &config)
        });
        compiled.await.unwrap_or_else(|error| {
            Err(ErrorBody {
                message: error.to_string(),
                ..ErrorBody::default()
            })
        })
    }
}
