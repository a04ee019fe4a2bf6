//! `down`: ends a cell of this user as Ctrl-C on its `up` does: its nets are canceled, its arms come to rest, its
//! processes and files are gone at the end.

use std::fs;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rcc_api::codes;
use rcc_ipc::{Cell, clean};
use rcc_protocol::{Announcement, Role};
use serde::Serialize;

use crate::cells;
use crate::context::{Context, cell_failure};
use crate::failure::Failure;
use crate::interrupt::Interrupts;
use crate::output::print_note;

/// Longest time for a cell to end: nets that are canceled, arms that come to rest, and the end of each process.
const DOWN_TIMEOUT: Duration = Duration::from_secs(60);
/// Interval between two checks of the processes.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Arguments of `down`.
#[derive(clap::Args, Debug)]
pub struct Arguments {}

#[derive(Serialize)]
struct Ended {
    cell: String,
    /// Process ids that were asked to end.
    pids: Vec<u32>,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the cell does not run, belongs to another user or to systemd, or does not end in time.
pub fn run(context: &Context, _arguments: Arguments) -> Result<(), Failure> {
    let name = context.cell_name();
    if context.remote.is_some() {
        let help =
            "log in there and run `rcc-cli down`; `rcc-cli cancel` and `abort` end nets over TCP";
        let message = "down ends a cell of this machine, not one that is reached by --url";
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    let interrupts = Interrupts::listen()?;
    let cell = match Cell::find(name) {
        Ok(Some(cell)) => cell,
        Ok(None) => return Err(cells::not_found(name)),
        Err(error) => return Err(cell_failure(&error)),
    };
    let living = living(&cell)?;
    let supervisor = living.iter().find(|one| one.is_supervisor());
    let Some(first) = supervisor.or(living.first()) else {
        return Err(cells::not_found(name));
    };
    if let Some(unit) = unit_of(first.pid) {
        return Err(Failure::new(
            codes::CELL_LIVES,
            format!(
                "cell `{name}` is run by systemd ({unit}), which would start its processes again"
            ),
            format!("`sudo systemctl stop 'rcc-*@{name}.service'`"),
        ));
    }
    let limit = Instant::now() + DOWN_TIMEOUT;
    let mut pids = Vec::new();
    match supervisor {
        Some(supervisor) => end(&cell, &[supervisor], &mut pids, (limit, &interrupts))?,
        // The supervisor was killed: its children end in the order in which it would have ended them.
        None => {
            for role in [Role::Executor, Role::Loader, Role::Driver] {
                let of_role: Vec<&Announcement> =
                    living.iter().filter(|one| one.role == role).collect();
                end(&cell, &of_role, &mut pids, (limit, &interrupts))?;
            }
            remove_files(&cell);
        }
    }
    let ended = Ended {
        cell: name.to_owned(),
        pids,
    };
    context.print(&ended, |ended| format!("cell {}  ended", ended.cell));
    Ok(())
}

/// Removes the files of a cell whose processes have ended, as its supervisor would have done.
fn remove_files(cell: &Cell) {
    if let Err(error) = clean::remove_cell(cell) {
        let (name, help) = (cell.name(), "the next `rcc-cli up` removes them");
        print_note(&format!("the files of cell `{name}` stay: {error}; {help}"));
    }
}

/// Returns the announced processes that are or may be alive.
fn living(cell: &Cell) -> Result<Vec<Announcement>, Failure> {
    let mut announced = cell
        .announced_all()
        .map_err(|error| Failure::new(codes::PROCESS_FAILED, error.to_string(), ""))?;
    announced.retain(|one| !one.liveness().is_dead());
    Ok(announced)
}

/// Asks processes to end, and waits until they have.
fn end(
    cell: &Cell,
    processes: &[&Announcement],
    pids: &mut Vec<u32>,
    (limit, interrupts): (Instant, &Interrupts),
) -> Result<(), Failure> {
    for process in processes {
        // Its id is still its own: it was alive a moment ago, and the kernel reuses ids last.
        let pid = i32::try_from(process.pid).map(Pid::from_raw);
        if pid.is_ok_and(|pid| kill(pid, Signal::SIGTERM).is_ok()) {
            pids.push(process.pid);
        }
    }
    loop {
        let left = processes.iter().find(|one| !one.liveness().is_dead());
        let Some(left) = left else {
            return Ok(());
        };
        if interrupts.asked() {
            return Err(Failure::interrupted());
        }
        if Instant::now() >= limit {
            return Err(Failure::new(
                codes::EXECUTOR_SILENT,
                format!(
                    "cell `{}` has not ended after {DOWN_TIMEOUT:?}: {} (process {}) is still running",
                    cell.name(),
                    left.who(),
                    left.pid
                ),
                "`rcc-cli events` shows what it waits for; run `rcc-cli down` again: the second request skips the waiting",
            ));
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// Returns the systemd unit of a process of a cell; `None` if it was not started by one of our units.
fn unit_of(pid: u32) -> Option<String> {
    let groups = fs::read_to_string(format!("/proc/{pid}/cgroup")).ok()?;
    unit_in(&groups).map(str::to_owned)
}

fn unit_in(groups: &str) -> Option<&str> {
    let mut parts = groups.lines().flat_map(|line| line.split('/'));
    parts.find(|part| part.starts_with("rcc-") && part.ends_with(".service"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_a_cell_without_a_supervisor_are_removed() {
        let temporary = rcc_testing::folder();
        let folder = temporary.path().join("demo");
        let cell = Cell::at("demo", &folder).unwrap();
        fs::write(cell.running_file(), "{}").unwrap();
        remove_files(&cell);
        assert!(!folder.exists());
    }

    #[test]
    fn a_unit_is_recognised_by_the_control_group() {
        let groups = "0::/system.slice/system-rcc\\x2dexec.slice/rcc-exec@lab.service\n";
        assert_eq!(unit_in(groups), Some("rcc-exec@lab.service"));
        for other in ["0::/user.slice/user-1000.slice/session-3.scope\n", ""] {
            assert_eq!(unit_in(other), None);
        }
    }
}
