//! `sim DEVICE [CHANNEL=VALUE …]`: sets inputs of a simulated device, as its sensors would, and shows all its channels.
//! Asks the control port of the device's simulator; the executor is not involved.

use rcc_api::codes;
use rcc_config::device::{is_output, kind_name};
use rcc_config::{CellConfig, ChannelConfig, DeviceConfig};
use rcc_core::primitive::ChannelKind;
use rcc_ipc::Cell;
use serde::Serialize;
use serde_json::Value;

use super::fault::{control_of, not_simulated};
use crate::cells;
use crate::context::{Context, cell_failure};
use crate::demo::simulator::SimulatorClient;
use crate::failure::Failure;
use crate::supervisor::running;
use crate::table;

mod wire;

/// Arguments of `sim`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Simulated device (io)
    device: String,
    /// Inputs to set: door_closed=true, temperature=293.15; numbers are in SI units
    #[arg(value_name = "CHANNEL=VALUE")]
    inputs: Vec<String>,
}

/// A channel of a simulated device.
#[derive(Debug, PartialEq, Serialize)]
struct SimulatedChannel {
    /// Name in the cell's configuration.
    name: String,
    /// `digital input` and others.
    kind: &'static str,
    /// Truth value, or a number in SI units; null if the simulator does not report it.
    value: Value,
    /// Unit; empty for a digital channel.
    unit: String,
}

/// Runs the verb.
///
/// # Errors
/// Fails if the device is not simulated, has no such input, or its simulator refuses; nothing is set if an assignment is
/// invalid.
pub fn run(context: &Context, arguments: Arguments) -> Result<(), Failure> {
    let name = context.cell_name();
    let cell = Cell::find(name).map_err(|error| cell_failure(&error))?;
    let cell = cell.ok_or_else(|| cells::not_found(name))?;
    let config = running::read(&cell)?;
    let target = &arguments.device;
    let Some((_, device)) = config.device(target) else {
        return Err(unknown(&config, target));
    };
    if device.channels.is_empty() {
        return Err(no_channels(&config, target));
    }
    let path = control_of(&cell, &config, target).ok_or_else(|| not_simulated(target))?;
    let commands: Result<Vec<Value>, Failure> = arguments
        .inputs
        .iter()
        .map(|pair| command(device, pair))
        .collect();
    let failed = |error: std::io::Error| {
        Failure::new(
            codes::PROCESS_FAILED,
            format!("the simulator of {target} at {}: {error}", path.display()),
            "`rcc-cli status` shows whether the cell's processes run",
        )
    };
    let commands = commands?;
    let mut simulator = SimulatorClient::connect(&path).map_err(failed)?;
    for command in &commands {
        simulator.ask(command).map_err(failed)?;
    }
    let state = simulator.ask(&wire::state()).map_err(failed)?;
    let channels: Vec<SimulatedChannel> = device
        .channels
        .iter()
        .map(|channel| SimulatedChannel {
            name: channel.name.clone(),
            kind: kind_name(channel.kind),
            value: wire::read(device, channel, &state),
            unit: match is_digital(channel) {
                true => String::new(),
                false => channel.unit.to_string(),
            },
        })
        .collect();
    context.print(&channels, |channels| human(channels));
    Ok(())
}

fn unknown(config: &CellConfig, target: &str) -> Failure {
    Failure::new(
        codes::BAD_REQUEST,
        format!("unknown device `{target}`"),
        format!("devices with channels: {}", with_channels(config)),
    )
}

fn no_channels(config: &CellConfig, target: &str) -> Failure {
    Failure::new(
        codes::BAD_REQUEST,
        format!("{target} has no channels: there is no input to set"),
        format!(
            "devices with channels: {}; `rcc-cli fault {target}` disturbs its connection",
            with_channels(config)
        ),
    )
}

fn with_channels(config: &CellConfig) -> String {
    let devices = config.devices.iter();
    let names: Vec<&str> = devices
        .filter(|device| !device.channels.is_empty())
        .map(|device| device.name.as_str())
        .collect();
    match names.is_empty() {
        true => "none in this cell".to_owned(),
        false => names.join(", "),
    }
}

fn is_digital(channel: &ChannelConfig) -> bool {
    matches!(
        channel.kind,
        ChannelKind::DigitalInput | ChannelKind::DigitalOutput
    )
}

fn human(channels: &[SimulatedChannel]) -> String {
    let mut rows = table::table(&["CHANNEL", "KIND", "VALUE"]);
    for channel in channels {
        let value = match &channel.value {
            Value::Null => "–".to_owned(),
            value if channel.unit.is_empty() => value.to_string(),
            value => format!("{value} {}", channel.unit),
        };
        rows.add_row([channel.name.as_str(), channel.kind, &value]);
    }
    table::text(&rows)
}

/// Converts `CHANNEL=VALUE` to a command of the device's simulator.
fn command(device: &DeviceConfig, pair: &str) -> Result<Value, Failure> {
    let refused = |message: String, help: String| Failure::new(codes::BAD_REQUEST, message, help);
    let usage = "write CHANNEL=VALUE, as in door_closed=true or temperature=293.15".to_owned();
    let Some((name, text)) = pair.split_once('=') else {
        return Err(refused(format!("`{pair}` is not an assignment"), usage));
    };
    let mut channels = device.channels.iter();
    let channel = channels.find(|channel| channel.name == name.trim());
    let inputs = || {
        let inputs = device.channels.iter().filter(|one| !is_output(one.kind));
        let names: Vec<&str> = inputs.map(|one| one.name.as_str()).collect();
        format!("inputs of {}: {}", device.name, names.join(", "))
    };
    let channel = match channel {
        None => {
            let message = format!("{} has no channel `{}`", device.name, name.trim());
            return Err(refused(message, inputs()));
        }
        Some(channel) if is_output(channel.kind) => {
            let message = format!("`{}` is an output: nets command it", channel.name);
            return Err(refused(message, inputs()));
        }
        Some(channel) => channel,
    };
    let value = number(text.trim(), is_digital(channel)).ok_or_else(|| {
        let wanted = match is_digital(channel) {
            true => "true or false".to_owned(),
            false => format!("a number in {}, without the unit", channel.unit),
        };
        let message = format!("`{}`: `{}` is not {wanted}", channel.name, text.trim());
        refused(message, usage.clone())
    })?;
    wire::write(device, channel, value)
        .map_err(|why| refused(format!("`{}`: {why}", channel.name), inputs()))
}

fn number(text: &str, digital: bool) -> Option<f64> {
    match text {
        "true" | "on" | "1" if digital => Some(1.0),
        "false" | "off" | "0" if digital => Some(0.0),
        _ if digital => None,
        _ => text.parse().ok().filter(|value: &f64| value.is_finite()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn demo() -> rcc_config::CellConfig {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/cells/demo.yaml");
        rcc_config::CellConfig::load_offline(std::path::Path::new(path)).expect("the demo's cell")
    }

    #[test]
    fn a_channel_of_a_terminal_is_set_and_read_by_its_position() {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../configs/cells/ethercat.yaml"
        );
        let config = rcc_config::CellConfig::load_offline(std::path::Path::new(path));
        let config = config.unwrap_or_else(|faults| panic!("{faults}"));
        let (_, device) = config.device("line").expect("there");
        let set = |terminal: u8, channel: u8, value: i32| json!({"set": {"terminal": terminal, "channel": channel, "value": value}});
        assert_eq!(command(device, "door_closed=true").unwrap(), set(1, 2, 1));
        assert_eq!(
            command(device, "pressure_measured=500000").unwrap(),
            set(3, 1, 16384)
        );
        assert!(command(device, "level=1").is_err(), "an entry of an object");
        let state = json!({"terminals": [{"inputs": [0, 1]}, {"outputs": [1, 0]}]});
        let read = |name: &str| {
            let channel = device.channels.iter().find(|channel| channel.name == name);
            wire::read(device, channel.expect("there"), &state)
        };
        assert_eq!(
            (read("door_closed"), read("lamp")),
            (json!(true), json!(true))
        );
        assert_eq!(
            (read("lamp_on"), read("level")),
            (json!(false), Value::Null)
        );
    }

    #[test]
    fn an_assignment_becomes_a_command_of_the_simulator() {
        let config = demo();
        for (device, pair, expected) in [
            (
                "io",
                "door_closed=true",
                json!({"set": {"discrete": {"address": 2, "value": true}}}),
            ),
            (
                "io",
                "temperature=293.1",
                json!({"set": {"input": {"address": 1, "value": 2931}}}),
            ),
            (
                "lwr",
                "contact=off",
                json!({"set_bool": {"number": 2, "value": false}}),
            ),
            (
                "lwr",
                "wire_speed_measured=0.25",
                json!({"set_real": {"number": 1, "value": 0.25}}),
            ),
        ] {
            let (_, device) = config.device(device).expect("there");
            assert_eq!(command(device, pair).expect(pair), expected, "{pair}");
        }
    }

    #[test]
    fn what_is_no_input_or_no_value_of_it_is_refused_with_the_inputs() {
        let config = demo();
        let (_, io) = config.device("io").expect("there");
        for (pair, part) in [
            ("lamp=true", "is an output"),
            ("dor_closed=true", "no channel `dor_closed`"),
            ("door_closed=2", "is not true or false"),
            ("temperature=warm", "is not a number in K"),
            ("temperature=1e9", "does not fit"),
            ("door_closed", "not an assignment"),
        ] {
            let failure = command(io, pair).expect_err(pair);
            assert!(failure.body.message.contains(part), "{pair}: {failure:?}");
        }
    }

    #[test]
    fn the_state_of_the_simulator_is_shown_by_channel() {
        let config = demo();
        let (_, io) = config.device("io").expect("there");
        let state = json!({
            "coils": [true], "discrete": [false, true], "holding": [250], "input": [0, 2931],
        });
        let value = |name: &str| {
            let channel = io.channels.iter().find(|one| one.name == name);
            wire::read(io, channel.expect("there"), &state)
        };
        assert_eq!(value("lamp"), json!(true));
        assert_eq!(value("belt_speed"), json!(0.25));
        assert_eq!(value("door_closed"), Value::Null);
        assert!((value("temperature").as_f64().expect("a number") - 293.1).abs() < 1e-9);
    }
}
