//! The structures of `include/rcc_driver.h`, field by field. Plain data; a test compares their layout with C's.

use std::ffi::{c_char, c_void};

/// `RCC_DRIVER_VERSION`.
pub const VERSION: u32 = 1;
/// `RCC_JOINTS_MAX`, `RCC_DIGITAL_MAX`, `RCC_ANALOG_MAX`: as in [`rcc_driver_kit::rcc_core::message`].
const JOINTS: usize = 8;
const DIGITAL: usize = 64;
const ANALOG: usize = 16;
const _: () = {
    use rcc_driver_kit::rcc_core::message::{ANALOG_MAX, DIGITAL_MAX, JOINTS_MAX};
    assert!(JOINTS == JOINTS_MAX && DIGITAL == DIGITAL_MAX && ANALOG == ANALOG_MAX);
};
/// `RCC_OK`.
pub const OK: i32 = 0;
/// `RCC_REFUSED`.
pub const REFUSED: i32 = 1;
/// `RCC_SILENT`.
pub const SILENT: i32 = 3;

/// `rcc_error`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RawError {
    pub at: [c_char; 64],
    pub text: [c_char; 192],
}

/// `rcc_setting`.
#[repr(C)]
#[derive(Debug)]
pub struct RawSetting {
    pub key: *const c_char,
    pub form: i32,
    pub fallback: *const c_char,
    pub expected: *const c_char,
}

/// `rcc_value`.
#[repr(C)]
#[derive(Debug)]
pub struct RawValue {
    pub text: *const c_char,
    pub number: f64,
}

/// `rcc_channel`.
#[repr(C)]
#[derive(Debug)]
pub struct RawChannel {
    pub name: *const c_char,
    pub address: *const c_char,
    pub kind: i32,
    pub index: u32,
    pub released: f64,
}

/// `rcc_device`.
#[repr(C)]
#[derive(Debug)]
pub struct RawDevice {
    pub name: *const c_char,
    pub joints: u32,
    pub channel_count: u32,
    pub settings: *const RawValue,
    pub channels: *const RawChannel,
    pub command_timeout_s: f64,
}

/// `rcc_inputs`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RawInputs {
    pub position: [f64; JOINTS],
    pub torque: [f64; JOINTS],
    pub external_torque: [f64; JOINTS],
    pub wrench: [f64; 6],
    pub analog: [f64; ANALOG],
    pub digital: [i8; DIGITAL],
}

/// `rcc_exchange`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RawExchange {
    pub mirror: [f64; JOINTS],
    pub period_s: f64,
    pub ticks: u64,
    pub late: u64,
    pub refused: u64,
    pub quality: u32,
    pub reason: u32,
    pub commandable: i8,
}

/// `rcc_outputs`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RawOutputs {
    pub position: [f64; JOINTS],
    pub analog: [f64; ANALOG],
    pub digital: [i8; DIGITAL],
}

/// `rcc_reason`.
#[repr(C)]
#[derive(Debug)]
pub struct RawReason {
    pub number: u32,
    pub text: *const c_char,
}

pub type Open = unsafe extern "C" fn(*const RawDevice, *mut *mut c_void, *mut RawError) -> i32;
pub type Receive =
    unsafe extern "C" fn(*mut c_void, f64, *mut RawInputs, *mut RawExchange, *mut RawError) -> i32;
pub type Send = unsafe extern "C" fn(*mut c_void, *const RawOutputs, *mut RawError) -> i32;
pub type Call = unsafe extern "C" fn(*mut c_void);

/// `rcc_driver`: the table that C gives.
#[repr(C)]
#[derive(Debug)]
pub struct RawDriver {
    pub version: u32,
    pub has_arm: u32,
    pub name: *const c_char,
    pub address: *const c_char,
    pub settings: *const RawSetting,
    pub reasons: *const RawReason,
    pub setting_count: u32,
    pub reason_count: u32,
    pub open: Option<Open>,
    pub receive: Option<Receive>,
    pub send: Option<Send>,
    pub release: Option<Call>,
    pub close: Option<Call>,
}

impl RawError {
    pub const EMPTY: RawError = RawError {
        at: [0; 64],
        text: [0; 192],
    };

    /// Returns the place that it names, and its words.
    pub fn words(&self) -> (String, String) {
        (of_chars(&self.at), of_chars(&self.text))
    }
}

/// Returns the text up to the first NUL, or all of it if C has left none.
fn of_chars(chars: &[c_char]) -> String {
    let bytes: Vec<u8> = chars
        .iter()
        .take_while(|byte| **byte != 0)
        .map(|byte| byte.to_ne_bytes()[0])
        .collect();
    String::from_utf8_lossy(&bytes).into_owned()
}
