//! Each system call of a program's start fails once: `strace` injects the error. The program works nevertheless, or
//! ends with an exit code and a message; it never hangs, nothing is left behind, and the next start succeeds.
//!
//! By default a sample of the errors is tried, evenly spread and the same in each run; `RCC_EVERY_SYSCALL=1` tries all.

use std::fs::{self, File};
use std::process::Stdio;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use rcc_protocol::Role;
use rcc_tests::cell_fixture::LIMIT;
use rcc_tests::injection::{
    ERRORS, NEVER_FAIL, SystemCall, calls_of, can_trace, choose, panics_of_ours, start_traced,
    tracee,
};
use rcc_tests::processes::signal;
use rcc_tests::{UnsupervisedCell, await_some, nets};

/// System calls with which the runtime of a Rust program checks its standard streams before `main`.
const FIRST: [&str; 2] = ["poll", "ppoll"];
/// Number of errors tried in each program by default.
const SAMPLE: usize = 12;
/// Interval at which a process is polled.
const LOOK: Duration = Duration::from_millis(5);

/// A program whose start is tested, and its names in the test cell.
struct StartTarget {
    name: &'static str,
    program: &'static str,
    arguments: &'static [&'static str],
    role: Role,
    label: &'static str,
}

/// Outcome of a start.
#[derive(Debug, PartialEq)]
enum StartOutcome {
    Works,
    /// Its exit code and its output on stderr.
    Ended(Option<i32>, String),
}

#[test]
fn an_error_at_the_start_of_the_executor_is_survived_or_reported() {
    fail_everywhere(&StartTarget {
        name: "executor",
        program: "rcc-exec",
        arguments: &[],
        role: Role::Executor,
        label: "exec",
    });
}

#[test]
fn an_error_at_the_start_of_the_fri_driver_is_survived_or_reported() {
    fail_everywhere(&StartTarget {
        name: "lwr",
        program: "rcc-driver",
        arguments: &["--device", "lwr"],
        role: Role::Driver,
        label: "lwr",
    });
}

#[test]
fn an_error_at_the_start_of_the_modbus_driver_is_survived_or_reported() {
    fail_everywhere(&StartTarget {
        name: "io",
        program: "rcc-driver",
        arguments: &["--device", "io"],
        role: Role::Driver,
        label: "io",
    });
}

#[test]
fn an_error_at_the_start_of_the_loader_is_survived_or_reported() {
    fail_everywhere(&StartTarget {
        name: "loader",
        program: "rcc-loader",
        arguments: &[],
        role: Role::Loader,
        label: "loader",
    });
}

fn fail_everywhere(victim: &StartTarget) {
    if let Err(cause) = can_trace() {
        eprintln!("skipped: errors at the start of {}: {cause}", victim.name);
        return;
    }
    let mut cell = UnsupervisedCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    arm.reset_statistics();
    cell.end(victim.name, Signal::SIGTERM);
    let calls = every_call(&cell, victim);
    let all: Vec<(SystemCall, &str)> = calls
        .iter()
        .flat_map(|call| ERRORS.map(|error| (call.clone(), error)))
        .collect();
    let chosen = choose(&all, SAMPLE);
    let mut worked = 0;
    let mut wrong = Vec::new();
    for (call, error) in &chosen {
        let outcome = start_with(&mut cell, victim, call, error);
        match &outcome {
            StartOutcome::Works => worked += 1,
            StartOutcome::Ended(Some(0), _) => {
                wrong.push(format!("{error} in {call:?}: {outcome:?}"))
            }
            StartOutcome::Ended(_, words) if words.is_empty() || panics_of_ours(words) => {
                wrong.push(format!("{error} in {call:?}: {outcome:?}"));
            }
            StartOutcome::Ended(..) => {}
        }
        cell.clean();
    }
    assert!(wrong.is_empty(), "{}:\n{}", victim.name, wrong.join("\n"));
    eprintln!(
        "{}: {} of {} errors tried, {worked} survived, the others reported",
        victim.name,
        chosen.len(),
        all.len()
    );
    match victim.name {
        "executor" => drop(cell.start_executor()),
        "loader" => drop(cell.start_loader()),
        device => drop(cell.start_driver(device)),
    }
    cell.await_devices();
    // Nothing moved meanwhile, and now everything works.
    arm.assert_not_moved();
    let line = cell.run(&nets::line("line", 0.1, 0.2));
    cell.assert_ends(line, "finished");
    cell.stop();
}

/// Traces a whole start; returns its system calls until the program works. Calls before `main` are left out: they are
/// made by the dynamic linker and by the start of the standard library, whose errors end any program in the same way.
fn every_call(cell: &UnsupervisedCell, victim: &StartTarget) -> Vec<SystemCall> {
    let file = cell.folder().join("calls.txt");
    let options = ["-o".to_owned(), file.display().to_string()];
    let mut strace = start_traced(
        cell,
        victim.program,
        victim.arguments,
        &options,
        Stdio::null(),
    );
    await_some(&format!("{} to work under strace", victim.name), || {
        let pid = tracee(&strace)?;
        works(cell, victim, pid).then(|| signal(pid, Signal::SIGKILL))
    });
    strace.wait().expect("the child is ours");
    cell.clean();
    let mut calls = calls_of(&file, |_, _| false);
    let start = calls
        .iter()
        .position(|(name, _)| FIRST.contains(&name.as_str()));
    calls.drain(..=start.expect("a Rust program asks whether its standard streams are open"));
    calls.retain(|(name, _)| !NEVER_FAIL.contains(&name.as_str()));
    assert!(calls.len() > 50, "{} system calls only", calls.len());
    calls
}

/// Starts the program with an error in one call; if it works nevertheless, it must end on SIGTERM.
fn start_with(
    cell: &mut UnsupervisedCell,
    victim: &StartTarget,
    (name, number): &SystemCall,
    error: &str,
) -> StartOutcome {
    let inject = format!("inject={name}:error={error}:when={number}");
    let path = cell.folder().join(format!("{}-injected.txt", victim.name));
    let stderr = File::create(&path).expect("a file can be written");
    let options = [
        "-o",
        "/dev/null",
        "-e",
        &format!("trace={name}"),
        "-e",
        &inject,
    ];
    let options = options.map(str::to_owned);
    let mut strace = start_traced(
        cell,
        victim.program,
        victim.arguments,
        &options,
        stderr.into(),
    );
    let begun = Instant::now();
    loop {
        if let Some(status) = strace.try_wait().expect("the child is ours") {
            let words = fs::read_to_string(&path).unwrap_or_default();
            return StartOutcome::Ended(status.code(), words);
        }
        if let Some(pid) = tracee(&strace)
            && works(cell, victim, pid)
        {
            signal(pid, Signal::SIGTERM);
            await_some(
                &format!("{} to end after {error} in {name} {number}", victim.name),
                || strace.try_wait().expect("the child is ours"),
            );
            return StartOutcome::Works;
        }
        assert!(
            begun.elapsed() < LIMIT,
            "{} hangs with {error} in {name} {number}: {}\n{}",
            victim.name,
            fs::read_to_string(&path).unwrap_or_default(),
            cell.logs()
        );
        std::thread::sleep(LOOK);
    }
}

/// Returns true if the process is announced and works: the executor runs nets, a driver exchanges data with its device,
/// the loader answers.
fn works(cell: &UnsupervisedCell, victim: &StartTarget, pid: u32) -> bool {
    let announced = cell.cell().announced(victim.role, victim.label);
    let Some(announced) = announced.ok().flatten() else {
        return false;
    };
    if announced.pid != pid || !announced.liveness().is_alive() {
        return false;
    }
    match victim.role {
        Role::Executor => runs_a_net(cell),
        Role::Loader => cell.try_rest("GET", "/status", "").is_some(),
        _ => exchanges(cell, victim.label, pid),
    }
}

/// Returns true if the device is ready and is served by this driver.
fn exchanges(cell: &UnsupervisedCell, device: &str, pid: u32) -> bool {
    let row = cell.device(device);
    row.is_some_and(|row| row["state"] == "ready" && row["pid"] == pid)
}

/// Loads, starts and cancels a net, which takes each helper thread of the executor. Returns false while the executor
/// does not answer.
fn runs_a_net(cell: &UnsupervisedCell) -> bool {
    let done = |method: &str, path: &str, body: &str| {
        let reply = cell.try_rest(method, path, body)?;
        (reply.status < 300).then_some(reply.body)
    };
    let Some(loaded) = done("POST", "/commands", &nets::clock("clock")) else {
        return false;
    };
    let id = loaded["id"].as_u64().unwrap_or(0);
    let state = await_some("the clock's net to be loaded", || {
        let reply = cell.try_rest("GET", &format!("/commands/{id}"), "")?;
        (reply.body["state"] != "loading").then_some(reply.body)
    });
    let runs = state["state"] == "ready"
        && done("POST", &format!("/commands/{id}/start"), "").is_some()
        && done("POST", &format!("/commands/{id}/cancel"), "").is_some();
    if runs {
        cell.assert_ends(id, "canceled");
    }
    done("DELETE", &format!("/commands/{id}"), "");
    runs
}
