//! `rcc-exec`: runs plans every cycle, in hard real time where the system grants it.
//!
//! The main thread sets everything up, starts the three threads and then waits for a signal.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::thread;

use clap::Parser;
use nix::sys::signal::{SigSet, Signal};
use rcc_config::cell::CellConfig;
use rcc_config::ports::PortArgument;
use rcc_exec::engine::{Engine, EngineConfig};
use rcc_exec::intake::{Intake, IntakeConfig, POLL_EVERY};
use rcc_exec::pump::{PUMP_EVERY, Pump};
use rcc_exec::queue::{HelperEnds, RtEnds, rings};
use rcc_exec::rt::{self, Boards};
use rcc_exec::setup::{Grants, lock_memory, prefault_stack, promote_thread};
use rcc_ipc::control::{CONTROL, RECORDS, STATUS, TABLES, command_board};
use rcc_ipc::{Announcement, Cell, Role, Session};
use tracing::{error, info, warn};

/// Runs the nets of a cell, every cycle.
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

/// Exit code of a configuration error: a supervisor need not try again (sysexits.h EX_CONFIG).
const EXIT_CONFIG: u8 = 78;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(false)
        .init();
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
    match execute(&arguments, &config) {
        Ok(()) => ExitCode::SUCCESS,
        Err(cause) => {
            error!("{cause}");
            ExitCode::FAILURE
        }
    }
}

type Failure = Box<dyn std::error::Error>;

fn execute(arguments: &Arguments, config: &CellConfig) -> Result<(), Failure> {
    let signals: SigSet = [Signal::SIGTERM, Signal::SIGINT].into_iter().collect();
    signals.thread_block()?;
    if arguments.parent_death {
        nix::sys::prctl::set_pdeathsig(Signal::SIGTERM)?;
    }
    let cell = Cell::new(&arguments.cell)?;
    let session = Session::join(&cell, Role::Executor, "exec")?;
    let mut grants = Grants::default();
    let (rt_ends, helper_ends) = rings();
    let models = config.models();
    let boards = make_boards(&session, config)?;
    let server = session.serve(CONTROL)?;
    let publisher = session.publisher(RECORDS)?;
    let announcement = Announcement::of(&session)
        .service(CONTROL, server.service())
        .service(STATUS, boards.status.service())
        .service(TABLES, boards.tables.service())
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
    };
    let HelperEnds {
        orders,
        outcomes,
        records,
        events,
    } = helper_ends;
    let intake = Intake::new(session, server, orders, outcomes, intake_config);
    let pump = Pump::new(records, events, publisher, names);
    let stop = Arc::new(AtomicBool::new(false));
    let (rt, grants) = start_rt(engine_config, rt_ends, boards, config, grants, &stop)?;
    info!("{grants}");
    let announced = cell.announce(&announcement.note(&grants.to_string()))?;
    run_helpers(intake, pump, rt, &stop, &signals);
    drop(announced);
    Ok(())
}

fn make_boards(session: &Session, config: &CellConfig) -> Result<Boards, Failure> {
    let commands = config
        .devices
        .iter()
        .map(|device| session.create_board(&command_board(&device.name)));
    Ok(Boards {
        status: session.create_board(STATUS)?,
        tables: session.create_board(TABLES)?,
        commands: commands.collect::<Result<_, _>>()?,
    })
}

/// Starts the real-time thread, which tells what it was granted before its first cycle.
fn start_rt(
    engine_config: EngineConfig,
    ends: RtEnds,
    boards: Boards,
    config: &CellConfig,
    mut grants: Grants,
    stop: &Arc<AtomicBool>,
) -> Result<(thread::JoinHandle<()>, Grants), Failure> {
    let (period_ns, executor) = (config.period_ns, config.executor.clone());
    let (told, tell) = mpsc::channel();
    let stop = Arc::clone(stop);
    let rt = thread::Builder::new()
        .name("rcc-rt".into())
        .spawn(move || {
            promote_thread(executor.priority, executor.core, &mut grants);
            prefault_stack();
            let engine = Engine::new(engine_config, ends, grants.bits);
            // The receiver waits for it; if it is gone the process is ending.
            let _ = told.send(grants);
            drop(told);
            rt::run(engine, boards, period_ns, &stop);
        })?;
    Ok((rt, tell.recv()?))
}

/// Runs the helper threads until a signal arrives and the real-time thread has ended.
fn run_helpers(
    mut intake: Intake,
    mut pump: Pump,
    rt: thread::JoinHandle<()>,
    stop: &Arc<AtomicBool>,
    signals: &SigSet,
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
        match signals.wait() {
            Ok(signal) => info!("{signal}: stopping"),
            Err(error) => warn!("signals cannot be awaited ({error}): stopping"),
        }
        stop.store(true, Ordering::Release);
        if rt.join().is_err() {
            error!("the real-time thread panicked");
        }
        over.store(true, Ordering::Release);
    });
}
