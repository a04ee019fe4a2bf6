//! The line: SubDevices one behind the other, the cables between them, and what a frame finds on its way.
//! Run by the thread of the socket; the control port's threads change it between frames.

use std::str::FromStr;
use std::time::Duration;

use super::frame::{self, Access, Addressing, Datagram, FrameError};
use super::model::Model;
use super::sub_device::SubDevice;

/// Data link status with neighbours on both sides: link and communication at ports 0 and 1.
const LINK_BOTH: u16 = 0x5a31;
/// Data link status at the end of the line: port 1 is closed.
const LINK_END: u16 = 0x5611;

/// A SubDevice and its power supply.
#[derive(Clone, Debug)]
pub struct Station {
    /// The SubDevice.
    pub device: SubDevice,
    /// It has power; frames turn back in front of one that has none.
    pub powered: bool,
    /// Number of further frames in which it takes no part in the exchange of process data.
    pub miss: u64,
}

/// A channel of a terminal; both from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terminal {
    /// Position of the terminal.
    pub position: usize,
    /// Its channel.
    pub channel: usize,
}

/// A wire from an output to an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineWire {
    /// The output.
    pub from: Terminal,
    /// The input.
    pub to: Terminal,
}

impl FromStr for LineWire {
    type Err = String;

    /// Reads `2.1=1.1`: terminal and channel of the output and of the input, from 1.
    fn from_str(text: &str) -> Result<LineWire, String> {
        let end = |text: &str| {
            let (position, channel) = text.split_once('.')?;
            let from_one = |text: &str| text.parse::<usize>().ok()?.checked_sub(1);
            Some(Terminal {
                position: from_one(position)?,
                channel: from_one(channel)?,
            })
        };
        let wire = text.split_once('=').and_then(|(from, to)| {
            Some(LineWire {
                from: end(from)?,
                to: end(to)?,
            })
        });
        wire.ok_or_else(|| {
            format!("invalid wire `{text}`: write TERMINAL.CHANNEL=TERMINAL.CHANNEL, from 1")
        })
    }
}

/// The line.
#[derive(Clone, Debug)]
pub struct Line {
    /// All SubDevices, in order.
    pub stations: Vec<Station>,
    /// Position, from 0, in front of which the cable is pulled.
    pub pulled: Option<usize>,
    /// Number of further frames that get no answer.
    pub drop: u64,
    /// Number of answered frames.
    pub frames: u64,
    /// Wires between the terminals.
    pub wires: Vec<LineWire>,
}

impl Station {
    /// Returns the values at its output terminals; a terminal without power drives nothing.
    #[must_use]
    pub fn outputs(&self) -> Vec<i32> {
        match self.powered {
            true => self.device.outputs(),
            false => vec![0; self.device.outputs().len()],
        }
    }
}

impl Line {
    /// Returns a line after power-on; serial numbers are the positions, from 1.
    #[must_use]
    pub fn new(models: &[&'static Model]) -> Line {
        let stations = (1..).zip(models).map(|(serial, model)| Station {
            device: SubDevice::new(model, serial),
            powered: true,
            miss: 0,
        });
        let mut line = Line {
            stations: stations.collect(),
            pulled: None,
            drop: 0,
            frames: 0,
            wires: Vec::new(),
        };
        line.connect();
        line
    }

    /// Returns the number of SubDevices that frames reach.
    #[must_use]
    pub fn reach(&self) -> usize {
        let powered = self.stations.iter().take_while(|one| one.powered).count();
        self.pulled.map_or(powered, |pulled| pulled.min(powered))
    }

    /// Pulls the cable in front of a position; the neighbours count a lost link at their ports.
    pub fn pull(&mut self, position: usize) {
        if self.pulled == Some(position) {
            return;
        }
        self.pulled = Some(position);
        if let Some(station) = self.stations.get_mut(position) {
            station.device.lose_link(0);
        }
        let before = position.checked_sub(1);
        if let Some(station) = before.and_then(|before| self.stations.get_mut(before)) {
            station.device.lose_link(1);
        }
    }

    /// Updates the link status of all SubDevices after a change of cables or power.
    pub fn connect(&mut self) {
        let reach = self.reach();
        let whole = self.stations.len();
        for (position, station) in (1..).zip(&mut self.stations) {
            let end = position == reach || position == whole;
            let link = if end { LINK_END } else { LINK_BOTH };
            let place = [position - 1, reach.saturating_sub(position)];
            station.device.set_link(link, place);
        }
    }

    /// Lets the time pass for all SubDevices, also for those that no frame reaches.
    pub fn advance(&mut self, now: Duration) {
        for station in self.stations.iter_mut().filter(|one| one.powered) {
            station.device.advance(now);
        }
        self.carry();
    }

    /// Carries the values of wired outputs to their inputs.
    fn carry(&mut self) {
        for at in 0..self.wires.len() {
            let Some(LineWire { from, to }) = self.wires.get(at).copied() else {
                return;
            };
            let outputs = self.stations.get(from.position).map(Station::outputs);
            let value = outputs.and_then(|outputs| outputs.get(from.channel).copied());
            if let (Some(value), Some(station)) = (value, self.stations.get_mut(to.position)) {
                station.device.set_input(to.channel, value);
            }
        }
    }

    /// Returns the first wire whose output or input does not exist.
    #[must_use]
    pub fn loose_wire(&self) -> Option<LineWire> {
        let outputs = |at: Terminal| {
            let station = self.stations.get(at.position);
            station.map_or(0, |one| one.device.outputs().len())
        };
        let inputs = |at: Terminal| {
            let station = self.stations.get(at.position);
            station.map_or(0, |one| one.device.inputs().len())
        };
        let loose = |wire: &&LineWire| {
            wire.from.channel >= outputs(wire.from) || wire.to.channel >= inputs(wire.to)
        };
        self.wires.iter().find(loose).copied()
    }

    /// Returns when the next watchdog expires.
    #[must_use]
    pub fn deadline(&self) -> Option<Duration> {
        let powered = self.stations.iter().filter(|one| one.powered);
        powered.filter_map(|one| one.device.deadline()).min()
    }

    /// Lets a frame run through the line and back. Returns false if it does not come back.
    ///
    /// # Errors
    /// Returns an error if the packet is no EtherCAT frame; it is unchanged then.
    pub fn exchange(&mut self, packet: &mut [u8], now: Duration) -> Result<bool, FrameError> {
        let places = frame::datagrams(packet)?;
        self.advance(now);
        let reach = self.reach();
        if reach == 0 {
            return Ok(false);
        }
        if self.drop > 0 {
            self.drop -= 1;
            return Ok(false);
        }
        for place in &places {
            if let Some(mut datagram) = Datagram::at(packet, place) {
                for station in self.stations.iter_mut().take(reach) {
                    if datagram.command.addressing == Addressing::Logical && station.miss > 0 {
                        station.miss -= 1;
                        continue;
                    }
                    visit(&mut station.device, &mut datagram, now);
                }
            }
        }
        self.carry();
        frame::mark_processed(packet);
        self.frames += 1;
        Ok(true)
    }
}

/// Lets a datagram pass one SubDevice.
fn visit(device: &mut SubDevice, datagram: &mut Datagram<'_>, now: Duration) {
    let command = datagram.command;
    if command.access == Access::None {
        return;
    }
    let addressed = match command.addressing {
        Addressing::Position => datagram.target() == 0,
        Addressing::Station => datagram.target() == device.station(),
        Addressing::Broadcast => {
            device.access_all(datagram, now);
            false
        }
        Addressing::Logical => {
            device.access_logical(datagram, now);
            false
        }
    };
    if addressed {
        device.access(datagram, now);
    } else if command.access == Access::ReadMultipleWrite {
        device.write_multiple(datagram, now);
    }
    if matches!(
        command.addressing,
        Addressing::Position | Addressing::Broadcast
    ) {
        datagram.pass();
    }
}

#[cfg(test)]
mod tests;
