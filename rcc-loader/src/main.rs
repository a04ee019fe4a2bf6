//! `rcc-loader`: serves the REST interface of one cell.
//! The main thread serves connections; blocking threads compile and talk to the executor; one thread tends the link.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use clap::Parser;
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::{Announcement, Cell, Configuration, Role, Session};
use rcc_loader::server::doors::Doors;
use rcc_loader::server::executor::Executor;
use rcc_loader::server::routes;
use rcc_loader::server::service::Service;
use rcc_os::memory::Returned;
use rcc_process::helpers::Hang;
use rcc_process::memory;
use rcc_process::signals::{end_with_parent, let_through};
use rcc_process::{CellArguments, Ending, Helper, Helpers, Notifier, Pulse, ending};
use tokio::signal::unix::{SignalKind, signal};

/// How often the executor is looked for and files of unloaded commands are removed.
const TEND_EVERY: Duration = Duration::from_millis(100);
/// How long requests under way may take after SIGTERM.
const DRAIN: Duration = Duration::from_secs(1);

/// How long a line of the event log, or a look for the executor, may take.
const SLOW_TURN_MAX: Duration = Duration::from_secs(10);
/// How long a request's work may wait for a thread: longer than any work may take.
const WORK_MAX: Duration = Duration::from_secs(30);
/// Threads for the work of requests that are made before the loader is ready; others come and stay when they are needed.
const WORKERS: usize = 4;
/// How long they may take to begin.
const WORKERS_WAIT: Duration = Duration::from_secs(20);
/// They are never given back.
const FOR_EVER: Duration = Duration::from_secs(100 * 365 * 24 * 3600);

/// How often the runtime shows that it answers.
const TURN_EVERY: Duration = Duration::from_millis(100);

/// Loads nets and controls commands: REST on the Unix socket of a cell.
#[derive(Parser)]
#[command(version = rcc_ipc::version::version())]
struct Arguments {
    #[command(flatten)]
    cell: CellArguments,
}

fn main() -> ExitCode {
    let Arguments { cell } = Arguments::parse();
    rcc_process::log();
    // Without /proc nothing can be said about it.
    let _ = memory::end_me_first(memory::STARTED_AGAIN);
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
    let helpers = Helpers::default();
    let writer = helpers.helper("events", SLOW_TURN_MAX);
    let turn = move || writer.turn();
    let recorder = Recorder::watched(&cell, Role::Loader, session.label(), turn)?;
    let predecessor = events::predecessor(&cell, Role::Loader, session.label());
    let announced = cell
        .announce(&Announcement::of(&session).configured(Configuration::new(config.identity())))?;
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
    let service = Service::new(Executor::new(session), config)
        .recording(recorder.clone())
        .watching(helpers.clone())
        .watching_files(arguments.chosen_ports());
    let service = Arc::new(service);
    let tended = Arc::clone(&service);
    helpers.spawn("tend", SLOW_TURN_MAX, move |helper| {
        // A long text takes a hundred times its memory while it is compiled.
        let mut memory = Returned::default();
        while !helper.rest(TEND_EVERY) {
            tended.tend();
            memory.look();
        }
    })?;
    let router = routes::router(service)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        // As many as there are requests at a time, and those that compile: none waits for a thread.
        .max_blocking_threads(routes::REQUESTS_MAX + routes::LOADING_MAX)
        .enable_all()
        .thread_keep_alive(FOR_EVER)
        .build()?;
    make_workers(&runtime)?;
    let turns = Arc::new(AtomicU64::new(0));
    let served: Result<(), Ending> = runtime.block_on(async {
        let mut terminate = signal(SignalKind::terminate())?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        tracing::info!(socket = %cell.socket().display(), "serving");
        if let Some(address) = doors.address() {
            tracing::info!(%address, "serving over TCP, with the token only");
        }
        tokio::spawn(self::turn(Arc::clone(&turns)));
        tokio::spawn(probe(helpers.helper("workers", WORK_MAX)));
        let socket = cell.socket();
        let told = recorder.clone();
        let mut hangs = helpers.watch(move |hang| tell_hang(&told, hang));
        let supervisor = Notifier::start(&helpers, move || {
            hangs.look(Pulse {
                progress: turns.load(Ordering::Relaxed),
                status: format!("serving on {}", socket.display()),
            })
        })?;
        // All threads are made: now it says that it is ready.
        helpers.go();
        tokio::select! {
            served = doors.recording(recorder.clone()).serve(router) => served?,
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
        if let Some(why) = helpers.failure() {
            recorder.tell(Kind::HelperEnded { why });
            return helpers.conclude();
        }
        supervisor.stopping();
        recorder.tell(Kind::Stopping {
            why: "asked to".to_owned(),
        });
        Ok(())
    });
    helpers.end();
    runtime.shutdown_timeout(DRAIN);
    recorder.flush(DRAIN);
    let _ = std::fs::remove_file(cell.socket());
    drop(announced);
    served
}

fn tell_hang(recorder: &Recorder, hang: &Hang) {
    tracing::error!("{hang}");
    let milliseconds = |time: Duration| time.as_millis().try_into().unwrap_or(u64::MAX);
    recorder.tell(Kind::HelperHangs {
        helper: hang.helper.to_owned(),
        silent_ms: milliseconds(hang.silent),
        limit_ms: milliseconds(hang.limit),
    });
}

/// Makes the first threads that do the work of requests, and they stay: where the system gives no more, requests wait for
/// one of these instead of failing.
///
/// # Errors
/// The system gives no thread.
fn make_workers(runtime: &tokio::runtime::Runtime) -> io::Result<()> {
    let refused = || {
        io::Error::other(format!(
            "the system gives no {WORKERS} threads for the work of requests: raise TasksMax= or pids.max of its group, or \
             the limit nproc of its user"
        ))
    };
    let (arrived, arrivals) = channel();
    let (keep, kept) = channel::<()>();
    let kept = Arc::new(Mutex::new(kept));
    for _ in 0..WORKERS {
        let (arrived, kept) = (arrived.clone(), Arc::clone(&kept));
        let work = move || {
            // Nobody listens any more when another one was refused.
            let _ = arrived.send(());
            // Until all are here: nobody ever sends.
            let _ = kept.lock().map(|kept| kept.recv());
        };
        // It panics when the system refuses the first thread.
        let made = catch_unwind(AssertUnwindSafe(|| runtime.spawn_blocking(work)));
        made.map_err(|_| refused())?;
    }
    for _ in 0..WORKERS {
        arrivals.recv_timeout(WORKERS_WAIT).map_err(|_| refused())?;
    }
    drop(keep);
    Ok(())
}

/// Shows that the threads that do the work of requests take some.
async fn probe(workers: Helper) {
    loop {
        if tokio::task::spawn_blocking(|| ()).await.is_ok() {
            workers.turn();
        }
        tokio::time::sleep(TURN_EVERY).await;
    }
}

/// The runtime's progress, for the supervisor: it answers as long as it comes here. Relaxed: nothing is told with it.
async fn turn(turns: Arc<AtomicU64>) {
    loop {
        tokio::time::sleep(TURN_EVERY).await;
        turns.fetch_add(1, Ordering::Relaxed);
    }
}
