//! Latches the measurements of drivers at the beginning of a cycle. Real-time thread.

use rcc_core::message::{DeviceState, MAGIC, Measurement};

use super::{Devices, reported_state};
use crate::boards::DeviceBoards;
use crate::engine::Engine;
use crate::queue::{EngineEvent, EngineReply};

impl<B: DeviceBoards> Engine<B> {
    /// Latches all devices from their boards.
    pub fn latch_boards(&mut self, now_ns: u64) {
        for index in 0..self.devices.len() {
            let Devices { devices, read, .. } = &mut self.devices;
            let driver = devices.get(index).and_then(|device| device.driver.as_ref());
            let newest = driver.map(|(incarnation, board)| {
                B::read(board, read);
                *incarnation
            });
            self.latch_read(index, newest, now_ns);
        }
    }

    /// Latches a device for this cycle: the incarnation of its driver and its newest measurement, or `None` without a
    /// board.
    pub fn latch(&mut self, index: usize, board: Option<(u64, Measurement)>, now_ns: u64) {
        let newest = board.map(|(incarnation, measurement)| {
            *self.devices.read = measurement;
            incarnation
        });
        self.latch_read(index, newest, now_ns);
    }

    /// As [`Engine::latch`], with the measurement that was read.
    fn latch_read(&mut self, index: usize, board: Option<u64>, now_ns: u64) {
        let Devices {
            models,
            inputs,
            devices,
            offline,
            changed,
            read,
        } = &mut self.devices;
        let place = models.get(index).zip(inputs.get_mut(index));
        let Some(((model, input), device)) = place.zip(devices.get_mut(index)) else {
            return;
        };
        let entry = &mut device.entry;
        // A driver was restarted: the device is absent for one cycle, so that nets that commanded the previous
        // incarnation end, however quickly it was replaced. A net never continues with a restarted driver.
        let known = entry.incarnation;
        let board = board.filter(|incarnation| known == 0 || known == *incarnation);
        let before = std::mem::replace(&mut input.present, false);
        let (mut fresh, mut forward) = (false, true);
        let mut same = true;
        if board.is_some() {
            let measurement = &mut **read;
            // Within one incarnation of a driver the sequence number of its exchanges never decreases.
            forward = known == 0 || measurement.sequence >= entry.sequence;
            // A stamp from the future is as bad as an old one: it would not age.
            let age_ns = now_ns.abs_diff(measurement.stamp_ns);
            fresh = measurement.magic == MAGIC && age_ns <= self.stale_after_ns;
            let plausible = is_plausible(measurement, model.joints);
            same = bytemuck::bytes_of(measurement) == bytemuck::bytes_of(&input.measurement);
            if !same {
                input.measurement = *measurement;
            }
            input.present = plausible && fresh && forward;
        }
        let is_changed = before != input.present || (input.present && !same);
        *changed |= u64::from(is_changed) << index;
        let (state, measurement) = (reported_state(input), &input.measurement);
        let holder = device.engagement;
        let holder = holder.map_or(0, |engagement| self.commands[engagement.row].entry.id);
        self.tables_changed |= entry.holder != holder;
        entry.holder = holder;
        entry.attached = u32::from(board.is_some());
        let driver = board.unwrap_or(known);
        entry.incarnation = board.unwrap_or(0);
        // After a sequence number went back, the device stays lost until it reaches the old one, or its driver is
        // restarted.
        if forward {
            entry.sequence = measurement.sequence;
        }
        entry.stamp_ns = measurement.stamp_ns;
        entry.quality_permille = measurement.quality_permille;
        entry.reason = measurement.reason;
        if before && !input.present {
            entry.losses += 1;
        }
        *offline &= !(1 << index);
        *offline |= u64::from(state == DeviceState::Offline) << index;
        let was = std::mem::replace(&mut entry.state, state as u32);
        if was != state as u32 {
            self.tables_changed = true;
            let age_ns = match fresh {
                true => 0,
                false => now_ns.abs_diff(measurement.stamp_ns),
            };
            let event = EngineEvent::Device {
                cycle: self.status.cycle + 1,
                device: index as u32,
                state: state as u32,
                was,
                reason: measurement.reason,
                age_ns,
                driver,
                attached: board.is_some(),
            };
            self.log(event);
        }
    }

    /// A driver announced itself: its board replaces the previous one, which is given back.
    pub(in crate::engine) fn attach(
        &mut self,
        device: usize,
        incarnation: u64,
        board: Box<B::Measurements>,
    ) {
        let old = match self.devices.get_mut(device) {
            Some((_, device)) => (device.driver)
                .replace((incarnation, board))
                .map(|(_, board)| board),
            None => Some(board),
        };
        if let Some(board) = old {
            self.send_reply(EngineReply::Board(board));
        }
    }

    /// A driver is dead: its board is given back, unless another one has replaced it.
    pub(in crate::engine) fn detach(&mut self, device: usize, incarnation: u64) {
        let Some((_, device)) = self.devices.get_mut(device) else {
            return;
        };
        if let Some((_, board)) = (device.driver).take_if(|(known, _)| *known == incarnation) {
            self.send_reply(EngineReply::Board(board));
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
            (measurement.hold.iter()).fold(true, |finite, value| finite & value.is_finite())
        }
    };
    null_unless_finite(&mut measurement.position);
    null_unless_finite(&mut measurement.torque);
    null_unless_finite(&mut measurement.external_torque);
    null_unless_finite(&mut measurement.wrench);
    for group in [&mut measurement.analog, &mut measurement.analog_out] {
        for value in group {
            *value = if value.is_finite() { *value } else { f64::NAN };
        }
    }
    online && measurement.joints == joints
}

/// Makes every value null if one of them is not finite. Looks at all of them, several at a time.
#[inline]
fn null_unless_finite<const N: usize>(group: &mut [f64; N]) {
    let finite = (group.iter()).fold(true, |finite, value| finite & value.is_finite());
    if !finite {
        *group = [f64::NAN; N];
    }
}
