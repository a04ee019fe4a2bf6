//! `rcc-exec`: runs plans every cycle, in hard real time where the system grants it.
//!
//! The main thread sets everything up, starts the three threads and then waits for a signal.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::thread;
use std::time::Instant;

use clap::Parser;
use rcc_config::cell::{CellConfig, RealTime};
use rcc_core::message::CycleStatus;
use rcc_engine::costs::Costs;
use rcc_engine::costs::cache::{self, Origin};
use rcc_engine::engine::{Engine, EngineConfig};
use rcc_engine::queue::{HelperEnds, RtEnds, rings};
use rcc_engine::record::{Recorder as FlightRecorder, RecorderConfig as FlightConfig};
use rcc_exec::clock::{Clock, Follow};
use rcc_exec::incidents::{About, Made, Scribe};
use rcc_exec::intake::{Intake, IntakeConfig, POLL_EVERY};
use rcc_exec::pump::{PUMP_EVERY, Pump};
use rcc_exec::rt::{self, Boards};
use rcc_exec::setup::{Grants, lock_memory, prefault_stack, promote_thread};
use rcc_ipc::control::{CONTROL, RECORDS, STATUS, TABLES, TIMING, command_board};
use rcc_ipc::events::{self, Kind, Recorder};
use rcc_ipc::{Announcement, BoardError, Cell, Role, Session, monotonic_ns};
use rcc_process::{CellArguments, Ending, Notifier, Pulse, Stop, ending};
use tracing::{error, info, warn};

/// Runs the nets of a cell, every cycle.
#[derive(Parser)]
#[command(version)]
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
    let recorder = Recorder::start(&cell, Role::Executor, session.label())?;
    let (rt_ends, helper_ends) = rings();
    let models = config.models();
    let boards = make_boards(&session, config)?;
    let status = session.open_board::<CycleStatus>(boards.status.service())?;
    let server = session.serve(CONTROL)?;
    let publisher = session.publisher(RECORDS)?;
    let announcement = Announcement::of(&session)
        .service(CONTROL, server.service())
        .service(STATUS, boards.status.service())
        .service(TABLES, boards.tables.service())
        .service(TIMING, boards.timing.service())
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
    };
    let HelperEnds {
        orders,
        outcomes,
        records,
        events,
    } = helper_ends;
    let (flight, scribe, made) = flight_recorder(config, &cell, session.incarnation());
    let scribe = scribe.map(|scribe| scribe.recording(recorder.clone()));
    let intake = Intake::new(session, server, orders, outcomes, intake_config)?;
    let intake = intake.recording(recorder.clone()).telling(made);
    let pump = Pump::new(records, events, publisher, names);
    let pump = pump.recording(&cell, recorder.clone());
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
        let _ = rt.join();
        return Err(Ending::not_permitted(&refused(&grants)));
    }
    let predecessor = events::predecessor(&cell, Role::Executor, &announcement.label);
    let announced = cell.announce(&announcement.note(&grants.to_string()))?;
    recorder.tell(Kind::Started {
        note: events::text(&grants.to_string()),
        predecessor,
    });
    let supervisor = Notifier::ready(move || pulse(&status.read(), &grants))?;
    let helpers = Helpers {
        intake,
        pump,
        scribe,
    };
    run_helpers(helpers, rt, &stop, &signals, &supervisor, &recorder);
    drop(announced);
    Ok(())
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

/// The flight recorder and who writes its files, unless the configuration gives it no memory.
fn flight_recorder(
    config: &CellConfig,
    cell: &Cell,
    incarnation: u64,
) -> (Option<FlightRecorder>, Option<Scribe>, Option<Sender<Made>>) {
    let recorder = &config.recorder;
    if recorder.memory == 0 {
        return (None, None, None);
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
    let (scribe, made) = Scribe::new(about, helper);
    (Some(flight), Some(scribe), Some(made))
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
) -> Result<(thread::JoinHandle<()>, Grants), Ending> {
    let (period_ns, executor) = (config.period_ns, config.executor.clone());
    let follow = config.clock.map(|clock| Follow {
        // At most 16 devices.
        device: clock.device as u32,
        offset_ns: clock.offset_ns,
    });
    let budget_ns = config.budget_ns();
    let (told, tell) = mpsc::channel();
    let stop = Arc::clone(stop);
    let rt = thread::Builder::new()
        .name("rcc-rt".into())
        .spawn(move || {
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
        })?;
    Ok((rt, tell.recv()?))
}

/// What the helper threads own.
struct Helpers {
    intake: Intake,
    pump: Pump,
    scribe: Option<Scribe>,
}

/// Runs the helper threads until a signal arrives and the real-time thread has ended.
fn run_helpers(
    Helpers {
        mut intake,
        mut pump,
        scribe,
    }: Helpers,
    rt: thread::JoinHandle<()>,
    stop: &Arc<AtomicBool>,
    signals: &Stop,
    supervisor: &Notifier,
    recorder: &Recorder,
) {
    let over = Arc::new(AtomicBool::new(false));
    thread::scope(|scope| {
        // `over` is set below (Release) once the real-time thread has ended; both loops load it (Acquire).
        let done = Arc::clone(&over);
        scope.spawn(move || {
            while !done.load(Ordering::Acquire) {
                if !intake.round() {
                    thread::sleep(POLL_EVERY);
                }
            }
        });
        let done = Arc::clone(&over);
        scope.spawn(move || {
            while !done.load(Ordering::Acquire) {
                pump.round();
                thread::sleep(PUMP_EVERY);
            }
            pump.round();
        });
        if let Some(scribe) = scribe {
            let done = Arc::clone(&over);
            scope.spawn(move || scribe.run(|| done.load(Ordering::Acquire)));
        }
        match signals.wait() {
            Ok(signal) => {
                info!("{signal}: stopping");
                recorder.tell(Kind::Stopping {
                    why: signal.to_string(),
                });
            }
            Err(error) => warn!("signals cannot be awaited ({error}): stopping"),
        }
        supervisor.stopping();
        stop.store(true, Ordering::Release);
        if rt.join().is_err() {
            error!("the real-time thread panicked");
        }
        over.store(true, Ordering::Release);
    });
}
