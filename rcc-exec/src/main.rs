//! `rcc-exec`: runs plans every cycle, in hard real time where the system grants it.
//!
//! The main thread sets everything up, makes all threads before it says that it is ready, and then waits for a signal. A
//! helper thread that panics or ends by itself asks for the same stop: nets are canceled, arms come to rest, and the
//! process ends with a failure, so that it is started again. One that hangs stops the heartbeat.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::io;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;
use rcc_config::cell::{CellConfig, RealTime};
use rcc_core::message::CycleStatus;
use rcc_engine::costs::Costs;
use rcc_engine::costs::cache::{self, Origin};
use rcc_engine::engine::{Engine, EngineConfig};
use rcc_engine::queue::{HelperEnds, RtEnds, rings};
use rcc_engine::record::{Recorder as FlightRecorder, RecorderConfig as FlightConfig};
use rcc_exec::clock::{Clock, Follow};
use rcc_exec::incidents::{About, Made, Recordings, Scribe};
use rcc_exec::intake::{Intake, IntakeConfig, POLL_EVERY};
use rcc_exec::pump::{PUMP_EVERY, Pump};
use rcc_exec::rt::{self, Boards};
use rcc_exec::setup::{Grants, lock_memory, prefault_stack, promote_thread};
use rcc_ipc::control::{CONTROL, HELPERS, RECORDS, STATUS, TABLES, TIMING, command_board};
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::{
    Announcement, BoardError, BoardReader, Cell, Configuration, Role, Session, monotonic_ns,
};
use rcc_process::signals::request_stop;
use rcc_process::{CellArguments, Ending, Helpers, Notifier, Pulse, Stop, ending};
use tracing::{error, info, warn};

/// How long the threads that take requests and carry records may take for a turn.
const TURN_MAX: Duration = Duration::from_secs(5);
/// How long a line of the event log may take on a slow disk.
const SLOW_TURN_MAX: Duration = Duration::from_secs(10);
/// How long a piece of an incident file may take on a slow disk, or all of it until it is safe there.
const WRITE_MAX: Duration = Duration::from_secs(60);
/// How long the helper threads may take to end after the real-time thread.
const FAREWELL: Duration = Duration::from_secs(5);

/// Runs the nets of a cell, every cycle.
#[derive(Parser)]
#[command(version = rcc_ipc::version::version())]
struct Arguments {
    #[command(flatten)]
    cell: CellArguments,
}

fn main() -> ExitCode {
    let Arguments { cell } = Arguments::parse();
    rcc_process::log();
    ending::conclude(execute(&cell))
}

fn execute(arguments: &CellArguments) -> Result<(), Ending> {
    let signals = Stop::prepare(arguments.parent_death)?;
    let config = &arguments.load()?;
    let cell = Cell::new(&arguments.cell)?;
    let costs = costs();
    let session = Session::join(&cell, Role::Executor, "exec")?;
    let mut grants = Grants::default();
    let helpers = Helpers::default();
    let writer = helpers.helper("events", SLOW_TURN_MAX);
    let turn = move || writer.turn();
    let recorder = Recorder::watched(&cell, Role::Executor, session.label(), turn)?;
    let (rt_ends, helper_ends) = rings();
    let models = config.models();
    let mut boards = make_boards(&session, config)?;
    let status = session.open_board::<CycleStatus>(boards.status.service())?;
    let server = session.serve(CONTROL)?;
    let publisher = session.publisher(RECORDS)?;
    let announcement = Announcement::of(&session)
        .configured(Configuration::new(config.identity()))
        .service(CONTROL, server.service())
        .service(STATUS, boards.status.service())
        .service(TABLES, boards.tables.service())
        .service(TIMING, boards.timing.service())
        .service(HELPERS, boards.helpers.service())
        .service(RECORDS, publisher.service());
    let announcement = config.devices.iter().zip(&boards.commands).fold(
        announcement,
        |announcement, (device, board)| {
            announcement.service(&command_board(&device.name), board.service())
        },
    );
    lock_memory(&mut grants);
    let engine_config = EngineConfig {
        incarnation: session.incarnation(),
        period_ns: config.period_ns,
        stale_after_ns: config.stale_after_ns,
        late_in_a_row_max: config.executor.late_in_a_row_max,
        models: models.clone(),
    };
    let names: Vec<_> = config
        .devices
        .iter()
        .map(|device| device.name.clone())
        .collect();
    let intake_config = IntakeConfig {
        names: names.clone(),
        models,
        configuration: config.fingerprint(),
        period_ns: config.period_ns,
        stale_after_ns: config.stale_after_ns,
        costs,
        helpers: helpers.clone(),
        announcement: announcement.clone(),
    };
    let HelperEnds {
        orders,
        outcomes,
        records,
        events,
    } = helper_ends;
    let Flight {
        recorder: flight,
        scribe,
        made,
        recordings,
    } = flight_recorder(config, &cell, session.incarnation());
    let scribe = scribe.map(|scribe| scribe.recording(recorder.clone()));
    let intake = Intake::new(session, server, orders, outcomes, intake_config)?;
    let intake = intake.recording(recorder.clone()).telling(made, recordings);
    let pump = Pump::new(records, events, publisher, names);
    let pump = pump.recording(&cell, recorder.clone());
    spawn_helpers(&helpers, intake, pump, scribe)?;
    let supervisor = supervisor(&helpers, &recorder, status, config.period_ns)?;
    boards.beats = helpers.beats();
    let stop = Arc::new(AtomicBool::new(false));
    let (rt, grants) = start_rt(
        engine_config,
        (rt_ends, flight),
        boards,
        config,
        grants,
        &stop,
    )?;
    info!("{grants}");
    if config.executor.rt == RealTime::Required && !grants.refusals.is_empty() {
        stop.store(true, Ordering::Release);
        // It has run a few cycles that nobody could see; how it ended does not matter any more.
        let _ = rt.thread.join();
        return Err(Ending::not_permitted(&refused(&grants)));
    }
    // The pulse tells of them. Nobody has set it before.
    let _ = supervisor.grants.set(grants.clone());
    let predecessor = events::predecessor(&cell, Role::Executor, &announcement.label);
    let announced = cell.announce(&announcement.note(&grants.to_string()))?;
    recorder.tell(Kind::Started {
        note: events::text(&grants.to_string()),
        predecessor,
    });
    helpers.go();
    let ended = run_until_stopped(
        &helpers,
        rt,
        &stop,
        &signals,
        &supervisor.notifier,
        &recorder,
    );
    drop(announced);
    ended
}

/// What tells the supervisor how this process does.
struct Supervisor {
    notifier: Notifier,
    /// What the real-time thread was granted, as soon as that is known; READY comes later.
    grants: Arc<OnceLock<Grants>>,
}

fn supervisor(
    helpers: &Helpers,
    recorder: &Recorder,
    status: BoardReader<CycleStatus>,
    period_ns: u64,
) -> Result<Supervisor, Ending> {
    let grants = Arc::new(OnceLock::<Grants>::new());
    let granted = Arc::clone(&grants);
    let recorder = recorder.clone();
    let mut hangs = helpers.watch(move |hang| {
        error!("{hang}");
        recorder.tell(Kind::HelperHangs {
            helper: hang.helper.to_owned(),
            silent_ms: milliseconds(hang.silent),
            limit_ms: milliseconds(hang.limit),
        });
    });
    let none = Grants::default();
    let notifier = Notifier::start(helpers, move || {
        let grants = granted.get().unwrap_or(&none);
        let mut status = status.read();
        if status.cycle == 0 {
            // READY may come before the first cycle.
            status.period_ns = period_ns;
        }
        hangs.look(pulse(&status, grants))
    })?;
    Ok(Supervisor { notifier, grants })
}

fn milliseconds(time: Duration) -> u64 {
    time.as_millis().try_into().unwrap_or(u64::MAX)
}

/// What primitives cost on this machine: what nets are admitted by.
fn costs() -> Costs {
    let begun = Instant::now();
    let (costs, origin) = cache::costs(false);
    let took = begun.elapsed();
    match origin {
        Origin::Read(path) => info!("costs of primitives are those of {}", path.display()),
        Origin::Measured(path) => {
            info!(
                "costs of primitives measured in {took:.1?}, kept in {}",
                path.display()
            );
        }
        Origin::NotKept(why) => {
            warn!("costs of primitives measured in {took:.1?}, and at each start again: {why}");
        }
    }
    costs
}

/// The flight recorder, who writes its files, and how these hear of each other.
#[derive(Default)]
struct Flight {
    recorder: Option<FlightRecorder>,
    scribe: Option<Scribe>,
    made: Option<Sender<Made>>,
    recordings: Recordings,
}

/// Nothing if the configuration gives it no memory.
fn flight_recorder(config: &CellConfig, cell: &Cell, incarnation: u64) -> Flight {
    let recorder = &config.recorder;
    if recorder.memory == 0 {
        return Flight::default();
    }
    let wanted = FlightConfig {
        span_ns: recorder.span_ns,
        memory: recorder.memory,
        period_ns: config.period_ns,
    };
    let (flight, helper) = FlightRecorder::new(wanted, config.devices.len());
    let about = About {
        cell: cell.clone(),
        config: config.source.display().to_string(),
        configuration: config.fingerprint(),
        incarnation,
        period_ns: config.period_ns,
        devices: config
            .devices
            .iter()
            .map(|device| device.name.clone())
            .collect(),
        models: config.models(),
        recorder: recorder.clone(),
    };
    let (scribe, made, recordings) = Scribe::new(about, helper);
    Flight {
        recorder: Some(flight),
        scribe: Some(scribe),
        made: Some(made),
        recordings,
    }
}

/// What becomes of a cell that must be real-time on a system that does not let it.
fn refused(grants: &Grants) -> String {
    format!(
        "not started: {}; the configuration says `executor: {{rt: required}}` (under systemd: the unit's limits; \
         otherwise /etc/security/limits.d and a new login; `rcc-cli doctor` says more)",
        grants.refusals.join("; ")
    )
}

/// For the supervisor: progress is the number of the cycle, the words are what a person wants to see first.
fn pulse(status: &CycleStatus, grants: &Grants) -> Pulse {
    let hertz = 1e9 / status.period_ns.max(1) as f64;
    let grade = match grants.refusals.as_slice() {
        [] => "RT granted".to_owned(),
        refusals => format!("DEGRADED: not real-time: {}", refusals.join("; ")),
    };
    let nets = match status.running {
        1 => "1 net".to_owned(),
        nets => format!("{nets} nets"),
    };
    Pulse {
        progress: status.cycle,
        status: format!(
            "{hertz:.0} Hz, {nets}, {} late cycles (last {}), longest cycle {:.1} µs; {grade}",
            status.late,
            status.last_late.cycle,
            status.exec_max_ns as f64 * 1e-3
        ),
    }
}

fn make_boards(session: &Session, config: &CellConfig) -> Result<Boards, BoardError> {
    let commands = config
        .devices
        .iter()
        .map(|device| session.create_commands(&command_board(&device.name)));
    Ok(Boards {
        status: session.create_board(STATUS)?,
        tables: session.create_board(TABLES)?,
        timing: session.create_board(TIMING)?,
        helpers: session.create_board(HELPERS)?,
        // Of the threads, once they are made.
        beats: Box::default(),
        commands: commands.collect::<Result<_, _>>()?,
    })
}

/// Starts the real-time thread, which tells what it was granted before its first cycle.
fn start_rt(
    engine_config: EngineConfig,
    (ends, flight): (RtEnds, Option<FlightRecorder>),
    boards: Boards,
    config: &CellConfig,
    mut grants: Grants,
    stop: &Arc<AtomicBool>,
) -> Result<(RtThread, Grants), Ending> {
    let (period_ns, executor) = (config.period_ns, config.executor.clone());
    let follow = config.clock.map(|clock| Follow {
        // At most 16 devices.
        device: clock.device as u32,
        offset_ns: clock.offset_ns,
    });
    let budget_ns = config.budget_ns();
    let (told, tell) = mpsc::channel();
    let ended = Arc::new(AtomicBool::new(false));
    let end = RtEnd {
        stop: Arc::clone(stop),
        ended: Arc::clone(&ended),
    };
    let stop = Arc::clone(stop);
    let thread = thread::Builder::new().name("rcc-rt".into());
    let thread = thread.spawn(move || {
        let _end = end;
        let engine = Engine::new(engine_config, ends).with_budget(budget_ns);
        let engine = match flight {
            Some(flight) => engine.recorded_by(flight),
            None => engine,
        };
        prefault_stack();
        // Last: what is made above takes milliseconds, and would keep another cell's executor of this priority from
        // its core.
        promote_thread(executor.priority, executor.core, &mut grants);
        let engine = engine.with_grants(grants.bits);
        // The receiver waits for it; if it is gone the process is ending.
        let _ = told.send(grants);
        drop(told);
        let clock = Clock::new(period_ns, follow, monotonic_ns());
        rt::run(engine, boards, clock, &stop);
    });
    let thread = thread.map_err(|error| Ending {
        code: ending::FAILED,
        words: format!("the system gives no real-time thread ({error}): raise TasksMax= or pids.max of its group"),
    })?;
    Ok((RtThread { thread, ended }, tell.recv()?))
}

/// The real-time thread.
struct RtThread {
    thread: thread::JoinHandle<()>,
    /// It ended although nobody asked it to. Written by [`RtEnd`] (Release), read by the main thread (Acquire).
    ended: Arc<AtomicBool>,
}

/// Dropped by the real-time thread when it ends, also by a panic.
struct RtEnd {
    stop: Arc<AtomicBool>,
    ended: Arc<AtomicBool>,
}

impl Drop for RtEnd {
    fn drop(&mut self) {
        // Set by the main thread with Release before it waits for this end.
        if !self.stop.load(Ordering::Acquire) {
            self.ended.store(true, Ordering::Release);
            request_stop();
        }
    }
}

/// The threads that carry what the real-time thread says and is told.
fn spawn_helpers(
    helpers: &Helpers,
    mut intake: Intake,
    mut pump: Pump,
    scribe: Option<Scribe>,
) -> io::Result<()> {
    helpers.spawn("intake", TURN_MAX, move |helper| {
        while !helper.is_over() {
            helper.turn();
            if !intake.round() {
                thread::sleep(POLL_EVERY);
            }
        }
    })?;
    helpers.spawn("pump", TURN_MAX, move |helper| {
        while !helper.is_over() {
            helper.turn();
            pump.round();
            thread::sleep(PUMP_EVERY);
        }
        pump.round();
    })?;
    if let Some(scribe) = scribe {
        helpers.spawn("incidents", WRITE_MAX, move |helper| scribe.run(helper))?;
    }
    Ok(())
}

/// Waits for a signal, or for the end of a thread that should not end; then the nets are canceled, and all threads end.
fn run_until_stopped(
    helpers: &Helpers,
    rt: RtThread,
    stop: &Arc<AtomicBool>,
    signals: &Stop,
    supervisor: &Notifier,
    recorder: &Recorder,
) -> Result<(), Ending> {
    let signal = signals.wait();
    let failed = |words: String| Ending {
        code: ending::FAILED,
        words,
    };
    let mut ended = helpers.conclude();
    if rt.ended.load(Ordering::Acquire) {
        let words = "the real-time thread panicked: the drivers bring their devices to rest, and this process ends to be \
                     started again";
        ended = Err(failed(words.to_owned()));
    }
    match &ended {
        Err(Ending { words, .. }) => {
            error!("{words}");
            let why = events::text(words);
            recorder.tell(Kind::HelperEnded { why });
        }
        Ok(()) => {
            info!("{signal}: stopping");
            let why = signal.to_string();
            recorder.tell(Kind::Stopping { why });
            supervisor.stopping();
        }
    }
    stop.store(true, Ordering::Release);
    if rt.thread.join().is_err() {
        error!("the real-time thread panicked");
    }
    helpers.end();
    let stuck = helpers.join(FAREWELL, &["events"]);
    if ended.is_ok() && !stuck.is_empty() {
        let names = stuck.join(", ");
        ended = Err(failed(format!(
            "helper threads that did not end within {FAREWELL:?}: {names}"
        )));
    }
    ended
}
