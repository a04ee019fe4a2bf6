//! Process data of a SubDevice: what logical datagrams exchange through its FMMUs.
//! Called by the thread of the socket.

use std::time::Duration;

use super::SubDevice;
use crate::sim::fmmu::Fmmu;
use crate::sim::frame::{Access, Datagram};
use crate::sim::model::Channels;
use crate::sim::registers::SyncManager;
use crate::sim::state_machine::State;

impl SubDevice {
    /// Exchanges the process data that a logical datagram and the FMMUs share.
    pub fn access_logical(&mut self, datagram: &mut Datagram<'_>, now: Duration) {
        if self.status.state < State::SafeOp {
            return;
        }
        self.latch_inputs();
        let access = datagram.command.access;
        let (reads, writes) = match access {
            Access::Read => (true, false),
            Access::Write => (false, true),
            Access::ReadWrite => (true, true),
            _ => return,
        };
        let (logical, size) = (datagram.logical(), datagram.data.len());
        let sent = datagram.data.to_vec();
        let manager = |manager: Option<(u16, _)>| {
            let manager = manager.map(|(number, _)| SyncManager::read(&self.memory, number));
            manager.filter(|manager| manager.active)
        };
        let inputs = manager(self.model.inputs_manager());
        let outputs = manager(self.model.outputs_manager());
        let (mut read, mut written) = (false, false);
        for number in 0..self.model.fmmu_uses().len() as u16 {
            let Some(fmmu) = Fmmu::read(&self.memory, number) else {
                continue;
            };
            for bit in fmmu.bits(logical, size) {
                let within = |manager: &Option<SyncManager>| {
                    manager
                        .as_ref()
                        .is_some_and(|one| one.contains(bit.address))
                };
                // Both buffers, and the registers with the state of the mailbox.
                let readable = within(&inputs) || within(&outputs) || bit.address < 0x1000;
                if reads && fmmu.reads && readable {
                    let value = self.memory.u8(bit.address) >> bit.bit & 1;
                    put_bit(datagram.data, bit.data, value);
                    read = true;
                }
                if writes && fmmu.writes && within(&outputs) {
                    let value = sent
                        .get(bit.data / 8)
                        .map_or(0, |byte| byte >> (bit.data % 8));
                    let place = self.memory.u8(bit.address) & !(1 << bit.bit);
                    self.memory
                        .put(bit.address, &[place | (value & 1) << bit.bit]);
                    self.note_outputs(bit.address, 1, now);
                    written = true;
                }
            }
        }
        if written {
            self.command_drive();
        }
        let weight = if access == Access::ReadWrite { 2 } else { 1 };
        datagram.count(u16::from(read) + weight * u16::from(written));
    }

    /// Copies the values at the input terminals into the buffer that the MainDevice reads.
    fn latch_inputs(&mut self) {
        let Some((_, manager)) = self.model.inputs_manager() else {
            return;
        };
        match self.model.channels {
            Channels::DigitalInput => {
                let bits = self.inputs.iter().zip(0..);
                let byte = bits.fold(0, |byte, (value, bit)| byte | u8::from(*value != 0) << bit);
                self.memory.put(manager.start, &[byte]);
            }
            Channels::AnalogInput => {
                for (channel, input) in (0..u16::from(self.model.count)).zip(self.inputs) {
                    let (value, status) = saturate(input);
                    let at = manager.start + channel * 4;
                    self.memory.put_u16(at, status);
                    self.memory.put_u16(at + 2, value.cast_unsigned());
                }
            }
            Channels::Drive => self.latch_drive(),
            Channels::DigitalOutput | Channels::AnalogOutput => {}
        }
    }
}

/// Returns the value as 16 bits, and the status word: underrange, overrange, error.
pub(super) fn saturate(value: i32) -> (i16, u16) {
    match i16::try_from(value) {
        Ok(value) => (value, 0),
        Err(_) if value < 0 => (i16::MIN, 0x0041),
        Err(_) => (i16::MAX, 0x0042),
    }
}

fn put_bit(data: &mut [u8], at: usize, value: u8) {
    if let Some(byte) = data.get_mut(at / 8) {
        *byte = *byte & !(1 << (at % 8)) | value << (at % 8);
    }
}
