//! `rcc-loader`: serves the REST interface of one cell.
//! The main thread serves connections; blocking threads compile and talk to the executor; one thread tends the link.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use clap::Parser;
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::{Announcement, Cell, Role, Session};
use rcc_loader::server::doors::Doors;
use rcc_loader::server::executor::Executor;
use rcc_loader::server::routes;
use rcc_loader::server::service::Service;
use rcc_process::signals::{end_with_parent, let_through};
use rcc_process::{CellArguments, Ending, Notifier, Pulse, ending};
use tokio::signal::unix::{SignalKind, signal};

/// How often the executor is looked for and files of unloaded commands are removed.
const TEND_EVERY: Duration = Duration::from_millis(100);
/// How long requests under way may take after SIGTERM.
const DRAIN: Duration = Duration::from_secs(1);

/// How often the runtime shows that it answers.
const TURN_EVERY: Duration = Duration::from_millis(100);

/// Loads nets and controls commands: REST on the Unix socket of a cell.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(flatten)]
    cell: CellArguments,
}

fn main() -> ExitCode {
    let Arguments { cell } = Arguments::parse();
    rcc_process::log();
    ending::conclude(serve(&cell))
}

fn serve(arguments: &CellArguments) -> Result<(), Ending> {
    let_through()?;
    if arguments.parent_death {
        end_with_parent()?;
    }
    let config = arguments.load()?;
    let cell = Cell::new(&arguments.cell)?;
    let session = Session::join(&cell, Role::Loader, "loader")?;
    // First the announcement, which only one process can hold, then the socket.
    let recorder = Recorder::start(&cell, Role::Loader, session.label())?;
    let predecessor = events::predecessor(&cell, Role::Loader, session.label());
    let announced = cell.announce(&Announcement::of(&session))?;
    recorder.tell(Kind::Started {
        note: String::new(),
        predecessor,
    });
    let doors = Doors::open(&cell, &config.access).map_err(|error| {
        if error.is_final() {
            Ending::configuration(&error)
        } else {
            error.into()
        }
    })?;
    let service = Service::new(Executor::new(session), config).recording(recorder.clone());
    let service = Arc::new(service);
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
    let turns = Arc::new(AtomicU64::new(0));
    let served: Result<(), Ending> = runtime.block_on(async {
        let mut terminate = signal(SignalKind::terminate())?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        tracing::info!(socket = %cell.socket().display(), "serving");
        if let Some(address) = doors.address() {
            tracing::info!(%address, "serving over TCP, with the token only");
        }
        tokio::spawn(turn(Arc::clone(&turns)));
        let socket = cell.socket();
        let supervisor = Notifier::ready(move || Pulse {
            progress: turns.load(Ordering::Relaxed),
            status: format!("serving on {}", socket.display()),
        })?;
        tokio::select! {
            served = doors.recording(recorder.clone()).serve(routes::router(service)) => served?,
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
        supervisor.stopping();
        recorder.tell(Kind::Stopping {
            why: "asked to".to_owned(),
        });
        Ok(())
    });
    runtime.shutdown_timeout(DRAIN);
    recorder.flush(DRAIN);
    let _ = std::fs::remove_file(cell.socket());
    drop(announced);
    served
}

/// The runtime's progress, for the supervisor: it answers as long as it comes here. Relaxed: nothing is told with it.
async fn turn(turns: Arc<AtomicU64>) {
    loop {
        tokio::time::sleep(TURN_EVERY).await;
        turns.fetch_add(1, Ordering::Relaxed);
    }
}
