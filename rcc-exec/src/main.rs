//! `rcc-exec`: evaluates plans every cycle, in hard real time where the system grants it.
//!
//! The main thread sets everything up and creates all threads before it reports that it is ready; then it waits for a
//! signal. A helper thread that panics or ends unexpectedly triggers the same stop: nets are canceled, arms come to
//! rest, and the process ends with a failure so that its supervisor restarts it. A helper thread that hangs stops the
//! heartbeat.

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
use rcc_core::counted::Counted;
use rcc_core::message::CycleStatus;
use rcc_engine::costs::Costs;
use rcc_engine::costs::cache::{self, CostsSource};
use rcc_engine::engine::EngineConfig;
use rcc_engine::queue::{HelperRingEnds, RtRingEnds, rings};
use rcc_engine::record::{FlightRecorder, FlightRecorderConfig};
use rcc_exec::boards::{Engine, SharedMemory};
use rcc_exec::clock::{Clock, FollowedDevice};
use rcc_exec::ids::IdBlocks;
use rcc_exec::incidents::{IncidentContext, IncidentWriter, PreparedNet, RecordingResults};
use rcc_exec::intake::{Intake, IntakeConfig};
use rcc_exec::pump::{PUMP_EVERY, Pump, PumpedDevice};
use rcc_exec::rt::{self, Boards};
use rcc_exec::rule_texts::RuleTexts;
use rcc_exec::setup::{Grants, lock_memory, prefault_stack, promote_thread};
use rcc_ipc::events::{self, EventRecorder};
use rcc_ipc::{BoardError, BoardReader, Cell, CommandWriter, Session};
use rcc_os::clock::monotonic_ns;
use rcc_process::priority::raise_stop_thread;
use rcc_process::signals::request_stop;
use rcc_process::{CellArguments, ExitError, HealthReport, Helpers, Notifier, Stop, exit};
use rcc_protocol::announcement::EXECUTOR_LABEL;
use rcc_protocol::control::{CONTROL, HELPERS, RECORDS, STATUS, TABLES, TIMING, command_board};
use rcc_protocol::events::{EventKind, event_text};
use rcc_protocol::{Configuration, Role};
use tracing::{error, info, warn};

/// Maximum time between two heartbeats of the threads `intake` and `pump`.
const TURN_MAX: Duration = Duration::from_secs(5);
/// Maximum time for one line of the event log, on a slow disk.
const SLOW_TURN_MAX: Duration = Duration::from_secs(10);
/// Maximum time for one write to an incident file, or for its final sync, on a slow disk.
const WRITE_MAX: Duration = Duration::from_secs(60);
/// Maximum time for the helper threads to end after the real-time thread.
const HELPER_END_MAX: Duration = Duration::from_secs(5);

/// Runs the nets of a cell, every cycle.
#[derive(Parser)]
#[command(version = rcc_protocol::version::version())]
struct Arguments {
    #[command(flatten)]
    cell: CellArguments,
}

fn main() -> ExitCode {
    let Arguments { cell } = Arguments::parse();
    rcc_process::begin();
    exit::conclude(execute(&cell))
}

fn execute(arguments: &CellArguments) -> Result<(), ExitError> {
    let signals = Stop::prepare(arguments.parent_death)?;
    let config = &arguments.load()?;
    let cell = Cell::new(&arguments.cell)?;
    cell.make_state(config.recorder.folder.as_deref())?;
    let costs = costs();
    let session = Session::join(&cell, Role::Executor, EXECUTOR_LABEL)?;
    let mut grants = Grants::default();
    let helpers = Helpers::default();
    let writer = helpers.helper("events", SLOW_TURN_MAX);
    let turn = move || writer.turn();
    let recorder = EventRecorder::watched(&cell, Role::Executor, session.label(), turn)?;
    let (rt_ends, helper_ends) = rings();
    let models = config.models();
    let mut boards = make_boards(&session)?;
    let commands = make_command_boards(&session, config)?;
    let status = session.open_board::<CycleStatus>(boards.status.service())?;
    let server = session.serve(CONTROL)?;
    let publisher = session.publisher(RECORDS)?;
    let announcement = session
        .announcement()
        .configured(Configuration::new(config.identity()))
        .service(CONTROL, server.service())
        .service(STATUS, boards.status.service())
        .service(TABLES, boards.tables.service())
        .service(TIMING, boards.timing.service())
        .service(HELPERS, boards.helpers.service())
        .service(RECORDS, publisher.service());
    let announcement =
        config
            .devices
            .iter()
            .zip(&commands)
            .fold(announcement, |announcement, (device, board)| {
                announcement.service(&command_board(&device.name), board.service())
            });
    let (ids, first_id) = IdBlocks::claim(&cell)?;
    lock_memory(&mut grants);
    let engine_config = EngineConfig {
        incarnation: session.incarnation(),
        first_id,
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
        names,
        models,
        configuration: config.fingerprint(),
        period_ns: config.period_ns,
        stale_after_ns: config.stale_after_ns,
        costs,
        helpers: helpers.clone(),
        status: session.open_board(boards.status.service())?,
        announcement: announcement.clone(),
        ids,
    };
    let HelperRingEnds {
        requests,
        replies,
        records,
        events,
    } = helper_ends;
    let FlightRecorderParts {
        recorder: flight,
        incident_writer,
        prepared,
        recordings,
    } = flight_recorder(config, &cell, session.incarnation());
    let rule_texts = RuleTexts::default();
    let incident_writer = incident_writer.map(|writer| {
        let writer = writer.with_event_log(recorder.clone());
        writer.with_rule_texts(rule_texts.clone())
    });
    let intake = Intake::new(session, server, requests, replies, intake_config)?;
    let intake = intake
        .with_event_log(recorder.clone())
        .with_incident_writer(prepared, recordings)
        .with_rule_texts(rule_texts);
    let pumped = config.devices.iter().map(|device| PumpedDevice {
        name: device.name.clone(),
        linear: device.model().is_linear(),
    });
    let pump = Pump::new(records, events, publisher, pumped.collect());
    let pump = pump.with_event_log(&cell, recorder.clone());
    spawn_helpers(&helpers, intake, pump, incident_writer)?;
    let supervisor = supervisor(&helpers, &recorder, status, config.period_ns)?;
    boards.beats = helpers.beats();
    let stop = Arc::new(AtomicBool::new(false));
    let (rt, grants) = start_rt(
        engine_config,
        (rt_ends, flight),
        (boards, commands),
        config,
        grants,
        &stop,
    )?;
    info!("{grants}");
    if config.executor.rt == RealTime::Required && !grants.refusals.is_empty() {
        stop.store(true, Ordering::Release);
        // The thread has run a few cycles that nobody could observe; how it ended does not matter.
        let _ = rt.thread.join();
        return Err(ExitError::not_permitted(&not_permitted_message(&grants)));
    }
    // Shown in the status line. Nothing has set it before.
    let _ = supervisor.grants.set(grants.clone());
    let predecessor = events::predecessor(&cell, Role::Executor, &announcement.label);
    let announced = cell.announce(&announcement.note(&grants.to_string()))?;
    recorder.tell(EventKind::Started {
        note: event_text(&grants.to_string()),
        predecessor,
    });
    helpers.start();
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

/// The connection to the supervisor (sd_notify).
struct SupervisorLink {
    notifier: Notifier,
    /// The privileges of the real-time thread, once they are known; READY comes later.
    grants: Arc<OnceLock<Grants>>,
}

fn supervisor(
    helpers: &Helpers,
    recorder: &EventRecorder,
    status: BoardReader<CycleStatus>,
    period_ns: u64,
) -> Result<SupervisorLink, ExitError> {
    let grants = Arc::new(OnceLock::<Grants>::new());
    let granted = Arc::clone(&grants);
    let recorder = recorder.clone();
    let mut hangs = helpers.watch(move |hang| {
        error!("{hang}");
        recorder.tell(EventKind::HelperHangs {
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
            // READY may be sent before the first cycle.
            status.period_ns = period_ns;
        }
        hangs.check(pulse(&status, grants))
    })?;
    Ok(SupervisorLink { notifier, grants })
}

fn milliseconds(time: Duration) -> u64 {
    time.as_millis().try_into().unwrap_or(u64::MAX)
}

/// Returns the measured cost of each primitive on this machine, which decides whether nets are admitted.
fn costs() -> Costs {
    let begun = Instant::now();
    let (costs, origin) = cache::costs(false);
    let took = begun.elapsed();
    match origin {
        CostsSource::Read(path) => info!("using the primitive costs of {}", path.display()),
        CostsSource::Measured(path) => {
            info!(
                "measured primitive costs in {took:.1?}, saved in {}",
                path.display()
            );
        }
        CostsSource::NotKept(why) => {
            warn!(
                "measured primitive costs in {took:.1?}; they are measured again at each start, because they cannot be saved: {why}"
            );
        }
    }
    costs
}

/// The flight recorder, the writer of its files, and the channels between them.
#[derive(Default)]
struct FlightRecorderParts {
    recorder: Option<FlightRecorder>,
    incident_writer: Option<IncidentWriter>,
    prepared: Option<Sender<PreparedNet>>,
    recordings: RecordingResults,
}

/// Creates the flight recorder; all parts are `None` if the configuration gives it no memory.
fn flight_recorder(config: &CellConfig, cell: &Cell, incarnation: u64) -> FlightRecorderParts {
    let recorder = &config.recorder;
    if recorder.memory == 0 {
        return FlightRecorderParts::default();
    }
    let wanted = FlightRecorderConfig {
        span_ns: recorder.span_ns,
        memory: recorder.memory,
        period_ns: config.period_ns,
    };
    let (flight, helper) = FlightRecorder::new(wanted, config.devices.len());
    let context = IncidentContext {
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
    let (incident_writer, prepared, recordings) = IncidentWriter::new(context, helper);
    FlightRecorderParts {
        recorder: Some(flight),
        incident_writer: Some(incident_writer),
        prepared: Some(prepared),
        recordings,
    }
}

/// Returns the message for a cell that requires real time on a system that does not grant it.
fn not_permitted_message(grants: &Grants) -> String {
    format!(
        "not started: {}; the configuration says `executor: {{rt: required}}` (under systemd: the unit's limits; \
         otherwise /etc/security/limits.d and a new login; `rcc-cli doctor` says more)",
        grants.refusals.join("; ")
    )
}

/// Returns the supervisor's view: the cycle number as progress, and a status line that begins with what a person wants
/// to know first.
fn pulse(status: &CycleStatus, grants: &Grants) -> HealthReport {
    let hertz = 1e9 / status.period_ns.max(1) as f64;
    let grade = match grants.refusals.as_slice() {
        [] => "RT granted".to_owned(),
        refusals => format!("DEGRADED: not real-time: {}", refusals.join("; ")),
    };
    let nets = Counted(u64::from(status.running), "net");
    let late = Counted(status.late, "late cycle");
    HealthReport {
        progress: status.cycle,
        status: format!(
            "{hertz:.0} Hz, {nets}, {late} (last {}), longest cycle {:.1} µs; {grade}",
            status.last_late.cycle,
            status.exec_max_ns as f64 * 1e-3
        ),
    }
}

fn make_boards(session: &Session) -> Result<Boards, BoardError> {
    Ok(Boards {
        status: session.create_board(STATUS)?,
        tables: session.create_board(TABLES)?,
        timing: session.create_board(TIMING)?,
        helpers: session.create_board(HELPERS)?,
        // Set once the threads exist.
        beats: Box::default(),
    })
}

/// Creates the boards with the set-points of all devices.
fn make_command_boards(
    session: &Session,
    config: &CellConfig,
) -> Result<Vec<CommandWriter>, BoardError> {
    let commands = config
        .devices
        .iter()
        .map(|device| session.create_commands(&command_board(&device.name)));
    commands.collect()
}

/// Starts the real-time thread, which reports its privileges before its first cycle.
fn start_rt(
    engine_config: EngineConfig,
    (ends, flight): (RtRingEnds<SharedMemory>, Option<FlightRecorder>),
    (boards, commands): (Boards, Vec<CommandWriter>),
    config: &CellConfig,
    mut grants: Grants,
    stop: &Arc<AtomicBool>,
) -> Result<(RtThread, Grants), ExitError> {
    let (period_ns, executor) = (config.period_ns, config.executor.clone());
    let follow = config.clock.map(|clock| FollowedDevice {
        // There are at most 16 devices.
        device: clock.device as u32,
        offset_ns: clock.offset_ns,
    });
    let budget_ns = config.budget_ns();
    let (grants_sender, grants_receiver) = mpsc::channel();
    let ended = Arc::new(AtomicBool::new(false));
    let end = RtEnd {
        stop: Arc::clone(stop),
        ended: Arc::clone(&ended),
    };
    let stop = Arc::clone(stop);
    let thread = thread::Builder::new().name("rcc-rt".into());
    let thread = thread.spawn(move || {
        let _end = end;
        let engine = Engine::with_boards(engine_config, ends, commands).with_budget(budget_ns);
        let engine = match flight {
            Some(flight) => engine.recorded_by(flight),
            None => engine,
        };
        prefault_stack();
        // Promoted last: the allocations above take milliseconds, and would keep another cell's executor of the same
        // priority from its core.
        promote_thread(executor.priority, executor.core, &mut grants);
        let engine = engine.with_grants(grants.bits);
        // The receiver waits for this; if it is gone, the process is ending.
        let _ = grants_sender.send(grants);
        drop(grants_sender);
        let clock = Clock::new(period_ns, follow, monotonic_ns());
        rt::run(engine, boards, clock, &stop);
    });
    let thread = thread.map_err(|error| ExitError {
        code: exit::FAILED,
        message: format!("cannot create the real-time thread ({error}): raise TasksMax= or pids.max of its control group"),
    })?;
    Ok((RtThread { thread, ended }, grants_receiver.recv()?))
}

/// Handle of the real-time thread.
struct RtThread {
    thread: thread::JoinHandle<()>,
    /// True if the thread ended without being asked to. Written by [`RtEnd`] (Release), read by the main thread
    /// (Acquire).
    ended: Arc<AtomicBool>,
}

/// Dropped when the real-time thread ends, by a panic or otherwise.
struct RtEnd {
    stop: Arc<AtomicBool>,
    ended: Arc<AtomicBool>,
}

impl Drop for RtEnd {
    fn drop(&mut self) {
        // The main thread sets it with Release before it waits for this end.
        if !self.stop.load(Ordering::Acquire) {
            self.ended.store(true, Ordering::Release);
            request_stop();
        }
    }
}

/// Starts the helper threads around the real-time thread.
fn spawn_helpers(
    helpers: &Helpers,
    mut intake: Intake,
    mut pump: Pump,
    incident_writer: Option<IncidentWriter>,
) -> io::Result<()> {
    helpers.spawn("intake", TURN_MAX, move |helper| {
        // Without permission this logs the consequence and lowers the nice value instead.
        raise_stop_thread();
        while !helper.is_over() {
            helper.turn();
            if !intake.round() {
                intake.wait();
            }
        }
    })?;
    helpers.spawn("pump", TURN_MAX, move |helper| {
        while !helper.is_over() {
            helper.turn();
            pump.round();
            thread::sleep(PUMP_EVERY);
        }
        pump.finish();
    })?;
    if let Some(mut incident_writer) = incident_writer {
        helpers.spawn("incidents", WRITE_MAX, move |helper| {
            incident_writer.run(helper)
        })?;
    }
    Ok(())
}

/// Waits for a signal, or for the unexpected end of a thread; then cancels the nets and ends all threads.
fn run_until_stopped(
    helpers: &Helpers,
    rt: RtThread,
    stop: &Arc<AtomicBool>,
    signals: &Stop,
    supervisor: &Notifier,
    recorder: &EventRecorder,
) -> Result<(), ExitError> {
    let signal = signals.wait();
    let failed = |message: String| ExitError {
        code: exit::FAILED,
        message,
    };
    let mut ended = helpers.conclude();
    if rt.ended.load(Ordering::Acquire) {
        let message = "the real-time thread panicked: the drivers bring their devices to rest, and this process ends so that its \
                     supervisor restarts it";
        ended = Err(failed(message.to_owned()));
    }
    match &ended {
        Err(ExitError { message, .. }) => {
            error!("{message}");
            let why = event_text(message);
            recorder.tell(EventKind::HelperEnded { why });
        }
        Ok(()) => {
            info!("{signal}: stopping");
            let why = signal.to_string();
            recorder.tell(EventKind::Stopping { why });
            supervisor.stopping();
        }
    }
    stop.store(true, Ordering::Release);
    if rt.thread.join().is_err() {
        error!("the real-time thread panicked");
    }
    helpers.end();
    let stuck = helpers.join(HELPER_END_MAX, &["events"]);
    if ended.is_ok() && !stuck.is_empty() {
        let names = stuck.join(", ");
        ended = Err(failed(format!(
            "helper threads did not end within {HELPER_END_MAX:?}: {names}"
        )));
    }
    ended
}
