//! What is so on this machine, as plain data: read once, from files below a root folder and by a few system calls.
//! Run by the main thread. The checks see nothing else, so they are tested on facts that were written down.

use std::path::PathBuf;

use super::measure::WakeUpMeasurement;
use super::trial::Trial;
use super::requirements::MachineRequirements;

pub mod cells;
pub mod cpu;
pub mod runtime_folder;
pub mod kernel;
pub mod limits;
pub mod login;
pub mod shared_memory;
pub mod system;

/// Everything that the checks look at.
#[derive(Clone, Debug, Default)]
pub struct MachineFacts {
    /// What is asked of the machine.
    pub requirements: MachineRequirements,
    /// What was tried.
    pub trial: Trial,
    /// Who we are.
    pub user: login::UserFacts,
    /// What this process may use.
    pub limits: limits::ResourceLimits,
    /// What the system's files grant to users at login.
    pub granted: Vec<limits::LimitGrant>,
    /// The kernel.
    pub kernel: kernel::KernelFacts,
    /// The core in question, or all.
    pub cpu: cpu::CpuFacts,
    /// MemoryFacts and swap.
    pub memory: kernel::MemoryFacts,
    /// `/dev/shm`.
    pub shared: shared_memory::SharedMemoryMount,
    /// logind's word about shared memory of users that log out.
    pub remove_ipc: Option<bool>,
    /// The folder of the cells.
    pub base: runtime_folder::FolderFacts,
    /// The cells in it.
    pub cells: Vec<cells::CellFacts>,
    /// Shared memory of cells whose folder is not in the usual base.
    pub strays: Vec<cells::StrayMemory>,
    /// The wake-ups.
    pub measured: Option<WakeUpMeasurement>,
    /// Why they could not be measured.
    pub not_measured: Option<String>,
    /// What the machine did meanwhile.
    pub activity: cpu::MachineActivity,
}

/// Reads everything but trial and measurement.
#[must_use]
pub fn read(root: &system::SystemRoot, requirements: MachineRequirements) -> MachineFacts {
    let user = login::read(root);
    MachineFacts {
        granted: limits::granted(root),
        limits: limits::read(root),
        kernel: kernel::read(root, &user.cgroup),
        cpu: cpu::read(root, requirements.core),
        memory: kernel::memory(root),
        shared: shared_memory::read(root),
        remove_ipc: login::remove_ipc(root),
        base: runtime_folder::read(&rcc_ipc::cell::base_dir()),
        cells: cells::read(&rcc_ipc::cell::base_dir()),
        strays: cells::strays(&PathBuf::from("/dev/shm"), &rcc_ipc::cell::base_dir()),
        requirements,
        user,
        ..MachineFacts::default()
    }
}
