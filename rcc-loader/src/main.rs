//! `rcc-loader`: serves the REST interface of one cell.
//! The main thread serves connections; blocking threads compile and talk to the executor; one thread tends the link.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use clap::Parser;
use nix::sys::signal::Signal;
use rcc_config::CellConfig;
use rcc_config::ports::PortArgument;
use rcc_ipc::{Announcement, Cell, Role, Session};
use rcc_loader::server::executor::Executor;
use rcc_loader::server::service::Service;
use rcc_loader::server::{routes, socket};
use tokio::net::UnixListener;
use tokio::signal::unix::{SignalKind, signal};

/// Exit code of a configuration error: a supervisor need not try again (sysexits.h EX_CONFIG).
const EXIT_CONFIG: u8 = 78;
/// How often the executor is looked for and files of unloaded commands are removed.
const TEND_EVERY: Duration = Duration::from_millis(100);
/// How long requests under way may take after SIGTERM.
const DRAIN: Duration = Duration::from_secs(1);

/// Loads nets and controls commands: REST on the Unix socket of a cell.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Name of the cell.
    #[arg(long, env = "RCC_CELL")]
    cell: String,
    /// Configuration of the cell.
    #[arg(long)]
    config: PathBuf,
    /// A port that the configuration leaves to the supervisor, `name=number`.
    #[arg(long = "port")]
    ports: Vec<PortArgument>,
    /// End when the parent process dies.
    #[arg(long)]
    parent_death: bool,
}

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(false)
        .init();
    if let Err(error) = arguments.parent_death.then(end_with_parent).transpose() {
        tracing::error!("{error}");
        return ExitCode::FAILURE;
    }
    let ports = arguments
        .ports
        .iter()
        .map(|port| (port.name.clone(), port.number))
        .collect();
    let config = match CellConfig::load(&arguments.config, &ports) {
        Ok(config) => config,
        Err(faults) => {
            eprintln!("{faults}");
            return ExitCode::from(EXIT_CONFIG);
        }
    };
    match serve(&arguments, config) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn serve(arguments: &Arguments, config: CellConfig) -> Result<(), Failure> {
    let cell = Cell::new(&arguments.cell)?;
    let session = Session::join(&cell, Role::Loader, "loader")?;
    // First the announcement, which only one process can hold, then the socket.
    let announced = cell.announce(&Announcement::of(&session))?;
    let listener = socket::listen(&cell.socket())?;
    let service = Arc::new(Service::new(Executor::new(session), config));
    let tended = Arc::clone(&service);
    // Ends with the process: between two turns it holds nothing.
    thread::Builder::new().name("tend".into()).spawn(move || {
        loop {
            tended.tend();
            thread::sleep(TEND_EVERY);
        }
    })?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let served: Result<(), Failure> = runtime.block_on(async {
        let mut terminate = signal(SignalKind::terminate())?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let listener = UnixListener::from_std(listener)?;
        tracing::info!(socket = %cell.socket().display(), "serving");
        tokio::select! {
            served = async { axum::serve(listener, routes::router(service)).await } => served?,
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
        Ok(())
    });
    runtime.shutdown_timeout(DRAIN);
    let _ = std::fs::remove_file(cell.socket());
    drop(announced);
    served
}

/// Asks for SIGTERM at the parent's death, and looks whether it is dead already.
fn end_with_parent() -> Result<(), Failure> {
    let parent = nix::unistd::getppid();
    nix::sys::prctl::set_pdeathsig(Signal::SIGTERM)?;
    if nix::unistd::getppid() != parent {
        return Err("the parent process is dead".into());
    }
    Ok(())
}
