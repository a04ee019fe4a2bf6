//! Runs the demo's nets one at a time, and records each. Used by the demo's main thread, which keeps supervising the
//! cell while it waits.

use std::time::{Duration, Instant};

use rcc_api::bodies::{CommandDetail, DeviceView, StatusView};
use rcc_api::codes;
use rcc_core::message::MonitorRecord;

use super::recorder::MonitorRecorder;
use super::simulator::{DatagramExchange, SimulatorClient};
use crate::client::LoaderClient;
use crate::failure::Failure;
use crate::follow::{self, OnRejection};
use crate::interrupt::Interrupts;
use crate::output::BackgroundPrinter;
use crate::supervisor::{POLL_INTERVAL, Supervisor};

/// Longest time to wait for a device to become ready.
const READY_TIMEOUT: Duration = Duration::from_secs(20);
/// Longest time for one net of the demo.
const NET_TIMEOUT: Duration = Duration::from_secs(20);
/// Longest time to wait for a net's last records.
const RECORDS_TIMEOUT: Duration = Duration::from_secs(1);

/// The demo's cell, its clients and its recorders.
pub struct DemoRunner<'a> {
    /// Time at which the cell was up.
    pub started: Instant,
    /// Supervises the cell.
    pub supervisor: &'a mut Supervisor,
    /// Client of the loader.
    pub client: &'a LoaderClient,
    /// Keeps the monitor records.
    pub recorder: &'a MonitorRecorder,
    /// Control port of the simulated arm.
    pub simulator: &'a mut SimulatorClient,
    /// Detects Ctrl-C.
    pub interrupts: &'a Interrupts,
    /// Prints progress and notes.
    pub printer: &'a BackgroundPrinter,
}

/// A net that has ended, with its recorded data.
pub struct NetRun {
    /// The command after its end.
    pub command: CommandDetail,
    /// Its monitor records.
    pub records: Vec<MonitorRecord>,
    /// Datagrams on the wire, from before START until the arm was at rest.
    pub exchanges: Vec<DatagramExchange>,
    /// Late cycles of the executor during the run.
    pub late: u64,
}

impl DemoRunner<'_> {
    /// Loads, starts and follows a net until it has ended and the arm is at rest. `watch` is called repeatedly while
    /// the net runs; it returns true when the net is to be canceled.
    ///
    /// # Errors
    /// Fails on an interrupt, if the loader cannot be reached or refuses, or if a time limit is exceeded.
    pub fn run(
        &mut self,
        name: &str,
        text: &str,
        mut watch: impl FnMut(&MonitorRecorder, &CommandDetail) -> bool,
    ) -> Result<NetRun, Failure> {
        let late = self.late()?;
        self.wait_until_ready()?;
        let path = self.supervisor.cell.supervisor_dir().join("trace.csv");
        let trace = self
            .simulator
            .begin_trace(&path)
            .map_err(simulator_failed)?;
        let loaded = self.load_and_start(name, text)?;
        let id = loaded.command.id;
        let started = Instant::now();
        let mut canceled = false;
        let command = loop {
            self.pause()?;
            let command = follow::state(self.client, &id.to_string())?;
            if watch(self.recorder, &loaded) && !canceled {
                canceled = true;
                follow::operate(self.client, &id.to_string(), "cancel")?;
            }
            if follow::is_over(&command.command) {
                break command;
            }
            if started.elapsed() > NET_TIMEOUT {
                let message = format!("{name} is not over after {NET_TIMEOUT:?}");
                return Err(Failure::new(codes::LOADER_SILENT, message, ""));
            }
        };
        self.wait_until_ready()?;
        let exchanges = self.simulator.end_trace(trace).map_err(simulator_failed)?;
        self.wait_for_records(&command)?;
        let (records, _) = self.recorder.take(id);
        follow::unload(self.client, &id.to_string())?;
        Ok(NetRun {
            command,
            records,
            exchanges,
            late: self.late()? - late,
        })
    }

    /// Loads and starts a net. On a busy machine the device may become unready between LOAD and START; then both are
    /// repeated.
    fn load_and_start(&mut self, name: &str, text: &str) -> Result<CommandDetail, Failure> {
        let limit = Instant::now() + READY_TIMEOUT;
        loop {
            let loaded = follow::load(self.client, name, text, OnRejection::Unload)?;
            let id = loaded.id;
            let refused = match follow::operate(self.client, &id.to_string(), "start") {
                Ok(_) => return follow::state(self.client, &id.to_string()),
                Err(failure) => failure,
            };
            follow::unload(self.client, &id.to_string())?;
            let passing = [codes::DEVICE_NOT_READY.code, codes::FIRST_SET_POINT.code];
            if !passing.contains(&refused.body.code.as_str()) || Instant::now() >= limit {
                return Err(refused);
            }
            self.wait_until_ready()?;
        }
    }

    /// Waits until every device is at rest and can be commanded.
    ///
    /// # Errors
    /// Fails on an interrupt, if the loader cannot be reached, or if it takes too long.
    pub fn wait_until_ready(&mut self) -> Result<(), Failure> {
        let limit = Instant::now() + READY_TIMEOUT;
        loop {
            let devices: Vec<DeviceView> = self.client.get("/devices")?;
            let Some(device) = devices.iter().find(|device| device.state != "ready") else {
                return Ok(());
            };
            if Instant::now() >= limit {
                return Err(Failure::new(
                    codes::DEVICE_NOT_READY,
                    format!("{} is {} ({})", device.name, device.state, device.reason),
                    "the demo needs an otherwise idle machine",
                ));
            }
            self.pause()?;
        }
    }

    fn wait_for_records(&mut self, command: &CommandDetail) -> Result<(), Failure> {
        let limit = Instant::now() + RECORDS_TIMEOUT;
        let (id, last) = (command.command.id, command.command.ended_cycle);
        let monitors = command
            .names
            .get("monitors")
            .and_then(|names| names.as_array());
        if monitors.is_none_or(Vec::is_empty) {
            return Ok(());
        }
        while self.recorder.last_cycle(id) < last && Instant::now() < limit {
            self.pause()?;
        }
        Ok(())
    }

    fn late(&self) -> Result<u64, Failure> {
        let status: StatusView = self.client.get("/status")?;
        Ok(status.executor.late)
    }

    fn pause(&mut self) -> Result<(), Failure> {
        std::thread::sleep(POLL_INTERVAL / 2);
        self.supervisor.poll();
        if self.interrupts.asked() {
            return Err(Failure::interrupted());
        }
        Ok(())
    }
}

/// Failure of a simulator's control port.
pub fn simulator_failed(error: std::io::Error) -> Failure {
    Failure::new(codes::PROCESS_FAILED, error.to_string(), "")
}
