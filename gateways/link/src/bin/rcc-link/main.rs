//! `rcc-link`: the gateway between cells, and what people ask over it. The main thread publishes or asks; one waits for
//! signals, the others are in `gateways/link/src/gateway.rs`.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Args, Parser, Subcommand};
use rcc_config::CellConfig;
use rcc_config::link::{TlsFiles, is_cell_key, is_endpoint};
use rcc_link::fleet::{self, CellMessage, FleetError, FoundCell};
use rcc_link::gateway::{self, GatewayError, GatewayOptions};
use rcc_link::keys::{CellKeys, Operation, is_topic};
use rcc_process::Stop;
use rcc_process::oom::{SCORE_OBSERVER, raise_score};

/// Cells on several hosts: carries topics, events and states of a cell, and lists and asks other cells.
#[derive(Parser)]
#[command(name = "rcc-link", version = rcc_protocol::version::version())]
struct Arguments {
    /// Name of the cell that is carried [default: the one in its configuration]
    #[arg(long, env = "RCC_CELL")]
    cell: Option<String>,
    #[command(subcommand)]
    what: LinkCommand,
}

#[derive(Subcommand)]
enum LinkCommand {
    /// Carry topics, events and states of a cell to other hosts, and their START and CANCEL to it, as its `link:` says
    Serve {
        /// Configuration of the cell, which has a `link:`; the cell need not run yet
        #[arg(long, env = "RCC_CONFIG", value_name = "FILE")]
        config: PathBuf,
        /// End with the process that started this one
        #[arg(long)]
        parent_death: bool,
    },
    /// List the cells that can be reached
    Cells {
        #[command(flatten)]
        reach: Reach,
        /// Only those of this site
        #[arg(long, default_value = "*")]
        site: String,
    },
    /// Follow the events of all cells, and the states of their nets, until interrupted
    Events {
        #[command(flatten)]
        reach: Reach,
        /// Only those of this site
        #[arg(long, default_value = "*")]
        site: String,
    },
    /// Follow topics of a cell, until interrupted
    Tail {
        #[command(flatten)]
        reach: Reach,
        /// Cell whose topics these are
        #[arg(value_name = "SITE/CELL", value_parser = cell_key)]
        cell: String,
        /// Topic; `*` stands for one part of a name, `**` for all
        #[arg(default_value = "**", value_parser = topic)]
        topic: String,
    },
    /// Start a net of another cell, if that cell's `link: start` allows it
    Start(Ask),
    /// Cancel a net of another cell
    Cancel(Ask),
}

#[derive(Args)]
struct Reach {
    /// Endpoint of an rcc-link or a router, such as tcp/192.168.0.7:7447
    #[arg(long, value_name = "ENDPOINT", required = true, value_parser = endpoint)]
    connect: Vec<String>,
    #[command(flatten)]
    tls: Tls,
}

/// Files (PEM) for endpoints `tls/…`: all three, or none.
#[derive(Args)]
struct Tls {
    /// Certificate of the authority that signed those of all cells
    #[arg(long, value_name = "FILE", requires_all = ["certificate", "key"])]
    authority: Option<PathBuf>,
    /// Own certificate; its common name is SITE/CELL, or that of a person
    #[arg(long, value_name = "FILE", requires_all = ["authority", "key"])]
    certificate: Option<PathBuf>,
    /// Its private key
    #[arg(long, value_name = "FILE", requires_all = ["authority", "certificate"])]
    key: Option<PathBuf>,
}

impl Reach {
    fn session(&self) -> Result<zenoh::Session, FleetError> {
        let Tls {
            authority,
            certificate,
            key,
        } = &self.tls;
        let files = match (authority, certificate, key) {
            (Some(authority), Some(certificate), Some(key)) => Some(TlsFiles {
                authority: authority.clone(),
                certificate: certificate.clone(),
                key: key.clone(),
            }),
            _ => None,
        };
        fleet::connect(&self.connect, files.as_ref())
    }
}

#[derive(Args)]
struct Ask {
    #[command(flatten)]
    reach: Reach,
    /// Cell that asks
    #[arg(long = "as", value_name = "SITE/CELL", value_parser = cell_key)]
    peer: String,
    /// Cell that is asked
    #[arg(value_name = "SITE/CELL", value_parser = cell_key)]
    cell: String,
    /// Name of the net
    net: String,
}

fn endpoint(text: &str) -> Result<String, String> {
    match is_endpoint(text) {
        true => Ok(text.to_owned()),
        false => Err(
            "write protocol, host and port: tcp/192.168.0.7:7447 or tls/192.168.0.7:7447"
                .to_owned(),
        ),
    }
}

fn topic(text: &str) -> Result<String, String> {
    match is_topic(&text.replace('*', "x")) {
        true => Ok(text.to_owned()),
        false => Err("write the name of a topic, such as door/open, door/* or **".to_owned()),
    }
}

fn cell_key(text: &str) -> Result<String, String> {
    match is_cell_key(text) {
        true => Ok(text.to_owned()),
        false => Err("write site and cell: lab/press".to_owned()),
    }
}

/// The reason why nothing is carried.
#[derive(Debug, thiserror::Error)]
enum LinkError {
    #[error("{0}")]
    Config(rcc_config::diagnostic::Faults),
    #[error("{0} has no `link:`: add `link: {{site: SITE, listen: [\"tcp/ADDRESS:7447\"]}}`")]
    NoLink(String),
    #[error("{0}: `link` has neither `listen` nor `connect`, so nobody can be reached")]
    Nobody(String),
    #[error("cannot start: {0}")]
    Signals(#[from] rcc_process::signals::SignalError),
    #[error("cannot start: {0}")]
    System(#[from] std::io::Error),
    #[error(transparent)]
    Gateway(#[from] GatewayError),
    #[error(transparent)]
    Fleet(#[from] FleetError),
}

fn main() -> ExitCode {
    rcc_process::log();
    match run(Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            rcc_process::remark(&format!("rcc-link: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn run(Arguments { cell, what }: Arguments) -> Result<(), LinkError> {
    match what {
        LinkCommand::Serve {
            config,
            parent_death,
        } => serve(cell, &config, parent_death),
        LinkCommand::Cells { reach, site } => {
            let session = reach.session()?;
            for (name, cell) in fleet::cells(&session, &site)? {
                rcc_process::say(&row(&name, &cell));
            }
            Ok(())
        }
        LinkCommand::Events { reach, site } => {
            let all = CellKeys::new(&site, "*");
            let session = reach.session()?;
            Ok(fleet::follow(
                &session,
                &[all.events(), all.nets()],
                |it| print(&event(&it)),
            )?)
        }
        LinkCommand::Tail { reach, cell, topic } => {
            let keys = [CellKeys::of(&cell).topics(&topic)];
            Ok(fleet::follow(&reach.session()?, &keys, |it| {
                print(&value(&it))
            })?)
        }
        LinkCommand::Start(ask) => operate(&ask, Operation::Start),
        LinkCommand::Cancel(ask) => operate(&ask, Operation::Cancel),
    }
}

fn operate(ask: &Ask, operation: Operation) -> Result<(), LinkError> {
    let session = ask.reach.session()?;
    let answer = fleet::ask(&session, (&ask.peer, &ask.cell), operation, &ask.net)?;
    rcc_process::say(&format!(
        "{}  {} in cycle {}",
        ask.cell,
        operation.name(),
        answer["cycle"]
    ));
    Ok(())
}

/// Writes a line; false if nobody reads any more.
fn print(line: &str) -> bool {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).is_ok()
}

/// Returns the line of an event, or of a net's new state.
fn event(CellMessage { cell, name, body }: &CellMessage) -> String {
    match body["words"].as_str().filter(|_| body["kind"].is_string()) {
        Some(words) => {
            let text = |key: &str| body[key].as_str().unwrap_or("–").to_owned();
            format!("{cell}  {}  {}  {words}", text("time"), text("severity"))
        }
        None => format!("{cell}  net {name}#{} is {}", body["id"], body["state"]),
    }
}

/// Returns the line of a topic's value.
fn value(CellMessage { cell, name, body }: &CellMessage) -> String {
    let unit = body["unit"].as_str().map(|unit| format!(" {unit}"));
    let age_ms = body["age_ns"].as_u64().unwrap_or(0) as f64 * 1e-6;
    let unit = unit.unwrap_or_default();
    format!(
        "{cell}  {name}  {}{unit}  age {age_ms:.1} ms",
        body["value"]
    )
}

/// Returns the line of a cell.
fn row(name: &str, cell: &FoundCell) -> String {
    let alive = if cell.is_alive {
        "alive"
    } else {
        "no executor"
    };
    match &cell.status {
        None => format!("{name}  {alive}  no status"),
        Some(status) => {
            let executor = &status["executor"];
            format!(
                "{name}  {alive}  cycle {}  late {}",
                executor["cycle"], executor["late"]
            )
        }
    }
}

fn serve(cell: Option<String>, file: &Path, parent_death: bool) -> Result<(), LinkError> {
    // If memory runs out, the kernel should first end processes that only observe.
    let _ = raise_score(SCORE_OBSERVER);
    // Before the first thread, which inherits the mask.
    let signals = Stop::prepare(parent_death)?;
    let config = CellConfig::load_offline(file).map_err(LinkError::Config)?;
    let file = file.display().to_string();
    let link = config.link.ok_or_else(|| LinkError::NoLink(file.clone()))?;
    if link.listen.is_empty() && link.connect.is_empty() {
        return Err(LinkError::Nobody(file));
    }
    let stop = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&stop);
    rcc_process::helpers::thread("signals", move || {
        let signal = signals.wait();
        tracing::info!(%signal, "ends");
        // Release pairs with the acquire of the other threads.
        told.store(true, Ordering::Release);
    })?;
    let options = GatewayOptions {
        cell: cell.unwrap_or(config.name),
        link,
    };
    Ok(gateway::run(&options, &stop)?)
}
