//! Devices in the engine: latches the measurements of drivers, and passes the commands of nets through the guard.
//! Real-time thread.

use rcc_core::frame::DeviceOutput;
use rcc_core::guard::{Violation, ViolationKind};
use rcc_core::impedance::AXES;
use rcc_core::message::{DeviceState, FaultCode, FaultRecord, JOINTS_MAX, MAGIC, Measurement};

use rcc_ipc::BoardReader;

use super::{Engagement, Engine, SETTLE_MAX_NS};
use crate::queue::{EngineEvent, EngineReply};

impl Engine {
    /// Latches a device for this cycle: the incarnation of its driver and its newest measurement, or `None` without a
    /// board.
    pub fn latch(&mut self, index: usize, board: Option<(u64, Measurement)>, now_ns: u64) {
        let Some(input) = self.inputs.get_mut(index) else {
            return;
        };
        // A driver was restarted: the device is absent for one cycle, so that nets that commanded the previous
        // incarnation end, however quickly it was replaced. A net never continues with a restarted driver.
        let known = (self.tables.devices.get(index)).map_or(0, |entry| entry.incarnation);
        let board = board.filter(|(incarnation, _)| known == 0 || known == *incarnation);
        let before = input.present;
        let mut fresh = false;
        input.present = false;
        let mut forward = true;
        if let Some((_, measurement)) = board {
            // Within one incarnation of a driver the sequence number of its exchanges never decreases.
            let counted = (self.tables.devices.get(index)).map_or(0, |entry| entry.sequence);
            forward = known == 0 || measurement.sequence >= counted;
            // A stamp from the future is as bad as an old one: it would not age.
            let age_ns = now_ns.abs_diff(measurement.stamp_ns);
            fresh = measurement.magic == MAGIC && age_ns <= self.config.stale_after_ns;
            let joints = self
                .config
                .models
                .get(index)
                .map_or(0, |model| model.joints);
            input.measurement = measurement;
            input.present = is_plausible(&mut input.measurement, joints) && fresh && forward;
        }
        let (present, measurement) = (input.present, input.measurement);
        let state = if present {
            DeviceState::from_number(measurement.state)
        } else {
            DeviceState::Offline
        };
        let engagement = self.devices.get(index).and_then(|device| device.engagement);
        let holder = engagement.and_then(|engagement| self.tables.commands.get(engagement.row));
        let holder = holder.map_or(0, |row| row.id);
        let Some(entry) = self.tables.devices.get_mut(index) else {
            return;
        };
        self.tables_changed |= entry.holder != holder;
        entry.holder = holder;
        entry.attached = u32::from(board.is_some());
        let driver = board.map_or(entry.incarnation, |(incarnation, _)| incarnation);
        entry.incarnation = board.map_or(0, |(incarnation, _)| incarnation);
        // After a sequence number went back, the device stays lost until it reaches the old one, or its driver is
        // restarted.
        if forward {
            entry.sequence = measurement.sequence;
        }
        entry.stamp_ns = measurement.stamp_ns;
        entry.quality_permille = measurement.quality_permille;
        entry.reason = measurement.reason;
        if before && !present {
            entry.losses += 1;
        }
        if entry.state != state as u32 {
            let was = entry.state;
            entry.state = state as u32;
            self.tables_changed = true;
            let cycle = self.status.cycle + 1;
            let reason = measurement.reason;
            self.log(EngineEvent::Device {
                cycle,
                device: index as u32,
                state: state as u32,
                was,
                reason,
                age_ns: if fresh {
                    0
                } else {
                    now_ns.abs_diff(measurement.stamp_ns)
                },
                driver,
                attached: board.is_some(),
            });
        }
    }

    /// A driver announced itself: its board replaces the previous one, which is given back.
    pub(super) fn attach(
        &mut self,
        device: usize,
        incarnation: u64,
        board: Box<BoardReader<Measurement>>,
    ) {
        let old = match self.boards.get_mut(device) {
            Some(place) => place.replace((incarnation, board)).map(|(_, board)| board),
            None => Some(board),
        };
        if let Some(board) = old {
            self.send_reply(EngineReply::Board(board));
        }
    }

    /// A driver is dead: its board is given back, unless another one has replaced it.
    pub(super) fn detach(&mut self, device: usize, incarnation: u64) {
        let Some(place) = self.boards.get_mut(device) else {
            return;
        };
        if let Some((_, board)) = place.take_if(|(attached, _)| *attached == incarnation) {
            self.send_reply(EngineReply::Board(board));
        }
    }

    /// Passes the commands of the net in `row` on to its devices: all of them, or none and a fault.
    pub(super) fn pass_commands(&mut self, row: usize) -> Result<(), FaultRecord> {
        for index in 0..self.devices.len() {
            let claimed = self
                .claims(row)
                .map_or(0, |claims| claims.arms >> index & 1);
            if claimed == 1 {
                self.guard_arm(row, index)?;
            }
        }
        let Some(net) = self.nets.get(row).and_then(Option::as_ref) else {
            return Ok(());
        };
        for (device, output) in self.devices.iter_mut().zip(net.outputs()) {
            merge(&mut device.output, output);
        }
        Ok(())
    }

    /// Checks the set-point of an arm: the first of an engagement against the hold set-point, all others against the
    /// previous one.
    fn guard_arm(&mut self, row: usize, index: usize) -> Result<(), FaultRecord> {
        let state = self.device_state(index);
        let output = self
            .nets
            .get(row)
            .and_then(Option::as_ref)
            .and_then(|net| net.outputs().get(index));
        let (Some(output), Some(device), Some(input)) =
            (output, self.devices.get_mut(index), self.inputs.get(index))
        else {
            return Ok(());
        };
        let cycle = self.status.cycle;
        if !output.has_position {
            device.engagement = None;
            return Ok(());
        }
        let Some(engagement) = &mut device.engagement else {
            // A device that becomes commanded must rest at its hold set-point, and the net must begin there.
            if state != DeviceState::Ready {
                return Err(fault_at(FaultCode::DeviceLost, index, cycle));
            }
            let strategy = input.measurement.strategy;
            let first = device
                .guard
                .first(&output.position, &input.measurement.hold)
                .and_then(|()| {
                    let guard = &mut device.guard;
                    guard.check_impedance(&output.impedance, strategy, self.dt_s)
                });
            first.map_err(|violation| fault_of(FaultCode::Jump, index, cycle, violation))?;
            let number = self.next_engagement;
            self.next_engagement += 1;
            device.engagement = Some(Engagement {
                row,
                number,
                since_cycle: cycle,
                followed: false,
                follows_from_ns: 0,
            });
            return Ok(());
        };
        let waited_ns = (cycle - engagement.since_cycle) * self.config.period_ns;
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
        let strategy = input.measurement.strategy;
        let next = device.guard.check(&output.position, self.dt_s);
        let next = next.and_then(|()| {
            let guard = &mut device.guard;
            guard.check_impedance(&output.impedance, strategy, self.dt_s)
        });
        next.map_err(|violation| fault_of(FaultCode::Limit, index, cycle, violation))
    }

    /// The first device that the net in `row` uses and that is offline.
    pub(super) fn lost_device(&self, row: usize) -> Option<usize> {
        let claims = self.claims(row)?;
        (0..self.devices.len())
            .find(|index| claims.uses(*index) && self.device_state(*index) == DeviceState::Offline)
    }

    /// Returns true if all arms of the net in `row` have played everything up to `logical_ns` and rest.
    pub(super) fn arms_settled(&self, row: usize, logical_ns: u64) -> bool {
        let Some(claims) = self.claims(row) else {
            return true;
        };
        self.inputs.iter().enumerate().all(|(index, input)| {
            let settled = input.measurement.settled_ns >= logical_ns
                && self.device_state(index) == DeviceState::Ready;
            claims.arms >> index & 1 == 0 || settled
        })
    }

    /// Ends the engagements of the net in `row`.
    pub(super) fn disengage(&mut self, row: usize) {
        for device in &mut self.devices {
            if device
                .engagement
                .is_some_and(|engagement| engagement.row == row)
            {
                device.engagement = None;
            }
        }
    }
}

/// Returns true if the measurement is plausible for a driver of a device with this number of joints. Data from drivers
/// is validated: measured values that are not finite become null; a hold set-point must be finite.
fn is_plausible(measurement: &mut Measurement, joints: u32) -> bool {
    let online = match DeviceState::from_number(measurement.state) {
        DeviceState::Offline => false,
        DeviceState::Online => true,
        DeviceState::Ready | DeviceState::Commanded | DeviceState::Stopping => {
            measurement.hold.iter().all(|value| value.is_finite())
        }
    };
    for group in [
        &mut measurement.position[..],
        &mut measurement.torque,
        &mut measurement.external_torque,
        &mut measurement.wrench,
    ] {
        if group.iter().any(|value| !value.is_finite()) {
            group.fill(f64::NAN);
        }
    }
    let analog = measurement.analog.iter_mut();
    for value in analog.chain(&mut measurement.analog_out) {
        if !value.is_finite() {
            *value = f64::NAN;
        }
    }
    online && measurement.joints == joints
}

pub(super) fn merge(all: &mut DeviceOutput, one: &DeviceOutput) {
    if one.has_position {
        all.has_position = true;
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
