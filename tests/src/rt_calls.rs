//! Counts the system calls of the executor's real-time thread with `strace` while nets, monitors, drivers and loaders
//! start and end. Runs on the test's thread.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cell_fixture::ExecutorBoards;
use crate::nets;
use crate::processes::{ends_with_test, signal};
use crate::records::RecordCollector;
use crate::unsupervised_cell::UnsupervisedCell;
use crate::waiting::{LIMIT, await_some};

/// Name of the real-time thread.
const THREAD: &str = "rcc-rt";
/// The only system call that the thread may make: its sleep.
const SLEEP: &str = "clock_nanosleep";
/// Interval at which strace is polled.
const LOOK: Duration = Duration::from_millis(5);

/// The result of a count.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counted {
    /// Lower bound of the cycles that began while strace was attached.
    pub cycles: u64,
    /// Number of calls by name.
    pub calls: BTreeMap<String, u64>,
    /// Numbers of motions, hand-overs, monitors, driver restarts and loader restarts meanwhile.
    pub happened: [u64; 5],
}

impl Counted {
    /// Returns the number of sleeps.
    #[must_use]
    pub fn sleeps(&self) -> u64 {
        self.calls.get(SLEEP).copied().unwrap_or(0)
    }

    /// Returns the calls other than the sleep. `clock_gettime` is left out, with a message, on machines whose clock
    /// source the vDSO does not support.
    #[must_use]
    pub fn others(&self) -> BTreeMap<String, u64> {
        let mut others = self.calls.clone();
        others.remove(SLEEP);
        if let Some(count) = others.get("clock_gettime").copied()
            && !clock_is_in_user_space()
        {
            eprintln!(
                "this machine reads its clock by system calls ({count} of them): not counted"
            );
            others.remove("clock_gettime");
        }
        others
    }
}

/// True if the kernel's clock source can be read without a system call (vDSO).
fn clock_is_in_user_space() -> bool {
    let source = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
    let source = fs::read_to_string(source).unwrap_or_default();
    [
        "tsc",
        "kvm-clock",
        "hyperv_clocksource_tsc_page",
        "arch_sys_counter",
    ]
    .contains(&source.trim())
}

/// Counts for at least this many cycles in a new cell, and until each activity has happened at least once.
///
/// # Errors
/// Returns the reason if the real-time thread cannot be traced.
pub fn count(cycles: u64) -> Result<Counted, String> {
    let mut cell = UnsupervisedCell::demo();
    let watch = cell.watch();
    let file = cell.folder().join("calls.txt");
    let strace = match attach(&cell, &file.display().to_string()) {
        Ok(strace) => strace,
        Err(cause) => {
            drop(watch);
            cell.stop();
            return Err(cause);
        }
    };
    let begun = watch.status().cycle;
    let mut happened = [0; 5];
    while watch.status().cycle < begun + cycles || happened.contains(&0) {
        round(&mut cell, &watch, &mut happened);
    }
    let counted = watch.status().cycle - begun;
    let ended = detach(strace);
    assert!(ended, "strace ends");
    let calls = summary(&fs::read_to_string(&file).expect("strace wrote its summary"));
    drop(watch);
    cell.stop();
    Ok(Counted {
        cycles: counted,
        calls,
        happened,
    })
}

/// Attaches strace to the real-time thread alone.
fn attach(cell: &UnsupervisedCell, file: &str) -> Result<Child, String> {
    let pid = cell.pid("executor");
    let thread = thread_of(pid).ok_or("the executor has no thread rcc-rt")?;
    let errors = cell.folder().join("strace.err");
    let mut command = Command::new("strace");
    command
        .args(["-c", "-p", &thread.to_string(), "-o", file])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(&errors).map_err(|error| error.to_string())?);
    let mut strace = ends_with_test(&mut command)
        .spawn()
        .map_err(|error| format!("strace: {error}"))?;
    let begun = Instant::now();
    let status = format!("/proc/{pid}/task/{thread}/status");
    while begun.elapsed() < LIMIT {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let tracer = text
            .lines()
            .find_map(|line| line.strip_prefix("TracerPid:"));
        if tracer.is_some_and(|tracer| tracer.trim() != "0") {
            return Ok(strace);
        }
        if strace.try_wait().is_ok_and(|status| status.is_some()) {
            return Err(fs::read_to_string(&errors)
                .unwrap_or_default()
                .trim()
                .to_owned());
        }
        std::thread::sleep(LOOK);
    }
    let _ = strace.kill();
    let _ = strace.wait();
    Err("strace does not attach".to_owned())
}

fn detach(mut strace: Child) -> bool {
    signal(strace.id(), Signal::SIGINT);
    let begun = Instant::now();
    while begun.elapsed() < LIMIT {
        if strace.try_wait().is_ok_and(|status| status.is_some()) {
            return true;
        }
        std::thread::sleep(LOOK);
    }
    let _ = strace.kill();
    let _ = strace.wait();
    false
}

fn thread_of(pid: u32) -> Option<u32> {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).ok()?;
    tasks.flatten().find_map(|task| {
        let name = fs::read_to_string(task.path().join("comm")).ok()?;
        let number = task.file_name().to_str()?.parse().ok()?;
        (name.trim() == THREAD).then_some(number)
    })
}

/// Parses the calls by name from the table of `strace -c`: % time, seconds, usecs/call, calls, errors (if any), name.
fn summary(text: &str) -> BTreeMap<String, u64> {
    let rows = text.lines().filter_map(|line| {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let (name, calls) = (fields.last()?, fields.get(3)?);
        let calls = calls.parse().ok()?;
        (*name != "total" && fields.len() >= 5).then(|| ((*name).to_owned(), calls))
    });
    rows.collect()
}

/// Runs one round: nets that start, hand over and end, a monitor, and in every second round a net that faults because
/// its driver is killed, or a loader that is killed.
fn round(cell: &mut UnsupervisedCell, watch: &ExecutorBoards, happened: &mut [u64; 5]) {
    let records = RecordCollector::follow(cell);
    happened[2] += 1;
    let first = cell.run(&nets::lamp("first"));
    let second = cell.load(&nets::lamp("second"));
    let body = format!(r#"{{"stop": [{first}], "start": [{second}]}}"#);
    let switched = cell.rest("POST", "/switch", &body);
    assert_eq!(switched.status, 200, "{switched:?}");
    happened[1] += 1;
    let y = if happened[0].is_multiple_of(2) {
        0.02
    } else {
        0.0
    };
    let line = cell.load(&nets::line("line", y, 0.1));
    cell.start_when_ready(line);
    cell.await_end(line);
    happened[0] += 1;
    records.finish();
    match happened[1] % 4 {
        1 => {
            // `second` ends with a fault because its device is lost.
            cell.end("io", Signal::SIGKILL);
            cell.assert_ends(second, "fault");
            cell.start_driver("io");
            cell.await_driver(watch, "io");
            happened[3] += 1;
        }
        3 => {
            cell.end("loader", Signal::SIGKILL);
            cell.start_loader();
            cell.done(second, "cancel");
            happened[4] += 1;
        }
        _ => cell.done(second, "cancel"),
    }
    cell.await_end(second);
    for id in [first, second, line] {
        await_some("the command to be unloaded", || {
            let reply = cell.try_rest("DELETE", &format!("/commands/{id}"), "")?;
            (reply.status == 200).then_some(())
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_of_strace_is_read() {
        let text = "\
% time     seconds  usecs/call     calls    errors syscall
------ ----------- ----------- --------- --------- ----------------
 99.00    0.001234          12      1000           clock_nanosleep
  1.00    0.000001           1         2         1 futex
------ ----------- ----------- --------- --------- ----------------
100.00    0.001235                  1002         1 total
";
        let wanted = [
            ("clock_nanosleep".to_owned(), 1000),
            ("futex".to_owned(), 2),
        ];
        assert_eq!(summary(text), BTreeMap::from(wanted));
    }
}
