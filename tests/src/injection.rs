//! Fault injection into system calls with `strace`: kills a process before a call, or makes the call fail.
//! strace counts the calls of each name per thread, so a call is identified by name and number: the n-th `openat`.
//! Runs on the test's thread.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::processes::ends_with_test;
use crate::unsupervised_cell::UnsupervisedCell;

/// Calls that are never made to fail. futex: the kernel does not refuse a wake-up, and a lost one hangs any program. brk: it
/// returns the end of the heap, unchanged if it cannot grow; the C library takes an injected error for an address.
pub const NEVER_FAIL: [&str; 2] = ["futex", "brk"];

/// Injected errors: those of a full, interrupted or broken system.
pub const ERRORS: [&str; 5] = ["ENOSPC", "ENOMEM", "EMFILE", "EINTR", "EIO"];

/// A system call by its name and its number among the calls of that name in a thread, from 1.
pub type SystemCall = (String, usize);

/// Checks that system calls can be traced on this machine.
///
/// # Errors
/// Returns the reason if strace is not installed or tracing is not permitted.
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

/// Returns the command that runs a program of the cell under strace with these strace options.
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

/// Starts a program of the cell under strace with these strace options; its stderr goes to `stderr`.
///
/// # Panics
/// Panics if strace cannot be started.
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

/// Returns the process id of the traced program; `None` if it has not started or has exited.
pub fn tracee(strace: &Child) -> Option<u32> {
    let pid = strace.id();
    let children = fs::read_to_string(format!("/proc/{pid}/task/{pid}/children")).ok()?;
    children.split_whitespace().next()?.parse().ok()
}

/// Returns the distinct calls in a trace written by `strace -f -o`, in order, up to and including the first one for
/// which `last` returns true.
///
/// # Panics
/// Panics if the file cannot be read.
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
        // Lines such as `<... resumed>`, `+++ exited` and `--- SIGNAL` are not calls.
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

/// Returns all elements if `RCC_EVERY_SYSCALL=1` is set, otherwise `sample` of them: evenly spread and deterministic.
pub fn choose<T: Clone>(all: &[T], sample: usize) -> Vec<T> {
    let every = std::env::var_os("RCC_EVERY_SYSCALL").is_some_and(|value| value == "1");
    let count = if every {
        all.len()
    } else {
        sample.min(all.len())
    };
    // The middle element of each of `count` equal parts.
    (0..count)
        .map(|part| all[(2 * part + 1) * all.len() / (2 * count)].clone())
        .collect()
}

/// True if the log shows a panic in a package of this repository. Other panics are accepted: the standard library
/// panics if a sleep fails, and iceoryx2 if a file cannot be closed.
pub fn panics_of_ours(log: &str) -> bool {
    let places = log
        .lines()
        .filter_map(|line| line.split_once("panicked at "));
    places
        .into_iter()
        .any(|(_, place)| place.starts_with("rcc-"))
}
