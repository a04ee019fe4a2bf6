//! Drivers written in C: `include/rcc_driver.h` is the interface, `librcc_driver_c.a` the host around it. Everything that a C
//! function returns is checked before it goes on: what is not finite or out of range becomes null or a lost device, with words
//! in the driver's log. Unsafe code is in [`ffi`] alone.

mod c_driver;
mod channel_argument;
mod check;
pub mod ffi;
mod reasons;
mod setting_value;

#[cfg(test)]
mod conforms;
