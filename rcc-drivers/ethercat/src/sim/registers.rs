//! Addresses in the memory of an EtherCAT SubDevice controller (ETG.1000.4, section 6), and its memory.

/// Size of the memory, bytes: registers below 0x1000, process data and mailboxes above.
pub const MEMORY_SIZE: usize = 0x2000;
/// Number of FMMUs (u8).
pub const FMMU_COUNT: u16 = 0x0004;
/// Number of sync managers (u8).
pub const SM_COUNT: u16 = 0x0005;
/// Station address (u16).
pub const STATION_ADDRESS: u16 = 0x0010;
/// Data link status (u16).
pub const DL_STATUS: u16 = 0x0110;
/// AL control (u16): the state that the MainDevice requests.
pub const AL_CONTROL: u16 = 0x0120;
/// AL status (u16): the present state and the error flag.
pub const AL_STATUS: u16 = 0x0130;
/// AL status code (u16): the reason of the error flag.
pub const AL_STATUS_CODE: u16 = 0x0134;
/// Error counters of the ports (20 bytes); a write clears them.
pub const ERROR_COUNTERS: u16 = 0x0300;
/// Counters of lost links of the ports (4 × u8).
pub const LOST_LINKS: u16 = 0x0310;
/// Watchdog divider (u16), in units of 40 ns, less 2.
pub const WATCHDOG_DIVIDER: u16 = 0x0400;
/// Process data watchdog time (u16), in units of the divider; 0 switches it off.
pub const WATCHDOG_TIME: u16 = 0x0420;
/// Process data watchdog status (u16): bit 0 is 1 as long as it has not expired.
pub const WATCHDOG_STATUS: u16 = 0x0440;
/// Number of process data watchdog expirations (u8).
pub const WATCHDOG_COUNT: u16 = 0x0442;
/// EEPROM control and status (u16), address (u32, words) and data (8 bytes).
pub const EEPROM_CONTROL: u16 = 0x0502;
/// EEPROM address (u32, in words).
pub const EEPROM_ADDRESS: u16 = 0x0504;
/// EEPROM data (8 bytes).
pub const EEPROM_DATA: u16 = 0x0508;
/// First FMMU; each has [`FMMU_SIZE`] bytes.
pub const FMMU: u16 = 0x0600;
/// Size of the registers of an FMMU, bytes.
pub const FMMU_SIZE: u16 = 16;
/// Receive times of ports 0 to 3 (4 × u32); a write latches them.
pub const DC_RECEIVE_TIMES: u16 = 0x0900;
/// System time (u64); a write is compared with it.
pub const DC_SYSTEM_TIME: u16 = 0x0910;
/// Local time at which the last latching frame arrived (u64).
pub const DC_RECEIVE_TIME: u16 = 0x0918;
/// System time minus local time (i64).
pub const DC_SYSTEM_TIME_OFFSET: u16 = 0x0920;
/// Delay from the reference clock (u32), ns.
pub const DC_DELAY: u16 = 0x0928;
/// Difference from the reference clock (u32, bit 31: the own time is smaller), ns.
pub const DC_DIFFERENCE: u16 = 0x092c;
/// Start value of the control loop (u16); a write starts the comparison anew.
pub const DC_LOOP_START: u16 = 0x0930;
/// Activation of SYNC signals (u8): bit 0 cyclic operation, bit 1 SYNC0.
pub const DC_ACTIVATION: u16 = 0x0981;
/// Start of cyclic operation (u64), system time.
pub const DC_START: u16 = 0x0990;
/// Period of SYNC0 (u32), ns.
pub const DC_SYNC0_CYCLE: u16 = 0x09a0;
/// Last register of distributed clocks.
pub const DC_LAST: u16 = 0x09ff;
/// First sync manager; each has [`SM_SIZE`] bytes.
pub const SM: u16 = 0x0800;
/// Size of the registers of a sync manager, bytes.
pub const SM_SIZE: u16 = 8;

/// Ranges that a MainDevice cannot write, first and last byte.
const READ_ONLY: &[(u16, u16)] = &[
    (0x0000, 0x000f),
    (0x0012, 0x0013),
    (0x0110, 0x0111),
    (0x0130, 0x0135),
    (0x0140, 0x0151),
    (0x0300, 0x0313),
    (0x0440, 0x0443),
    (0x0900, 0x090f),
    (0x0918, 0x091f),
    (0x092c, 0x092f),
];

/// The memory of one SubDevice.
#[derive(Clone, Debug)]
pub struct Memory(Box<[u8; MEMORY_SIZE]>);

impl Default for Memory {
    fn default() -> Self {
        Memory(Box::new([0; MEMORY_SIZE]))
    }
}

impl Memory {
    /// Returns this range, if it exists.
    #[must_use]
    pub fn range(&self, address: u16, size: usize) -> Option<&[u8]> {
        let first = usize::from(address);
        self.0.get(first..first.checked_add(size)?)
    }

    /// Writes a range as the SubDevice itself; what lies beyond the memory is ignored.
    pub fn put(&mut self, address: u16, bytes: &[u8]) {
        let places = self.0.iter_mut().skip(usize::from(address));
        for (place, byte) in places.zip(bytes) {
            *place = *byte;
        }
    }

    /// Writes a range as the MainDevice, which cannot change read-only registers. Returns false, without effect, if the
    /// range does not exist.
    pub fn write(&mut self, address: u16, bytes: &[u8]) -> bool {
        if self.range(address, bytes.len()).is_none() {
            return false;
        }
        for (at, byte) in (address..).zip(bytes) {
            let protected = READ_ONLY
                .iter()
                .any(|(first, last)| (*first..=*last).contains(&at));
            if !protected {
                self.put(at, &[*byte]);
            }
        }
        true
    }

    /// Returns a byte; 0 beyond the memory.
    #[must_use]
    pub fn u8(&self, address: u16) -> u8 {
        self.0.get(usize::from(address)).copied().unwrap_or(0)
    }

    /// Returns a little-endian word.
    #[must_use]
    pub fn u16(&self, address: u16) -> u16 {
        u16::from_le_bytes([self.u8(address), self.u8(address.saturating_add(1))])
    }

    /// Returns a little-endian double word.
    #[must_use]
    pub fn u32(&self, address: u16) -> u32 {
        u32::from(self.u16(address)) | u32::from(self.u16(address.saturating_add(2))) << 16
    }

    /// Returns a little-endian quad word.
    #[must_use]
    pub fn u64(&self, address: u16) -> u64 {
        u64::from(self.u32(address)) | u64::from(self.u32(address.saturating_add(4))) << 32
    }

    /// Writes a little-endian word as the SubDevice itself.
    pub fn put_u16(&mut self, address: u16, value: u16) {
        self.put(address, &value.to_le_bytes());
    }
}

/// Registers of a sync manager.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SyncManager {
    /// First address.
    pub start: u16,
    /// Length, bytes.
    pub length: u16,
    /// Control byte: bit 0-1 mode, 2-3 direction, 6 triggers the watchdog.
    pub control: u8,
    /// The MainDevice has switched it on.
    pub active: bool,
}

impl SyncManager {
    /// Reads sync manager `number`.
    #[must_use]
    pub fn read(memory: &Memory, number: u16) -> SyncManager {
        let at = SM + number * SM_SIZE;
        SyncManager {
            start: memory.u16(at),
            length: memory.u16(at + 2),
            control: memory.u8(at + 4),
            active: memory.u8(at + 6) & 1 == 1,
        }
    }

    /// Returns true if the last byte of the buffer is in the `size` bytes from `address`: this access ends the exchange.
    #[must_use]
    pub fn ends_in(&self, address: u16, size: usize) -> bool {
        let last = usize::from(self.start) + usize::from(self.length);
        let first = usize::from(address);
        self.length > 0 && (first + 1..=first + size).contains(&last)
    }

    /// Returns true if the byte at `address` belongs to the buffer.
    #[must_use]
    pub fn contains(&self, address: u16) -> bool {
        address >= self.start && address - self.start < self.length
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_main_device_cannot_write_read_only_registers() {
        let mut memory = Memory::default();
        memory.put_u16(AL_STATUS, 0x0001);
        assert!(memory.write(0x012f, &[7, 0xff, 0xff, 8]));
        assert_eq!(memory.u16(AL_STATUS), 0x0001);
        assert_eq!((memory.u8(0x012f), memory.u8(0x0132)), (7, 0));
    }

    #[test]
    fn a_range_beyond_the_memory_changes_nothing() {
        let mut memory = Memory::default();
        assert!(!memory.write(0x1fff, &[1, 2]));
        assert_eq!(memory.u8(0x1fff), 0);
        assert!(memory.range(0xffff, 1).is_none());
    }

    #[test]
    fn a_sync_manager_knows_its_last_byte() {
        let sm = SyncManager {
            start: 0x1000,
            length: 4,
            control: 0,
            active: true,
        };
        assert!(sm.ends_in(0x1000, 4) && sm.ends_in(0x1003, 1) && sm.ends_in(0x0ff0, 100));
        assert!(!sm.ends_in(0x1000, 3) && !sm.ends_in(0x1004, 1));
        assert!(sm.contains(0x1003) && !sm.contains(0x1004) && !sm.contains(0x0fff));
    }
}
