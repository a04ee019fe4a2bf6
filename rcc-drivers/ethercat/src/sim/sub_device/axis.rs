//! The axis of a SubDevice that is a drive: its process data, its objects and its time.
//! Called by the thread of the socket and the control port's threads, one at a time.

use std::time::Duration;

use super::SubDevice;
use crate::sim::drive::{Drive, DriveSettings};
use crate::sim::drive_objects;
use crate::sim::state_machine::State;

impl SubDevice {
    /// Returns the axis, if it is a drive.
    #[must_use]
    pub fn drive(&self) -> Option<&Drive> {
        self.drive.as_ref()
    }

    /// Returns the axis for a change, if it is a drive.
    pub fn drive_mut(&mut self) -> Option<&mut Drive> {
        self.drive.as_mut()
    }

    /// Process data have stopped.
    pub(super) fn lose_communication(&mut self) {
        if let Some(drive) = &mut self.drive {
            drive.lose_communication();
        }
    }

    /// Tells the axis that its SubDevice has left OP, by a request.
    pub(super) fn follow_state(&mut self, before: State) {
        let left = before == State::Op && self.status.state != State::Op;
        if let Some(drive) = self.drive.as_mut().filter(|_| left) {
            drive.leave_op();
        }
    }

    /// Lets the time of the axis pass.
    pub(super) fn advance_drive(&mut self, now: Duration) {
        if let Some(drive) = &mut self.drive {
            drive.advance(now, &DriveSettings::read(&self.objects));
        }
    }

    /// Gives controlword and target position to the axis; outputs count in OP only.
    pub(super) fn command_drive(&mut self) {
        let (Some(drive), Some((_, manager))) = (&mut self.drive, self.model.outputs_manager())
        else {
            return;
        };
        if self.status.state == State::Op {
            let word = self.memory.u16(manager.start);
            let target = self.memory.u32(manager.start + 2).cast_signed();
            drive.command(word, target, &DriveSettings::read(&self.objects));
        }
    }

    /// Puts statusword, actual position and error code into the buffer that the MainDevice reads.
    pub(super) fn latch_drive(&mut self) {
        if let (Some(drive), Some((_, manager))) = (&self.drive, self.model.inputs_manager()) {
            self.memory.put_u16(manager.start, drive.statusword());
            let position = drive.position().to_le_bytes();
            self.memory.put(manager.start + 2, &position);
            self.memory.put_u16(manager.start + 6, drive.error());
        }
    }

    /// Stores the present values of the axis as objects.
    pub(super) fn show_drive(&mut self) {
        if let Some(drive) = &self.drive {
            drive_objects::show(&mut self.objects, drive);
        }
    }
}
