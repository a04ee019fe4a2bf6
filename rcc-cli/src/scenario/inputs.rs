//! Resolves the name of an `--input`: a channel or reading of a device, the primitive that reads it, or an Input of
//! the net. Run by the main thread.

use rcc_api::codes;
use rcc_api::compile::findings;
use rcc_config::CellConfig;
use rcc_config::diagnostic::closest;
use rcc_language::devices::DeviceTable;
use rcc_language::input_values;
use rcc_language::names::Names;
use rcc_language::structure::{NetStructure, PrimitiveInfo, PrimitiveRole};

use crate::failure::Failure;
use crate::simulate::SimulationOptions;
use crate::simulate::script::{Assignment, ScriptError, ScriptStep};

/// Where names are looked up.
pub struct ScenarioInputs<'a> {
    /// The cell.
    pub config: &'a CellConfig,
    /// Name and text of the net, which is valid and has no libraries left.
    pub source: &'a (String, String),
    /// Names of its plan.
    pub names: &'a Names,
}

/// Failure for an invalid option.
pub fn wrong(error: &ScriptError) -> Failure {
    let help = "see `rcc-cli simulate --help`";
    Failure::new(codes::BAD_REQUEST, error.to_string(), help)
}

impl ScenarioInputs<'_> {
    /// Adds what an `--input` sets.
    ///
    /// # Errors
    /// Fails if it names nothing that can be set, or if the value does not suit.
    pub fn add(&self, text: &str, options: &mut SimulationOptions) -> Result<(), Failure> {
        let assignment = Assignment::parse(text).map_err(|error| wrong(&error))?;
        let name = assignment.name;
        let settable =
            |(_, input): (u32, &rcc_language::names::InputNames)| input.primitive == name;
        if self.names.settable().any(settable) {
            let line = format!("{name}: {}\n", assignment.value);
            let values = input_values::read(&line, "--input", self.names)
                .map_err(|faults| Failure::from_faults("invalid input", &faults))?;
            let at_ns = assignment.at_ns;
            options
                .values
                .extend(values.into_iter().map(|value| (at_ns, value)));
            return Ok(());
        }
        let device = name.split_once('.').map(|(device, _)| device);
        let is_device = device.is_some_and(|device| self.config.device(device).is_some());
        let step = match is_device {
            true => ScriptStep::input(&assignment, name, self.config),
            false => {
                let read = self.read_by(&assignment)?;
                ScriptStep::input(&assignment, &read, self.config)
            }
        };
        options.steps.push(step.map_err(|error| wrong(&error))?);
        Ok(())
    }

    /// Returns the `device.channel` or `device.reading` that an output of a primitive gives: `lwr.fz` for `ft.fz`.
    fn read_by(&self, assignment: &Assignment<'_>) -> Result<String, Failure> {
        let structure = self.structure()?;
        let sensors = || {
            let primitives = structure.primitives.iter();
            primitives.filter(|part| part.role == PrimitiveRole::Measures)
        };
        let (id, port) = assignment
            .name
            .rsplit_once('.')
            .unwrap_or((assignment.name, ""));
        if let Some(part) = sensors().find(|part| part.id == id) {
            return read_from(part, port).ok_or_else(|| {
                let message = format!(
                    "`{}`: `{}` of a {} cannot be set",
                    assignment.text, port, part.type_name
                );
                let help = "set what it is computed from: a channel, the wrench (fx to tz), or position, torque and external_torque of a joint";
                Failure::new(codes::BAD_REQUEST, message, help)
            });
        }
        Err(self.unknown(assignment, &structure, id))
    }

    fn unknown(&self, assignment: &Assignment<'_>, structure: &NetStructure, id: &str) -> Failure {
        let devices = self
            .config
            .devices
            .iter()
            .map(|device| device.name.as_str());
        let sensors = structure.primitives.iter();
        let sensors = sensors.filter(|part| part.role == PrimitiveRole::Measures);
        let sensors = sensors.map(|part| part.id.as_str());
        let inputs = self
            .names
            .settable()
            .map(|(_, input)| input.primitive.as_str());
        let known = devices.clone().chain(sensors.clone()).chain(inputs.clone());
        let list = |names: Vec<&str>| match names.is_empty() {
            true => "none".to_owned(),
            false => names.join(", "),
        };
        let message = format!(
            "`{}`: `{id}` is neither a device nor a primitive of the net that measures",
            assignment.text
        );
        let help = match closest(id, known) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!(
                "devices: {}; primitives that measure: {}; Inputs of the net: {}",
                list(devices.collect()),
                list(sensors.collect()),
                list(inputs.collect())
            ),
        };
        Failure::new(codes::BAD_REQUEST, message, help)
    }

    /// Compiles the net once more, for the devices of its primitives.
    fn structure(&self) -> Result<NetStructure, Failure> {
        let cell = DeviceTable::from(self.config);
        let (file, text) = self.source;
        let (_, structure) = rcc_directionet::compiler(&cell)
            .compile_with_structure(text, file)
            .map_err(|faults| {
                let what = format!("{file} is invalid");
                Failure::invalid(&what, findings(&faults), self.source.clone())
            })?;
        Ok(structure)
    }
}

/// Returns what an output of a measuring primitive reads, as `device.channel` or `device.reading`.
fn read_from(part: &PrimitiveInfo, port: &str) -> Option<String> {
    let device = part.device.as_deref()?;
    let channel = part.parameters.iter().find(|(name, _)| *name == "channel");
    match (part.type_name, channel) {
        ("DigitalInput" | "AnalogInput", Some((_, channel))) => {
            (port == "out").then(|| format!("{device}.{channel}"))
        }
        ("ForceTorque" | "JointState", _) => {
            let list = port.split('[').next().unwrap_or(port);
            (list != "hold").then(|| format!("{device}.{port}"))
        }
        _ => None,
    }
}
