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
        let (number, _) = self.model.process_manager();
        let manager = SyncManager::read(&self.memory, number);
        let (mut read, mut written) = (false, false);
        for number in 0..self.model.fmmu_uses().len() as u16 {
            let Some(fmmu) = Fmmu::read(&self.memory, number) else {
                continue;
            };
            for bit in fmmu.bits(logical, size) {
                let data = manager.active && manager.contains(bit.address);
                if reads && fmmu.reads && (data || bit.address < 0x1000) {
                    let value = self.memory.u8(bit.address) >> bit.bit & 1;
                    put_bit(datagram.data, bit.data, value);
                    read = true;
                }
                if writes && fmmu.writes && data && self.model.is_output() {
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
        let weight = if access == Access::ReadWrite { 2 } else { 1 };
        datagram.count(u16::from(read) + weight * u16::from(written));
    }

    /// Copies the values at the input terminals into the buffer that the MainDevice reads.
    fn latch_inputs(&mut self) {
        let (_, manager) = self.model.process_manager();
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
