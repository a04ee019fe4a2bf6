//! Kills two processes of the cell at the same moment. The thread that owns a process notices its death and restarts
//! it. Runs on the thread of the arm during a motion; with the executor, on the calling thread while no round is
//! running.

use std::process::{Child, Stdio};
use std::sync::atomic::Ordering;

use nix::sys::signal::Signal;
use rcc_protocol::Role;

use super::field::{Field, count, held};
use crate::journal::Random;
use crate::process::Process;
use crate::processes::signal;
use crate::simulator::{ANSWERS_LOST, assert_within_limits};
use crate::{await_some, nets};

/// A process that can be killed together with another one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Victim {
    /// The arm's driver.
    ArmDriver,
    /// The I/O driver.
    IoDriver,
    /// The loader.
    Loader,
    /// `rcc-monitor tail`.
    Monitor,
    /// `rcc-cli tail`.
    Client,
}

const VICTIMS: [Victim; 5] = [
    Victim::ArmDriver,
    Victim::IoDriver,
    Victim::Loader,
    Victim::Monitor,
    Victim::Client,
];

/// Two processes that are killed together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair(Victim, Victim);

impl Pair {
    /// Chooses two different processes at random.
    pub fn choose(random: &mut Random) -> Pair {
        let first = random.below(VICTIMS.len() as u64) as usize;
        let step = 1 + random.below(VICTIMS.len() as u64 - 1) as usize;
        Pair(VICTIMS[first], VICTIMS[(first + step) % VICTIMS.len()])
    }

    /// True if the process is in the pair.
    pub fn contains(self, victim: Victim) -> bool {
        self.0 == victim || self.1 == victim
    }

    /// Starts the monitor and the client if they are in the pair; the other processes are always running.
    pub fn guests(self, field: &Field<'_>) -> Vec<Child> {
        let programs = [
            (Victim::Monitor, "rcc-monitor"),
            (Victim::Client, "rcc-cli"),
        ];
        let chosen = programs
            .into_iter()
            .filter(|(victim, _)| self.contains(*victim));
        let start = |(_, name)| {
            let mut command = field.place.program(name);
            command.args(["tail", "--output", "json"]);
            command.stdout(Stdio::null()).stderr(Stdio::null());
            command.spawn().expect("our programs start")
        };
        chosen.map(start).collect()
    }

    /// Kills both processes.
    pub fn strike(self, field: &Field<'_>, guests: Vec<Child>) {
        field.journal.note(format!("kill {self:?}"));
        kill(field, &[self.0, self.1], guests, None);
        count(&field.counts.pairs);
    }
}

/// True if the next pair is due; pairs are spread evenly over the time.
pub fn due(field: &Field<'_>) -> bool {
    // Relaxed: pairs without the executor are counted by this thread.
    let done = field.counts.pairs.load(Ordering::Relaxed)
        - field.counts.executor_pairs.load(Ordering::Relaxed);
    let share = field.begun.elapsed().as_secs_f64() / field.options.time.as_secs_f64();
    (done as f64) < field.options.pairs as f64 * share.min(1.0)
}

/// Kills all victims, guests and the executor, if given, while the processes are locked: no thread checks or restarts
/// one of them before it is dead. A process that dies slowly would seem to live, and nobody would start it again.
fn kill(field: &Field<'_>, victims: &[Victim], guests: Vec<Child>, executor: Option<u32>) {
    let places = [
        (Victim::ArmDriver, &field.arm_driver),
        (Victim::IoDriver, &field.io_driver),
        (Victim::Loader, &field.loader),
    ];
    let mut holders: Vec<_> = places
        .iter()
        .filter(|(victim, _)| victims.contains(victim))
        .map(|(_, process)| held(process))
        .collect();
    let pids = holders.iter().map(|process| process.pid());
    let pids: Vec<u32> = pids
        .chain(guests.iter().map(Child::id))
        .chain(executor)
        .collect();
    for pid in pids {
        signal(pid, Signal::SIGKILL);
    }
    for process in &mut holders {
        await_some("a killed process to be dead", || {
            (process.pid() == 0 || process.ended().is_some()).then_some(())
        });
    }
    drop(holders);
    for mut guest in guests {
        guest.wait().expect("the process is a child of this one");
    }
}

/// Kills the executor and another process while the arm moves and no round is running. Asserts that the arm comes to
/// rest and does not move, and starts the next executor.
pub fn strike_executor(field: &Field<'_>, executor: &mut Process, random: &mut Random) {
    let victim = VICTIMS[random.below(VICTIMS.len() as u64) as usize];
    field
        .journal
        .note(format!("kill the executor and {victim:?}"));
    let mut arm = field.place.simulator("lwr-sim");
    arm.await_rest();
    arm.reset_statistics();
    let name = format!("struck-{}", executor.pid());
    let line = field.load(&name, &nets::line(&name, 0.0, 0.1));
    field.start(line);
    arm.await_motion();
    let guests = Pair(victim, victim).guests(field);
    std::thread::sleep(random.time_below(std::time::Duration::from_millis(300)));
    kill(field, &[victim], guests, Some(executor.pid()));
    await_some("the executor to be dead", || executor.ended());
    assert_within_limits(&arm.await_rest(), &ANSWERS_LOST);
    arm.reset_statistics();
    field.clean();
    let pid = executor.start(field.place);
    await_some("another executor", || {
        let announced = field.place.cell().announced(Role::Executor, "exec");
        (announced.ok().flatten()?.pid == pid).then_some(())
    });
    field.set_executor(pid);
    arm.assert_not_moved();
    count(&field.counts.pairs);
    count(&field.counts.executor_pairs);
}
