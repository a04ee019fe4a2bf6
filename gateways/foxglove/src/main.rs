//! `rcc-foxglove`: the gateway for Foxglove and Lichtblick. The main thread serves; one thread reads the cell, one waits for
//! signals.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Parser;
use rcc_api::own_hosts::OwnHosts;
use rcc_api::token::{Token, TokenError};
use rcc_foxglove::access::Access;
use rcc_foxglove::cell::{self, CellOptions};
use rcc_foxglove::listener;
use rcc_foxglove::server::Server;
use rcc_foxglove::viewers::Viewers;
use rcc_process::Stop;
use rcc_process::oom::{SCORE_OBSERVER, raise_score};
use tokio::net::TcpListener;
use tokio::runtime::Builder;
use tokio::sync::oneshot;

/// Lets Foxglove and Lichtblick watch a cell, and prints the address to connect to.
#[derive(Parser)]
#[command(name = "rcc-foxglove", version = rcc_protocol::version::version())]
struct Arguments {
    /// Name of the cell; it need not run yet
    #[arg(long, env = "RCC_CELL", default_value = "demo")]
    cell: String,
    /// Address and port; 0 takes any free port. Another address than a loopback one needs --token-file
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8765")]
    bind: SocketAddr,
    /// File with the token that clients must send; only its owner may read it [default: a random one, printed]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Let clients set the Inputs of nets, and load, start and cancel nets
    #[arg(long)]
    control: bool,
    /// Also admit pages of this origin, such as http://localhost:8080
    #[arg(long, value_name = "ORIGIN")]
    origin: Vec<String>,
    /// Name under which other machines reach this one, besides its addresses
    #[arg(long, value_name = "NAME", requires = "token_file")]
    host: Vec<String>,
    /// Greatest rate of the messages of each net, device and arm, Hz
    #[arg(long, default_value = "100", value_parser = rate)]
    rate: f64,
    /// End with the process that started this one
    #[arg(long)]
    parent_death: bool,
}

/// The reason why nothing is served.
#[derive(Debug, thiserror::Error)]
enum GatewayError {
    #[error("--token-file: {0}")]
    Token(#[from] TokenError),
    #[error(
        "{0} is reached by other machines: add --token-file FILE (create it with `openssl rand -hex 32`), or use `ssh -L` and 127.0.0.1"
    )]
    NeedsToken(SocketAddr),
    #[error("cannot listen on {0}: {1}; choose another port with --bind")]
    Listen(SocketAddr, io::Error),
    #[error("cannot start: {0}")]
    System(#[from] io::Error),
    #[error("cannot start: {0}")]
    Signals(#[from] rcc_process::signals::SignalError),
}

fn main() -> ExitCode {
    rcc_process::begin();
    let arguments = Arguments::parse();
    // If memory runs out, the kernel should first end processes that only observe.
    let _ = raise_score(SCORE_OBSERVER);
    match run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            rcc_process::remark(&format!("rcc-foxglove: {error}"));
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: Arguments) -> Result<(), GatewayError> {
    // Before the first thread, which inherits the mask.
    let stop = Stop::prepare(arguments.parent_death)?;
    let token = match &arguments.token_file {
        Some(file) => Token::read(file)?,
        None if arguments.bind.ip().is_loopback() => Token::random()?,
        None => return Err(GatewayError::NeedsToken(arguments.bind)),
    };
    let runtime = Builder::new_current_thread().enable_all().build()?;
    let (told, end) = oneshot::channel();
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            // Nobody listens any more if the server has ended by itself.
            let _ = told.send(stop.wait());
        })?;
    let viewers = Arc::new(Viewers::new(arguments.rate));
    let ends = Arc::new(AtomicBool::new(false));
    let options = CellOptions {
        cell: arguments.cell.clone(),
        rate_hz: arguments.rate,
    };
    let reader = {
        let (viewers, ends) = (Arc::clone(&viewers), Arc::clone(&ends));
        std::thread::Builder::new()
            .name("cell".to_owned())
            .spawn(move || cell::run(&options, &viewers, &ends))?
    };
    let served = runtime.block_on(async {
        let listener = TcpListener::bind(arguments.bind).await;
        let listener = listener.map_err(|error| GatewayError::Listen(arguments.bind, error))?;
        let address = listener.local_addr()?;
        rcc_process::say(&address_line(&arguments, address, &token));
        let access = Access {
            hosts: match address.ip() == Ipv4Addr::LOCALHOST && arguments.host.is_empty() {
                true => OwnHosts::loopback(address.port()),
                false => OwnHosts::reachable(address.port(), &arguments.host),
            },
            origins: arguments.origin,
            token,
        };
        let server = Server::new(&arguments.cell, arguments.control, access, viewers);
        let end = async {
            if let Ok(signal) = end.await {
                tracing::info!(%signal, "ends");
            }
        };
        listener::serve(&Arc::new(server), listener, end).await;
        Ok(())
    });
    ends.store(true, Ordering::Release);
    // Shared memory is given back before the process ends. An error means that the thread panicked, and said so.
    let _ = reader.join();
    // A request to the loader may take seconds; nobody waits for it any more.
    runtime.shutdown_background();
    served
}

/// Returns the address for people. The token of a file stays in the file, because logs last.
fn address_line(arguments: &Arguments, address: SocketAddr, token: &Token) -> String {
    match &arguments.token_file {
        None => format!("ws://{address}/?token={}", token.reveal()),
        Some(file) => format!("ws://{address}/?token= and the token of {}", file.display()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let rate = text.trim().parse::<f64>().ok();
    rate.filter(|rate| (0.1..=1000.0).contains(rate))
        .ok_or_else(|| format!("invalid rate `{text}`: write a number from 0.1 to 1000, in Hz"))
}
