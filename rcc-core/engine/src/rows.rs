//! Rows of the command table by number, and sets of them. Used by the real-time thread; nothing here can fail.

use rcc_core::message::COMMANDS_MAX;

const _: () = assert!(COMMANDS_MAX <= u64::BITS as usize);

/// Number of a row of the command table, below [`COMMANDS_MAX`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowIndex(u8);

impl RowIndex {
    /// The first row.
    pub const FIRST: RowIndex = RowIndex(0);

    /// All rows, in ascending order.
    #[inline]
    pub fn all() -> impl Iterator<Item = RowIndex> {
        (0..COMMANDS_MAX as u8).map(RowIndex)
    }

    /// The row with this number, counted around the table.
    #[inline]
    pub fn wrapping(number: u64) -> RowIndex {
        RowIndex((number % COMMANDS_MAX as u64) as u8)
    }

    /// The row after this one; after the last, the first.
    #[inline]
    #[must_use]
    pub fn next(self) -> RowIndex {
        RowIndex::wrapping(u64::from(self.0) + 1)
    }

    /// Its number.
    #[inline]
    pub fn number(self) -> usize {
        usize::from(self.0)
    }
}

/// A set of rows; bit r is row r.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowSet(u64);

impl RowSet {
    /// No row.
    pub const EMPTY: RowSet = RowSet(0);
    /// All rows.
    pub const ALL: RowSet = RowSet(u64::MAX >> (u64::BITS as usize - COMMANDS_MAX));

    /// Returns true if the row is in the set.
    #[inline]
    pub fn contains(self, row: RowIndex) -> bool {
        self.0 >> row.0 & 1 == 1
    }

    /// Adds a row.
    #[inline]
    pub fn insert(&mut self, row: RowIndex) {
        self.0 |= 1 << row.0;
    }

    /// Removes a row.
    #[inline]
    pub fn remove(&mut self, row: RowIndex) {
        self.0 &= !(1 << row.0);
    }

    /// The rows that are in this set and not in the other.
    #[inline]
    #[must_use]
    pub fn without(self, other: RowSet) -> RowSet {
        RowSet(self.0 & !other.0)
    }

    /// The rows that are in both sets.
    #[inline]
    #[must_use]
    pub fn common(self, other: RowSet) -> RowSet {
        RowSet(self.0 & other.0)
    }

    /// The rows from `first` on.
    #[inline]
    #[must_use]
    pub fn starting_at(self, first: RowIndex) -> RowSet {
        RowSet(self.0 >> first.0 << first.0)
    }

    /// Number of its rows.
    #[inline]
    pub fn count(self) -> u32 {
        self.0.count_ones()
    }

    /// Its rows, in ascending order.
    #[inline]
    pub fn rows(self) -> impl Iterator<Item = RowIndex> {
        let mut rest = self.0;
        std::iter::from_fn(move || {
            let row = rest.trailing_zeros();
            rest &= rest.wrapping_sub(1);
            (row < u64::BITS).then_some(RowIndex(row as u8))
        })
    }
}

/// The numbers of the bits that are set, in ascending order.
#[inline]
pub fn set_bits(bits: u64) -> impl Iterator<Item = usize> {
    RowSet(bits).rows().map(RowIndex::number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_has_its_rows_in_ascending_order() {
        let mut set = RowSet::EMPTY;
        for number in [63, 0, 17, 64 + 17] {
            set.insert(RowIndex::wrapping(number));
        }
        let numbers = |set: RowSet| set.rows().map(RowIndex::number).collect::<Vec<_>>();
        assert_eq!(numbers(set), [0, 17, 63]);
        assert_eq!(numbers(set.starting_at(RowIndex::wrapping(1))), [17, 63]);
        assert_eq!(RowSet::ALL.rows().count(), COMMANDS_MAX);
        assert_eq!(RowIndex::wrapping(63).next(), RowIndex::FIRST);
    }
}
