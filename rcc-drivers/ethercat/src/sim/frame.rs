//! EtherCAT frames and their datagrams (ETG.1000.4, section 5): found, read and written in place, as a SubDevice does.
//! Run by the thread of the socket.

use std::ops::Range;

/// EtherType of EtherCAT.
pub const ETHER_TYPE: u16 = 0x88a4;
/// Length of the Ethernet header and of the EtherCAT header, bytes.
const HEADERS: usize = 16;
/// Length of a datagram's header, bytes.
const DATAGRAM_HEADER: usize = 10;

/// The access that a datagram requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Nothing.
    None,
    /// Read.
    Read,
    /// Write.
    Write,
    /// Read, then write.
    ReadWrite,
    /// The addressed SubDevice reads, all others write what it has read.
    ReadMultipleWrite,
}

/// Whom a datagram addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Addressing {
    /// The SubDevice that receives position 0.
    Position,
    /// The SubDevice with this station address.
    Station,
    /// All SubDevices.
    Broadcast,
    /// The SubDevices whose FMMUs map the logical address.
    Logical,
}

/// Command of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Command {
    /// Whom it addresses.
    pub addressing: Addressing,
    /// The requested access.
    pub access: Access,
}

impl Command {
    /// Returns the command with this number; unknown numbers ask for nothing, as in a SubDevice.
    #[must_use]
    pub fn of(number: u8) -> Command {
        use {Access as A, Addressing as D};
        let (addressing, access) = match number {
            1 => (D::Position, A::Read),
            2 => (D::Position, A::Write),
            3 => (D::Position, A::ReadWrite),
            4 => (D::Station, A::Read),
            5 => (D::Station, A::Write),
            6 => (D::Station, A::ReadWrite),
            7 => (D::Broadcast, A::Read),
            8 => (D::Broadcast, A::Write),
            9 => (D::Broadcast, A::ReadWrite),
            10 => (D::Logical, A::Read),
            11 => (D::Logical, A::Write),
            12 => (D::Logical, A::ReadWrite),
            13 => (D::Position, A::ReadMultipleWrite),
            14 => (D::Station, A::ReadMultipleWrite),
            _ => (D::Broadcast, A::None),
        };
        Command { addressing, access }
    }
}

/// Why a packet is not an EtherCAT frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Another protocol.
    #[error("EtherType {0:#06x}, not 0x88a4")]
    EtherType(u16),
    /// The type in the EtherCAT header is not 1 (datagrams).
    #[error("EtherCAT frame type {0}, not 1")]
    Kind(u16),
    /// A length leads beyond the end.
    #[error("a length leads beyond the {0} bytes of the packet")]
    Length(usize),
}

/// A datagram's place in the packet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// First byte of its header.
    pub header: usize,
    /// Its data.
    pub data: Range<usize>,
}

/// Returns the places of all datagrams.
///
/// # Errors
/// Returns an error if the packet is not a complete EtherCAT frame; a SubDevice forwards such a packet unchanged.
pub fn datagrams(packet: &[u8]) -> Result<Vec<Place>, FrameError> {
    let short = FrameError::Length(packet.len());
    let word = |at: usize| packet.get(at..at + 2).map(|two| [two[0], two[1]]);
    let kind = u16::from_be_bytes(word(12).ok_or(short)?);
    if kind != ETHER_TYPE {
        return Err(FrameError::EtherType(kind));
    }
    let header = u16::from_le_bytes(word(14).ok_or(short)?);
    if header >> 12 != 1 {
        return Err(FrameError::Kind(header >> 12));
    }
    let end = HEADERS + usize::from(header & 0x07ff);
    if end > packet.len() {
        return Err(short);
    }
    let mut found = Vec::new();
    let mut at = HEADERS;
    loop {
        let length = u16::from_le_bytes(word(at + 6).ok_or(short)?);
        let data = at + DATAGRAM_HEADER..at + DATAGRAM_HEADER + usize::from(length & 0x07ff);
        let next = data.end + 2;
        if next > end {
            return Err(short);
        }
        found.push(Place { header: at, data });
        if length & 0x8000 == 0 {
            return Ok(found);
        }
        at = next;
    }
}

/// A datagram, changed in place.
#[derive(Debug)]
pub struct Datagram<'a> {
    /// Its command.
    pub command: Command,
    /// Its four bytes of address: position or station and offset, or a logical address.
    address: &'a mut [u8],
    /// Its data.
    pub data: &'a mut [u8],
    counter: &'a mut [u8],
}

impl<'a> Datagram<'a> {
    /// Returns the datagram at this place of a packet, as [`datagrams`] found it; `None` for any other place.
    #[must_use]
    pub fn at(packet: &'a mut [u8], place: &Place) -> Option<Datagram<'a>> {
        let (head, rest) = packet
            .get_mut(place.header..place.data.end + 2)?
            .split_at_mut_checked(DATAGRAM_HEADER)?;
        let (data, counter) = rest.split_at_mut_checked(place.data.len())?;
        Some(Datagram {
            command: Command::of(*head.first()?),
            address: head.get_mut(2..6)?,
            data,
            counter,
        })
    }

    /// Returns the position or station that is addressed.
    #[must_use]
    pub fn target(&self) -> u16 {
        u16::from_le_bytes([self.address[0], self.address[1]])
    }

    /// Returns the address in the memory of the SubDevice.
    #[must_use]
    pub fn offset(&self) -> u16 {
        u16::from_le_bytes([self.address[2], self.address[3]])
    }

    /// Returns the logical address.
    #[must_use]
    pub fn logical(&self) -> u32 {
        u32::from(self.target()) | u32::from(self.offset()) << 16
    }

    /// Adds 1 to the position, as each SubDevice does.
    pub fn pass(&mut self) {
        let next = self.target().wrapping_add(1);
        self.address[..2].copy_from_slice(&next.to_le_bytes());
    }

    /// Adds to the working counter.
    pub fn count(&mut self, more: u16) {
        let now = u16::from_le_bytes([self.counter[0], self.counter[1]]).wrapping_add(more);
        self.counter.copy_from_slice(&now.to_le_bytes());
    }
}

/// Sets the bit of the source address by which a MainDevice tells an answer from its own frame.
pub fn mark_processed(packet: &mut [u8]) {
    if let Some(byte) = packet.get_mut(6) {
        *byte |= 0x02;
    }
}

/// Builds a frame of datagrams `(command, address, data)`, for tests.
#[cfg(test)]
#[must_use]
pub(crate) fn build(datagrams: &[(u8, u32, &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (number, (command, address, data)) in datagrams.iter().enumerate() {
        let more = u16::from(number + 1 < datagrams.len()) << 15;
        body.extend([*command, number as u8]);
        body.extend(address.to_le_bytes());
        body.extend((data.len() as u16 | more).to_le_bytes());
        body.extend([0, 0]);
        body.extend(*data);
        body.extend([0, 0]);
    }
    let mut packet = vec![0xff; 6];
    packet.extend([0x10; 6]);
    packet.extend(ETHER_TYPE.to_be_bytes());
    packet.extend((body.len() as u16 | 0x1000).to_le_bytes());
    packet.extend(body);
    packet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_every_datagram_of_the_chain() {
        let mut packet = build(&[(7, 0x0130_0000, &[0, 0]), (12, 0x0001_0203, &[1, 2, 3])]);
        let places = datagrams(&packet).unwrap();
        assert_eq!(places.len(), 2);
        let datagram = Datagram::at(&mut packet, &places[1]).unwrap();
        assert_eq!(datagram.command, Command::of(12));
        assert_eq!(datagram.logical(), 0x0001_0203);
        assert_eq!(datagram.data, [1, 2, 3]);
    }

    #[test]
    fn the_position_wraps_to_zero_at_the_addressed_one() {
        let mut packet = build(&[(1, 0x0010_ffff, &[0])]);
        let places = datagrams(&packet).unwrap();
        let mut datagram = Datagram::at(&mut packet, &places[0]).unwrap();
        datagram.pass();
        datagram.count(3);
        assert_eq!((datagram.target(), datagram.offset()), (0, 0x0010));
        assert_eq!(packet[packet.len() - 2..], [3, 0]);
    }

    #[test]
    fn padding_behind_the_datagrams_is_ignored() {
        let mut packet = build(&[(7, 0, &[0])]);
        packet.resize(60, 0xaa);
        assert_eq!(datagrams(&packet).unwrap().len(), 1);
    }

    #[test]
    fn no_cut_or_changed_packet_leads_beyond_its_end() {
        let whole = build(&[(7, 0, &[0, 0]), (12, 0, &[1, 2, 3])]);
        for size in 0..whole.len() {
            assert!(datagrams(&whole[..size]).is_err(), "{size} bytes");
        }
        let mut random = fastrand::Rng::with_seed(11);
        for _ in 0..20_000 {
            let mut packet = whole.clone();
            for _ in 0..3 {
                let at = random.usize(12..packet.len());
                packet[at] = random.u8(..);
            }
            for place in datagrams(&packet).unwrap_or_default() {
                assert!(Datagram::at(&mut packet, &place).is_some());
            }
        }
    }

    #[test]
    fn another_protocol_is_named() {
        let mut packet = build(&[(7, 0, &[0])]);
        packet[12] = 0x08;
        assert_eq!(datagrams(&packet), Err(FrameError::EtherType(0x08a4)));
    }
}
