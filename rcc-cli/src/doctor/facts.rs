//! Facts about this machine as plain data: read once, from files below a root folder and by a few system calls. Run by
//! the main thread. The checks use nothing else, so they can be tested on fixed facts.

use std::path::PathBuf;

use super::HealthFinding;
use super::measure::WakeUpMeasurement;
use super::requirements::MachineRequirements;
use super::trial::Trial;

pub mod cells;
pub mod cpu;
pub mod kernel;
pub mod limits;
pub mod link;
pub mod login;
pub mod memory;
pub mod system;

/// All facts that the checks use.
#[derive(Clone, Debug, Default)]
pub struct MachineFacts {
    /// The cell's requirements.
    pub requirements: MachineRequirements,
    /// Results of trying SCHED_FIFO and memory locking.
    pub trial: Trial,
    /// User and login session.
    pub user: login::UserFacts,
    /// Resource limits of this process.
    pub limits: limits::ResourceLimits,
    /// Limits that the system's files grant to users at login.
    pub limit_grants: Vec<limits::LimitGrant>,
    /// Kernel.
    pub kernel: kernel::KernelFacts,
    /// The configured core, or all cores.
    pub cpu: cpu::CpuFacts,
    /// Memory and swap.
    pub memory: memory::MemoryFacts,
    /// `/dev/shm`.
    pub shared: memory::SharedMemoryMount,
    /// logind's RemoveIPC setting; `None` without systemd.
    pub remove_ipc: Option<bool>,
    /// Folder of the cells.
    pub runtime_folder: cells::FolderFacts,
    /// Cells in that folder.
    pub cells: Vec<cells::CellFacts>,
    /// Shared memory of cells in other folders.
    pub strays: Vec<cells::StrayMemory>,
    /// Findings about the cell's link to others.
    pub link: Vec<HealthFinding>,
    /// Measured wake-up latency.
    pub measured: Option<WakeUpMeasurement>,
    /// Reason why it could not be measured.
    pub not_measured: Option<String>,
    /// Activity of the machine during the measurement.
    pub activity: cpu::MachineActivity,
}

/// Reads all facts except trial and measurement.
#[must_use]
pub fn read(root: &system::SystemRoot, requirements: MachineRequirements) -> MachineFacts {
    let user = login::read(root);
    MachineFacts {
        limit_grants: limits::limit_grants(root),
        limits: limits::read(root),
        kernel: kernel::read(root, &user.cgroup),
        cpu: cpu::read(root, requirements.core),
        memory: memory::read(root),
        shared: memory::shared(root),
        remove_ipc: login::remove_ipc(root),
        runtime_folder: cells::folder(&rcc_ipc::cell::base_dir()),
        cells: cells::read(&rcc_ipc::cell::base_dir()),
        strays: cells::strays(&PathBuf::from("/dev/shm"), &rcc_ipc::cell::base_dir()),
        requirements,
        user,
        ..MachineFacts::default()
    }
}
