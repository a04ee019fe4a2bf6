//! Devices in the engine: passes the commands of nets through the guard. Real-time thread.

use bytemuck::Zeroable;
use rcc_core::frame::{DeviceInput, DeviceModel, DeviceOutput};
use rcc_core::guard::{Guard, Violation, ViolationKind};
use rcc_core::impedance::AXES;
use rcc_core::message::{
    CommandHead, DEVICES_MAX, DeviceEntry, DeviceState, FaultCode, FaultRecord, JOINTS_MAX, MAGIC,
    Measurement, SetPoint,
};

use super::command_table::CommandRow;
use super::{Engine, EngineConfig, SETTLE_MAX_NS};
use crate::boards::DeviceBoards;
use crate::rows::{RowIndex, set_bits};

mod latch;

/// One device of the cell, without its model and its input: see [`Devices`].
#[derive(Debug)]
pub(super) struct Device<B: DeviceBoards> {
    index: usize,
    /// Incarnation of its driver, and the board that the driver writes.
    driver: Option<(u64, Box<B::Measurements>)>,
    /// Board with its set-points, for the driver.
    set_points: B::SetPoints,
    pub(super) guard: Guard,
    /// The engagement of the command that currently commands the arm.
    pub(super) engagement: Option<Engagement>,
    before_handover: BeforeHandover,
    /// Commands of this cycle.
    point: SetPoint,
    /// A net has added commands to `point` in this cycle.
    commanded: bool,
    head: CommandHead,
    /// Its row of the published device table.
    pub(super) entry: DeviceEntry,
}

/// An uninterrupted sequence of cycles in which a net commands an arm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Engagement {
    pub(super) row: RowIndex,
    pub(super) number: u64,
    pub(super) since_cycle: u64,
    pub(super) followed: bool,
    /// Logical time that the driver must have played before it follows this engagement and not the previous one, ns.
    pub(super) follows_from_ns: u64,
}

/// The cycle in which a set-point is checked.
#[derive(Clone, Copy, Debug)]
struct GuardedCycle {
    cycle: u64,
    period_ns: u64,
    dt_s: f64,
}

/// The devices of the cell, in the order of the configuration. Nets read models and inputs as slices, so these are
/// apart; all three have the same length.
#[derive(Debug)]
pub(super) struct Devices<B: DeviceBoards> {
    models: Box<[DeviceModel]>,
    inputs: Box<[DeviceInput]>,
    devices: Box<[Device<B>]>,
    /// Bit d: device d is offline.
    offline: u64,
    /// Bit d: the input of device d has changed since [`Devices::take_changed`].
    changed: u64,
    /// Room for a measurement that is read.
    read: Box<Measurement>,
}

impl<B: DeviceBoards> Devices<B> {
    /// `set_points` are the boards of the devices in `config.models`, in the same order.
    pub(super) fn new(config: &EngineConfig, set_points: Vec<B::SetPoints>) -> Devices<B> {
        let models = config.models.iter().take(DEVICES_MAX);
        let devices: Box<[_]> = (models.zip(set_points).enumerate())
            .map(|(index, (model, set_points))| {
                let guard = Guard::new(model.limits, model.first_tolerance_rad)
                    .with_impedance(model.impedance)
                    .with_workspace(model.arm, model.workspace);
                let head = CommandHead {
                    magic: MAGIC,
                    executor: config.incarnation,
                    period_ns: config.period_ns,
                    ..CommandHead::zeroed()
                };
                Device {
                    index,
                    driver: None,
                    set_points,
                    before_handover: BeforeHandover {
                        guard: guard.clone(),
                        engagement: None,
                        point: SetPoint::NONE,
                        commanded: false,
                    },
                    guard,
                    engagement: None,
                    point: SetPoint::NONE,
                    commanded: false,
                    head,
                    entry: DeviceEntry::zeroed(),
                }
            })
            .collect();
        let absent = DeviceInput {
            present: false,
            measurement: Measurement::zeroed(),
        };
        Devices {
            offline: (0..devices.len()).fold(0, |bits, device| bits | 1 << device),
            changed: 0,
            read: Box::new(Measurement::zeroed()),
            models: config.models.iter().take(devices.len()).copied().collect(),
            inputs: vec![absent; devices.len()].into(),
            devices,
        }
    }

    /// The devices that are offline, bit by bit.
    pub(super) fn offline(&self) -> u64 {
        self.offline
    }

    pub(super) fn len(&self) -> usize {
        self.devices.len()
    }

    /// Models and inputs, as nets read them.
    pub(super) fn slices(&self) -> (&[DeviceModel], &[DeviceInput]) {
        (&self.models, &self.inputs)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (&DeviceInput, &Device<B>)> {
        self.inputs.iter().zip(self.devices.iter())
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = (&DeviceInput, &mut Device<B>)> {
        self.inputs.iter().zip(self.devices.iter_mut())
    }

    pub(super) fn get(&self, index: usize) -> Option<(&DeviceInput, &Device<B>)> {
        self.inputs.get(index).zip(self.devices.get(index))
    }

    pub(super) fn get_mut(&mut self, index: usize) -> Option<(&DeviceInput, &mut Device<B>)> {
        self.inputs.get(index).zip(self.devices.get_mut(index))
    }

    /// The devices whose input has changed since the last call, bit by bit.
    pub(super) fn take_changed(&mut self) -> u64 {
        std::mem::take(&mut self.changed)
    }

    /// State of a device as its driver reports it; offline if it is not present.
    pub(super) fn state(&self, index: usize) -> DeviceState {
        (self.inputs.get(index)).map_or(DeviceState::Offline, reported_state)
    }
}

/// State of a device as its driver reports it; offline if it is not present.
fn reported_state(input: &DeviceInput) -> DeviceState {
    match input.present {
        true => DeviceState::from_number(input.measurement.state),
        false => DeviceState::Offline,
    }
}

/// State of a device before a hand-over is tried, to restore it if the hand-over is refused. An earlier hand-over of the
/// same cycle may have commanded the device already.
#[derive(Clone, Debug)]
struct BeforeHandover {
    guard: Guard,
    engagement: Option<Engagement>,
    point: SetPoint,
    commanded: bool,
}

impl<B: DeviceBoards> Device<B> {
    pub(super) fn set_points(&self) -> &B::SetPoints {
        &self.set_points
    }

    /// Discards the commands of the previous cycle.
    pub(super) fn begin_cycle(&mut self) {
        if std::mem::take(&mut self.commanded) {
            self.point = SetPoint::NONE;
        }
    }

    /// Adds the commands of a net to those of this cycle.
    fn add(&mut self, output: &DeviceOutput) {
        self.commanded = true;
        merge(&mut self.point, output);
    }

    /// Remembers the state to which [`Device::undo_handover`] returns.
    pub(super) fn begin_handover(&mut self) {
        self.before_handover = BeforeHandover {
            guard: self.guard.clone(),
            engagement: self.engagement,
            point: self.point,
            commanded: self.commanded,
        };
    }

    /// Restores the state before the hand-over was tried.
    pub(super) fn undo_handover(&mut self) {
        let BeforeHandover {
            guard,
            engagement,
            point,
            commanded,
        } = self.before_handover.clone();
        (self.guard, self.engagement) = (guard, engagement);
        (self.point, self.commanded) = (point, commanded);
    }

    /// Ends the engagement of the net in `row`, if there is one.
    fn disengage(&mut self, row: RowIndex) {
        if self
            .engagement
            .is_some_and(|engagement| engagement.row == row)
        {
            self.engagement = None;
        }
    }

    /// Checks the set-point of an arm: the first of an engagement against the hold set-point, all others against the
    /// previous one. Returns true if it begins the engagement `next`.
    fn check_set_point(
        &mut self,
        input: &DeviceInput,
        output: &DeviceOutput,
        next: Engagement,
        now: GuardedCycle,
    ) -> Result<bool, FaultRecord> {
        let (index, cycle) = (self.index, now.cycle);
        if !output.has_position {
            self.engagement = None;
            return Ok(false);
        }
        let (state, strategy) = (reported_state(input), input.measurement.strategy);
        let guard = &mut self.guard;
        let Some(engagement) = &mut self.engagement else {
            // A device that becomes commanded must rest at its hold set-point, and the net must begin there.
            if state != DeviceState::Ready {
                return Err(fault_at(FaultCode::DeviceLost, index, cycle));
            }
            let first = guard.first(&output.position, &input.measurement.hold);
            let first =
                first.and_then(|()| guard.check_impedance(&output.impedance, strategy, now.dt_s));
            first.map_err(|violation| fault_of(FaultCode::Jump, index, cycle, violation))?;
            self.engagement = Some(next);
            return Ok(true);
        };
        let waited_ns = (cycle - engagement.since_cycle) * now.period_ns;
        let follows = match state {
            DeviceState::Commanded => true,
            // The driver buffers some set-points before it follows the first.
            DeviceState::Ready => !engagement.followed && waited_ns < SETTLE_MAX_NS,
            _ => false,
        };
        if !follows {
            return Err(fault_at(FaultCode::DeviceLost, index, cycle));
        }
        engagement.followed |= state == DeviceState::Commanded
            && input.measurement.played_ns >= engagement.follows_from_ns;
        let later = guard.check(&output.position, now.dt_s);
        let later =
            later.and_then(|()| guard.check_impedance(&output.impedance, strategy, now.dt_s));
        later.map_err(|violation| fault_of(FaultCode::Limit, index, cycle, violation))?;
        Ok(false)
    }

    /// Writes the commands of this cycle to the board.
    pub(super) fn write_set_point(&mut self, input: &DeviceInput, cycle: u64, now_ns: u64) {
        let (head, point) = (&mut self.head, &mut self.point);
        (head.sequence, head.stamp_ns) = (cycle, now_ns);
        head.seen = match input.present {
            true => input.measurement.sequence,
            false => 0,
        };
        point.logical_ns = cycle.wrapping_mul(head.period_ns);
        point.owner = self.engagement.map_or(0, |engagement| engagement.number);
        B::write(&mut self.set_points, head, point);
    }
}

impl<B: DeviceBoards> Engine<B> {
    /// Passes the commands of the net in `row` on to its devices: all of them, or none and a fault. If it `survives` the
    /// loss of a device, an arm that is lost gets nothing from then on, also when it is back, and also if the net commanded
    /// null meanwhile: whoever brought it back does not expect that it moves.
    pub(super) fn pass_commands(
        &mut self,
        row: RowIndex,
        survives: bool,
    ) -> Result<(), FaultRecord> {
        let now = GuardedCycle {
            cycle: self.status.cycle,
            period_ns: self.period_ns,
            dt_s: self.dt_s,
        };
        let Some(net) = &self.commands[row].net else {
            return Ok(());
        };
        let mut lost = self.commands[row].lost_arms;
        if survives {
            let gone = net.arms() & self.devices.offline & !lost;
            for index in set_bits(gone) {
                if let Some((_, device)) = self.devices.get_mut(index) {
                    device.disengage(row);
                }
            }
            lost |= gone;
        }
        for index in set_bits(net.arms() & !lost) {
            let place = self.devices.get_mut(index).zip(net.outputs().get(index));
            let Some(((input, device), output)) = place else {
                continue;
            };
            let next = Engagement {
                row,
                number: self.next_engagement,
                since_cycle: now.cycle,
                followed: false,
                follows_from_ns: 0,
            };
            match device.check_set_point(input, output, next, now) {
                Ok(begins) => self.next_engagement += u64::from(begins),
                Err(fault) if survives && fault.code == FaultCode::DeviceLost as u32 => {
                    device.disengage(row);
                    lost |= 1 << index;
                }
                Err(fault) => return Err(fault),
            }
        }
        self.commands[row].lost_arms = lost;
        self.merge_outputs(row);
        Ok(())
    }

    /// Adds the outputs of the net in `row` to the commands of this cycle, except those for arms that it has lost.
    pub(super) fn merge_outputs(&mut self, row: RowIndex) {
        let CommandRow {
            net: Some(net),
            lost_arms,
            ..
        } = &self.commands[row]
        else {
            return;
        };
        for index in set_bits(net.devices() & !lost_arms) {
            let place = self.devices.get_mut(index).zip(net.outputs().get(index));
            if let Some(((_, device), output)) = place {
                device.add(output);
            }
        }
    }

    /// The first device that the net in `row` uses and that is offline.
    pub(super) fn lost_device(&self, row: RowIndex) -> Option<usize> {
        let net = self.commands[row].net.as_ref();
        let used = net.map_or(0, |net| net.devices());
        set_bits(used & self.devices.offline).next()
    }

    /// The first arm of the net in `row`, without those that it has lost, that has not played everything up to
    /// `logical_ns` or does not rest.
    pub(super) fn unsettled_arm(&self, row: RowIndex, logical_ns: u64) -> Option<usize> {
        let row = &self.commands[row];
        set_bits(row.claims().arms & !row.lost_arms).find(|index| {
            self.devices.get(*index).is_some_and(|(input, _)| {
                input.measurement.settled_ns < logical_ns
                    || reported_state(input) != DeviceState::Ready
            })
        })
    }

    /// Ends the engagements of the net in `row`.
    pub(super) fn disengage(&mut self, row: RowIndex) {
        for (_, device) in self.devices.iter_mut() {
            device.disengage(row);
        }
    }
}

fn merge(all: &mut SetPoint, one: &DeviceOutput) {
    if one.has_position {
        all.has_position = 1;
        all.position = one.position;
        all.impedance = one.impedance;
    }
    all.digital |= one.digital & one.digital_commanded;
    all.digital_commanded |= one.digital_commanded;
    for (place, value) in all.analog.iter_mut().zip(one.analog) {
        if !value.is_nan() {
            *place = value;
        }
    }
}

fn fault_at(code: FaultCode, device: usize, cycle: u64) -> FaultRecord {
    FaultRecord {
        code: code as u32,
        device: device as u32,
        cycle,
        ..FaultRecord::NONE
    }
}

fn fault_of(code: FaultCode, device: usize, cycle: u64, violation: Violation) -> FaultRecord {
    // If the first set-point violates a limit, the fault is the limit, not the position of the device.
    let code = match (code, violation.kind) {
        (_, ViolationKind::Jump) => FaultCode::Jump,
        (FaultCode::Jump, _) => FaultCode::Limit,
        (code, _) => code,
    };
    debug_assert!(usize::from(violation.joint) < JOINTS_MAX + AXES.len());
    let joint = match violation.kind.is_of_device() {
        true => 0,
        false => u32::from(violation.joint) + 1,
    };
    FaultRecord {
        joint,
        violation: violation.kind.number(),
        value: violation.value,
        limit: violation.limit,
        ..fault_at(code, device, cycle)
    }
}
