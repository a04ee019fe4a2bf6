//! Finds the processes of a test by their environment, sends signals, and ends children together with the test.
//! Runs on the threads of the test harness.
#![allow(unsafe_code)] // `pre_exec` has no safe wrapper.

use std::fs;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::Command;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// Sends a signal; false if the process does not exist.
pub fn signal(pid: u32, signal: Signal) -> bool {
    assert!(
        pid > 0,
        "0 stands for the whole process group, this process included"
    );
    kill(Pid::from_raw(pid.cast_signed()), signal).is_ok()
}

/// Makes the child die with the thread that starts it, even if the whole test is killed.
pub fn ends_with_test(command: &mut Command) -> &mut Command {
    // SAFETY: between fork and exec only `prctl` is called, which is async-signal-safe.
    unsafe {
        command.pre_exec(|| nix::sys::prctl::set_pdeathsig(Signal::SIGKILL).map_err(Into::into))
    }
}

/// Returns the process ids of all other processes whose `RCC_RUNTIME_DIR` is `base`.
pub fn with_runtime_dir(base: &Path) -> Vec<u32> {
    let wanted = format!("RCC_RUNTIME_DIR={}", base.display());
    let own = std::process::id();
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    pids.filter(|pid| *pid != own)
        .filter(|pid| {
            let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
            environment
                .split(|byte| *byte == 0)
                .any(|entry| entry == wanted.as_bytes())
        })
        .collect()
}

/// Returns the arguments of a process's command line.
pub fn command_line(pid: u32) -> Vec<String> {
    let bytes = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
    let words = bytes.split(|byte| *byte == 0);
    words
        .map(|word| String::from_utf8_lossy(word).into_owned())
        .collect()
}

/// Returns the thread ids of a process with their names.
pub fn threads(pid: u32) -> Vec<(u32, String)> {
    let folder = format!("/proc/{pid}/task");
    let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
    let ids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    ids.map(|id: u32| {
        let name = fs::read_to_string(format!("{folder}/{id}/comm")).unwrap_or_default();
        (id, name.trim_end().to_owned())
    })
    .collect()
}

/// Numbers of open files and shared-memory mappings of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpenResources {
    /// Open file descriptors.
    pub files: usize,
    /// Mappings of files in `/dev/shm`.
    pub mappings: usize,
}

/// Counts the open files and shared-memory mappings of a process.
pub fn holdings(pid: u32) -> OpenResources {
    let files = fs::read_dir(format!("/proc/{pid}/fd")).map_or(0, Iterator::count);
    let maps = fs::read_to_string(format!("/proc/{pid}/maps")).unwrap_or_default();
    let mappings = maps.lines().filter(|line| line.contains("/dev/shm/"));
    OpenResources {
        files,
        mappings: mappings.count(),
    }
}
