//! The conformance suite of drivers: one rule, one test, generic over the driver and the other end of its wire.
//! For tests, with the feature `conformance`; [`crate::conformance!`] in a driver's tests instantiates all rules, see `docs/drivers.md`.
//!
//! A rule runs the driver against a [`Subject`], the device's side on loopback, with a fault proxy in between. The
//! variable `RCC_DEVICE_<DRIVER>` runs the rules that are safe against a real device; `RCC_SEED` repeats a run.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rcc_config::{CellConfig, ChannelConfig, DeviceConfig, DriverConfig, OnRelease};
use rcc_core::message::{ANALOG_MAX, Joints};
use rcc_core::primitive::ChannelKind;
use rcc_core::unit::Unit;

use crate::driver::{Driver, Exchange, Inputs, LinkError, Outputs};
use crate::host::reason::Reason;

pub mod capture;
pub mod driver_bench;
pub mod fault_path;
pub mod hosted;
pub mod limit_checker;
pub mod real;
pub mod rules;

/// Time-out of each receive.
pub const TIMEOUT: Duration = Duration::from_millis(20);

/// The other end of the wire. Its inputs 0 are looped back from its outputs 0.
pub trait Peer {
    /// Called before each receive: a device that sends first sends now.
    fn before_receive(&mut self);
    /// Called after each answer, or after an exchange without one.
    fn after_exchange(&mut self);
    /// Makes the device disappear or return.
    fn set_present(&mut self, present: bool);
}

/// Transport protocol of the wire, and who sends first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// The device sends the first datagram to the address where the driver listens; its clock is the test's.
    UdpFromDevice,
    /// The driver sends the first datagram; the device runs in threads of its own.
    UdpFromDriver,
    /// The driver connects; the device runs in threads of its own.
    TcpFromDriver,
}

/// The outputs that the device has received, by the index of their channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObservedOutputs {
    /// Bit i: digital output i.
    pub digital: u64,
    /// Analog outputs, SI; NaN = never received.
    pub analog: [f64; ANALOG_MAX],
}

/// A driver under test, seen from its device.
pub trait Subject: Peer + Sized {
    /// The driver of this device.
    type Driver: Driver + 'static;
    /// Name of the driver in a cell's configuration.
    const NAME: &'static str;
    /// The driver's reasons.
    const REASONS: &'static [Reason];
    /// The driver's wire.
    const TRANSPORT: Transport;
    /// The wire has a checksum that detects corrupted packets.
    const HAS_CHECKSUM: bool;
    /// The same device gives the same packets, whatever the time: a recording of its packets can be replayed.
    const CAN_BE_REPLAYED: bool = true;
    /// Invalid values of settings, as JSON: at least one row for every setting that has a range or a set of words.
    const BAD_SETTINGS: &'static [(&'static str, &'static str)];
    /// Invalid channel addresses of each kind, as JSON; addresses of another type are always tested.
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)];

    /// Starts a device on loopback that is present.
    fn start() -> Self;
    /// The device's address, if the driver sends first; otherwise any address.
    fn address(&self) -> SocketAddr;
    /// Sets the address that the device sends to, if it sends first.
    fn set_driver_address(&mut self, driver: SocketAddr) {
        let _ = driver;
    }
    /// Returns the configuration for a device at this address or, if the device sends first, for a driver at this
    /// address. Each kind of output has a channel, and a digital output has `on_release: hold`.
    fn device(at: SocketAddr) -> DeviceConfig;
    /// Returns the present outputs of the device.
    fn outputs(&mut self) -> ObservedOutputs;
    /// Returns the set-points in a packet of the driver, if the device follows them.
    fn followed(&self, packet: &[u8]) -> Option<Joints> {
        let _ = packet;
        None
    }
    /// Returns the protocol violations of the driver that the device has seen; losses on the wire do not count.
    fn protocol_violations(&self) -> Vec<String> {
        Vec::new()
    }
    /// Returns captured bytes of an exchange with another device, and the expected inputs; `None` if there are none.
    fn capture() -> Option<capture::Capture> {
        None
    }
}

/// Instantiates all rules for a driver: `conformance!(io: IoServer)` for plain I/O, `conformance!(arm: Controller)` for
/// a device with joints that sends first. `conformance!(drives: Line)` is for joints moved by drives that the driver asks: their
/// set-points are not seen by [`Subject::followed`], so the rules of rest and restart are tests of the driver's own. It is the part
/// of `io` that every driver keeps.
#[macro_export]
macro_rules! conformance {
    (drives: $subject:ty) => {
        $crate::conformance!(tests of $subject:
            opens_what_is_right,
            refuses_a_setting_that_it_does_not_have,
            refuses_each_setting_of_another_form,
            refuses_each_setting_out_of_range,
            refuses_each_channel_of_a_wrong_address,
            refuses_two_outputs_at_one_address,
            refuses_a_robot_that_it_cannot_move,
            says_when_nobody_is_there,
            tells_what_it_knows,
            carries_outputs_there_and_inputs_back,
            comes_back_when_the_device_does,
            releases_outputs_on_null,
            releases_outputs_on_termination,
            releases_outputs_when_the_executor_vanishes,
            releases_outputs_when_the_executor_stops_writing,
            sends_every_safe_value_whatever_the_device_answers,
            survives_lost_packets,
            survives_late_packets,
            survives_duplicated_packets,
            survives_reordered_packets,
            survives_truncated_packets,
            in_a_cell_outputs_are_released_when_the_executor_dies,
            in_a_cell_a_lost_device_is_offline_and_comes_back,
        );
    };
    (io: $subject:ty) => {
        $crate::conformance!(drives: $subject);
        $crate::conformance!(tests of $subject:
            says_which_setting_is_missing,
            survives_corrupted_packets,
            survives_all_faults_at_once,
            replays_its_capture,
            replays_a_recording,
        );
    };
    (arm: $subject:ty) => {
        $crate::conformance!(io: $subject);
        $crate::conformance!(tests of $subject:
            sends_nothing_but_hold_on_null,
            comes_to_rest_in_time_when_the_executor_vanishes,
            comes_to_rest_in_time_when_the_executor_stops_writing,
            comes_to_rest_in_time_on_null,
            comes_to_rest_in_time_on_termination,
            restarted_it_sends_nothing_but_hold_until_a_new_start,
            restarted_while_the_device_brakes_it_sends_nothing_but_hold,
            in_a_cell_the_arm_comes_to_rest_when_the_executor_dies,
            in_a_cell_a_restarted_driver_moves_nothing,
        );
    };
    (tests of $subject:ty: $($rule:ident,)*) => {
        $(
            #[test]
            fn $rule() {
                $crate::conformance::real::run::<$subject>(
                    stringify!($rule),
                    $crate::conformance::rules::$rule::<$subject>,
                );
            }
        )*
    };
}

/// A channel: name, kind, address, `on_release`, range.
pub type ChannelRow<'a> = (
    &'a str,
    ChannelKind,
    serde_json::Value,
    Option<OnRelease>,
    Option<[f64; 2]>,
);

/// Returns a device without a robot.
pub fn device(driver: &str, settings: serde_json::Value, rows: &[ChannelRow<'_>]) -> DeviceConfig {
    let channel = |(place, row): (usize, &ChannelRow<'_>)| {
        let (name, kind, address, on_release, range) = row.clone();
        let before = rows[..place].iter().filter(|other| other.1 == kind);
        ChannelConfig {
            name: name.to_owned(),
            kind,
            index: before.count() as u32,
            address,
            unit: Unit::ONE,
            scale: 1.0,
            offset: 0.0,
            range,
            on_release,
        }
    };
    DeviceConfig {
        name: "device".to_owned(),
        driver: DriverConfig::Name(driver.to_owned()),
        folder: PathBuf::new(),
        robot: None,
        settings,
        channels: rows.iter().enumerate().map(channel).collect(),
        first_tolerance_rad: 2e-3,
        base: rcc_core::pose::Pose::IDENTITY,
        workspace: None,
        command_timeout_ns: 50_000_000,
        delay_ns: 10_000_000,
    }
}

/// Returns a cell that contains only this device, with a period of 1 ms.
pub fn cell(device: &DeviceConfig) -> CellConfig {
    let text =
        "cell: conformance\nperiod: 1 ms\nstale_after: 50 ms\ndevices: {device: {driver: none}}\n";
    let cell = CellConfig::parse(text, "conformance", Path::new(""), &Default::default());
    CellConfig {
        devices: vec![device.clone()],
        ..cell.unwrap_or_else(|faults| panic!("{faults}"))
    }
}

/// Performs one exchange; the answer is `outputs` with the mirrored position.
pub fn exchange(
    driver: &mut dyn Driver,
    peer: &mut dyn Peer,
    inputs: &mut Inputs,
    outputs: &Outputs,
) -> Result<Exchange, LinkError> {
    peer.before_receive();
    let result = driver.receive(TIMEOUT, inputs).and_then(|exchange| {
        let position = exchange.mirror;
        driver.send(&Outputs {
            position,
            ..*outputs
        })?;
        Ok(exchange)
    });
    peer.after_exchange();
    result
}
