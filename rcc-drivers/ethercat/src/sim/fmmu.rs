//! Fieldbus memory management units (ETG.1000.4, section 6.6): bit-wise mapping of logical addresses to the memory of a
//! SubDevice.
//! Pure; called by the thread of the socket.

use std::ops::Range;

use super::registers::{FMMU, FMMU_SIZE, Memory};

/// One active FMMU; all places are in bits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fmmu {
    /// Mapped logical bits.
    logical: Range<u64>,
    /// First bit in the memory.
    physical: u64,
    /// Maps reads.
    pub reads: bool,
    /// Maps writes.
    pub writes: bool,
}

/// A bit of a datagram and its bit in the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MappedBit {
    /// Bit of the datagram's data.
    pub data: usize,
    /// Address of its byte in the memory.
    pub address: u16,
    /// Number of its bit in that byte.
    pub bit: u8,
}

impl Fmmu {
    /// Reads FMMU `number`; `None` if it is not active or empty.
    #[must_use]
    pub fn read(memory: &Memory, number: u16) -> Option<Fmmu> {
        let at = FMMU + number * FMMU_SIZE;
        let length = u64::from(memory.u16(at + 4));
        if memory.u8(at + 12) & 1 == 0 || length == 0 {
            return None;
        }
        let start = u64::from(memory.u32(at)) * 8;
        let bit = |offset: u16| u64::from(memory.u8(at + offset) & 7);
        Some(Fmmu {
            logical: start + bit(6)..start + (length - 1) * 8 + bit(7) + 1,
            physical: u64::from(memory.u16(at + 8)) * 8 + bit(10),
            reads: memory.u8(at + 11) & 1 != 0,
            writes: memory.u8(at + 11) & 2 != 0,
        })
    }

    /// Returns the bits that a datagram of `size` bytes at `logical` shares with this FMMU.
    pub fn bits(&self, logical: u32, size: usize) -> impl Iterator<Item = MappedBit> + use<> {
        let first = u64::from(logical) * 8;
        let shared = self.logical.start.max(first)..self.logical.end.min(first + size as u64 * 8);
        let (start, physical) = (self.logical.start, self.physical);
        shared.filter_map(move |at| {
            let place = physical + (at - start);
            Some(MappedBit {
                data: usize::try_from(at - first).ok()?,
                address: u16::try_from(place / 8).ok()?,
                bit: (place % 8) as u8,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fmmu(logical: u32, length: u16, bits: (u8, u8), physical: (u16, u8), active: u8) -> Memory {
        let mut memory = Memory::default();
        memory.put(FMMU, &logical.to_le_bytes());
        memory.put_u16(FMMU + 4, length);
        memory.put(FMMU + 6, &[bits.0, bits.1]);
        memory.put_u16(FMMU + 8, physical.0);
        memory.put(FMMU + 10, &[physical.1, 2, active]);
        memory
    }

    #[test]
    fn maps_single_bits_across_bytes() {
        // Bits 6 to 9 from logical byte 0x100, to bit 1 of 0x0f00.
        let memory = fmmu(0x100, 2, (6, 1), (0x0f00, 1), 1);
        let fmmu = Fmmu::read(&memory, 0).unwrap();
        let found: Vec<(usize, u16, u8)> = fmmu
            .bits(0x0ff, 4)
            .map(|bit| (bit.data, bit.address, bit.bit))
            .collect();
        let want = [
            (14, 0x0f00, 1),
            (15, 0x0f00, 2),
            (16, 0x0f00, 3),
            (17, 0x0f00, 4),
        ];
        assert_eq!(found, want);
        assert!(fmmu.writes && !fmmu.reads);
    }

    #[test]
    fn a_datagram_beside_the_mapping_shares_nothing() {
        let memory = fmmu(0x100, 1, (0, 7), (0x1000, 0), 1);
        let fmmu = Fmmu::read(&memory, 0).unwrap();
        assert_eq!(fmmu.bits(0x0fe, 2).count(), 0);
        assert_eq!(fmmu.bits(0x101, 2).count(), 0);
        assert_eq!(fmmu.bits(0x0, 0x200).count(), 8);
    }

    #[test]
    fn an_inactive_or_empty_one_maps_nothing() {
        assert_eq!(Fmmu::read(&fmmu(0, 1, (0, 7), (0, 0), 0), 0), None);
        assert_eq!(Fmmu::read(&fmmu(0, 0, (0, 7), (0, 0), 1), 0), None);
    }

    #[test]
    fn the_last_addresses_do_not_overflow() {
        let memory = fmmu(u32::MAX, u16::MAX, (7, 7), (u16::MAX, 7), 1);
        let fmmu = Fmmu::read(&memory, 0).unwrap();
        assert_eq!(fmmu.bits(u32::MAX, 2000).count(), 1);
    }
}
