//! What is so on this machine, as plain data: read once, from files below a root folder and by a few system calls.
//! Run by the main thread. The checks see nothing else, so they are tested on facts that were written down.

use std::path::PathBuf;

use super::measure::Measured;
use super::trial::Trial;
use super::wish::Wish;

pub mod cells;
pub mod cpu;
pub mod files;
pub mod kernel;
pub mod limits;
pub mod login;
pub mod shared;
pub mod system;

/// Everything that the checks look at.
#[derive(Clone, Debug, Default)]
pub struct Facts {
    /// What is asked of the machine.
    pub wish: Wish,
    /// What was tried.
    pub trial: Trial,
    /// Who we are.
    pub user: login::User,
    /// What this process may use.
    pub limits: limits::Limits,
    /// What the system's files grant to users at login.
    pub granted: Vec<limits::Granted>,
    /// The kernel.
    pub kernel: kernel::Kernel,
    /// The core in question, or all.
    pub cpu: cpu::Cpu,
    /// Memory and swap.
    pub memory: kernel::Memory,
    /// `/dev/shm`.
    pub shared: shared::Shared,
    /// logind's word about shared memory of users that log out.
    pub remove_ipc: Option<bool>,
    /// The folder of the cells.
    pub base: files::Folder,
    /// The cells in it.
    pub cells: Vec<cells::CellFacts>,
    /// Shared memory of cells whose folder is not in the usual base.
    pub strays: Vec<cells::Stray>,
    /// The wake-ups.
    pub measured: Option<Measured>,
    /// Why they could not be measured.
    pub not_measured: Option<String>,
    /// What the machine did meanwhile.
    pub during: cpu::During,
}

/// Reads everything but trial and measurement.
#[must_use]
pub fn read(root: &system::System, wish: Wish) -> Facts {
    let user = login::read(root);
    Facts {
        granted: limits::granted(root),
        limits: limits::read(root),
        kernel: kernel::read(root, &user.cgroup),
        cpu: cpu::read(root, wish.core),
        memory: kernel::memory(root),
        shared: shared::read(root),
        remove_ipc: login::remove_ipc(root),
        base: files::read(&rcc_ipc::cell::base_dir()),
        cells: cells::read(&rcc_ipc::cell::base_dir()),
        strays: cells::strays(&PathBuf::from("/dev/shm"), &rcc_ipc::cell::base_dir()),
        wish,
        user,
        ..Facts::default()
    }
}
