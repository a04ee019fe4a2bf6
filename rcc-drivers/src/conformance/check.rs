//! All rules in one run for a subject without a proxy; superseded by `conformance!`, which names each rule.
//! Test code only.

use rcc_config::DeviceConfig;
use rcc_core::message::ANALOG_MAX;

use super::{Peer, exchange};
use crate::driver::{Driver, DriverError, Exchange, Inputs, LinkError, Outputs};
use crate::host::reason::Reason;

/// Exchanges in which something must have happened.
const PATIENCE: usize = 4000;

fn until(
    driver: &mut dyn Driver,
    peer: &mut dyn Peer,
    outputs: &Outputs,
    what: &str,
    mut done: impl FnMut(&Result<Exchange, LinkError>, &Inputs) -> bool,
) {
    let mut inputs = Inputs::NONE;
    for _ in 0..PATIENCE {
        let result = exchange(driver, peer, &mut inputs, outputs);
        if done(&result, &inputs) {
            return;
        }
    }
    panic!("never: {what}");
}

/// Runs all rules; digital and analog channel 0 of both directions must be there.
pub fn check<D: Driver>(device: &DeviceConfig, reasons: &[Reason], peer: &mut dyn Peer) -> D {
    refuses_unknown_settings::<D>(device);
    let mut driver = D::open(device).expect("the device's configuration is right");
    says_when_nobody_is_there(&mut driver, reasons, peer);
    peer.set_present(true);
    until(
        &mut driver,
        peer,
        &Outputs::NONE,
        "an exchange",
        |result, _| result.is_ok(),
    );
    tells_what_it_knows(&mut driver, device, reasons, peer);
    carries_outputs(&mut driver, peer);
    peer.set_present(false);
    until(
        &mut driver,
        peer,
        &Outputs::NONE,
        "the loss of the peer",
        |result, _| result.is_err(),
    );
    peer.set_present(true);
    until(
        &mut driver,
        peer,
        &Outputs::NONE,
        "its return",
        |result, _| result.is_ok(),
    );
    driver
}

fn refuses_unknown_settings<D: Driver>(device: &DeviceConfig) {
    let mut wrong = device.clone();
    wrong.settings["no_such_setting"] = 1.into();
    match D::open(&wrong) {
        Err(DriverError::UnknownSetting { key, .. }) => assert_eq!(key, "no_such_setting"),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("an unknown setting was accepted"),
    }
}

fn says_when_nobody_is_there(driver: &mut dyn Driver, reasons: &[Reason], peer: &mut dyn Peer) {
    let mut inputs = Inputs::NONE;
    peer.set_present(false);
    for _ in 0..3 {
        match exchange(driver, peer, &mut inputs, &Outputs::NONE) {
            Ok(_) => panic!("an exchange with nobody"),
            Err(LinkError::Silent) => {}
            Err(LinkError::Lost { reason }) => {
                assert!(reasons.iter().any(|row| row.0 == reason), "{reason}");
            }
        }
    }
    assert_eq!(inputs.digital_known, 0);
}

fn tells_what_it_knows(
    driver: &mut dyn Driver,
    device: &DeviceConfig,
    reasons: &[Reason],
    peer: &mut dyn Peer,
) {
    let [digital, _, analog, _] = device.model().channels;
    for _ in 0..10 {
        let mut inputs = Inputs::NONE;
        let Ok(exchange) = exchange(driver, peer, &mut inputs, &Outputs::NONE) else {
            continue;
        };
        assert!(exchange.ticks >= 1 && exchange.period_ns > 0);
        assert!(exchange.quality_permille <= 1000);
        assert!(exchange.commandable || !exchange.startable);
        let known = exchange.reason == 0 || reasons.iter().any(|row| row.0 == exchange.reason);
        assert!(known, "reason {}", exchange.reason);
        assert_eq!(exchange.startable, exchange.reason == 0);
        let numbers = exchange
            .mirror
            .iter()
            .chain(&inputs.position)
            .chain(&inputs.wrench);
        assert!(numbers.copied().all(f64::is_finite));
        assert_eq!(inputs.digital_known, (1 << digital) - 1);
        for index in 0..ANALOG_MAX {
            assert_eq!(inputs.analog[index].is_finite(), index < analog as usize);
        }
    }
}

fn carries_outputs(driver: &mut dyn Driver, peer: &mut dyn Peer) {
    for (on, value) in [(true, 3.0), (false, 0.0), (true, 1.0)] {
        let mut outputs = Outputs {
            digital: u64::from(on),
            digital_set: 1,
            ..Outputs::NONE
        };
        outputs.analog[0] = value;
        until(
            driver,
            peer,
            &outputs,
            "outputs that come back",
            |_, inputs| inputs.digital & 1 == u64::from(on) && inputs.analog[0] == value,
        );
    }
}
