//! A driver is killed before each system call from its start to its first exchange, and the loader up to its first
//! answer: `strace` injects the signal. No process hangs, the next start succeeds, nothing is left behind, and the
//! executor misses no cycle.
//!
//! By default a sample of the deaths is tried, evenly spread and the same in each run; `RCC_EVERY_SYSCALL=1` tries all.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use rcc_core::message::MonitorRecord;
use rcc_os::process_instance::ProcessInstance;
use rcc_tests::cell_fixture::{ExecutorBoards, LIMIT, files_below};
use rcc_tests::injection::{SystemCall, calls_of, can_trace, choose, start_traced, tracee};
use rcc_tests::processes::signal;
use rcc_tests::records::RecordCollector;
use rcc_tests::{UnsupervisedCell, await_some, nets};

/// Number of deaths tried in each program by default.
const SAMPLE: usize = 12;
/// Interval at which a process is polled.
const LOOK: Duration = Duration::from_millis(2);

/// A program that is killed, and how to determine that it works.
struct KillTarget {
    /// Name in the test cell.
    name: &'static str,
    program: &'static str,
    arguments: &'static [&'static str],
    /// Index among the devices, for a driver.
    device: Option<usize>,
    /// A net that keeps running without any device, with a monitor that records every cycle.
    bystander: fn() -> String,
}

#[test]
fn a_death_of_the_fri_driver_before_any_system_call_harms_no_other_process() {
    die_everywhere(&KillTarget {
        name: "lwr",
        program: "rcc-driver",
        arguments: &["--device", "lwr"],
        device: Some(0),
        bystander: || nets::input("bystander", "io", "lamp_on"),
    });
}

#[test]
fn a_death_of_the_modbus_driver_before_any_system_call_harms_no_other_process() {
    die_everywhere(&KillTarget {
        name: "io",
        program: "rcc-driver",
        arguments: &["--device", "io"],
        device: Some(1),
        bystander: || nets::input("bystander", "lwr", "contact"),
    });
}

#[test]
fn a_death_of_the_loader_before_any_system_call_harms_no_other_process() {
    die_everywhere(&KillTarget {
        name: "loader",
        program: "rcc-loader",
        arguments: &[],
        device: None,
        bystander: || nets::input("bystander", "io", "lamp_on"),
    });
}

fn die_everywhere(victim: &KillTarget) {
    if let Err(cause) = can_trace() {
        eprintln!(
            "skipped: deaths of {} before system calls: {cause}",
            victim.name
        );
        return;
    }
    let mut cell = UnsupervisedCell::demo();
    cell.run(&(victim.bystander)());
    let watch = cell.watch();
    let records = RecordCollector::follow(&cell);
    let (executor, before) = (cell.pid("executor"), watch.status());
    cell.end(victim.name, Signal::SIGKILL);
    let usual = left(&cell);

    let all = every_death(&cell, victim, &watch);
    let chosen = choose(&all, SAMPLE);
    let mut reached = 0;
    for death in &chosen {
        reached += usize::from(die(&cell, victim, &watch, death));
        cell.clean();
        start(&mut cell, victim, &watch);
        cell.end(victim.name, Signal::SIGKILL);
        let mut more = BTreeMap::new();
        let clean = becomes_true(|| {
            cell.clean();
            more = left(&cell);
            more.retain(|name, count| *count > usual.get(name).copied().unwrap_or(0));
            more.is_empty()
        });
        assert!(
            clean,
            "left behind after a death before {death:?}: {more:?}"
        );
        assert_eq!(cell.pid("executor"), executor);
        assert_eq!(
            watch.status().incarnation,
            before.incarnation,
            "after {death:?}"
        );
    }
    let after = watch.status();
    eprintln!(
        "{}: {} of {} deaths tried, {reached} before the first exchange; {} cycles meanwhile, {} of them late",
        victim.name,
        chosen.len(),
        all.len(),
        after.cycle - before.cycle,
        after.late - before.late
    );
    assert!(
        reached * 10 >= chosen.len() * 8,
        "most deaths must come before the first exchange: {reached} of {}",
        chosen.len()
    );
    assert_no_cycle_missing(&records.finish());
    start(&mut cell, victim, &watch);
    drop(watch);
    cell.stop();
}

/// Starts the program under strace with these options.
fn traced(cell: &UnsupervisedCell, victim: &KillTarget, options: &[String]) -> Child {
    start_traced(
        cell,
        victim.program,
        victim.arguments,
        options,
        Stdio::null(),
    )
}

/// Returns true if the driver has exchanged data with its device, or the loader answers.
fn works(cell: &UnsupervisedCell, victim: &KillTarget, watch: &ExecutorBoards, pid: u32) -> bool {
    match victim.device {
        Some(device) => {
            let row = watch.tables().devices[device];
            let is_it = ProcessInstance::from_incarnation(row.incarnation).pid == pid;
            // Any exchange counts: on a slow machine the device may be lost again by now.
            is_it && row.sequence > 0
        }
        None => cell.try_rest("GET", "/status", "").is_some(),
    }
}

/// Traces a whole start; returns the system calls before which the program can be killed, in order.
fn every_death(
    cell: &UnsupervisedCell,
    victim: &KillTarget,
    watch: &ExecutorBoards,
) -> Vec<SystemCall> {
    let file = cell.folder().join("calls.txt");
    let mut strace = traced(cell, victim, &["-o".into(), file.display().to_string()]);
    await_some(&format!("{} to work under strace", victim.name), || {
        let pid = tracee(&strace)?;
        works(cell, victim, watch, pid).then(|| signal(pid, Signal::SIGKILL))
    });
    strace.wait().expect("the child is ours");
    cell.clean();
    let deaths = deaths_of(&file, victim);
    assert!(deaths.len() > 50, "{} system calls only", deaths.len());
    deaths
}

/// Returns the system calls of a trace up to the first answer or exchange of the victim.
fn deaths_of(file: &Path, victim: &KillTarget) -> Vec<SystemCall> {
    let mut accepted = false;
    calls_of(file, |name, call| {
        accepted |= name.starts_with("accept");
        let answers =
            ["sendto", "sendmsg", "write", "writev"].contains(&name) && call.contains("HTTP/1.1 ");
        let exchanges =
            name == "sendto" && (call.contains("sin_port") || call.contains("MSG_NOSIGNAL"));
        match victim.device {
            None => accepted && answers,
            Some(_) => exchanges,
        }
    })
}

/// Starts the program and kills it before a system call; returns false if it worked before it came to that call.
fn die(
    cell: &UnsupervisedCell,
    victim: &KillTarget,
    watch: &ExecutorBoards,
    (name, number): &SystemCall,
) -> bool {
    let inject = format!("inject={name}:signal=SIGKILL:when={number}");
    let options = [
        "-o",
        "/dev/null",
        "-e",
        &format!("trace={name}"),
        "-e",
        &inject,
    ];
    let mut strace = traced(cell, victim, &options.map(str::to_owned));
    let begun = Instant::now();
    let died = loop {
        if strace.try_wait().expect("the child is ours").is_some() {
            break true;
        }
        if let Some(pid) = tracee(&strace)
            && works(cell, victim, watch, pid)
        {
            signal(pid, Signal::SIGKILL);
            break false;
        }
        assert!(
            begun.elapsed() < LIMIT,
            "{} hangs before {name} {number}\n{}",
            victim.name,
            cell.logs()
        );
        std::thread::sleep(LOOK);
    };
    strace.wait().expect("the child is ours");
    died
}

/// Starts the program again, and waits until it works.
fn start(cell: &mut UnsupervisedCell, victim: &KillTarget, watch: &ExecutorBoards) {
    if victim.device.is_none() {
        cell.start_loader();
        return;
    }
    let pid = cell.start_driver(victim.name);
    await_some(&format!("the next {} to work", victim.name), || {
        works(cell, victim, watch, pid).then_some(())
    });
    let reply = cell.try_rest("GET", "/status", "");
    let status = reply.expect("the loader answers").status;
    assert_eq!(status, 200, "the loader answers with success");
}

/// Waits until `so` returns true; returns false after a time limit.
fn becomes_true(mut so: impl FnMut() -> bool) -> bool {
    let begun = Instant::now();
    while !so() {
        if begun.elapsed() > LIMIT / 4 {
            return false;
        }
        std::thread::sleep(LOOK);
    }
    true
}

/// Counts the files in shared memory and in the runtime folder by their names, without the numbers of an incarnation.
fn left(cell: &UnsupervisedCell) -> BTreeMap<String, usize> {
    let shared = cell.cell().leftovers().expect("/dev/shm can be listed");
    let files = shared
        .into_iter()
        .chain(files_below(cell.cell().runtime_dir()));
    let mut names = BTreeMap::new();
    for path in files {
        let name = path.display().to_string();
        // Not counted, because living processes write them at any time: a driver's last minute, and the cell's event
        // log. Both have a bounded size.
        let minute = name.contains("/drivers/") && name.ends_with(".json");
        if minute || name.contains("/events.") {
            continue;
        }
        let words = name.split_inclusive(|letter: char| !letter.is_ascii_hexdigit());
        let shown = words.map(|word| if word.len() > 6 { "#" } else { word });
        *names.entry(shown.collect()).or_default() += 1;
    }
    names
}

fn assert_no_cycle_missing(records: &[MonitorRecord]) {
    assert!(records.len() > 100, "{} records", records.len());
    for pair in records.windows(2) {
        let (cycles, sequences) = (
            pair[1].cycle - pair[0].cycle,
            pair[1].sequence - pair[0].sequence,
        );
        assert_eq!(cycles, sequences, "a cycle without a record: {pair:?}");
    }
}
