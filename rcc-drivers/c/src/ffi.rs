//! The boundary to C: the structures of `include/rcc_driver.h`, the table of a driver, calls of its functions, and the
//! program that C starts. Run by the main thread (`rcc_driver_main`, `open`) and by the host's thread (all other functions).
//!
//! The obligations of C are in the header: tables and texts live as long as the program, and a function writes only where the
//! header says so. Everything else is checked here or in [`crate::check`].
#![allow(unsafe_code)] // Only in this file, in `ffi/program.rs` and in `ffi/table.rs`.

use std::ffi::{CString, c_void};

mod program;
mod raw;
mod table;

pub use program::rcc_driver_main;
pub(crate) use raw::{OK, REFUSED, RawError, RawExchange, RawInputs, RawOutputs, SILENT};
use raw::{RawChannel, RawDevice, RawValue};
use table::Functions;
pub(crate) use table::SettingRow;
pub use table::{Description, TableError};

/// Arguments of `open`, owned by Rust.
#[derive(Debug)]
pub(crate) struct OpenArguments {
    pub name: CString,
    pub joints: u32,
    pub command_timeout_s: f64,
    /// Text and number of each setting.
    pub settings: Vec<(CString, f64)>,
    pub channels: Vec<ChannelArgument>,
}

/// A channel as `open` is told of it.
#[derive(Debug)]
pub(crate) struct ChannelArgument {
    pub name: CString,
    pub address: CString,
    pub kind: i32,
    pub index: u32,
    pub released: f64,
}

/// The state of an open driver, and its functions.
#[derive(Debug)]
pub(crate) struct OpenDriver {
    state: *mut c_void,
    functions: Functions,
}

// SAFETY: the header says that the functions may be called by another thread than `open` was, one at a time; `&mut self`, and
// one owner, secure the latter.
unsafe impl std::marker::Send for OpenDriver {}

impl OpenDriver {
    /// Calls `open`; the driver is closed when the result is dropped.
    ///
    /// # Errors
    /// Returns what `open` returned, with its words.
    pub(crate) fn open(
        table: &Description,
        arguments: &OpenArguments,
    ) -> Result<Self, (i32, Box<RawError>)> {
        let settings: Vec<RawValue> = arguments
            .settings
            .iter()
            .map(|(text, number)| RawValue {
                text: text.as_ptr(),
                number: *number,
            })
            .collect();
        let channels: Vec<RawChannel> = arguments
            .channels
            .iter()
            .map(|channel| RawChannel {
                name: channel.name.as_ptr(),
                address: channel.address.as_ptr(),
                kind: channel.kind,
                index: channel.index,
                released: channel.released,
            })
            .collect();
        let device = RawDevice {
            name: arguments.name.as_ptr(),
            joints: arguments.joints,
            // At most 160: DIGITAL_MAX and ANALOG_MAX for each direction.
            channel_count: channels.len() as u32,
            settings: settings.as_ptr(),
            channels: channels.as_ptr(),
            command_timeout_s: arguments.command_timeout_s,
        };
        let functions = table.functions;
        let (mut state, mut error) = (std::ptr::null_mut(), RawError::EMPTY);
        // SAFETY: `device` and all that it points to live until the call returns; `state` and `error` are ours to be written.
        let result = unsafe { (functions.open)(&raw const device, &raw mut state, &raw mut error) };
        match result {
            OK => Ok(Self { state, functions }),
            other => Err((other, Box::new(error))),
        }
    }

    /// Calls `receive`; returns its result and its words.
    pub(crate) fn receive(
        &mut self,
        timeout_s: f64,
        inputs: &mut RawInputs,
        exchange: &mut RawExchange,
    ) -> (i32, RawError) {
        let mut error = RawError::EMPTY;
        // SAFETY: `state` is what `open` returned and has not been closed; the others are ours to be written. Every bit
        // pattern of their fields is valid.
        let result = unsafe {
            (self.functions.receive)(
                self.state,
                timeout_s,
                &raw mut *inputs,
                &raw mut *exchange,
                &raw mut error,
            )
        };
        (result, error)
    }

    /// Calls `send`; returns its result and its words.
    pub(crate) fn send(&mut self, outputs: &RawOutputs) -> (i32, RawError) {
        let mut error = RawError::EMPTY;
        // SAFETY: as for `receive`; `outputs` lives until the call returns.
        let result =
            unsafe { (self.functions.send)(self.state, &raw const *outputs, &raw mut error) };
        (result, error)
    }

    /// Calls `release`, if there is one.
    pub(crate) fn release(&mut self) {
        if let Some(release) = self.functions.release {
            // SAFETY: `state` is what `open` returned and has not been closed.
            unsafe { release(self.state) };
        }
    }
}

impl Drop for OpenDriver {
    fn drop(&mut self) {
        if let Some(close) = self.functions.close {
            // SAFETY: `state` is what `open` returned; closed once, as nothing uses it after this.
            unsafe { close(self.state) };
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::raw::{RawDriver, RawReason, RawSetting};
    use super::*;
    use std::os::unix::ffi::OsStrExt;
    use std::path::Path;

    /// Returns an object of a shared library, which stays loaded.
    fn symbol(library: &Path, name: &str) -> *const c_void {
        let path = CString::new(library.as_os_str().as_bytes()).expect("a path");
        let name = CString::new(name).expect("a name");
        // SAFETY: both texts live until the calls return; the library's constructors do nothing.
        let found = unsafe {
            let handle = libc::dlopen(path.as_ptr(), libc::RTLD_NOW | libc::RTLD_LOCAL);
            assert!(!handle.is_null(), "{}", library.display());
            libc::dlsym(handle, name.as_ptr())
        };
        assert!(!found.is_null(), "{name:?}");
        found
    }

    /// Returns the table `name` of a shared library.
    pub(crate) fn load(library: &Path, name: &str) -> Result<Description, TableError> {
        // SAFETY: the object is an `rcc_driver`, as the tests' C files have it; the library is never unloaded.
        unsafe { Description::read(symbol(library, name).cast()) }
    }

    /// Returns the first `count` numbers of the array `name` of a shared library.
    pub(crate) fn numbers(library: &Path, name: &str, count: usize) -> Vec<usize> {
        // SAFETY: the object is an array of `count` numbers of size_t; the library is never unloaded.
        unsafe { std::slice::from_raw_parts(symbol(library, name).cast(), count) }.to_vec()
    }

    /// Sizes of the structures, in the order of `src/conforms/tables.c`.
    pub(crate) fn sizes() -> Vec<usize> {
        vec![
            size_of::<RawError>(),
            size_of::<RawSetting>(),
            size_of::<RawValue>(),
            size_of::<RawChannel>(),
            size_of::<RawDevice>(),
            size_of::<RawInputs>(),
            size_of::<RawExchange>(),
            size_of::<RawOutputs>(),
            size_of::<RawReason>(),
            size_of::<RawDriver>(),
            std::mem::offset_of!(RawChannel, released),
            std::mem::offset_of!(RawDevice, command_timeout_s),
            std::mem::offset_of!(RawInputs, digital),
            std::mem::offset_of!(RawExchange, commandable),
            std::mem::offset_of!(RawOutputs, digital),
            std::mem::offset_of!(RawDriver, close),
        ]
    }
}
