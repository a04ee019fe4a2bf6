//! The I/O box in C in the conformance suite, with the template's simulated box.
//! Test code only.

use std::net::{Ipv4Addr, SocketAddr};

use line_drivers::simulated_box::SimulatedBox;
use rcc_driver_kit::conformance;
use rcc_driver_kit::conformance::{ObservedOutputs, Peer, Subject, Transport, device};
use rcc_driver_kit::host::reason::Reason;
use rcc_driver_kit::rcc_config::{DeviceConfig, OnRelease};
use rcc_driver_kit::rcc_core::message::ANALOG_MAX;
use rcc_driver_kit::rcc_core::primitive::ChannelKind::{
    self, AnalogInput, AnalogOutput, DigitalInput, DigitalOutput,
};
use rcc_driver_kit::serde_json::json;

use super::example;
use crate::c_driver::{CDriver, DriverTable};
use crate::ffi::Description;
use crate::reasons::OWN_REASONS;

#[derive(Debug)]
enum LineBox {}

impl DriverTable for LineBox {
    fn description() -> Option<&'static Description> {
        Some(example("line_box"))
    }
}

/// The other end of the wire.
struct TextIoBox(SimulatedBox);

impl Peer for TextIoBox {
    fn before_receive(&mut self) {}

    fn after_exchange(&mut self) {}

    fn set_present(&mut self, present: bool) {
        self.0.set_present(present);
    }
}

impl Subject for TextIoBox {
    type Driver = CDriver<LineBox>;
    const NAME: &'static str = "c-line-io";
    const REASONS: &'static [Reason] = OWN_REASONS;
    const TRANSPORT: Transport = Transport::UdpFromDriver;
    const HAS_CHECKSUM: bool = true;
    const BAD_SETTINGS: &'static [(&'static str, &'static str)] = &[
        ("box", "\"192.168.0.7\""),
        ("box", "\"[::1]:7000\""),
        ("period", "\"0 ms\""),
        ("period", "\"10\""),
        ("timeout", "\"-1 ms\""),
    ];
    const BAD_ADDRESSES: &'static [(ChannelKind, &'static str)] =
        &[(DigitalInput, "0"), (AnalogOutput, "17")];

    fn start() -> Self {
        let started = SimulatedBox::start((Ipv4Addr::LOCALHOST, 0).into());
        TextIoBox(started.expect("a socket and a thread"))
    }

    fn address(&self) -> SocketAddr {
        self.0.address()
    }

    fn device(at: SocketAddr) -> DeviceConfig {
        let safe = Some(OnRelease::Safe(0.0));
        let hold = Some(OnRelease::Hold);
        let rows = [
            ("lamp", DigitalOutput, 1.into(), safe, None),
            ("clamp", DigitalOutput, 2.into(), hold, None),
            ("lamp_on", DigitalInput, 1.into(), None, None),
            ("speed", AnalogOutput, 1.into(), safe, Some([0.0, 0.5])),
            ("speed_is", AnalogInput, 1.into(), None, None),
        ];
        let settings = json!({"box": at.to_string(), "period": "1 ms", "timeout": "20 ms"});
        device("c-line-io", settings, &rows)
    }

    fn outputs(&mut self) -> ObservedOutputs {
        let outputs = self.0.outputs();
        let bit = |name: &str| u64::from(outputs.get(name).is_some_and(|value| *value != 0.0));
        let mut analog = [f64::NAN; ANALOG_MAX];
        analog[0] = outputs.get("a1").copied().unwrap_or(f64::NAN);
        ObservedOutputs {
            digital: bit("d1") | bit("d2") << 1,
            analog,
        }
    }
}

conformance!(io: TextIoBox);
