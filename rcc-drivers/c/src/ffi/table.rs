//! The table of a driver, read once and checked: texts, settings, reasons and functions.
//! Run by the main thread.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_char};

use rcc_driver_kit::host::reason::Reason;
use thiserror::Error;

use super::raw::{Call, Open, RawDriver, RawSetting, Receive, Send, VERSION};
use crate::reasons::{OWN_REASON_MAX, OWN_REASONS};

/// Most rows of a table: more are a mistake of its author.
const ROWS_MAX: u32 = 1000;

/// Why a table cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum TableError {
    /// There is none.
    #[error("rcc_driver_main was called with NULL: give it the address of an rcc_driver")]
    Missing,
    /// It was compiled with another header.
    #[error(
        "the driver was compiled with version {table} of rcc_driver.h, the library has {library}: compile both from one release"
    )]
    Version {
        /// Version in the table.
        table: u32,
        /// Version of this library.
        library: u32,
    },
    /// A field that a driver needs is NULL or is not UTF-8.
    #[error("rcc_driver.{field} is NULL or not UTF-8")]
    Field {
        /// Name of the field.
        field: &'static str,
    },
    /// A count is beyond every plausible number.
    #[error("rcc_driver.{field} is {count}, more than {ROWS_MAX}")]
    Count {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        count: u32,
    },
    /// A reason has a number of the library.
    #[error("reason {number} of the driver: its numbers begin at 200")]
    ReasonNumber {
        /// The number.
        number: u32,
    },
}

/// A row of the table of settings.
#[derive(Clone, Copy, Debug)]
pub struct SettingRow {
    pub key: &'static str,
    pub form: i32,
    pub fallback: Option<&'static str>,
    pub expected: &'static str,
}

/// The functions of a driver.
#[derive(Clone, Copy, Debug)]
pub struct Functions {
    pub open: Open,
    pub receive: Receive,
    pub send: Send,
    pub release: Option<Call>,
    pub close: Option<Call>,
}

/// The table of a driver, checked.
#[derive(Clone, Debug)]
pub struct Description {
    pub(crate) name: &'static str,
    pub(crate) has_arm: bool,
    pub(crate) address: &'static str,
    pub(crate) settings: Vec<SettingRow>,
    /// The library's and the driver's.
    pub(crate) reasons: &'static [Reason],
    pub(crate) functions: Functions,
}

impl Description {
    /// Reads the table of a driver.
    ///
    /// # Errors
    /// Returns what is wrong with it.
    ///
    /// # Safety
    /// `table` is NULL, or points to an `rcc_driver` that, with all that it points to, is constant and lives as long as the
    /// program. Of a table of another version only the first field is read.
    pub unsafe fn read(table: *const RawDriver) -> Result<Self, TableError> {
        if table.is_null() {
            return Err(TableError::Missing);
        }
        // SAFETY: not NULL; by contract it points to a table, whose first field is the version in every release.
        let version = unsafe { (&raw const (*table).version).read() };
        if version != VERSION {
            return Err(TableError::Version {
                table: version,
                library: VERSION,
            });
        }
        // SAFETY: by contract a constant table that lives as long as the program; its layout is that of this version.
        let table: &'static RawDriver = unsafe { &*table };
        // SAFETY: by contract NULL or constant texts that live as long as the program.
        let text = |pointer, field| unsafe { text(pointer) }.ok_or(TableError::Field { field });
        // SAFETY: by contract NULL or `setting_count` rows.
        let setting_rows = unsafe { rows(table.settings, table.setting_count, "setting_count") }?;
        let setting = |row: &RawSetting| {
            Ok(SettingRow {
                key: text(row.key, "settings[].key")?,
                form: row.form,
                fallback: match row.fallback.is_null() {
                    true => None,
                    false => Some(text(row.fallback, "settings[].fallback")?),
                },
                expected: text(row.expected, "settings[].expected")?,
            })
        };
        let settings = setting_rows.iter().map(setting).collect::<Result<_, _>>()?;
        // SAFETY: by contract NULL or `reason_count` rows.
        let reason_rows = unsafe { rows(table.reasons, table.reason_count, "reason_count") }?;
        let mut reasons = OWN_REASONS.to_vec();
        for row in reason_rows {
            if row.number <= OWN_REASON_MAX {
                return Err(TableError::ReasonNumber { number: row.number });
            }
            reasons.push((row.number, text(row.text, "reasons[].text")?));
        }
        Ok(Self {
            name: text(table.name, "name")?,
            has_arm: table.has_arm != 0,
            address: text(table.address, "address")?,
            settings,
            // Once per program: it lives as long as the table.
            reasons: reasons.leak(),
            functions: Functions {
                open: table.open.ok_or(TableError::Field { field: "open" })?,
                receive: (table.receive).ok_or(TableError::Field { field: "receive" })?,
                send: table.send.ok_or(TableError::Field { field: "send" })?,
                release: table.release,
                close: table.close,
            },
        })
    }
}

/// Returns a text of C that lives as long as the program; `None` if it is NULL or not UTF-8.
///
/// # Safety
/// `pointer` is NULL or a constant, NUL-terminated text that lives as long as the program.
unsafe fn text(pointer: *const c_char) -> Option<&'static str> {
    if pointer.is_null() {
        return None;
    }
    // SAFETY: not NULL, and as the caller promises.
    unsafe { CStr::from_ptr(pointer) }.to_str().ok()
}

/// Returns the rows of a table.
///
/// # Safety
/// `first` is NULL or points to `count` constant rows that live as long as the program.
unsafe fn rows<T>(
    first: *const T,
    count: u32,
    field: &'static str,
) -> Result<&'static [T], TableError> {
    match (first.is_null(), count) {
        (_, 0) => Ok(&[]),
        (true, _) => Err(TableError::Field { field }),
        (false, ROWS_MAX..) => Err(TableError::Count { field, count }),
        // SAFETY: not NULL, `count` rows as the caller promises.
        (false, _) => Ok(unsafe { std::slice::from_raw_parts(first, count as usize) }),
    }
}
