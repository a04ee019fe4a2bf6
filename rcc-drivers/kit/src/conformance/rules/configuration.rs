//! Checks that a bad configuration is refused with the path of the key and the expected value.
//! Test code only; no device is reached.

use std::net::SocketAddr;

use rcc_config::device::is_output;
use rcc_config::{CellConfig, DeviceConfig};
use serde_json::{Value, json};

use super::super::Subject;
use super::super::fault_path::free_udp;
use crate::driver::{Driver, DriverError};

/// Default of `delay` in a cell file, ns.
const DELAY_NS: u64 = 10_000_000;
const COMMAND_TIMEOUT_NS: u64 = 50_000_000;

fn good<S: Subject>() -> DeviceConfig {
    S::device(free_udp())
}

fn refusal<S: Subject>(device: &DeviceConfig, what: &str) -> DriverError {
    match S::Driver::open(device) {
        Ok(_) => panic!("accepted: {what}"),
        Err(error) => error,
    }
}

/// Returns the names of all settings that the driver accepts, as its own error message lists them.
fn known<S: Subject>() -> Vec<String> {
    let mut device = good::<S>();
    device.settings["no_such_setting"] = 1.into();
    match refusal::<S>(&device, "settings.no_such_setting") {
        DriverError::UnknownSetting { key, known, .. } => {
            assert_eq!(key, "no_such_setting");
            known.split(", ").map(str::to_owned).collect()
        }
        other => panic!("not refused as an unknown setting: {other}"),
    }
}

/// Panics unless the error names this setting and says what to give.
fn names_setting(device: &DeviceConfig, error: &DriverError, key: &str) {
    let place = match error {
        DriverError::Setting { key, expected, .. } => {
            assert!(!expected.is_empty(), "{error}");
            key.as_str()
        }
        DriverError::UnknownSetting { key, known, .. } => {
            assert!(!known.is_empty(), "{error}");
            key.as_str()
        }
        DriverError::System { key, .. } => key,
        other => panic!("settings.{key} is wrong, refused is {other}"),
    };
    let within = place.strip_prefix(key);
    let within = within.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
    assert!(within, "settings.{key} is wrong, refused is {error}");
    let path = format!("devices.{}.settings.{key}", device.name);
    assert!(error.to_string().starts_with(&path), "{error}");
}

/// Opens the driver with the suite's own configuration.
pub fn opens_what_is_right<S: Subject>() {
    let device = good::<S>();
    if let Err(error) = S::Driver::open(&device) {
        panic!("{error}");
    }
}

/// Refuses a key that the driver does not know.
pub fn refuses_a_setting_that_it_does_not_have<S: Subject>() {
    assert!(known::<S>().iter().all(|key| !key.is_empty()));
}

/// Refuses a number, a text or a Boolean where a value of another type is expected.
pub fn refuses_each_setting_of_another_form<S: Subject>() {
    for key in known::<S>() {
        for form in [
            json!({"no": "such form"}),
            json!([[]]),
            json!("no such word, no such number"),
        ] {
            let mut device = good::<S>();
            device.settings[&key] = form.clone();
            let error = refusal::<S>(&device, &format!("settings.{key}: {form}"));
            names_setting(&device, &error, &key);
        }
    }
}

/// Refuses each value of the subject's table of bad settings.
pub fn refuses_each_setting_out_of_range<S: Subject>() {
    let known = known::<S>();
    for (key, text) in S::BAD_SETTINGS {
        assert!(known.iter().any(|own| own == key), "no setting {key}");
        let value: Value = serde_json::from_str(text).expect("the subject's table is JSON");
        let mut device = good::<S>();
        device.settings[*key] = value;
        let error = refusal::<S>(&device, &format!("settings.{key}: {text}"));
        names_setting(&device, &error, key);
    }
}

/// Each setting either has a default, or the driver reports that it is missing.
pub fn says_which_setting_is_missing<S: Subject>() {
    let keys: Vec<String> = match good::<S>().settings.as_object() {
        Some(settings) => settings.keys().cloned().collect(),
        None => Vec::new(),
    };
    for key in keys {
        let mut device = good::<S>();
        if let Some(settings) = device.settings.as_object_mut() {
            settings.remove(&key);
        }
        if let Err(error) = S::Driver::open(&device) {
            names_setting(&device, &error, &key);
            assert!(error.to_string().contains("missing"), "{error}");
        }
    }
}

fn names_channel(device: &DeviceConfig, error: &DriverError, name: &str) {
    let DriverError::Channel {
        channel, expected, ..
    } = error
    else {
        panic!("channels.{name} is wrong, refused is {error}");
    };
    assert_eq!(channel, name, "{error}");
    assert!(!expected.is_empty(), "{error}");
    let path = format!("devices.{}.channels.{name}", device.name);
    assert!(error.to_string().starts_with(&path), "{error}");
}

/// Refuses an address of another type, and each address of the subject's table, for every channel.
pub fn refuses_each_channel_of_a_wrong_address<S: Subject>() {
    let others = [
        "null",
        "true",
        "-1",
        "1.5",
        "\"no such address\"",
        "[]",
        "{}",
        "\"\"",
        "1e300",
    ];
    for place in 0..good::<S>().channels.len() {
        let kind = good::<S>().channels[place].kind;
        let own = S::BAD_ADDRESSES.iter().filter(|row| row.0 == kind);
        for text in others.iter().chain(own.map(|row| &row.1)) {
            let mut device = good::<S>();
            let name = device.channels[place].name.clone();
            device.channels[place].address =
                serde_json::from_str(text).expect("the subject's table is JSON");
            let error = refusal::<S>(&device, &format!("channels.{name}.address: {text}"));
            names_channel(&device, &error, &name);
        }
    }
}

/// Refuses two outputs of one kind at the same address.
pub fn refuses_two_outputs_at_one_address<S: Subject>() {
    let device = good::<S>();
    let mut tried = 0;
    for (place, channel) in device.channels.iter().enumerate() {
        let before = &device.channels[..place];
        let twin = before.iter().find(|other| other.kind == channel.kind);
        let Some(twin) = twin.filter(|_| is_output(channel.kind)) else {
            continue;
        };
        let mut device = device.clone();
        device.channels[place].address = twin.address.clone();
        let error = refusal::<S>(&device, "two outputs at one address");
        // The driver chooses which of the two channels it names; the message mentions the other one.
        let words = error.to_string();
        assert!(matches!(error, DriverError::Channel { .. }), "{error}");
        assert!(
            words.contains(&channel.name) && words.contains(&twin.name),
            "{words}"
        );
        tried += 1;
    }
    assert!(tried > 0, "the subject needs two outputs of one kind");
}

/// Refuses an arm that the driver cannot move, or a missing arm if it needs one.
pub fn refuses_a_robot_that_it_cannot_move<S: Subject>() {
    let mut device = good::<S>();
    device.robot = match device.robot {
        Some(_) => None,
        None => some_robot().robot,
    };
    let error = refusal::<S>(&device, "another robot");
    let DriverError::Robot { cause, .. } = &error else {
        panic!("the robot is wrong, refused is {error}");
    };
    assert!(!cause.is_empty());
}

/// Returns the arm of the demo cell, with the times that an arm has by default: those of the demo are generous.
pub fn some_robot() -> DeviceConfig {
    let path =
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/cells/demo.yaml");
    let cell = CellConfig::load_offline(&path).expect("the demo's configuration");
    let (_, device) = cell.device("lwr").expect("the demo has an lwr");
    let settings = json!({"listen": SocketAddr::from(([127, 0, 0, 1], 0)).to_string()});
    DeviceConfig {
        settings,
        delay_ns: DELAY_NS,
        command_timeout_ns: COMMAND_TIMEOUT_NS,
        ..device.clone()
    }
}
