//! Reads the cell and publishes it, over restarts of its executor. A thread of its own, because shared memory is polled.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rcc_core::message::Measurement;
use rcc_reading::messages::{CellMessages, MessageOptions};
use rcc_reading::selection::Selection;
use rcc_reading::source::{CellSource, SourceBatch};
use rcc_recording::arm::ViewedArm;
use rcc_recording::file::RecordingError;

use crate::node::RosNode;
use crate::sink::RosSink;

/// Interval at which executors are looked for.
const IDLE: Duration = Duration::from_millis(50);
/// Interval at which the event log is read.
const EVENTS_EVERY: Duration = Duration::from_millis(200);
/// Pause after the cell could not be read.
const RETRY_AFTER: Duration = Duration::from_secs(2);

/// Options of the thread that reads the cell.
#[derive(Clone, Debug)]
pub struct CellOptions {
    /// Name of the cell.
    pub cell: String,
    /// Greatest rate of the messages about an arm, Hz.
    pub rate_hz: f64,
}

/// Newest state of an arm.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmState {
    /// Measured positions, rad.
    pub position: Vec<f64>,
    /// Set-points that the driver holds or follows, rad.
    pub commanded: Vec<f64>,
}

/// An arm: the names of its joints, and its newest state, which it has not while its driver is gone.
#[derive(Clone, Debug, Default)]
struct SeenArm {
    joints: Vec<String>,
    state: Option<ArmState>,
}

/// The arms by the names of their devices, with their newest states.
#[derive(Debug, Default)]
pub struct ArmStates(Mutex<BTreeMap<String, SeenArm>>);

impl ArmStates {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, SeenArm>> {
        // Each change is one call of the map.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the state of an arm.
    #[must_use]
    pub fn of(&self, device: &str) -> Option<ArmState> {
        self.lock().get(device)?.state.clone()
    }

    /// Returns devices and joints of all arms that were seen.
    #[must_use]
    pub fn arms(&self) -> Vec<(String, Vec<String>)> {
        let arms = self.lock();
        arms.iter()
            .map(|(device, arm)| (device.clone(), arm.joints.clone()))
            .collect()
    }

    fn add(&self, arm: &ViewedArm) {
        let joints = (1..=arm.joints()).map(|number| arm.joint_name(number));
        self.lock().entry(arm.device.clone()).or_default().joints = joints.collect();
    }

    fn set(&self, device: &str, measured: Option<&Measurement>) {
        if let Some(arm) = self.lock().get_mut(device) {
            let joints = arm.joints.len();
            let first = |values: &[f64]| values.iter().take(joints).copied().collect();
            arm.state = measured.map(|measured| ArmState {
                position: first(&measured.position),
                commanded: first(&measured.hold),
            });
        }
    }
}

/// Reads and publishes until `ends`.
pub fn run(options: &CellOptions, node: Arc<RosNode>, states: &ArmStates, ends: &AtomicBool) {
    let mut sink = RosSink::new(node);
    let options_of_messages = MessageOptions {
        selection: Selection::default(),
        view_every_ns: (1e9 / options.rate_hz) as u64,
        reader: "ros2",
    };
    let messages = CellMessages::new(&mut sink, options_of_messages);
    let mut reader = CellReader {
        sink,
        messages,
        states,
        devices: Vec::new(),
    };
    if let Err(error) = reader.run(options, ends) {
        tracing::error!(%error, "messages cannot be published");
    }
}

struct CellReader<'a> {
    sink: RosSink,
    messages: CellMessages,
    states: &'a ArmStates,
    /// Names of the devices, in the order of the configuration.
    devices: Vec<String>,
}

impl CellReader<'_> {
    fn run(&mut self, options: &CellOptions, ends: &AtomicBool) -> Result<(), RecordingError> {
        // Twice the rate that is sent; the record stream is read in each fifth poll, and its buffers hold 100 ms.
        let polls_hz = (2.0 * options.rate_hz).clamp(200.0, 2000.0);
        let pause = Duration::from_secs_f64(1.0 / polls_hz);
        let mut source = CellSource::new(&options.cell, polls_hz as u64);
        let mut events = Instant::now();
        let mut problem = String::new();
        // Acquire pairs with the release of the thread that ends the program.
        while !ends.load(Ordering::Acquire) {
            match source.poll() {
                Ok(batch) => self.batch(&batch)?,
                Err(error) => {
                    let words = error.to_string();
                    if problem != words {
                        tracing::warn!("cell `{}` cannot be read: {words}", options.cell);
                        problem = words;
                    }
                    std::thread::sleep(RETRY_AFTER);
                    source = CellSource::new(&options.cell, polls_hz as u64);
                    continue;
                }
            }
            if events.elapsed() >= EVENTS_EVERY {
                events = Instant::now();
                self.messages.write_events(&mut self.sink)?;
            }
            std::thread::sleep(if source.is_attached() { pause } else { IDLE });
        }
        self.messages.end_nets(&mut self.sink)
    }

    fn batch(&mut self, batch: &SourceBatch) -> Result<(), RecordingError> {
        if let Some(facts) = &batch.executor {
            for arm in facts
                .devices
                .iter()
                .filter_map(|device| device.arm.as_ref())
            {
                self.states.add(arm);
            }
            self.devices = facts
                .devices
                .iter()
                .map(|device| device.name.clone())
                .collect();
        }
        for (index, measured) in &batch.measurements {
            if let Some(device) = self.devices.get(*index) {
                self.states.set(device, measured.as_ref());
            }
        }
        if batch.gone {
            for device in &self.devices {
                self.states.set(device, None);
            }
        }
        self.messages.batch(&mut self.sink, batch)
    }
}
