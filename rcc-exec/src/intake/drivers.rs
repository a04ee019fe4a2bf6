//! The drivers of the cell's devices: attaches those that announce themselves, detaches dead ones, and reads their
//! boards. Run by the intake thread.

use std::fmt::Display;
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use rcc_core::frame::DeviceInput;
use rcc_core::message::{DeviceState, JOINTS_MAX, Joints, MAGIC, Measurement};
use rcc_ipc::events::EventRecorder;
use rcc_ipc::{BoardReader, Session};
use rcc_os::clock::monotonic_ns;
use rcc_os::process_instance::{Liveness, ProcessInstance};
use rcc_process::log_throttle::LogThrottle;
use rcc_protocol::control::MEASUREMENT;
use rcc_protocol::events::{EventKind, event_text, hex_digits};
use rcc_protocol::{Announcement, ProcessMismatch, Role};
use rtrb::Producer;
use tracing::{info, warn};

use crate::boards::EngineRequest;
use crate::net_builder::DeviceSnapshot;

/// Interval at which the announcements of drivers are checked.
const CHECK_EVERY: Duration = Duration::from_millis(50);

/// All devices, in the order of the configuration, and what is needed to watch their drivers.
pub(super) struct DriverLinks {
    watch: DriverWatch,
    devices: Vec<DeviceLink>,
    checked_at: Option<Instant>,
}

/// The driver of a device, as the intake thread knows it.
struct DeviceLink {
    index: usize,
    name: String,
    /// The driver's incarnation, and this thread's reader of its board; the real-time thread has its own.
    attached: Option<(u64, BoardReader<Measurement>)>,
    /// Incarnation of the driver that was last reported as refused, because of its build or configuration; 0 if none
    /// was.
    refused: u64,
}

/// Everything that is not of one device.
struct DriverWatch {
    session: Session,
    announcement: Announcement,
    stale_after_ns: u64,
    recorder: Option<EventRecorder>,
    /// Limits log lines about drivers whose liveness is unknown or whose board cannot be opened.
    log: LogThrottle,
}

impl DriverLinks {
    /// No driver is attached yet. `announcement` is the executor's: a driver that announces another configuration is
    /// not attached. A board older than `stale_after_ns` is not used.
    pub(super) fn new(
        session: Session,
        names: Vec<String>,
        announcement: Announcement,
        stale_after_ns: u64,
    ) -> DriverLinks {
        let link = |(index, name)| DeviceLink {
            index,
            name,
            attached: None,
            refused: 0,
        };
        DriverLinks {
            watch: DriverWatch {
                session,
                announcement,
                stale_after_ns,
                recorder: None,
                log: LogThrottle::default(),
            },
            devices: names.into_iter().enumerate().map(link).collect(),
            checked_at: None,
        }
    }

    /// Also writes events to the cell's event log.
    pub(super) fn log_events(&mut self, recorder: EventRecorder) {
        self.watch.recorder = Some(recorder);
    }

    /// Attaches drivers that have announced themselves and detaches dead ones, if it is time to check.
    pub(super) fn update(&mut self, engine: &mut Producer<EngineRequest>) {
        let checked = self.checked_at;
        if checked.is_none_or(|at| at.elapsed() >= CHECK_EVERY) {
            self.checked_at = Some(Instant::now());
            for device in &mut self.devices {
                self.watch.update(device, engine);
            }
        }
    }

    /// Returns the current state of all devices.
    pub(super) fn snapshot(&self) -> DeviceSnapshot {
        let looks = self.devices.iter().map(|device| self.watch.read(device));
        let (devices, holds) = looks.unzip();
        DeviceSnapshot { devices, holds }
    }
}

impl DriverWatch {
    fn record(&self, event: EventKind) {
        if let Some(recorder) = &self.recorder {
            recorder.tell(event);
        }
    }

    /// Returns the measurement of a device, and the hold position of its arm if it is known.
    fn read(&self, device: &DeviceLink) -> (DeviceInput, Option<Joints>) {
        let mut input = DeviceInput {
            present: false,
            measurement: Measurement::zeroed(),
        };
        let Some((_, board)) = device.attached.as_ref() else {
            return (input, None);
        };
        let measurement = board.read();
        let fresh = monotonic_ns().abs_diff(measurement.stamp_ns) <= self.stale_after_ns;
        let online = DeviceState::from_number(measurement.state) != DeviceState::Offline;
        let finite = measurement.hold.iter().all(|value| value.is_finite());
        let known = measurement.magic == MAGIC
            && measurement.joints as usize <= JOINTS_MAX
            && measurement.joints > 0;
        input.present = fresh && online && measurement.magic == MAGIC;
        input.measurement = measurement;
        let hold = (fresh && online && finite && known).then_some(measurement.hold);
        (input, hold)
    }

    /// Attaches the driver of a device if it has announced itself, and detaches it if it is dead; a driver that may be
    /// alive stays attached. A driver that was started with another configuration is not attached, because its
    /// measurements and our set-points would refer to other channels. One check per incarnation is enough, because
    /// neither process reads its configuration again.
    fn update(&mut self, device: &mut DeviceLink, engine: &mut Producer<EngineRequest>) {
        let attached = device.attached.as_ref().map(|(driver, _)| *driver);
        let announced = self.session.cell().announced(Role::Driver, &device.name);
        match announced {
            Ok(Some(announced)) if attached != Some(announced.incarnation) => {
                match announced.liveness() {
                    Liveness::Alive => self.consider(device, &announced, engine),
                    // It is not attached before it is known to be alive.
                    Liveness::Unknown(error) => self.report_unknown(device, &error),
                    Liveness::Dead => self.detach_dead(device, engine),
                }
            }
            Ok(Some(_)) => self.detach_dead(device, engine),
            // A driver removes its announcement when its device is at rest and it ends.
            Ok(None) => self.detach(device, engine),
            Err(error) => {
                self.report_unknown(device, &error);
                self.detach_dead(device, engine);
            }
        }
    }

    /// Attaches a living driver, unless its build or configuration differs from ours.
    fn consider(
        &mut self,
        device: &mut DeviceLink,
        driver: &Announcement,
        engine: &mut Producer<EngineRequest>,
    ) {
        if let Some(why) = ProcessMismatch::about_device(driver, &self.announcement, &device.name) {
            self.detach(device, engine);
            self.report_mismatch(device, driver, &why);
        } else if let Some(service) = driver.services.get(MEASUREMENT) {
            self.attach(device, (driver, service.as_str()), engine);
        }
    }

    /// Detaches the driver of a device if the driver is known to be dead.
    fn detach_dead(&mut self, device: &mut DeviceLink, engine: &mut Producer<EngineRequest>) {
        let Some((driver, _)) = device.attached.as_ref() else {
            return;
        };
        match ProcessInstance::from_incarnation(*driver).liveness() {
            Liveness::Alive => {}
            Liveness::Dead => self.detach(device, engine),
            Liveness::Unknown(error) => self.report_unknown(device, &error),
        }
    }

    fn detach(&mut self, device: &mut DeviceLink, engine: &mut Producer<EngineRequest>) {
        let Some((incarnation, _)) = device.attached else {
            return;
        };
        let engine_request = EngineRequest::Detach {
            device: device.index,
            incarnation,
        };
        // If the ring is full the driver stays attached, and the next check tries again.
        if engine.push(engine_request).is_err() {
            return;
        }
        device.attached = None;
        let gone = EventKind::DriverGone {
            device: device.name.clone(),
            driver: hex_digits(incarnation),
        };
        info!("driver of {} detached", device.name);
        self.record(gone);
    }

    /// Reports that it is not known whether a driver is alive; nothing else is done.
    fn report_unknown(&mut self, device: &DeviceLink, why: &dyn Display) {
        let Some(others) = self.log.admit(Instant::now()) else {
            return;
        };
        let name = &device.name;
        let event = EventKind::LifeUnknown {
            process: format!("driver/{name}"),
            why: event_text(&why.to_string()),
        };
        warn!(
            "cannot tell whether driver/{name} is alive ({why}); the check is repeated; {others} more such failures since the last message"
        );
        self.record(event);
    }

    /// Reports, once per incarnation, a driver whose build or configuration differs from this executor's.
    fn report_mismatch(
        &self,
        device: &mut DeviceLink,
        driver: &Announcement,
        why: &ProcessMismatch,
    ) {
        let reported = std::mem::replace(&mut device.refused, driver.incarnation);
        if reported == driver.incarnation {
            return;
        }
        warn!("{} is not attached: {why}; {}", driver.who(), why.remedy());
        self.record(why.event(driver));
    }

    fn attach(
        &mut self,
        device: &mut DeviceLink,
        (driver, service): (&Announcement, &str),
        engine: &mut Producer<EngineRequest>,
    ) {
        let incarnation = driver.incarnation;
        let boards = (
            self.session.open_board(service),
            self.session.open_board(service),
        );
        match boards {
            (Ok(mine), Ok(board)) => {
                let engine_request = EngineRequest::Attach {
                    device: device.index,
                    incarnation,
                    board: Box::new(board),
                };
                // If the ring is full the driver stays detached, and the next check tries again.
                if engine.push(engine_request).is_ok() {
                    info!("driver of {} attached", device.name);
                    self.record(EventKind::DriverAttached {
                        device: device.name.clone(),
                        pid: driver.pid,
                        driver: hex_digits(incarnation),
                    });
                    device.attached = Some((incarnation, mine));
                }
            }
            // The next check tries again.
            (Err(error), _) | (_, Err(error)) => {
                if self.log.admit(Instant::now()).is_some() {
                    warn!("cannot open the board of {}: {error}", device.name);
                }
            }
        }
    }
}
