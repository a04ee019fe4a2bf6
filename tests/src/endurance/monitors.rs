//! Monitors that start, read, stall and end in different ways. Runs on [`THREADS`] threads.

use std::io::{BufRead, BufReader};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use super::field::{Field, count};
use crate::processes::signal;

/// Number of dead monitors of a thread after which the janitor runs: a stream has room for 16 subscribers.
const CLEAN_AFTER: u32 = 4;
/// Number of threads that run monitors.
pub const THREADS: u32 = 3;

/// Runs until the journal ends.
pub fn run(field: &Field<'_>, number: u64) {
    let mut random = field.random(10 + number);
    let begun = Instant::now();
    let every =
        field.options.time * THREADS / u32::try_from(field.options.monitors.max(1)).unwrap_or(1);
    let mut came = 0;
    field.journal.rounds("monitors", |_| {
        let early = (every * came).saturating_sub(begun.elapsed());
        field.journal.pause(
            early
                .min(Duration::from_millis(500))
                .max(Duration::from_millis(2)),
        );
        if field.counts.monitors() >= field.options.monitors || early > Duration::from_millis(500) {
            return;
        }
        came += 1;
        let mut tail = start(field);
        match random.below(5) {
            // Killed while it starts.
            0 => std::thread::sleep(random.time_below(Duration::from_millis(40))),
            // Killed after some lines were read.
            1 => read(&mut tail, 1 + random.below(200)),
            // Not read: its pipe fills up and it blocks.
            2 => {
                read(&mut tail, 1);
                std::thread::sleep(random.time_below(Duration::from_millis(500)));
            }
            // Stopped and continued.
            3 => {
                read(&mut tail, 1);
                signal(tail.id(), Signal::SIGSTOP);
                std::thread::sleep(random.time_below(Duration::from_millis(500)));
                signal(tail.id(), Signal::SIGCONT);
            }
            // Ends by itself on SIGTERM.
            _ => {
                signal(tail.id(), Signal::SIGTERM);
                end(field, tail);
                return;
            }
        }
        signal(tail.id(), Signal::SIGKILL);
        end(field, tail);
        if came.is_multiple_of(CLEAN_AFTER) {
            field.clean();
        }
    });
}

fn start(field: &Field<'_>) -> Child {
    let mut tail = field.place.program("rcc-monitor");
    tail.args(["tail", "--output", "json"]);
    tail.stdout(Stdio::piped()).stderr(Stdio::null());
    tail.spawn().expect("rcc-monitor starts")
}

/// Reads up to this many lines; fewer if nothing arrives because no net with a monitor runs.
fn read(tail: &mut Child, lines: u64) {
    use std::os::fd::AsFd;

    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

    let Some(pipe) = &mut tail.stdout else { return };
    let mut ready = [PollFd::new(pipe.as_fd(), PollFlags::POLLIN)];
    if !poll(&mut ready, PollTimeout::from(500_u16)).is_ok_and(|count| count > 0) {
        return;
    }
    // The reader may take more from the pipe than it returns; the monitor is stopped or killed next anyway.
    let mut reader = BufReader::with_capacity(512, pipe);
    let mut line = String::new();
    for _ in 0..lines {
        line.clear();
        if reader.buffer().is_empty() && !has_more(reader.get_ref().as_fd()) {
            return;
        }
        if reader.read_line(&mut line).unwrap_or(0) == 0 {
            return;
        }
    }
}

fn has_more(pipe: std::os::fd::BorrowedFd<'_>) -> bool {
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    let mut ready = [PollFd::new(pipe, PollFlags::POLLIN)];
    poll(&mut ready, PollTimeout::from(20_u16)).is_ok_and(|count| count > 0)
}

fn end(field: &Field<'_>, mut tail: Child) {
    let begun = Instant::now();
    while tail
        .try_wait()
        .expect("the process is a child of this one")
        .is_none()
    {
        if begun.elapsed() > Duration::from_secs(10) {
            field
                .journal
                .add_finding(format!("monitor {} does not end", tail.id()));
            tail.kill().expect("the process is a child of this one");
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    count(&field.counts.tails);
}
