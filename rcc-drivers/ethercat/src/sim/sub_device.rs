//! One simulated SubDevice: memory, EEPROM, state machine, mailbox, watchdog, and the signals at its terminals.
//! Called by the thread of the socket and the control port's threads, one at a time.

use std::time::Duration;

use super::clock::Clock;
use super::drive::Drive;
use super::eeprom;
use super::frame::{Access, Datagram};
use super::mailbox::Mailbox;
use super::model::{Channels, MAILBOX_IN, MAILBOX_OUT, MAILBOX_SIZE, Model, SyncManagerDefault};
use super::model_objects;
use super::objects::ObjectDictionary;
use super::registers::{self as register, Memory, SM, SM_SIZE, SyncManager};
use super::state_machine::{State, Status, code};

mod axis;
mod process_data;

use process_data::saturate;

/// Largest number of channels.
pub const CHANNELS_MAX: usize = 8;
/// Bit 3 of a mailbox's status: it holds a message.
const FULL: u8 = 0x08;
/// Units of the watchdog divider, ns.
const WATCHDOG_UNIT_NS: u64 = 40;

/// A simulated SubDevice.
#[derive(Clone, Debug)]
pub struct SubDevice {
    model: &'static Model,
    serial: u32,
    memory: Memory,
    eeprom: Vec<u8>,
    status: Status,
    mailbox: Mailbox,
    objects: ObjectDictionary,
    /// The axis of a drive.
    drive: Option<Drive>,
    /// Its distributed clock.
    clock: Option<Clock>,
    /// Values at the input terminals; they outlast a loss of power.
    inputs: [i32; CHANNELS_MAX],
    /// Since when no outputs arrived.
    silent_since: Duration,
    trips: u64,
}

impl SubDevice {
    /// Returns a SubDevice after power-on.
    #[must_use]
    pub fn new(model: &'static Model, serial: u32) -> SubDevice {
        let mut device = SubDevice {
            model,
            serial,
            memory: Memory::default(),
            eeprom: eeprom::image(model, serial),
            status: Status::POWER_ON,
            mailbox: Mailbox::default(),
            objects: model_objects::of(model, serial),
            drive: (model.channels == Channels::Drive).then(|| Drive::new(0)),
            clock: model.has_clock().then(|| Clock::new(serial)),
            inputs: [0; CHANNELS_MAX],
            silent_since: Duration::ZERO,
            trips: 0,
        };
        // Type ET1100 and its revision; FMMUs, sync managers, 8 KiB RAM, ports 0 and 1 E-bus; distributed clocks of 64 bits or none.
        let managers = model.sync_managers().len() as u8;
        let fmmus = model.fmmu_uses().len() as u8;
        let features = if model.has_clock() { 0x0c } else { 0 };
        let head = [0x11, 0, 2, 0, fmmus, managers, 8, 0x0a, features, 0];
        device.memory.put(0, &head);
        device.memory.put_u16(register::WATCHDOG_DIVIDER, 2498);
        device.memory.put_u16(register::WATCHDOG_TIME, 1000);
        device.memory.put_u16(register::WATCHDOG_STATUS, 1);
        device.memory.put(0x0140, &device.eeprom[..2]);
        device.show_status();
        device
    }

    /// Loses its power and gets it back: registers, settings and outputs are those of power-on.
    pub fn restart(&mut self) {
        let (inputs, trips) = (self.inputs, self.trips);
        let drive = self.drive.as_ref().map(Drive::restarted);
        *self = SubDevice::new(self.model, self.serial);
        (self.inputs, self.trips, self.drive) = (inputs, trips, drive);
    }

    /// Returns its type.
    #[must_use]
    pub fn model(&self) -> &'static Model {
        self.model
    }

    /// Returns state and code.
    #[must_use]
    pub fn status(&self) -> Status {
        self.status
    }

    /// Returns its station address.
    #[must_use]
    pub fn station(&self) -> u16 {
        self.memory.u16(register::STATION_ADDRESS)
    }

    /// Returns how often its watchdog has expired.
    #[must_use]
    pub fn trips(&self) -> u64 {
        self.trips
    }

    /// Sets the data link status, and how many SubDevices are before it and behind it.
    pub fn set_link(&mut self, status: u16, [before, behind]: [usize; 2]) {
        self.memory.put_u16(register::DL_STATUS, status);
        if let Some(clock) = &mut self.clock {
            clock.set_place(before, behind);
        }
    }

    /// Returns its distributed clock, if it has one.
    #[must_use]
    pub fn clock(&self) -> Option<&Clock> {
        self.clock.as_ref()
    }

    /// Returns the period of SYNC0; `None` if it is off.
    #[must_use]
    pub fn sync0(&self) -> Option<Duration> {
        let on = self.memory.u8(register::DC_ACTIVATION) & 3 == 3;
        let period = u64::from(self.memory.u32(register::DC_SYNC0_CYCLE));
        (self.clock.is_some() && on).then(|| Duration::from_nanos(period))
    }

    /// Counts a lost link at a port.
    pub fn lose_link(&mut self, port: u16) {
        let register = register::LOST_LINKS + port;
        let count = self.memory.u8(register).saturating_add(1);
        self.memory.put(register, &[count]);
    }

    /// Returns the values at the input terminals: 0 or 1, or raw numbers. Empty for a terminal with outputs.
    #[must_use]
    pub fn inputs(&self) -> &[i32] {
        match self.model.has_outputs() {
            true => &[],
            false => self
                .inputs
                .get(..usize::from(self.model.count))
                .unwrap_or(&[]),
        }
    }

    /// Sets the value at an input terminal; `channel` from 0. A number beyond 16 bits is an over- or underrange. Returns
    /// false if there is no such input.
    pub fn set_input(&mut self, channel: usize, value: i32) -> bool {
        let exists = channel < self.inputs().len();
        if let Some(place) = self.inputs.get_mut(channel).filter(|_| exists) {
            *place = value;
        }
        exists
    }

    /// Returns the values at the output terminals: 0 or 1, or raw numbers. Empty for a terminal with inputs.
    #[must_use]
    pub fn outputs(&self) -> Vec<i32> {
        let Some((_, manager)) = self.model.outputs_manager() else {
            return Vec::new();
        };
        let driven = self.status.state == State::Op;
        let channels = 0..self.model.count;
        let value = |channel: u8| match self.model.channels {
            Channels::DigitalOutput if driven => {
                i32::from(self.memory.u8(manager.start) >> channel & 1)
            }
            Channels::DigitalOutput => 0,
            _ if driven => {
                let at = manager.start + u16::from(channel) * 2;
                i32::from(self.memory.u16(at).cast_signed())
            }
            _ => i32::from(self.objects.default_output(channel)),
        };
        channels.map(value).collect()
    }

    /// Lets the time pass: an expired watchdog switches the outputs off.
    pub fn advance(&mut self, now: Duration) {
        if self.deadline().is_some_and(|deadline| now >= deadline) {
            self.trips += 1;
            self.status = Status {
                state: State::SafeOp,
                code: code::WATCHDOG,
            };
            self.memory.put_u16(register::WATCHDOG_STATUS, 0);
            let count = self.memory.u8(register::WATCHDOG_COUNT).saturating_add(1);
            self.memory.put(register::WATCHDOG_COUNT, &[count]);
            self.show_status();
            self.lose_communication();
        }
        self.advance_drive(now);
    }

    /// Returns when its watchdog expires unless outputs arrive; `None` if it does not run.
    #[must_use]
    pub fn deadline(&self) -> Option<Duration> {
        let running = self.status.state == State::Op;
        self.watchdog()
            .filter(|_| running)
            .map(|limit| self.silent_since + limit)
    }

    /// Returns the time without outputs after which they are switched off; `None` if nothing watches.
    fn watchdog(&self) -> Option<Duration> {
        let time = u64::from(self.memory.u16(register::WATCHDOG_TIME));
        let divider = u64::from(self.memory.u16(register::WATCHDOG_DIVIDER)) + 2;
        let (number, _) = self.model.outputs_manager()?;
        let triggers = SyncManager::read(&self.memory, number).control & 0x40 != 0;
        (triggers && time > 0).then(|| Duration::from_nanos(time * divider * WATCHDOG_UNIT_NS))
    }

    /// Carries out what a datagram asks of this SubDevice, which is addressed.
    pub fn access(&mut self, datagram: &mut Datagram<'_>, now: Duration) {
        let (offset, size) = (datagram.offset(), datagram.data.len());
        match datagram.command.access {
            Access::None => {}
            Access::Read | Access::ReadMultipleWrite => {
                let Some(data) = self.read(offset, size, now) else {
                    return;
                };
                datagram.data.copy_from_slice(&data);
                datagram.count(1);
            }
            Access::Write => {
                if self.write(offset, datagram.data, now) {
                    datagram.count(1);
                }
            }
            Access::ReadWrite => {
                let before = self.read(offset, size, now);
                let written = self.write(offset, datagram.data, now);
                if let Some(before) = &before {
                    datagram.data.copy_from_slice(before);
                }
                datagram.count(u16::from(before.is_some()) + 2 * u16::from(written));
            }
        }
    }

    /// Carries out a broadcast: reads are combined by OR.
    pub fn access_all(&mut self, datagram: &mut Datagram<'_>, now: Duration) {
        let sent = datagram.data.to_vec();
        self.access(datagram, now);
        if datagram.command.access != Access::Write {
            for (place, byte) in datagram.data.iter_mut().zip(sent) {
                *place |= byte;
            }
        }
    }

    /// Carries out a write of what another SubDevice has read.
    pub fn write_multiple(&mut self, datagram: &mut Datagram<'_>, now: Duration) {
        if self.write(datagram.offset(), datagram.data, now) {
            datagram.count(1);
        }
    }

    /// Reads the memory; `None` if the address does not exist, or the mailbox there is empty.
    fn read(&mut self, address: u16, size: usize, now: Duration) -> Option<Vec<u8>> {
        if self.lacks_clock(address) {
            return None;
        }
        if let Some(clock) = &self.clock {
            clock.show(&mut self.memory, now);
        }
        let data = self.memory.range(address, size)?.to_vec();
        if let Some(manager) = self.mailbox_at(1, address) {
            let status = SM + SM_SIZE + 5;
            if self.memory.u8(status) & FULL == 0 {
                return None;
            }
            if manager.ends_in(address, size) {
                self.memory.put(status, &[0]);
            }
        }
        Some(data)
    }

    /// Writes the memory, with what follows from it. Returns false if the address does not exist, or the mailbox there
    /// cannot take a message.
    fn write(&mut self, address: u16, data: &[u8], now: Duration) -> bool {
        if self.lacks_clock(address) {
            return false;
        }
        let mailbox = self.mailbox_at(0, address);
        let waiting = self.memory.u8(SM + SM_SIZE + 5) & FULL != 0;
        if mailbox.is_some() && waiting || !self.memory.write(address, data) {
            return false;
        }
        let last = address.saturating_add((data.len() as u16).saturating_sub(1));
        let touched = |register: u16| (address..=last).contains(&register) && !data.is_empty();
        if mailbox.is_some_and(|manager| manager.ends_in(address, data.len())) {
            self.take_message();
        }
        if let Some(clock) = &mut self.clock {
            if touched(register::DC_RECEIVE_TIMES) {
                clock.latch(&mut self.memory, now);
            }
            if touched(register::DC_SYSTEM_TIME) {
                let reference = self.memory.u64(register::DC_SYSTEM_TIME);
                clock.compare(&mut self.memory, reference, now);
            }
            if touched(register::DC_SYSTEM_TIME_OFFSET) || touched(register::DC_LOOP_START) {
                clock.forget_difference(&mut self.memory);
            }
        }
        if touched(register::AL_CONTROL) {
            self.request(now);
        }
        if touched(register::EEPROM_CONTROL + 1) {
            eeprom::serve(&self.eeprom, &mut self.memory);
        }
        let repeat = SM + SM_SIZE + 6;
        if touched(repeat) && self.model.has_mailbox() {
            self.repeat(repeat);
        }
        self.note_outputs(address, data.len(), now);
        true
    }

    /// Returns true for a register of distributed clocks that this SubDevice does not have.
    fn lacks_clock(&self, address: u16) -> bool {
        self.clock.is_none() && (register::DC_RECEIVE_TIMES..=register::DC_LAST).contains(&address)
    }

    /// Returns the sync manager of a mailbox if it is on and the address is in it.
    fn mailbox_at(&self, number: u16, address: u16) -> Option<SyncManager> {
        let manager = SyncManager::read(&self.memory, number);
        let ours = self.model.has_mailbox() && manager.active && manager.contains(address);
        ours.then_some(manager)
    }

    /// Answers the message in the mailbox.
    fn take_message(&mut self) {
        if self.status.state == State::Init {
            return;
        }
        self.show_drive();
        let (count, inputs) = (self.model.count, self.inputs);
        let outputs = self.outputs();
        for channel in 0..count {
            let place = usize::from(channel);
            let value = outputs.get(place).or(inputs.get(place)).copied();
            let (value, _) = saturate(value.unwrap_or(0));
            self.objects.put_value(self.model, channel, value);
        }
        let message = self.memory.range(MAILBOX_OUT, usize::from(MAILBOX_SIZE));
        let message = message.unwrap_or_default().to_vec();
        let answer = self.mailbox.answer(&message, &mut self.objects);
        self.post(&answer);
    }

    /// Puts an answer into the mailbox that the MainDevice reads.
    fn post(&mut self, answer: &[u8]) {
        let mut whole = answer.to_vec();
        whole.resize(usize::from(MAILBOX_SIZE), 0);
        self.memory.put(MAILBOX_IN, &whole);
        self.memory.put(SM + SM_SIZE + 5, &[FULL]);
    }

    /// Sends the last answer again if the MainDevice has changed the repeat bit, and confirms the bit.
    fn repeat(&mut self, activate: u16) {
        let (asked, confirmed) = (
            self.memory.u8(activate) & 2,
            self.memory.u8(activate + 1) & 2,
        );
        if asked != confirmed {
            if !self.mailbox.last.is_empty() {
                let last = self.mailbox.last.clone();
                self.post(&last);
            }
            self.memory.put(activate + 1, &[asked]);
        }
    }

    /// Restarts the watchdog if a write ends in the buffer of the outputs.
    fn note_outputs(&mut self, address: u16, size: usize, now: Duration) {
        let Some((number, _)) = self.model.outputs_manager() else {
            return;
        };
        let manager = SyncManager::read(&self.memory, number);
        if manager.active && manager.ends_in(address, size) {
            self.silent_since = now;
            self.memory.put_u16(register::WATCHDOG_STATUS, 1);
        }
    }

    /// Follows or refuses the request in AL control.
    fn request(&mut self, now: Duration) {
        let control = self.memory.u16(register::AL_CONTROL);
        let before = self.status;
        self.status = before.request(control, |state| self.check(state));
        self.follow_state(before.state);
        if before.state != State::Op && self.status.state == State::Op {
            self.silent_since = now;
            self.memory.put_u16(register::WATCHDOG_STATUS, 1);
        }
        if self.status.state == State::Init {
            self.mailbox = Mailbox::default();
            self.memory.put(SM + SM_SIZE + 5, &[0]);
        }
        self.show_status();
    }

    /// Returns the code of what is wrong in the sync managers before a step up into `state`.
    fn check(&self, state: State) -> Option<u16> {
        let managers = self.model.sync_managers();
        let fits = |(number, want): (u16, &SyncManagerDefault)| {
            let is = SyncManager::read(&self.memory, number);
            let off = want.length == 0 && !is.active;
            off || (is.start, is.length) == (want.start, want.length)
                && (is.active || want.length == 0)
        };
        let wrong = |kinds: &[u8]| {
            let mut all = (0..).zip(&managers);
            all.any(|(number, want)| kinds.contains(&want.kind) && !fits((number, want)))
        };
        match state {
            State::PreOp if wrong(&[1, 2]) => Some(code::MAILBOX),
            State::SafeOp if wrong(&[3]) => Some(code::OUTPUTS),
            State::SafeOp if wrong(&[4]) => Some(code::INPUTS),
            State::SafeOp | State::Op if self.sync0() == Some(Duration::ZERO) => {
                Some(code::SYNC_CONFIGURATION)
            }
            _ => None,
        }
    }

    fn show_status(&mut self) {
        let Status { code, .. } = self.status;
        self.memory
            .put_u16(register::AL_STATUS, self.status.register());
        self.memory.put_u16(register::AL_STATUS_CODE, code);
    }
}
