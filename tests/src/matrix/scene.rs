//! Who is there in a case: the processes that are struck, and those that only this case has.
//! Run by the thread of the matrix.

use std::process::Child;

use rcc_ipc::Role;

use super::{Target, Way};
use crate::await_some;

/// A process that is struck.
#[derive(Clone, Copy, Debug)]
pub struct StruckProcess {
    /// Which one.
    pub target: Target,
    /// Its process id.
    pub pid: u32,
    /// Its life before, if it announces itself.
    pub incarnation: u64,
}

/// Who is there.
#[derive(Debug, Default)]
pub struct Scene {
    /// The motion of the case, if it has one.
    pub line: Option<u64>,
    /// Processes beside the cell's own, and which target each is.
    pub guests: Vec<(Option<Target>, Child)>,
    /// Who is struck.
    pub struck: Vec<StruckProcess>,
}

impl Scene {
    /// The guest that is this target; the newest, if a case makes several.
    pub fn guest(&mut self, target: Target) -> Option<&mut Child> {
        let mut guests = self.guests.iter_mut().rev();
        let found = guests.find(|(of, _)| *of == Some(target));
        found.map(|(_, guest)| guest)
    }

    /// Waits for guests that were only stopped, or may end in order.
    pub fn await_guests(&mut self, way: Way) {
        if !matches!(way, Way::Stop | Way::Term) {
            return;
        }
        for (_, guest) in &mut self.guests {
            await_some("a client to end", || {
                guest.try_wait().expect("the child is ours")
            });
        }
    }

    /// Waits for `rcc-cli run`, which unloads its net itself and tells by its exit code how it ended.
    pub fn end_of_client(&mut self, way: Way) -> String {
        let client = self.guest(Target::Client).expect("a client");
        let status = await_some("the client to end", || {
            client.try_wait().expect("the child is ours")
        });
        match status.code() {
            Some(0) => "finished".to_owned(),
            Some(130 | 143) | None if way == Way::Term => "canceled".to_owned(),
            _ => panic!("rcc-cli run: {status}"),
        }
    }

    /// Ends who is still there, and takes its exit code: a zombie would count as a process that was left.
    pub fn end_guests(&mut self) {
        for (_, guest) in &mut self.guests {
            let _ = guest.kill();
            let _ = guest.wait();
        }
    }
}

impl Target {
    /// Role and label of a process that announces itself and that the supervisor starts again.
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
