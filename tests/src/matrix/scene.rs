//! The processes of a case: the targets of its fault, and the processes that only this case starts (its guests).
//! Runs on the thread of the matrix.

use std::process::Child;

use rcc_protocol::Role;

use super::{Disturbance, Target, Victim};
use crate::await_some;

/// A target process of the fault.
#[derive(Clone, Copy, Debug)]
pub struct StruckProcess {
    /// Which process of the cell it is.
    pub target: Target,
    /// Process id.
    pub pid: u32,
    /// Incarnation before the fault; 0 if the process does not announce itself.
    pub incarnation: u64,
}

/// The processes and the motion of a case.
#[derive(Debug, Default)]
pub struct Scene {
    /// Command id of the case's motion, if it has one.
    pub line: Option<u64>,
    /// Processes in addition to the cell's own, each with the target that it is, if any.
    pub guests: Vec<(Option<Target>, Child)>,
    /// The target processes of the fault.
    pub struck: Vec<StruckProcess>,
}

impl Scene {
    /// Adds the guests among the targets to the processes that the fault hits.
    pub fn remember_guests(&mut self, victim: Victim) {
        for target in victim.targets() {
            let guest = self.guest(target).map(|guest| guest.id());
            self.struck.extend(guest.map(|pid| StruckProcess {
                target,
                pid,
                incarnation: 0,
            }));
        }
    }

    /// Returns the guest that is this target; the newest if there are several.
    pub fn guest(&mut self, target: Target) -> Option<&mut Child> {
        let mut guests = self.guests.iter_mut().rev();
        let found = guests.find(|(of, _)| *of == Some(target));
        found.map(|(_, guest)| guest)
    }

    /// Waits until all guests have exited, if the fault lets them exit by themselves (SIGSTOP with SIGCONT, or
    /// SIGTERM).
    pub fn await_guests(&mut self, disturbance: Disturbance) {
        if !matches!(disturbance, Disturbance::Stop | Disturbance::Term) {
            return;
        }
        for (_, guest) in &mut self.guests {
            await_some("a client to end", || {
                guest
                    .try_wait()
                    .expect("the process is a child of this one")
            });
        }
    }

    /// Waits for `rcc-cli run`, which unloads its net itself, and returns how the net ended according to the exit code.
    pub fn end_of_client(&mut self, disturbance: Disturbance) -> String {
        let client = self.guest(Target::Client).expect("a client");
        let status = await_some("the client to end", || {
            client
                .try_wait()
                .expect("the process is a child of this one")
        });
        match status.code() {
            Some(0) => "finished".to_owned(),
            Some(130 | 143) | None if disturbance == Disturbance::Term => "canceled".to_owned(),
            _ => panic!("rcc-cli run: {status}"),
        }
    }

    /// Kills the remaining guests and reaps them: a zombie would count as a leftover process.
    pub fn end_guests(&mut self) {
        for (_, guest) in &mut self.guests {
            let _ = guest.kill();
            let _ = guest.wait();
        }
    }
}

impl Target {
    /// Returns role and label of a process that announces itself and is restarted by the supervisor.
    pub fn announced_as(self) -> Option<(Role, &'static str)> {
        match self {
            Target::ArmDriver => Some((Role::Driver, "lwr")),
            Target::IoDriver => Some((Role::Driver, "io")),
            Target::Loader => Some((Role::Loader, "loader")),
            Target::Executor => Some((Role::Executor, "exec")),
            Target::Monitor | Target::Client | Target::Supervisor | Target::Janitor => None,
        }
    }
}
