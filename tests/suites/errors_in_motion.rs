//! System calls of a running cell fail while its arm moves, in each thread of each process: `strace` injects the
//! errors, several in a row. A motion that does not need the process finishes, and a process that ends reports the
//! reason.
//!
//! By default a sample of the errors is tried, evenly spread and the same in each run; `RCC_EVERY_SYSCALL=1` tries all.

use std::fs;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use nix::sys::signal::Signal;
use rcc_tests::injection::{ERRORS, NEVER_FAIL, can_trace, choose, panics_of_ours};
use rcc_tests::processes::{ends_with_test, signal, threads};
use rcc_tests::simulator::{ANSWERS_LOST, Simulator, assert_within_limits};
use rcc_tests::{UnsupervisedCell, await_some, nets};

/// Number of errors tried in each process by default.
const SAMPLE: usize = 5;
/// Number of errors in a row: more than a loop of three attempts survives.
const IN_A_ROW: u32 = 5;
/// Time for which the system calls of a process are recorded.
const LISTEN: Duration = Duration::from_millis(400);

/// An error in a system call of a thread.
#[derive(Clone, Debug)]
struct Case {
    thread: String,
    call: String,
    error: &'static str,
}

#[test]
fn errors_in_the_executor_while_the_arm_moves_fault_no_net() {
    fail_in_motion("executor");
}

#[test]
fn errors_in_the_fri_driver_while_the_arm_moves_bring_it_to_rest_at_worst() {
    fail_in_motion("lwr");
}

#[test]
fn errors_in_the_modbus_driver_change_no_motion() {
    fail_in_motion("io");
}

#[test]
fn errors_in_the_loader_change_no_motion() {
    fail_in_motion("loader");
}

fn fail_in_motion(process: &str) {
    if let Err(cause) = can_trace() {
        eprintln!("skipped: errors in {process} while the arm moves: {cause}");
        return;
    }
    let mut cell = UnsupervisedCell::demo();
    let mut arm = cell.simulator("lwr-sim");
    let all = every_case(&cell, process, &mut arm);
    assert!(!all.is_empty(), "{process} makes no system calls");
    let chosen = choose(&all, SAMPLE);
    let mut ended = 0;
    for (number, case) in chosen.iter().enumerate() {
        let y = if number % 2 == 0 { 0.1 } else { -0.1 };
        ended += u32::from(fail(&mut cell, process, case, &mut arm, y));
    }
    eprintln!(
        "{process}: {} of {} errors tried, each {IN_A_ROW} times in a row; it ended {ended} times, in an orderly way",
        chosen.len(),
        all.len()
    );
    cell.stop();
}

/// Returns each error in each system call that each thread of the process makes while the arm moves and the loader gets
/// a request.
fn every_case(cell: &UnsupervisedCell, process: &str, arm: &mut Simulator) -> Vec<Case> {
    let line = cell.run(&nets::line("listen", 0.1, 0.05));
    arm.await_motion();
    let file = cell.folder().join("listened.txt");
    let options = ["-f", "-qq", "-o", &file.display().to_string()].map(str::to_owned);
    let pid = cell.pid(process);
    let names = threads(pid);
    let strace = attach(pid, &options);
    std::thread::sleep(LISTEN);
    cell.try_rest("GET", "/status", "");
    detach(strace);
    // On a busy machine the motion may have ended already.
    cell.operate(line, "cancel");
    cell.await_end(line);
    cell.rest("DELETE", &format!("/commands/{line}"), "");
    let text = fs::read_to_string(file).expect("strace wrote it");
    let mut calls: Vec<(String, String)> = text
        .lines()
        .filter_map(|line| {
            let (thread, call) = line.split_once(' ')?;
            let id: u32 = thread.parse().ok()?;
            let (_, name) = names.iter().find(|(other, _)| *other == id)?;
            let call = call.trim_start().split('(').next()?;
            let plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_';
            let is_call =
                !call.is_empty() && call.bytes().all(plain) && !NEVER_FAIL.contains(&call);
            is_call.then(|| (name.clone(), call.to_owned()))
        })
        .collect();
    calls.sort();
    calls.dedup();
    let cases = calls.into_iter().flat_map(|(thread, call)| {
        ERRORS.map(|error| Case {
            thread: thread.clone(),
            call: call.clone(),
            error,
        })
    });
    cases.collect()
}

/// Runs a motion with errors in the middle; returns true if they ended the process.
fn fail(
    cell: &mut UnsupervisedCell,
    process: &str,
    case: &Case,
    arm: &mut Simulator,
    y: f64,
) -> bool {
    let Case {
        thread,
        call,
        error,
    } = case;
    arm.reset_statistics();
    let line = cell.run(&nets::line("line", y, 0.2));
    // If the last motion was ended at its start, this one is short and may be over before anybody looks.
    await_some("the arm to move or the line to end", || {
        let over = cell.state(line)["state"] == "terminated";
        (over || arm.has_moved()).then_some(())
    });
    let ids = threads(cell.pid(process));
    let Some((id, _)) = ids.iter().find(|(_, name)| name == thread) else {
        // The thread belonged to a pool, and has ended.
        cell.await_end(line);
        cell.rest("DELETE", &format!("/commands/{line}"), "");
        return false;
    };
    let inject = format!("inject={call}:error={error}:when=1..{IN_A_ROW}");
    let injected = cell.folder().join("injected.txt");
    let options = [
        "-qq",
        "-o",
        &injected.display().to_string(),
        "-e",
        &format!("trace={call}"),
        "-e",
        &inject,
    ];
    let mut strace = Some(attach(*id, &options.map(str::to_owned)));
    let over = await_some(&format!("the end of the motion with {case:?}"), || {
        // A thread that is traced for long misses its cycles.
        let text = fs::read_to_string(&injected).unwrap_or_default();
        if text.matches("(INJECTED)").count() >= IN_A_ROW as usize {
            strace.take().into_iter().for_each(detach);
        }
        if let Some(status) = cell.ended(process) {
            return Some(Err(status));
        }
        let reply = cell.try_rest("GET", &format!("/commands/{line}"), "")?;
        (reply.body["state"] == "terminated").then_some(Ok(reply.body))
    });
    strace.into_iter().for_each(detach);
    assert_within_limits(&arm.await_rest(), &ANSWERS_LOST);
    // An executor that has lost a helper thread cancels its nets and then exits.
    let over = match over {
        Ok(row) if process == "executor" && row["reason"] == "canceled" => {
            Err(await_some("the executor to end", || cell.ended(process)))
        }
        over => over,
    };
    match over {
        Ok(row) => {
            let finished = row["reason"] == "finished";
            assert!(
                finished || process == "lwr",
                "{process}, {case:?}: {row}\n{}",
                cell.logs()
            );
            cell.rest("DELETE", &format!("/commands/{line}"), "");
            false
        }
        Err(status) => {
            let log = cell.log(process);
            assert!(
                status.code().is_some_and(|code| code != 0) && log.contains("ERROR"),
                "{process}, {case:?}: {status}, its log: {log}"
            );
            assert!(!panics_of_ours(&log), "{case:?}: {log}");
            restart(cell, process);
            // Nets end with their executor; without one of the other processes they continue, and end by themselves.
            let reply = cell.rest("GET", &format!("/commands/{line}"), "");
            if reply.status == 200 {
                cell.await_end(line);
                cell.rest("DELETE", &format!("/commands/{line}"), "");
            }
            true
        }
    }
}

fn restart(cell: &mut UnsupervisedCell, process: &str) {
    cell.clean();
    match process {
        "executor" => drop(cell.start_executor()),
        "loader" => drop(cell.start_loader()),
        device => drop(cell.start_driver(device)),
    }
    cell.await_devices();
}

/// Attaches strace to a running thread or process; returns once it traces.
fn attach(id: u32, options: &[String]) -> Child {
    let mut command = Command::new("strace");
    command.args(options).args(["-p", &id.to_string()]);
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut child = ends_with_test(&mut command).spawn().expect("strace starts");
    await_some("strace to be attached", || {
        let text = fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
        let traced = text
            .lines()
            .any(|line| line.starts_with("TracerPid:") && !line.ends_with("\t0"));
        let gone = text.is_empty() || child.try_wait().expect("the child is ours").is_some();
        (traced || gone).then_some(())
    });
    child
}

fn detach(mut strace: Child) {
    signal(strace.id(), Signal::SIGINT);
    strace.wait().expect("the child is ours");
}
