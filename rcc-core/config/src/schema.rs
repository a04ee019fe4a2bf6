//! JSON Schemas of the files of cells and robots, for completion and documentation in editors. They accept what the
//! readers accept, and refuse unknown and missing keys; ranges and units are checked by the readers only. Never
//! real-time.

use serde_json::{Map, Value, json};

use crate::device::{CHANNEL_KINDS, kind_name};

/// The JSON Schema dialect.
const DIALECT: &str = "https://json-schema.org/draft/2020-12/schema";
/// Pattern of a number with a unit, or of an angle such as `deg(30)`.
const QUANTITY: &str =
    r"^\s*[+-]?\s*((deg|rad)\(.+\)|([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?\s*[^0-9\s.,].*)$";
const CELL_NAME: &str = "^[a-z0-9][a-z0-9_-]{0,31}$";
const DEVICE_NAME: &str = "^[a-z][a-z0-9_-]{0,31}$";
const ID: &str = "^[a-z][a-z0-9_]{0,31}$";
const JOINT_NAME: &str = "^[A-Za-z][A-Za-z0-9_]{0,31}$";

/// Returns the schema of the file of a cell.
#[must_use]
pub fn cell() -> Value {
    let properties = json!({
        "cell": named("Name of the cell.", CELL_NAME),
        "period": quantity("Period of the executor: `1 ms`."),
        "stale_after": quantity("Age beyond which a measurement is stale: `50 ms`."),
        "clock": clock(),
        "executor": executor(),
        "recorder": recorder(),
        "supervision": supervision(),
        "access": access(),
        "link": link_of_cell(),
        "ports": by_name(ID, "Network ports by name; `${name}` in texts is replaced by the number.", json!({
            "anyOf": [{"type": "integer", "minimum": 1, "maximum": 65535}, {"enum": ["auto udp", "auto tcp"]}],
        })),
        "simulators": by_name(DEVICE_NAME, "Programs that simulate devices; none in production.", simulator()),
        "devices": by_name(DEVICE_NAME, "Devices by name, at most 16.", device()),
    });
    file("A cell of RCC", &["cell", "period", "devices"], properties)
}

/// Returns the schema of the file of a robot.
#[must_use]
pub fn robot() -> Value {
    let joint = object(
        "Limits of a joint.",
        &["position", "velocity", "acceleration", "jerk"],
        json!({
            "position": pair("Least and greatest position: `[deg(-170), deg(170)]`."),
            "velocity": quantity("Greatest speed: `110 deg/s`."),
            "acceleration": quantity("Greatest acceleration: `1200 deg/s^2`."),
            "jerk": quantity("Greatest jerk: `12000 deg/s^3`."),
        }),
    );
    let properties = json!({
        "robot": text("Name for people."),
        "kinematics": kinematics(),
        "joints": by_name(JOINT_NAME, "Joints from the base to the flange.", joint),
        "impedance": impedance(),
        "dynamics": by_name(JOINT_NAME, "Mass and friction of each joint's link, for simulators.", link()),
    });
    file(
        "A robot of RCC",
        &["robot", "kinematics", "joints"],
        properties,
    )
}

fn file(title: &str, required: &[&str], properties: Value) -> Value {
    let mut schema = Map::new();
    schema.insert("$schema".to_owned(), json!(DIALECT));
    schema.insert("title".to_owned(), json!(title));
    if let Value::Object(object) = object(title, required, properties) {
        schema.extend(object);
    }
    Value::Object(schema)
}

/// Returns an object schema without additional keys. An absent key may also be written with the value null.
fn object(description: &str, required: &[&str], mut properties: Value) -> Value {
    for (key, schema) in properties.as_object_mut().into_iter().flatten() {
        if !required.contains(&key.as_str()) {
            *schema = json!({"anyOf": [schema.take(), {"type": "null"}]});
        }
    }
    json!({
        "description": description,
        "type": "object",
        "required": required,
        "properties": properties,
        "additionalProperties": false,
    })
}

fn by_name(pattern: &str, description: &str, schema: Value) -> Value {
    json!({
        "description": description,
        "type": "object",
        "propertyNames": {"pattern": pattern},
        "additionalProperties": schema,
    })
}

fn text(description: &str) -> Value {
    json!({"description": description, "type": "string"})
}

fn named(description: &str, pattern: &str) -> Value {
    json!({"description": description, "type": "string", "pattern": pattern})
}

fn integer(description: &str, least: u32, most: u32) -> Value {
    json!({"description": description, "type": "integer", "minimum": least, "maximum": most})
}

/// Returns the schema of a number with a unit; a bare number is accepted, because some quantities have the unit 1.
fn quantity(description: &str) -> Value {
    json!({
        "description": description,
        "anyOf": [{"type": "string", "pattern": QUANTITY}, {"type": "number"}],
    })
}

fn list(description: &str, count: u32, items: &Value) -> Value {
    json!({"description": description, "type": "array", "minItems": count, "maxItems": count, "items": items})
}

fn pair(description: &str) -> Value {
    list(description, 2, &quantity("Bound."))
}

fn clock() -> Value {
    object(
        "The device that the executor's clock follows.",
        &["device"],
        json!({
            "device": text("Name of the device."),
            "offset": quantity("Time from its packet to the cycle: `200 us`."),
        }),
    )
}

fn executor() -> Value {
    object(
        "Real-time thread of the executor.",
        &[],
        json!({
            "priority": integer("SCHED_FIFO priority.", 1, 99),
            "core": integer("CPU core that the thread is bound to.", 0, 4095),
            "late_in_a_row_max": integer("Late cycles in a row after which the most expensive net ends; 0: never.", 0, u32::MAX),
            "budget": quantity("Share of a cycle that all nets may use together: `0.5`."),
            "rt": {"description": "`required`: the executor ends without real time.", "enum": ["best-effort", "required"]},
        }),
    )
}

fn recorder() -> Value {
    object(
        "Flight recorder.",
        &[],
        json!({
            "seconds": quantity("Longest time that is kept before an incident: 10."),
            "memory": {"description": "Locked memory: `64 MB`; `0 MB`: nothing is recorded.", "anyOf": [{"type": "string", "pattern": "^[0-9]+ *[MG]B$"}, {"const": 0}]},
            "files": integer("Most incident files; the oldest is removed.", 1, 1000),
            "folder": text("Folder of event log, incident files and logs instead of the state folder, relative to this file."),
            "keep": {"description": "Most that is kept of all of them, at least `memory`: `200 MB`, `2 GB`. The oldest go first.", "type": "string", "pattern": "^[0-9]+ *[MG]B$"},
        }),
    )
}

fn supervision() -> Value {
    object(
        "What happens to processes that die or hang.",
        &[],
        json!({
            "restarts": integer("A process that dies is restarted this many times …", 0, 1000),
            "within": quantity("… within this time: `30 s`."),
            "stop_timeout": quantity("Time that a process may take to end: `5 s`."),
            "watchdog": quantity("Time without progress after which a process is restarted: `2 s`."),
        }),
    )
}

fn access() -> Value {
    let tcp = object(
        "Access over TCP.",
        &["listen", "token_file"],
        json!({
            "listen": text("Numeric address and port: `127.0.0.1:7425`."),
            "token_file": text("File that contains the token, relative to this file."),
            "allow_remote": {"description": "True for an address that other machines can reach.", "type": "boolean"},
        }),
    );
    object(
        "Access for others than the user that runs the cell.",
        &[],
        json!({"group": text("Group whose members may use the Unix socket."), "tcp": tcp}),
    )
}

fn link_of_cell() -> Value {
    let texts = |description: &str| json!({"description": description, "type": "array", "items": {"type": "string"}});
    object(
        "Link to other cells, carried by `rcc-link`.",
        &["site"],
        json!({
            "site": named("Name of the site, the second part of every key.", CELL_NAME),
            "listen": texts("Endpoints at which others reach this cell: `tcp/192.168.0.1:7447`."),
            "connect": texts("Endpoints of other cells."),
            "router": texts("Endpoints of routers, of which the first that answers is used; then neither `listen` nor `connect`."),
            "publish": texts("Patterns of the topics that leave this cell, with * and ?; all by default."),
            "rate": quantity("Greatest rate of each topic: `100 Hz`."),
            "start": {
                "description": "For each other cell, SITE/CELL, the nets that it may start; none by default.",
                "type": "object",
                "additionalProperties": texts("Names of nets."),
            },
            "deploy": texts("Peers, SITE/NAME, that may load nets and unload those again; needs `tls`; none by default."),
            "configure": texts("Peers, SITE/NAME, that may replace the file of this configuration; needs `tls`; none by default."),
            "tls": object(
                "Files (PEM, absolute paths) for mutual TLS; then all endpoints are `tls/HOST:PORT`.",
                &crate::link::TLS_KEYS,
                json!({
                    "authority": text("Certificate of the authority that signed those of all cells."),
                    "certificate": text("Certificate of this cell; its common name is SITE/CELL."),
                    "key": text("Its private key."),
                }),
            ),
        }),
    )
}

fn simulator() -> Value {
    object(
        "A program that simulates a device.",
        &["program"],
        json!({
            "program": text("A program next to those of RCC, or a path."),
            "arguments": {"description": "Its arguments.", "type": "array", "items": {"type": ["string", "integer"]}},
            "device": text("The simulated device."),
        }),
    )
}

fn device() -> Value {
    let base = object(
        "Pose of the arm's base in the world frame.",
        &["xyz"],
        json!({
            "xyz": list("Position: `[0 m, 0.9 m, 0 m]`.", 3, &quantity("Length.")),
            "rpy": list("Roll, pitch and yaw: `[0 deg, 0 deg, 180 deg]`.", 3, &quantity("Angle.")),
        }),
    );
    let bounds = object(
        "Bounds of each axis; an axis that is left out has none.",
        &[],
        json!({"x": pair("Along x."), "y": pair("Along y."), "z": pair("Along z.")}),
    );
    let workspace = object(
        "Where the arm may be, in its base.",
        &[],
        json!({
            "box": bounds,
            "point": list("Point on the flange that stays inside.", 3, &quantity("Length.")),
            "singularity": quantity("Smallest distance to a singular position, 0 to 1."),
        }),
    );
    object(
        "A device.",
        &["driver"],
        json!({
            "driver": {"anyOf": [driver_program(), named("Driver: `fri-lwr`, `modbus`, `ideal-arm`, …", DEVICE_NAME)]},
            "robot": text("File of the robot, relative to this file."),
            "settings": {"description": "Settings of the driver; docs/drivers.md lists them.", "type": "object"},
            "channels": by_name(ID, "Channels by name.", channel()),
            "first_tolerance": quantity("Largest distance of the first set-point from the hold position: `deg(0.1)`."),
            "base": base,
            "workspace": workspace,
            "command_timeout": quantity("Age of a command after which the driver stops the arm: `50 ms`."),
            "delay": quantity("Time that set-points wait in the driver: `10 ms`."),
        }),
    )
}

fn driver_program() -> Value {
    object(
        "A program that drives the device.",
        &["program"],
        json!({
            "program": text("With a `/` a path relative to this file, otherwise in the folder of RCC's programs."),
            "arguments": {"description": "Its first arguments.", "type": "array", "items": {"type": ["string", "integer"]}},
            "needs": {
                "description": "What its unit permits: `raw network`, `/dev/ttyUSB0`.",
                "type": "array",
                "items": {"type": "string", "pattern": "^(raw network|/dev/[A-Za-z0-9/_.:-]+)$"},
            },
        }),
    )
}

fn channel() -> Value {
    let kinds = CHANNEL_KINDS.map(kind_name);
    let safe = object(
        "The value that the output takes.",
        &["safe"],
        json!({"safe": {"type": ["boolean", "number", "string"]}}),
    );
    object(
        "A channel.",
        &["kind", "address"],
        json!({
            "kind": {"description": "Kind of channel.", "enum": kinds},
            "address": {"description": "Address as the driver writes it: 3, `coil 3`.", "type": ["integer", "string"]},
            "unit": {"description": "SI unit of an analog value: `m/s`; 1 for a plain number.", "anyOf": [{"type": "string"}, {"const": 1}]},
            "scale": quantity("Value of one raw step: `1 mm/s`."),
            "offset": quantity("Value of the raw number 0."),
            "range": pair("Least and greatest value."),
            "on_release": {"description": "What an output does when no net commands it.", "anyOf": [{"const": "hold"}, safe]},
        }),
    )
}

fn kinematics() -> Value {
    let lengths = |names: &[&str]| -> Map<String, Value> {
        let length = |name: &&str| ((*name).to_owned(), quantity("Length: `0.4 m`."));
        names.iter().map(length).collect()
    };
    let signs = |count| list("Direction of each joint.", count, &json!({"enum": [1, -1]}));
    let mut srs = lengths(&["shoulder_height", "upper_arm", "forearm", "wrist_to_flange"]);
    srs.insert("type".to_owned(), json!({"const": "srs"}));
    srs.insert("signs".to_owned(), signs(7));
    let mut six = lengths(&[
        "shoulder_height",
        "shoulder_offset",
        "lateral_offset",
        "upper_arm",
        "elbow_offset",
        "forearm",
        "wrist_to_flange",
    ]);
    six.insert("type".to_owned(), json!({"const": "ortho-parallel"}));
    six.insert("signs".to_owned(), signs(6));
    let zeros = list(
        "Joint positions of the upright arm.",
        6,
        &quantity("Angle: `deg(90)`."),
    );
    six.insert("zeros".to_owned(), zeros);
    let required = |properties: &Map<String, Value>| -> Value {
        json!({
            "type": "object",
            "required": properties.keys().collect::<Vec<_>>(),
            "properties": properties,
            "additionalProperties": false,
        })
    };
    json!({
        "description": "`srs`: spherical shoulder, hinge and spherical wrist, seven joints; `ortho-parallel`: six joints; `serial`: one to seven axes in any arrangement; `linear`: one to six linear axes.",
        "oneOf": [required(&srs), required(&six), serial(), linear()],
    })
}

fn axis() -> Value {
    object(
        "The axis of a joint in the base frame, with all joints at 0.",
        &["point", "direction"],
        json!({
            "point": three("A point on the axis.", "Coordinate: `0.1625 m`."),
            "direction": three("Direction of the axis: `[0, 0, 1]`.", "Coordinate without unit."),
        }),
    )
}

fn three(description: &str, item: &str) -> Value {
    list(description, 3, &quantity(item))
}

fn flange() -> Value {
    object(
        "Pose of the flange in the base frame, with all joints at 0.",
        &["xyz"],
        json!({
            "xyz": three("Position.", "Coordinate: `0.1 m`."),
            "rpy": three("Roll, pitch and yaw.", "Angle: `90 deg`."),
        }),
    )
}

fn linear() -> Value {
    object(
        "A machine of linear axes; limits of its joints are in m.",
        &["type", "axes", "flange"],
        json!({
            "type": {"const": "linear"},
            "axes": {"description": "Axes from the base to the flange; a joint moves along its direction.", "type": "array", "minItems": 1, "maxItems": 6, "items": axis()},
            "flange": flange(),
        }),
    )
}

fn serial() -> Value {
    object(
        "An arm by its joints; its inverse kinematics is numeric.",
        &["type", "axes", "flange"],
        json!({
            "type": {"const": "serial"},
            "axes": {"description": "Axes from the base to the flange.", "type": "array", "minItems": 1, "maxItems": 7, "items": axis()},
            "flange": flange(),
            "redundant_joint": integer("With seven axes: number of the joint that keeps its position on lines and arcs.", 1, 7),
        }),
    )
}

fn impedance() -> Value {
    object(
        "Limits of impedance set-points.",
        &[
            "translation",
            "rotation",
            "joint",
            "damping",
            "force",
            "torque",
            "joint_torque",
        ],
        json!({
            "translation": pair("Stiffness along an axis: `[0 N/m, 5000 N/m]`."),
            "rotation": pair("Stiffness about an axis: `[0 N·m/rad, 300 N·m/rad]`."),
            "joint": pair("Stiffness of a joint."),
            "damping": pair("Damping ratio: `[0, 1]`."),
            "rate": quantity("Change per second, in parts of the greatest stiffness: `2 Hz`."),
            "force": quantity("Greatest additional force: `50 N`."),
            "torque": quantity("Greatest additional torque: `10 N·m`."),
            "joint_torque": quantity("Greatest additional torque of a joint."),
        }),
    )
}

fn link() -> Value {
    object(
        "Mass of the body that moves with a joint, and friction of the joint.",
        &["mass", "centre", "friction", "damping"],
        json!({
            "mass": quantity("Mass: `2 kg`."),
            "centre": list("Centre of mass while all joints are 0, base frame.", 3, &quantity("Length.")),
            "friction": quantity("Dry friction: `0.4 N·m`."),
            "damping": quantity("Viscous friction: `0.4 N·m·s/rad`."),
        }),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the keys of an object schema, sorted.
    fn keys<'s>(schema: &'s Value, path: &[&str]) -> Vec<&'s str> {
        let inner = path.iter().fold(schema, |schema, key| {
            let property = &schema["properties"][*key];
            let property = match property["anyOf"].as_array() {
                Some(kinds) => &kinds[0],
                None => property,
            };
            match property.get("additionalProperties") {
                Some(of_each) if of_each.is_object() => of_each,
                _ => property,
            }
        });
        let properties = inner["properties"].as_object().expect("an object");
        let keys: Vec<&str> = properties.keys().map(String::as_str).collect();
        sorted(&keys)
    }

    fn sorted<'k>(keys: &[&'k str]) -> Vec<&'k str> {
        let mut keys = keys.to_vec();
        keys.sort_unstable();
        keys
    }

    #[test]
    fn the_schemas_have_the_keys_that_the_readers_know() {
        use crate::cell::keys as of_cell;
        let schema = cell();
        for (path, known) in [
            (&[][..], &of_cell::CELL[..]),
            (&["executor"], &of_cell::EXECUTOR),
            (&["supervision"], &of_cell::SUPERVISION),
            (&["simulators"], &of_cell::SIMULATOR),
            (&["devices"], &of_cell::DEVICE),
            (&["devices", "channels"], &crate::device::CHANNEL_KEYS),
            (&["devices", "driver"], &of_cell::DRIVER),
            (&["recorder"], &crate::recorder::KEYS),
            (&["access"], &crate::access::KEYS),
            (&["link"], &crate::link::KEYS),
            (&["link", "tls"], &crate::link::TLS_KEYS),
        ] {
            assert_eq!(keys(&schema, path), sorted(known), "{path:?}");
        }
        let schema = robot();
        for (path, known) in [
            (&[][..], &crate::robot::keys::ROBOT[..]),
            (&["joints"], &crate::robot::keys::JOINT),
            (&["impedance"], &crate::robot::keys::IMPEDANCE),
            (&["dynamics"], &crate::robot::keys::LINK),
        ] {
            assert_eq!(keys(&schema, path), sorted(known), "{path:?}");
        }
    }
}
