//! The ROS 2 message types that viewers know, as `ros2msg` schemas: fields in the order of the standard definitions. Pure.

/// Line between the text of a type and that of a type that it uses.
const SEPARATOR: &str =
    "================================================================================";

/// A message type and its schema.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MessageSchema {
    /// Full name, such as `sensor_msgs/msg/JointState`.
    pub name: String,
    /// Its fields, followed by the types that they use.
    pub text: String,
}

/// Types that others use: name without `/msg/`, and fields.
const TYPES: &[(&str, &str)] = &[
    ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"),
    (
        "std_msgs/Header",
        "builtin_interfaces/Time stamp\nstring frame_id\n",
    ),
    ("std_msgs/String", "string data\n"),
    (
        "sensor_msgs/JointState",
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    ),
    ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    (
        "geometry_msgs/Quaternion",
        "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    ),
    (
        "geometry_msgs/Transform",
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    ),
    (
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    ),
    (
        "tf2_msgs/TFMessage",
        "geometry_msgs/TransformStamped[] transforms\n",
    ),
    (
        "geometry_msgs/Pose",
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    ),
    (
        "geometry_msgs/PoseStamped",
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    ),
    (
        "geometry_msgs/Wrench",
        "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
    ),
    (
        "geometry_msgs/WrenchStamped",
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n",
    ),
    ("diagnostic_msgs/KeyValue", "string key\nstring value\n"),
    (
        "diagnostic_msgs/DiagnosticStatus",
        "byte level\nstring name\nstring message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values\n",
    ),
    (
        "diagnostic_msgs/DiagnosticArray",
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
    ),
    (
        "rcl_interfaces/Log",
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n",
    ),
];

fn fields_of(name: &str) -> &'static str {
    let row = TYPES.iter().find(|(known, _)| *known == name);
    row.map_or("", |(_, fields)| fields)
}

/// Adds the types that `fields` use and that `found` does not have yet, with the types that those use.
fn add_used(fields: &str, found: &mut Vec<&'static str>) {
    for line in fields.lines() {
        let used = line.split([' ', '[']).next().unwrap_or_default();
        let Some((name, _)) = TYPES.iter().find(|(known, _)| *known == used) else {
            continue;
        };
        if !found.contains(name) {
            found.push(name);
            add_used(fields_of(name), found);
        }
    }
}

/// Returns the schema of a type of the table, by its full name without `/msg/`: `sensor_msgs/JointState`.
#[must_use]
pub fn standard(name: &str) -> MessageSchema {
    let fields = fields_of(name);
    let mut used = Vec::new();
    add_used(fields, &mut used);
    let mut text = fields.to_owned();
    for other in used {
        text.push_str(&format!("{SEPARATOR}\nMSG: {other}\n{}", fields_of(other)));
    }
    MessageSchema {
        name: name.replacen('/', "/msg/", 1),
        text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_names_only_types_that_are_there() {
        for (name, fields) in TYPES {
            assert!(!fields.is_empty(), "{name}");
            for line in fields.lines() {
                let used = line.split([' ', '[']).next().expect("a type");
                let known = !used.contains('/') || TYPES.iter().any(|(name, _)| *name == used);
                assert!(known, "{name}: {used}");
            }
        }
    }

    #[test]
    fn a_schema_has_each_used_type_once_after_a_line_of_80_equals_signs() {
        let tf = standard("tf2_msgs/TFMessage");
        assert_eq!(tf.name, "tf2_msgs/msg/TFMessage");
        for used in [
            "geometry_msgs/TransformStamped",
            "std_msgs/Header",
            "builtin_interfaces/Time",
        ] {
            let head = format!("\n{}\nMSG: {used}\n", "=".repeat(80));
            assert_eq!(tf.text.matches(&head).count(), 1, "{used}");
        }
        assert!(!tf.text.contains("/msg/"));
    }
}
