//! Faults that `strace` injects into system calls of a process: its death before a call, or an error in place of it.
//! strace counts the calls of each name in each thread, so a call is named by a name and a number: the n-th `openat`.
//! Run by a test's thread.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::processes::ends_with_test;
use crate::unsupervised_cell::UnsupervisedCell;

/// The call that gets no error: the kernel refuses no wake-up, and one that is swallowed hangs any program.
pub const NEVER_FAILS: &str = "futex";

/// Errors that the system gives when it is full, interrupted or broken.
pub const ERRORS: [&str; 5] = ["ENOSPC", "ENOMEM", "EMFILE", "EINTR", "EIO"];

/// The n-th call of a name in a thread.
pub type SystemCall = (String, usize);

/// Why system calls cannot be traced here, if they cannot.
///
/// # Errors
/// There is no strace, or we may not trace.
pub fn can_trace() -> Result<(), String> {
    let output = Command::new("strace")
        .args(["-f", "-o", "/dev/null", "true"])
        .output();
    match output {
        Ok(output) if output.status.success() => Ok(()),
        Ok(output) => Err(String::from_utf8_lossy(&output.stderr).trim().to_owned()),
        Err(error) => Err(format!("strace: {error}")),
    }
}

/// A program of the cell under strace with these options; nothing is started yet.
pub fn traced(
    cell: &UnsupervisedCell,
    program: &str,
    arguments: &[&str],
    options: &[String],
) -> Command {
    let usual = cell.program(program);
    let mut command = Command::new("strace");
    command.args(["-f", "-qq"]).args(options).arg("--");
    command.arg(usual.get_program()).args(usual.get_args());
    command
        .arg("--config")
        .arg(cell.config())
        .arg("--parent-death")
        .args(arguments);
    for (key, value) in usual.get_envs() {
        command.env(key, value.unwrap_or_default());
    }
    command.stdin(Stdio::null()).stdout(Stdio::null());
    command
}

/// Starts a program of the cell under strace with these options; what it says goes to `stderr`.
///
/// # Panics
/// strace does not start.
pub fn start_traced(
    cell: &UnsupervisedCell,
    program: &str,
    arguments: &[&str],
    options: &[String],
    stderr: Stdio,
) -> Child {
    let mut command = traced(cell, program, arguments, options);
    command.stderr(stderr);
    ends_with_test(&mut command).spawn().expect("strace starts")
}

/// The process that strace started.
pub fn tracee(strace: &Child) -> Option<u32> {
    let pid = strace.id();
    let children = fs::read_to_string(format!("/proc/{pid}/task/{pid}/children")).ok()?;
    children.split_whitespace().next()?.parse().ok()
}

/// Each call of a trace that strace wrote with `-f -o`, in their order, until one for which `last` says so.
///
/// # Panics
/// There is no such file.
pub fn calls_of(file: &Path, mut last: impl FnMut(&str, &str) -> bool) -> Vec<SystemCall> {
    let text = fs::read_to_string(file).expect("strace wrote it");
    let mut counts: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    let mut seen = BTreeSet::new();
    let mut calls = Vec::new();
    for line in text.lines() {
        let Some((thread, call)) = line.split_once(' ') else {
            continue;
        };
        let call = call.trim_start();
        // `<... resumed>`, `+++ exited`, `--- SIGNAL` are no calls.
        let name = call.split('(').next().unwrap_or_default();
        if name.is_empty() || !name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') {
            continue;
        }
        let count = counts.entry((thread, name)).or_default();
        *count += 1;
        if seen.insert((name, *count)) {
            calls.push((name.to_owned(), *count));
        }
        if last(name, call) {
            break;
        }
    }
    calls
}

/// All of them if `RCC_EVERY_SYSCALL=1` asks for it, otherwise `sample` of them, evenly spread and the same each time.
pub fn choose<T: Clone>(all: &[T], sample: usize) -> Vec<T> {
    let every = std::env::var_os("RCC_EVERY_SYSCALL").is_some_and(|value| value == "1");
    let count = if every {
        all.len()
    } else {
        sample.min(all.len())
    };
    // The middles of as many equal parts.
    (0..count)
        .map(|part| all[(2 * part + 1) * all.len() / (2 * count)].clone())
        .collect()
}

/// True if code of ours has panicked. The standard library does where a sleep fails, and iceoryx2 where a file cannot be
/// closed.
pub fn panics_of_ours(log: &str) -> bool {
    let places = log
        .lines()
        .filter_map(|line| line.split_once("panicked at "));
    places
        .into_iter()
        .any(|(_, place)| place.starts_with("rcc-"))
}
