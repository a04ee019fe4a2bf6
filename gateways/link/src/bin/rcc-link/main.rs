//! `rcc-link`: the gateway between cells, and what people ask over it. The main thread publishes or asks; one waits for
//! signals, the others are in `gateways/link/src/gateway.rs`.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Args, Parser, Subcommand};
use rcc_api::findings::{FindingLevel, LinkFinding};
use rcc_config::CellConfig;
use rcc_config::link::is_cell_key;
use rcc_core::printable::Printable;
use rcc_link::certificate::CertificateError;
use rcc_link::deploy::DeployError;
use rcc_link::doctor;
use rcc_link::fleet::{self, CellMessage, CellRequest, FleetError, FoundCell};
use rcc_link::gateway::{self, GatewayError, GatewayOptions};
use rcc_link::keys::{CellKeys, Operation, is_topic};
use rcc_link::session::has_port;
use rcc_os::wall;
use rcc_process::Stop;
use rcc_process::arguments::PortArguments;
use rcc_process::oom::{SCORE_OBSERVER, raise_score};
use serde_json::json;

use reach::Reach;

mod deployment;
mod reach;
mod top;

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
        #[command(flatten)]
        file: CellFile,
        /// End with the process that started this one
        #[arg(long)]
        parent_death: bool,
    },
    /// List the cells that can be reached
    Cells {
        #[command(flatten)]
        reach: Reach,
        /// Only those of this site
        #[arg(long, default_value = "*", value_parser = site)]
        site: String,
    },
    /// Show all cells, first those that need a person; live in a terminal, or once as text
    Top {
        #[command(flatten)]
        reach: Reach,
        /// Only those of this site
        #[arg(long, default_value = "*", value_parser = site)]
        site: String,
        /// Print once as text; implied without a terminal
        #[arg(long)]
        once: bool,
    },
    /// Follow the events of all cells, and the states of their nets, until interrupted
    Events {
        #[command(flatten)]
        reach: Reach,
        /// Only those of this site
        #[arg(long, default_value = "*", value_parser = site)]
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
    /// List what cells let their peers do, besides reading and CANCEL
    Rights {
        #[command(flatten)]
        reach: Reach,
        /// Only those of this site
        #[arg(long, default_value = "*", value_parser = site)]
        site: String,
    },
    /// Verify the link of a cell and its link devices: certificates, names, addresses, and who answers at each endpoint. Nothing
    /// is changed; fails if something cannot work
    Doctor {
        #[command(flatten)]
        file: CellFile,
        /// Print the findings as JSON
        #[arg(long)]
        json: bool,
    },
    /// Give nets and configuration files to cells: every cell checks them, and only if all would take them, each gets them in
    /// turn. Nothing is started; a configuration holds from the cell's next start
    Deploy(deployment::Deploy),
    /// Unload nets that were deployed and do not run
    Withdraw {
        #[command(flatten)]
        reach: Reach,
        /// Nets, as `deploy` has named them
        #[arg(value_name = "SITE/CELL/NET#ID", required = true, value_parser = deployment::loaded_net)]
        nets: Vec<(String, String)>,
    },
}

/// A cell's file.
#[derive(Args)]
struct CellFile {
    /// Configuration of the cell; the cell need not run
    #[arg(long, env = "RCC_CONFIG", value_name = "FILE")]
    config: PathBuf,
    #[command(flatten)]
    ports: PortArguments,
}

impl CellFile {
    /// Reads the configuration; automatic ports are 0 if no numbers are given.
    fn load(&self) -> Result<CellConfig, LinkError> {
        let ports = self.ports.chosen();
        let config = match ports.is_empty() {
            true => CellConfig::load_offline(&self.config),
            false => CellConfig::load(&self.config, &ports),
        };
        config.map_err(LinkError::Config)
    }

    fn name(&self) -> String {
        self.config.display().to_string()
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

fn topic(text: &str) -> Result<String, String> {
    match is_topic(&text.replace('*', "x")) {
        true => Ok(text.to_owned()),
        false => Err("write the name of a topic, such as door/open, door/* or **".to_owned()),
    }
}

fn site(text: &str) -> Result<String, String> {
    match text == "*" || is_cell_key(&format!("{text}/cell")) {
        true => Ok(text.to_owned()),
        false => Err("write the name of a site, such as lab, or * for all".to_owned()),
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
    #[error(
        "{0}: `link` has neither `listen` nor `connect` nor `router`, so nobody can be reached"
    )]
    Nobody(String),
    #[error("cannot start: {0}")]
    Signals(#[from] rcc_process::signals::SignalError),
    #[error("cannot start: {0}")]
    System(#[from] std::io::Error),
    #[error(transparent)]
    Gateway(#[from] GatewayError),
    #[error(transparent)]
    Fleet(#[from] FleetError),
    #[error(
        "cells take texts of named certificates only: give --authority, --certificate and --key"
    )]
    NoCertificate,
    #[error(
        "the certificate's common name is `{0}`: write SITE/NAME, such as lab/office, as its subject's CN"
    )]
    NoPeer(String),
    #[error(transparent)]
    Certificate(#[from] CertificateError),
    #[error(transparent)]
    Deploy(#[from] DeployError),
    #[error("{0} of the nets are still there")]
    NotWithdrawn(usize),
    #[error("no cell of the site `{0}` answers: `rcc-link top` lists those that are there")]
    NoCell(String),
    #[error("{0} has neither `link:` nor a device of rcc-link-device: there is nothing to verify")]
    NothingToVerify(String),
    #[error("the link does not work as it is written: {0} to mend")]
    Faults(usize),
}

fn main() -> ExitCode {
    rcc_process::begin();
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
        LinkCommand::Serve { file, parent_death } => serve(cell, &file, parent_death),
        LinkCommand::Cells { reach, site } => {
            let session = reach.session()?;
            let cells = fleet::cells(&session, &site)?;
            if cells.is_empty() {
                rcc_process::remark(&format!(
                    "no cell of the site `{site}` has an executor or tells its status; `rcc-link top` lists those without, too"
                ));
            }
            for (name, cell) in cells {
                rcc_process::say(&row(&name, &cell));
            }
            Ok(())
        }
        LinkCommand::Top { reach, site, once } => top::top(&reach, &site, once),
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
        LinkCommand::Rights { reach, site } => {
            let all = fleet::rights(&reach.session()?, &format!("{site}/*"))?;
            if all.is_empty() {
                return Err(LinkError::NoCell(site));
            }
            for (cell, rights) in all {
                for line in rights.lines() {
                    rcc_process::say(&format!("{cell}  {line}"));
                }
            }
            Ok(())
        }
        LinkCommand::Doctor { file, json } => doctor(cell, &file, json),
        LinkCommand::Deploy(deploy) => deployment::give(&deploy),
        LinkCommand::Withdraw { reach, nets } => deployment::withdraw(&reach, &nets),
    }
}

/// Waits for a signal on a thread of its own.
fn stop_at(signals: Stop) -> std::io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&stop);
    rcc_process::helpers::thread("signals", move || {
        let signal = signals.wait();
        tracing::info!(%signal, "ends");
        // Release pairs with the acquire of the other threads.
        told.store(true, Ordering::Release);
    })?;
    Ok(stop)
}

fn doctor(cell: Option<String>, file: &CellFile, as_json: bool) -> Result<(), LinkError> {
    let config = file.load()?;
    let cell = cell.unwrap_or_else(|| config.name.clone());
    let now_s = i64::try_from(wall::seconds()).unwrap_or(i64::MAX);
    let findings = doctor::verify(&config, &cell, now_s);
    if findings.is_empty() {
        return Err(LinkError::NothingToVerify(file.name()));
    }
    match as_json {
        true => rcc_process::say(&json!(findings).to_string()),
        false => {
            for finding in &findings {
                let LinkFinding { level, of, what } = finding;
                rcc_process::say(&format!("{:<4}  {of}: {what}", level.word()));
            }
        }
    }
    let failed = findings.iter().filter(|it| it.level == FindingLevel::Fail);
    match failed.count() {
        0 => Ok(()),
        count => Err(LinkError::Faults(count)),
    }
}

fn operate(ask: &Ask, operation: Operation) -> Result<(), LinkError> {
    let session = ask.reach.session()?;
    let request = CellRequest {
        peer: &ask.peer,
        cell: &ask.cell,
        operation,
        net: &ask.net,
        text: "",
    };
    let answer = request.ask(&session)?;
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
    writeln!(out, "{}", Printable(line))
        .and_then(|()| out.flush())
        .is_ok()
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

fn serve(cell: Option<String>, file: &CellFile, parent_death: bool) -> Result<(), LinkError> {
    // If memory runs out, the kernel should first end processes that only observe.
    let _ = raise_score(SCORE_OBSERVER);
    // Before the first thread, which inherits the mask.
    let signals = Stop::prepare(parent_death)?;
    let config = file.load()?;
    let file = file.name();
    let link = config.link.clone();
    let link = link.ok_or_else(|| LinkError::NoLink(file.clone()))?;
    if link.listen.is_empty() && link.connect.is_empty() && link.router.is_empty() {
        return Err(LinkError::Nobody(file));
    }
    for endpoint in link.listen.iter().chain(&link.connect).chain(&link.router) {
        has_port(endpoint).map_err(GatewayError::Session)?;
    }
    let stop = stop_at(signals)?;
    let options = GatewayOptions {
        cell: cell.unwrap_or_else(|| config.name.clone()),
        link,
        config,
    };
    Ok(gateway::run(&options, &stop)?)
}
