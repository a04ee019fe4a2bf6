//! The demo: figures 3, 4 and 5 of the paper and a cancel, on a simulated robot with all processes, verified from
//! recorded data. Runs on the main thread, which also supervises the demo's cell.

pub mod checks;
pub mod facts;
pub mod progress;
pub mod recorder;
pub mod runner;
pub mod simulator;
pub mod verify;

use std::cell::Cell;
use std::rc::Rc;
use std::time::{Duration, Instant};

use rcc_api::bodies::StatusView;
use rcc_api::codes::{self, exit};
use rcc_core::kinematics::Arm;
use rcc_core::primitive::ChannelKind;
use serde_json::json;

use crate::client::LoaderClient;
use crate::context::{Context, OutputFormat};
use crate::dashboard::{Dashboard, DashboardArguments};
use crate::failure::Failure;
use crate::follow;
use crate::interrupt::Interrupts;
use crate::output::{BackgroundPrinter, print_line, print_record};
use crate::supervisor::processes::PreparedCell;
use crate::supervisor::{POLL_INTERVAL, Supervisor, SupervisorEvent, paths, processes};
use crate::table::{counted, grouped, time};
use checks::{MotionEvent, RecordedMotion, checks, monitor_index};
use progress::{Bar, MotionProgress};
use recorder::MonitorRecorder;
use runner::{DemoRunner, NetRun, simulator_failed};
use simulator::SimulatorClient;
use verify::MotionCheck;

/// One motion of the demo.
struct DemoFigure {
    title: &'static str,
    file: &'static str,
    /// Start position of the flange, base frame, m.
    start: [f64; 3],
    event: MotionEvent,
}

/// Two start positions (m): near the start configuration of the simulated arm, and 0.15 m to the side.
const MIDDLE: [f64; 3] = [0.538, 0.0, 0.384];
const SIDE: [f64; 3] = [0.538, 0.15, 0.384];

const FIGURES: [DemoFigure; 4] = [
    DemoFigure {
        title: "figure 3: line",
        file: "nets/line.yaml",
        start: MIDDLE,
        event: MotionEvent::None,
    },
    DemoFigure {
        title: "figure 4: contact",
        file: "nets/guarded-line.yaml",
        start: SIDE,
        event: MotionEvent::Contact,
    },
    DemoFigure {
        title: "figure 5: torch",
        file: "nets/welding-line.yaml",
        start: SIDE,
        event: MotionEvent::Weld,
    },
    DemoFigure {
        title: "figure 5: cancel",
        file: "nets/welding-line.yaml",
        start: SIDE,
        event: MotionEvent::Cancel,
    },
];

/// Names of the arm, its simulator and its torch in the demo's configuration.
const ARM: &str = "lwr";
const SIMULATOR: &str = "lwr-sim";
const TORCH: &str = "torch";
/// Stiffness of the floor, N/m.
const STIFFNESS: f64 = 3000.0;
/// Figures disturbed by a late machine are repeated until this time after the start.
const REPEAT_TIMEOUT: Duration = Duration::from_secs(35);
/// Attempts to approach a start position: a busy machine loses the connection now and then.
const APPROACH_ATTEMPTS_MAX: usize = 5;

/// Runs the demo.
///
/// # Errors
/// Fails if the cell does not start or a check does not hold.
pub fn run(context: &Context, open: bool) -> Result<(), Failure> {
    let started = Instant::now();
    let interrupts = Interrupts::listen()?;
    let prepared = processes::prepare(&paths::config("cells/demo.yaml")?)?;
    let own = format!("demo-{}", std::process::id());
    let name = context.cell.clone().unwrap_or(own);
    let json = context.format == OutputFormat::Json;
    let starting = Rc::new(Cell::new(!json));
    let verbose = Rc::clone(&starting);
    let printer = BackgroundPrinter::start();
    let event_printer = printer.clone();
    let print_event = move |line: &SupervisorEvent| {
        if verbose.get() || is_trouble(&line.what) {
            let at = line.at.as_secs_f64();
            event_printer.print_note(&format!("  {at:7.3} s  {:<20} {}", line.who, line.what));
        }
    };
    if !json {
        printer.print_line(&format!(
            "RCC demo: simulated KUKA LWR 4+ and I/O station on loopback; cell {name}"
        ));
    }
    let mut supervisor = Supervisor::start(&name, prepared.clone(), Box::new(print_event))?;
    let mut dashboard = None;
    let played = supervisor.wait_until_up(&interrupts).and_then(|()| {
        starting.set(false);
        if open {
            dashboard = Some(show_dashboard(&name, &printer, json)?);
        }
        run_figures(context, &mut supervisor, (&interrupts, &printer), &prepared)
    });
    if dashboard.is_some() && played.is_ok() {
        printer.print_note("the cell stays for the dashboard: Ctrl-C ends it");
        while !interrupts.asked() && !supervisor.is_over() {
            supervisor.poll();
            std::thread::sleep(POLL_INTERVAL);
        }
    }
    // It leaves the cell before the cell ends.
    drop(dashboard);
    starting.set(false);
    let kept = supervisor.cell.state_anchor().to_owned();
    let clean = supervisor.stop(&interrupts);
    // Flushed before the report, which is the demo's result: it is printed, or that is an error.
    printer.finish();
    let (results, status) = played?;
    report(
        context,
        &results,
        &status,
        clean,
        started.elapsed().as_secs_f64(),
    );
    let holds = results
        .iter()
        .flat_map(|(_, checks)| checks)
        .all(|check| check.holds);
    if holds && clean {
        // Only a demo that failed leaves its event log and logs: each demo is a cell of its own.
        let _ = std::fs::remove_dir_all(kept);
        Ok(())
    } else {
        Err(Failure::reported(exit::FAILED))
    }
}

/// Starts the dashboard of the demo's cell, prints its address and opens it.
fn show_dashboard(
    cell: &str,
    printer: &BackgroundPrinter,
    json: bool,
) -> Result<Dashboard, Failure> {
    let dashboard = Dashboard::start(cell, &DashboardArguments::default())?;
    match json {
        // The result is the only record on the standard output.
        true => printer.print_note(&dashboard.address),
        false => printer.print_line(&format!("  dashboard: {}", dashboard.address)),
    }
    dashboard.show();
    Ok(dashboard)
}

fn is_trouble(what: &str) -> bool {
    ["died", "failed", "restarting", "  |", "left behind"]
        .iter()
        .any(|begin| what.starts_with(begin))
}

type FigureResults = Vec<(&'static str, Vec<MotionCheck>)>;

fn run_figures(
    context: &Context,
    supervisor: &mut Supervisor,
    (interrupts, printer): (&Interrupts, &BackgroundPrinter),
    prepared: &PreparedCell,
) -> Result<(FigureResults, StatusView), Failure> {
    let cell = supervisor.cell.clone();
    let timeout = context.timeout.max(Duration::from_secs(5));
    let client = LoaderClient::new(cell.name(), &cell.socket(), timeout)?;
    let setting = DemoArm::of(prepared)?;
    let recorder = MonitorRecorder::start(&cell)?;
    let control = cell.simulator_socket(SIMULATOR);
    let mut simulator = SimulatorClient::connect(&control).map_err(simulator_failed)?;
    let quiet = context.format == OutputFormat::Json;
    let status: StatusView = client.get("/status")?;
    if !quiet {
        printer.print_line(&format!("  {}", status.executor.grade));
        printer.print_line("");
    }
    let mut runner = DemoRunner {
        started: Instant::now(),
        supervisor,
        client: &client,
        recorder: &recorder,
        simulator: &mut simulator,
        interrupts,
        printer,
    };
    let mut results = Vec::new();
    for figure in &FIGURES {
        results.push((figure.title, measure(&mut runner, figure, &setting, quiet)?));
    }
    Ok((results, client.get("/status")?))
}

/// The demo's arm, as configured.
struct DemoArm {
    arm: Arm,
    torch_bit: u16,
    dt_s: f64,
}

impl DemoArm {
    fn of(prepared: &PreparedCell) -> Result<DemoArm, Failure> {
        let config = &prepared.config;
        let lacks = |what: &str| {
            Failure::new(
                codes::BAD_REQUEST,
                format!("{} has no {what}", prepared.path.display()),
                "use the demo's own configuration (RCC_CONFIGS)",
            )
        };
        let (_, device) = config.device(ARM).ok_or_else(|| lacks("device `lwr`"))?;
        let robot = device.robot.as_ref().ok_or_else(|| lacks("robot"))?;
        let torch = device
            .channel(ChannelKind::DigitalOutput, TORCH)
            .and_then(|channel| channel.address.as_u64())
            .filter(|address| (1..=16).contains(address))
            .ok_or_else(|| lacks("digital output `torch` with a number as address"))?;
        Ok(DemoArm {
            arm: robot.arm,
            torch_bit: 1 << (torch - 1),
            dt_s: config.period_ns as f64 * 1e-9,
        })
    }
}

/// Runs and checks one figure; repeats it if it failed while the machine was late or the connection was lost.
fn measure(
    runner: &mut DemoRunner<'_>,
    figure: &DemoFigure,
    setting: &DemoArm,
    quiet: bool,
) -> Result<Vec<MotionCheck>, Failure> {
    let path = paths::config(figure.file)?;
    let text = std::fs::read_to_string(&path)
        .map_err(|error| Failure::unreadable(&path.display().to_string(), &error))?;
    let facts = facts::read(figure.file, &text)?;
    loop {
        approach_start(runner, figure.start)?;
        let run = run_figure(runner, figure, &text, &facts, quiet);
        runner.simulator.no_floor().map_err(simulator_failed)?;
        let NetRun {
            command,
            records,
            exchanges,
            late,
        } = run?;
        let recorded = RecordedMotion {
            command: &command,
            facts: facts.clone(),
            records,
            exchanges,
            arm: setting.arm,
            torch_bit: setting.torch_bit,
            dt_s: setting.dt_s,
        };
        let checks = checks(&recorded, figure.event);
        let failed: Vec<&MotionCheck> = checks.iter().filter(|check| !check.holds).collect();
        let disturbed = late > 0 || command.command.fault.is_some();
        if failed.is_empty() || !disturbed || runner.started.elapsed() > REPEAT_TIMEOUT {
            return Ok(checks);
        }
        let whats: Vec<&str> = failed.iter().map(|check| check.what.as_str()).collect();
        runner.printer.print_note(&format!(
            "  repeating the measurement: {}, or the connection was lost ({})",
            counted(late, "late cycle"),
            whats.join("; ")
        ));
    }
}

/// Moves the arm to the start position of a figure.
fn approach_start(runner: &mut DemoRunner<'_>, start: [f64; 3]) -> Result<(), Failure> {
    let mut last_state = String::new();
    for _ in 0..APPROACH_ATTEMPTS_MAX {
        let run = runner.run("approach", &approach_net(start), |_, _| false)?;
        let command = &run.command.command;
        if command.reason.as_deref() == Some("finished") {
            return Ok(());
        }
        last_state = follow::state_text(command);
    }
    Err(Failure::new(
        codes::PROCESS_FAILED,
        format!(
            "the approach to a figure's start pose ended {last_state}, {APPROACH_ATTEMPTS_MAX} times"
        ),
        "the demo needs an otherwise idle machine",
    ))
}

fn run_figure(
    runner: &mut DemoRunner<'_>,
    figure: &DemoFigure,
    text: &str,
    facts: &facts::MotionFacts,
    quiet: bool,
) -> Result<NetRun, Failure> {
    let way = verify::LineSegment {
        start: figure.start,
        end: facts.goal,
    };
    if figure.event == MotionEvent::Contact {
        let height = f64::midpoint(way.start[2], way.end[2]);
        runner
            .simulator
            .floor(height, STIFFNESS)
            .map_err(simulator_failed)?;
    }
    let torch = facts.torch_on.zip(facts.torch_off);
    let middle = torch.map_or(f64::INFINITY, |(on, off)| f64::midpoint(on, off));
    let mut bar = Bar::new(figure.title, quiet, runner.printer);
    let mut view = MotionProgress::default();
    let run = runner.run(figure.file, text, |recorder, command| {
        let newest = |source: &str| {
            monitor_index(command, source)
                .and_then(|index| recorder.newest(command.command.id, index))
        };
        view = MotionProgress {
            distance: newest("move.distance").unwrap_or(view.distance),
            speed: newest("move.speed"),
            force: newest("force.out"),
            torch: newest("burn.out").map(|value| value == 1.0),
            ..view
        };
        view.part = view.distance / way.length();
        bar.show(&view);
        figure.event == MotionEvent::Cancel && view.distance >= middle
    })?;
    let ended = &run.command.command;
    if !quiet {
        bar.end(&view, ended.reason.as_deref().unwrap_or(&ended.state));
    }
    Ok(run)
}

/// Returns a net that moves the flange to a point, with the tool pointing down.
fn approach_net([x, y, z]: [f64; 3]) -> String {
    format!(
        "net: approach
primitives:
  cancel: {{type: Cancel}}
  move:
    type: LinearMotion
    parameters:
      device: lwr
      to: {{xyz: [{x}, {y}, {z}], rpy: [0, deg(180), 0]}}
      velocity: 0.2 m/s
      acceleration: 1 m/s^2
      jerk: 10 m/s^3
    inputs: {{stop: cancel.requested}}
  ik:    {{type: InverseKinematics, parameters: {{device: lwr}}, inputs: {{pose: move.pose}}}}
  robot: {{type: JointPositionCommand, parameters: {{device: lwr}}, inputs: {{position: ik.joints}}}}
  end:   {{type: Termination, inputs: {{done: move.done}}}}
"
    )
}

fn report(
    context: &Context,
    results: &FigureResults,
    status: &StatusView,
    clean: bool,
    seconds: f64,
) {
    let checks = || results.iter().flat_map(|(_, checks)| checks);
    let (all, held) = (
        checks().count(),
        checks().filter(|check| check.holds).count(),
    );
    if context.format == OutputFormat::Json {
        let row = |figure: &str, check: &MotionCheck| {
            json!({"figure": figure, "what": check.what, "expected": check.expected, "found": check.found,
                   "holds": check.holds})
        };
        let rows: Vec<_> = results
            .iter()
            .flat_map(|(figure, checks)| checks.iter().map(|check| row(figure, check)))
            .collect();
        let value = json!({"checks": rows, "late_cycles": status.executor.late, "cycles": status.executor.cycle,
                           "grade": status.executor.grade, "clean_end": clean, "seconds": seconds});
        print_record(&value.to_string());
        return;
    }
    print_line("\nVerified against the recorded values and the datagrams on the wire:");
    for (title, checks) in results {
        print_line(&format!("  {title}"));
        for check in checks {
            let mark = if check.holds { "ok  " } else { "FAIL" };
            print_line(&format!(
                "    {mark}  {:<44} {}  (expected: {})",
                check.what, check.found, check.expected
            ));
        }
    }
    let executor = &status.executor;
    print_line(&format!(
        "  executor: {} of {}, longest cycle {}; {}",
        counted(executor.late, "late cycle"),
        grouped(executor.cycle),
        time(executor.exec_max_ns),
        executor.grade
    ));
    let end = if clean {
        "no process and no shared memory left behind"
    } else {
        "some files or processes were left behind"
    };
    print_line(&format!("  {held} of {all} hold; {end}; {seconds:.1} s"));
}
