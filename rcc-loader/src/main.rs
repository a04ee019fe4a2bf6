//! `rcc-loader`: serves the REST interface of one cell. The thread `front` accepts connections, reads the heads of
//! requests, and carries out CANCEL and ABORT; the main thread serves all other requests, blocking threads compile and talk
//! to the executor, and one thread maintains the link to the executor.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use clap::Parser;
use rcc_ipc::events::{self, EventRecorder};
use rcc_ipc::{Cell, Session};
use rcc_loader::server::executor::ExecutorLink;
use rcc_loader::server::listeners::Listeners;
use rcc_loader::server::routes;
use rcc_loader::server::service::Service;
use rcc_loader::server::service::history::{READ_EVERY, RecordFollower};
use rcc_os::memory::{MemoryTrimmer, configure_allocator};
use rcc_process::helpers::Hang;
use rcc_process::oom;
use rcc_process::priority::{STOP_NICE, WorkerPriority, raise_stop_thread};
use rcc_process::{CellArguments, ExitError, HealthReport, Helper, Helpers, Notifier, Stop, exit};
use rcc_protocol::events::EventKind;
use rcc_protocol::{Configuration, Role};
use tokio::sync::oneshot;

/// Interval at which the executor is looked up and the files of unloaded commands are removed.
const MAINTAIN_EVERY: Duration = Duration::from_millis(100);
/// Time allowed for pending requests after SIGTERM.
const DRAIN: Duration = Duration::from_secs(1);

/// Maximum time for one line of the event log, or for one maintenance pass.
const SLOW_TURN_MAX: Duration = Duration::from_secs(10);
/// Maximum time that the work of a request may wait for a thread: longer than any work may take.
const WORK_MAX: Duration = Duration::from_secs(30);
/// Number of worker threads created before the loader is ready; more are created on demand and kept.
const WORKERS: usize = 4;
/// Upper limit of the number of other threads of this program.
const OWN_THREADS_MAX: usize = 32;
/// Time allowed for these threads to start.
const WORKERS_WAIT: Duration = Duration::from_secs(20);
/// Idle time after which a worker thread would end: never.
const IDLE_THREAD_LIFETIME: Duration = Duration::from_secs(100 * 365 * 24 * 3600);

/// Maximum time between two heartbeats of the thread `front`.
const FRONT_TURN_MAX: Duration = Duration::from_secs(2);
/// Interval at which the runtimes show that they respond.
const TURN_EVERY: Duration = Duration::from_millis(100);

/// Loads nets and controls commands: REST on the Unix socket of a cell.
#[derive(Parser)]
#[command(version = rcc_protocol::version::version())]
struct Arguments {
    #[command(flatten)]
    cell: CellArguments,
}

fn main() -> ExitCode {
    let Arguments { cell } = Arguments::parse();
    rcc_process::begin();
    configure_allocator(routes::THREADS_MAX + OWN_THREADS_MAX);
    // Without /proc the score cannot be set.
    let _ = oom::raise_score(oom::SCORE_RESTARTABLE);
    exit::conclude(serve(&cell))
}

fn serve(arguments: &CellArguments) -> Result<(), ExitError> {
    let stop = Stop::prepare(arguments.parent_death)?;
    let config = arguments.load()?;
    let cell = Cell::new(&arguments.cell)?;
    cell.make_state(config.recorder.folder.as_deref())?;
    let session = Session::join(&cell, Role::Loader, "loader")?;
    // Announce first, because only one process can hold the announcement; then open the socket.
    let helpers = Helpers::default();
    let writer = helpers.helper("events", SLOW_TURN_MAX);
    let turn = move || writer.turn();
    let recorder = EventRecorder::watched(&cell, Role::Loader, session.label(), turn)?;
    let predecessor = events::predecessor(&cell, Role::Loader, session.label());
    let announced = cell.announce(
        &session
            .announcement()
            .configured(Configuration::new(config.identity())),
    )?;
    recorder.tell(EventKind::Started {
        note: String::new(),
        predecessor,
    });
    let listeners = Listeners::open(&cell, &config.access).map_err(|error| {
        if error.is_final() {
            ExitError::configuration(&error)
        } else {
            error.into()
        }
    })?;
    let listeners = listeners.with_event_log(recorder.clone());
    let service = Service::new(ExecutorLink::new(session), config)
        .with_event_log(recorder.clone())
        .with_helpers(helpers.clone())
        .with_file_watch(arguments.chosen_ports());
    let service = Arc::new(service);
    spawn_helpers(&helpers, &service)?;
    let workers = WorkerPriority::raise_calling_thread()
        .inspect_err(|error| {
            tracing::info!(
                "CANCEL and ABORT compete with all other programs for the processor: nice {STOP_NICE} was refused \
                 ({error}): raise the limit `nice` (LimitNICE={STOP_NICE})"
            );
        })
        .ok();
    // Its threads inherit the nice value.
    let router = routes::router(service, &helpers)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .on_thread_start(move || {
            if let Some(workers) = workers {
                workers.apply();
            }
        })
        .max_blocking_threads(routes::THREADS_MAX)
        .enable_all()
        .thread_keep_alive(IDLE_THREAD_LIFETIME)
        .build()?;
    make_workers(&runtime)?;
    let front = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let mut served = Some((listeners, runtime.handle().clone(), router.clone()));
    let address = served
        .as_ref()
        .and_then(|(listeners, ..)| listeners.address());
    helpers.spawn("front", FRONT_TURN_MAX, move |helper| {
        raise_stop_thread();
        if let Some((listeners, serving, router)) = served.take() {
            front.block_on(serve_front(helper, listeners.serve(serving, router)));
        }
    })?;
    // A thread of its own: it tries again if the system cannot deliver the signal at once.
    let (stop_sender, stop_requested) = oneshot::channel();
    rcc_process::helpers::thread("signals", move || {
        // Without a receiver the program has ended already.
        let _ = stop_sender.send(stop.wait());
    })?;
    let turns = Arc::new(AtomicU64::new(0));
    let served: Result<(), ExitError> = runtime.block_on(async {
        tracing::info!(socket = %cell.socket().display(), "serving");
        if let Some(address) = address {
            tracing::info!(%address, "serving on TCP; a token is required");
        }
        tokio::spawn(self::count_turns(Arc::clone(&turns)));
        tokio::spawn(probe_workers(helpers.helper("workers", WORK_MAX)));
        let socket = cell.socket();
        let reporter = recorder.clone();
        let mut hangs = helpers.watch(move |hang| report_hang(&reporter, hang));
        let supervisor = Notifier::start(&helpers, move || {
            hangs.check(HealthReport {
                progress: turns.load(Ordering::Relaxed),
                status: format!("serving on {}", socket.display()),
            })
        })?;
        // All threads exist: report READY.
        helpers.start();
        let _ = stop_requested.await;
        if let Some(why) = helpers.failure() {
            recorder.tell(EventKind::HelperEnded { why });
            return helpers.conclude();
        }
        supervisor.stopping();
        recorder.tell(EventKind::Stopping {
            why: "on request".to_owned(),
        });
        Ok(())
    });
    helpers.end();
    // Not before: its threads are helpers, and one that ends while the others work is a failure.
    drop(router);
    runtime.shutdown_timeout(DRAIN);
    recorder.flush(DRAIN);
    let _ = std::fs::remove_file(cell.socket());
    drop(announced);
    served
}

/// Starts the threads that look after the executor's commands, monitored values and memory.
fn spawn_helpers(helpers: &Helpers, service: &Arc<Service>) -> Result<(), ExitError> {
    let maintained = Arc::clone(service);
    helpers.spawn("maintenance", SLOW_TURN_MAX, move |helper| {
        while !helper.rest(MAINTAIN_EVERY) {
            maintained.maintain();
        }
    })?;
    helpers.spawn("memory", SLOW_TURN_MAX, |helper| {
        // It locks each arena of the allocator in turn, also those of CANCEL and ABORT, and must not lose the processor
        // meanwhile.
        raise_stop_thread();
        // Compiling a long text takes a hundred times its size in memory, which is returned to the system afterwards.
        let mut memory = MemoryTrimmer::default();
        while !helper.rest(MAINTAIN_EVERY) {
            memory.trim_if_grown();
        }
    })?;
    let followed = Arc::clone(service);
    helpers.spawn("history", SLOW_TURN_MAX, move |helper| {
        let mut follower = RecordFollower::default();
        while !helper.rest(READ_EVERY) {
            followed.follow_records(&mut follower);
        }
    })?;
    Ok(())
}

fn report_hang(recorder: &EventRecorder, hang: &Hang) {
    tracing::error!("{hang}");
    let milliseconds = |time: Duration| time.as_millis().try_into().unwrap_or(u64::MAX);
    recorder.tell(EventKind::HelperHangs {
        helper: hang.helper.to_owned(),
        silent_ms: milliseconds(hang.silent),
        limit_ms: milliseconds(hang.limit),
    });
}

/// Serves the listeners until the helpers end, with heartbeats of the thread.
async fn serve_front(helper: &Helper, listeners: impl Future<Output = io::Result<()>>) {
    let heartbeats = async {
        while !helper.is_over() {
            helper.turn();
            tokio::time::sleep(TURN_EVERY).await;
        }
    };
    tokio::select! {
        served = listeners => if let Err(error) = served {
            tracing::error!(%error, "the listeners cannot be served");
        },
        () = heartbeats => {}
    }
}

/// Creates the first worker threads, which are never ended: when the system refuses further threads, requests wait for
/// one of these instead of failing.
///
/// # Errors
/// Returns an error if the system cannot create the threads.
fn make_workers(runtime: &tokio::runtime::Runtime) -> io::Result<()> {
    let refused = || {
        io::Error::other(format!(
            "cannot create {WORKERS} worker threads: raise TasksMax= or pids.max of the control group, or \
             the limit nproc of its user"
        ))
    };
    let (arrived, arrivals) = channel();
    let (keep, kept) = channel::<()>();
    let kept = Arc::new(Mutex::new(kept));
    // The error of a refused thread says it; the panic of the library need not be printed besides.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let mut made = Ok(());
    for _ in 0..WORKERS {
        let (arrived, kept) = (arrived.clone(), Arc::clone(&kept));
        let work = move || {
            // The receiver is gone when another thread was refused.
            let _ = arrived.send(());
            // Blocks until all threads have started; nothing is ever sent.
            let _ = kept.lock().map(|kept| kept.recv());
        };
        // `spawn_blocking` panics if the system refuses the first thread.
        let worker = catch_unwind(AssertUnwindSafe(|| runtime.spawn_blocking(work)));
        made = made.and(worker.map(drop).map_err(|_| refused()));
    }
    std::panic::set_hook(hook);
    made?;
    for _ in 0..WORKERS {
        arrivals.recv_timeout(WORKERS_WAIT).map_err(|_| refused())?;
    }
    drop(keep);
    Ok(())
}

/// Counts heartbeats of the worker threads while they accept work.
async fn probe_workers(workers: Helper) {
    loop {
        if tokio::task::spawn_blocking(|| ()).await.is_ok() {
            workers.turn();
        }
        tokio::time::sleep(TURN_EVERY).await;
    }
}

/// Counts the runtime's progress for the supervisor. Relaxed, because nothing else is communicated with it.
async fn count_turns(turns: Arc<AtomicU64>) {
    loop {
        tokio::time::sleep(TURN_EVERY).await;
        turns.fetch_add(1, Ordering::Relaxed);
    }
}
