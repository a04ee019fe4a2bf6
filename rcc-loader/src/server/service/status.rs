//! Status of a cell other than commands: devices, processes, and the executor's health. Read from boards and
//! announcements by blocking threads of the server; never asks the real-time thread.

use rcc_api::bodies::{
    ChannelView, ClockView, DeviceView, ExecutorView, HelperView, ProcessView, StatusView,
};
use rcc_api::codes;
use rcc_api::error::ApiError;
use rcc_config::device::kind_name;
use rcc_config::{ChannelConfig, DeviceConfig, OnRelease};
use rcc_core::helper::{HelperEntry, HelperState};
use rcc_core::message::{ClockState, ClockStatus, DEVICES_MAX, DeviceEntry, DeviceState, MAGIC};
use rcc_ipc::AnnounceError;
use rcc_os::clock::monotonic_ns;
use rcc_protocol::{Announcement, Role};

use super::Service;
use super::configuration::disagreement_sentence;
use super::timing::committed_ns;
use crate::server::executor::ExecutorConnection;
use crate::server::store::CommandStore;

/// Bits of `CycleStatus::grants`, and what they grant.
const GRANTS: [(u32, &str); 3] = [(1, "SCHED_FIFO"), (2, "memory locked"), (4, "own core")];

/// Reason of a device whose driver does not run, or is not yet known to the executor.
const NO_DRIVER: &str = "no driver is attached";

impl Service {
    /// Returns the devices of the cell, in the order of its configuration.
    ///
    /// # Errors
    /// Returns an error if there is no executor.
    pub fn devices(&self) -> Result<Vec<DeviceView>, ApiError> {
        let (attached, store) = self.attach()?;
        let rows = attached.tables().devices;
        let drivers = self.announced(Role::Driver)?;
        let net = |id: u64| {
            let net = self.net(&store, id);
            format!("{net}#{id}")
        };
        let view = |(device, row): (&DeviceConfig, Option<&DeviceEntry>)| {
            let state = row.map_or(DeviceState::Offline, |row| {
                DeviceState::from_number(row.state)
            });
            // The executor checks announcements at intervals; until the next check its row describes the former driver.
            let is_attached = row.is_some_and(|row| row.attached == 1);
            let disagreement = match is_attached {
                true => None,
                false => self.disagreement(&device.name),
            };
            let reason = match row {
                _ if disagreement.is_some() => disagreement
                    .map(|why| disagreement_sentence("its driver is not attached: it", &why))
                    .unwrap_or_default(),
                row => self.reason_of_state(&device.name, row),
            };
            let driver = drivers
                .iter()
                .find(|driver| driver.label == device.name && !driver.liveness().is_dead());
            let joints = device.robot.iter().flat_map(|robot| &robot.joints);
            DeviceView {
                name: device.name.clone(),
                driver: device.driver.to_string(),
                state: state.name().to_owned(),
                reason,
                holder: row.filter(|row| row.holder != 0).map(|row| net(row.holder)),
                quality_permille: row.map_or(0, |row| row.quality_permille),
                losses: row.map_or(0, |row| row.losses),
                pid: driver.map_or(0, |driver| driver.pid),
                joints: joints.map(|joint| joint.name.clone()).collect(),
                channels: device.channels.iter().map(channel).collect(),
            }
        };
        let rows = (0..DEVICES_MAX).map(|index| rows.get(index));
        Ok(self
            .naming_config()
            .devices
            .iter()
            .zip(rows)
            .map(view)
            .collect())
    }

    /// Returns the current state of a device and its reason, empty if there is none; `None` without an executor or
    /// without such a device.
    pub(super) fn condition(&self, device: &str) -> Option<(DeviceState, String)> {
        let (attached, _) = self.executor.attach().ok()?;
        let (index, _) = self.naming_config().device(device)?;
        let tables = attached.tables();
        let row = tables.devices.get(index)?;
        let state = DeviceState::from_number(row.state);
        Some((state, self.reason_of_state(device, Some(row))))
    }

    /// Returns why a device is in its state; empty if there is nothing to say.
    fn reason_of_state(&self, device: &str, row: Option<&DeviceEntry>) -> String {
        match row {
            Some(row) if row.attached != 1 => NO_DRIVER.to_owned(),
            None => NO_DRIVER.to_owned(),
            // A driver that runs gives a reason for `offline`.
            Some(row)
                if row.reason == 0
                    && DeviceState::from_number(row.state) == DeviceState::Offline =>
            {
                "its driver is attached and does not respond".to_owned()
            }
            Some(row) => self.reason_words(device, row.reason),
        }
    }

    /// Returns the executor's health and all processes.
    ///
    /// # Errors
    /// Returns an error if there is no executor.
    pub fn status(&self) -> Result<StatusView, ApiError> {
        let (attached, store) = self.attach()?;
        let cell = self.executor.cell();
        let processes = cell.announced_all().map_err(|error| unread(&error))?;
        Ok(StatusView {
            cell: cell.name().to_owned(),
            config: self.config.source.display().to_string(),
            executor: self.executor_view(&attached, &store),
            configuration: self.configuration_problems(&attached, &processes),
            processes: processes.iter().map(process).collect(),
            helpers: self.helper_views(&attached),
        })
    }

    fn helper_views(&self, attached: &ExecutorConnection) -> Vec<HelperView> {
        let now_ns = monotonic_ns();
        let theirs = attached.helpers().into_iter();
        let theirs = theirs.map(|row| helper("executor", &row, now_ns));
        let ours = self.helpers.beats().into_iter();
        let ours = ours.map(|beat| helper("loader", &beat.entry(), now_ns));
        theirs.chain(ours).collect()
    }

    fn executor_view(&self, attached: &ExecutorConnection, store: &CommandStore) -> ExecutorView {
        let status = attached.status();
        let announcement = &attached.announcement;
        let granted = |bit: u32| status.grants & bit != 0;
        ExecutorView {
            pid: announcement.pid,
            incarnation: format!("{:016x}", announcement.incarnation),
            cycle: status.cycle,
            period_ns: status.period_ns,
            clock: self.clock(&status.clock),
            late: status.late,
            late_acknowledged: status.late_acknowledged,
            late_woken: status.late_woken,
            late_computed: status.late_computed,
            first_late: self.late(store, &status.first_late),
            last_late: self.late(store, &status.last_late),
            worst_wake_ns: status.worst_wake_ns,
            exec_last_ns: status.exec_last_ns,
            exec_max_ns: status.exec_max_ns,
            budget_ns: status.budget_ns,
            committed_ns: committed_ns(&attached.tables()),
            skipped_periods: status.skipped_periods,
            dropped_records: status.dropped_records,
            incidents: status.incidents,
            running: status.running,
            fifo: granted(1),
            locked: granted(2),
            pinned: granted(4),
            grade: if status.magic == MAGIC {
                grade(status.grants, &announcement.note)
            } else {
                "RT: not yet running".to_owned()
            },
        }
    }

    fn clock(&self, status: &ClockStatus) -> ClockView {
        let naming = self.naming_config();
        let device = naming.devices.get(status.device as usize);
        ClockView {
            state: ClockState::from_number(status.state).name().to_owned(),
            device: device.map(|device| device.name.clone()),
            error_ns: status.error_ns,
            jitter_ns: status.jitter_ns,
            device_period_ns: status.device_period_ns,
            rate_ppm: status.rate_ppm,
            losses: status.losses,
        }
    }

    /// Returns a driver's explanation of a reason number; empty for 0.
    pub(super) fn reason_words(&self, device: &str, reason: u32) -> String {
        if reason == 0 {
            return String::new();
        }
        let announced = self.executor.cell().announced(Role::Driver, device);
        let note = announced.ok().flatten().map(|driver| driver.note);
        let text = note
            .as_deref()
            .and_then(|note| reason_in(note, reason))
            .map(str::to_owned);
        text.unwrap_or_else(|| format!("reason {reason}"))
    }

    fn announced(&self, role: Role) -> Result<Vec<Announcement>, ApiError> {
        let mut all = self
            .executor
            .cell()
            .announced_all()
            .map_err(|error| unread(&error))?;
        all.retain(|found| found.role == role);
        Ok(all)
    }
}

/// An incomplete list of processes would be misleading, so this is an error.
fn unread(error: &AnnounceError) -> ApiError {
    ApiError::new(
        codes::PROCESS_FAILED,
        format!("cannot read the announcements of the processes: {error}"),
        "try again; if the error persists, the loader has too few file descriptors (LimitNOFILE=)",
    )
}

/// Drivers explain their reason numbers in the note of their announcement, one `NUMBER TEXT` per line.
fn reason_in(note: &str, reason: u32) -> Option<&str> {
    note.lines().find_map(|line| {
        let (number, text) = line.split_once(' ')?;
        (number.trim().parse() == Ok(reason)).then(|| text.trim())
    })
}

/// Describes the privileges that were really obtained. A core of its own is an advantage, not a condition.
fn grade(grants: u32, note: &str) -> String {
    // The executor's own note is better: it names the limits that prevented more.
    if note.starts_with("RT:") {
        return note.to_owned();
    }
    let has = |bit: u32| grants & bit != 0;
    let got: Vec<&str> = GRANTS
        .iter()
        .filter(|(bit, _)| has(*bit))
        .map(|(_, name)| *name)
        .collect();
    if has(1) && has(2) {
        return format!("RT: granted ({})", got.join(", "));
    }
    let because = if note.is_empty() {
        let missing = [
            (1, "SCHED_FIFO was refused"),
            (2, "memory could not be locked"),
        ];
        let names = missing.iter().filter(|(bit, _)| !has(*bit));
        names
            .map(|(_, name)| *name)
            .collect::<Vec<_>>()
            .join(" and ")
    } else {
        note.to_owned()
    };
    format!("RT: degraded, because {because}")
}

fn process(announcement: &Announcement) -> ProcessView {
    ProcessView {
        role: announcement.role.to_string(),
        label: announcement.label.clone(),
        pid: announcement.pid,
        incarnation: format!("{:016x}", announcement.incarnation),
        // A process that may be alive is not shown as dead.
        alive: !announcement.liveness().is_dead(),
        note: announcement.note.clone(),
    }
}

fn helper(process: &str, row: &HelperEntry, now_ns: u64) -> HelperView {
    let state = HelperState::from_number(u32::try_from(row.state).unwrap_or(u32::MAX));
    let age_ns = match row.turns {
        0 => 0,
        _ => now_ns.saturating_sub(row.stamp_ns),
    };
    let hangs = state == HelperState::Running && age_ns > row.limit_ns;
    HelperView {
        process: process.to_owned(),
        name: row.name().to_owned(),
        state: if hangs { "hanging" } else { state.name() }.to_owned(),
        turns: row.turns,
        age_ns,
        limit_ns: row.limit_ns,
    }
}

fn channel(channel: &ChannelConfig) -> ChannelView {
    ChannelView {
        name: channel.name.clone(),
        kind: kind_name(channel.kind).to_owned(),
        unit: channel.unit.to_string(),
        on_release: channel.on_release.map(|release| match release {
            OnRelease::Hold => "hold".to_owned(),
            OnRelease::Safe(value) => format!("safe: {value}"),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grade_tells_what_is_missing() {
        assert_eq!(grade(3, ""), "RT: granted (SCHED_FIFO, memory locked)");
        assert_eq!(grade(2, ""), "RT: degraded, because SCHED_FIFO was refused");
        assert_eq!(grade(3, "RT: as I say"), "RT: as I say");
        assert_eq!(grade(0, "no rights"), "RT: degraded, because no rights");
    }

    #[test]
    fn a_reason_number_is_looked_up_in_the_drivers_note() {
        let note = "1 drives are off\n12 quality is bad\n";
        assert_eq!(reason_in(note, 12), Some("quality is bad"));
        assert_eq!(reason_in(note, 2), None);
    }
}
