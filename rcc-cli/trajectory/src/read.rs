//! Reads the message: YAML as `ros2 topic echo` prints it, or JSON. Run by whoever imports.

use rcc_config::codes::{self, Code};
use rcc_config::diagnostic::{Diagnostic, Span, closest};
use rcc_config::yaml::{self, Node, Value};

/// Largest number of points: as many as `Lookup` has, less one for a start that is given besides.
const POINTS_MAX: usize = 1023;
/// Longest trajectory, s: a day.
const TIME_MAX_S: f64 = 86_400.0;
/// Keys of messages and goals around a `JointTrajectory`.
const WRAPPERS: [&str; 3] = ["goal", "trajectory", "joint_trajectory"];
/// Keys of a `JointTrajectory`.
const KEYS: [&str; 3] = ["header", "joint_names", "points"];
/// Keys of a point.
const POINT_KEYS: [&str; 5] = [
    "positions",
    "velocities",
    "accelerations",
    "effort",
    "time_from_start",
];

/// A trajectory, as it was given.
#[derive(Clone, Debug, PartialEq)]
pub struct JointTrajectory {
    /// Names of the joints, each once.
    pub joints: Vec<String>,
    /// At least one point; times increase.
    pub points: Vec<Point>,
    /// Keys with values that a net does not use, such as `effort` and `goal_tolerance`.
    pub unused: Vec<String>,
}

/// A point: one number for each joint, in the order of their names.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Time from the start, s.
    pub time_s: f64,
    /// Positions, rad.
    pub positions: Vec<f64>,
    /// Velocities, rad/s.
    pub velocities: Option<Vec<f64>>,
    /// Accelerations, rad/s².
    pub accelerations: Option<Vec<f64>>,
}

/// Reads a text with one trajectory, alone or in a goal or message around it.
///
/// # Errors
/// Returns all faults with their places.
pub fn read(text: &str) -> Result<JointTrajectory, Vec<Diagnostic>> {
    let text = one_message(text).map_err(|fault| vec![*fault])?;
    let root = yaml::parse(&text)?;
    let mut reader = Reader {
        faults: Vec::new(),
        unused: Vec::new(),
    };
    let trajectory = reader.trajectory(&root);
    match trajectory {
        Some((joints, points)) if reader.faults.is_empty() => Ok(JointTrajectory {
            joints,
            points,
            unused: reader.unused,
        }),
        _ => Err(reader.faults),
    }
}

/// Blanks the `---` that `ros2 topic echo` writes after each message; positions stay those of the text.
fn one_message(text: &str) -> Result<String, Box<Diagnostic>> {
    let mut blanked = String::with_capacity(text.len());
    let (mut messages, mut is_inside) = (0, false);
    for line in text.split_inclusive('\n') {
        if line.trim_end() == "---" {
            is_inside = false;
            blanked.push_str("   ");
            blanked.push_str(&line[3..]);
            continue;
        }
        let has_content = !line.trim().is_empty() && !line.trim_start().starts_with('#');
        if has_content && !is_inside {
            (messages, is_inside) = (messages + 1, true);
        }
        if messages > 1 {
            let start = blanked.len();
            let place = Span::new(start, start + line.trim_end().len());
            let fault = error(codes::TOO_MANY, place, "a second message begins here");
            return Err(Box::new(fault.help(
                "keep one trajectory: `ros2 topic echo --once --full-length TOPIC`",
            )));
        }
        blanked.push_str(line);
    }
    Ok(blanked)
}

fn error(code: Code, place: Span, message: impl Into<String>) -> Diagnostic {
    Diagnostic::error(code.code, place, message)
}

struct Reader {
    faults: Vec<Diagnostic>,
    unused: Vec<String>,
}

impl Reader {
    fn trajectory(&mut self, root: &Node) -> Option<(Vec<String>, Vec<Point>)> {
        let mut node = root;
        while let Some(inner) = WRAPPERS.iter().find_map(|key| node.get(key)) {
            let others = node.map().unwrap_or(&[]).iter();
            let others = others.filter(|entry| !WRAPPERS.contains(&entry.key.name.as_str()));
            for other in others.filter(|entry| has_values(&entry.value)) {
                self.unused.push(other.key.name.to_string());
            }
            // A DisplayTrajectory of MoveIt has a list of them.
            node = match inner.list() {
                Some([only]) => only,
                _ => inner,
            };
        }
        self.keys(node, "a JointTrajectory", &KEYS)?;
        if node.get("header").is_some_and(has_start_time) {
            self.unused.push("header.stamp".to_owned());
        }
        let joints = self.require(node, "joint_names", "a JointTrajectory");
        let points = self.require(node, "points", "a JointTrajectory");
        let joints = self.joint_names(joints?)?;
        let points = self.points(points?, joints.len())?;
        Some((joints, points))
    }

    /// Reports keys that the message does not have; `None` if it is no mapping.
    fn keys(&mut self, node: &Node, what: &str, keys: &[&str]) -> Option<()> {
        if node.map().is_none() {
            self.wrong_type(node, what, "a mapping (`key: value`)");
            return None;
        }
        for key in node.unknown_keys(keys) {
            let help = match closest(&key.name, keys.iter().copied()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("its keys are: {}", keys.join(", ")),
            };
            let message = format!("{what} has no key `{}`", key.name);
            let fault = error(codes::UNKNOWN_KEY, key.span, message).help(help);
            self.faults.push(fault);
        }
        Some(())
    }

    fn require<'n>(&mut self, node: &'n Node, key: &str, what: &str) -> Option<&'n Node> {
        let found = node.get(key);
        if found.is_none() {
            let message = format!("{what} needs a key `{key}`");
            let fault = error(codes::MISSING_KEY, node.span, message);
            self.faults
                .push(fault.help("the message is trajectory_msgs/JointTrajectory"));
        }
        found
    }

    fn wrong_type(&mut self, node: &Node, what: &str, expected: &str) {
        let message = format!("{what} must be {expected}, found {}", node.kind());
        let fault = error(codes::WRONG_SHAPE, node.span, message);
        let is_cut = node.text().is_some_and(|text| text.starts_with("..."));
        self.faults.push(match is_cut {
            true => fault.help("the text is cut: `ros2 topic echo --full-length`"),
            false => fault,
        });
    }

    fn joint_names(&mut self, node: &Node) -> Option<Vec<String>> {
        let Some(list) = node.list().filter(|list| !list.is_empty()) else {
            self.wrong_type(node, "`joint_names`", "a list of names");
            return None;
        };
        let mut names: Vec<String> = Vec::new();
        for element in list {
            match element.text() {
                None => self.wrong_type(element, "a joint's name", "text"),
                Some(name) if names.iter().any(|other| other == name) => {
                    let message = format!("joint `{name}` occurs twice");
                    self.faults
                        .push(error(codes::BAD_NAME, element.span, message));
                }
                Some(name) => names.push(name.to_owned()),
            }
        }
        (names.len() == list.len()).then_some(names)
    }

    fn points(&mut self, node: &Node, joints: usize) -> Option<Vec<Point>> {
        let Some(list) = node.list().filter(|list| !list.is_empty()) else {
            self.wrong_type(node, "`points`", "a list of points");
            return None;
        };
        if let Some(first) = list.get(POINTS_MAX) {
            let message = format!("{} points, the maximum is {POINTS_MAX}", list.len());
            let fault = error(codes::TOO_MANY, first.span, message);
            self.faults
                .push(fault.help("resample the trajectory with longer times between its points"));
            return None;
        }
        let mut points: Vec<Point> = Vec::new();
        for (number, element) in list.iter().enumerate() {
            let Some(point) = self.point(element, joints) else {
                continue;
            };
            if let Some(last) = points.last() {
                self.follows(last, &point, element.span, number);
            }
            points.push(point);
        }
        (points.len() == list.len()).then_some(points)
    }

    /// Reports a point that does not come after the one before it, or that has other derivatives.
    fn follows(&mut self, last: &Point, point: &Point, place: Span, number: usize) {
        if point.time_s <= last.time_s {
            let message = format!(
                "point {number} is at {} s, not after the point before it ({} s)",
                point.time_s, last.time_s
            );
            self.faults.push(error(codes::REVERSED, place, message));
        }
        for (key, here, there) in [
            ("velocities", &point.velocities, &last.velocities),
            ("accelerations", &point.accelerations, &last.accelerations),
        ] {
            if here.is_some() != there.is_some() {
                let message = format!(
                    "`{key}` of point {number} and of the one before it differ: one has none"
                );
                let help = "give them for all points or for none";
                self.faults
                    .push(error(codes::MISSING_KEY, place, message).help(help));
            }
        }
    }

    fn point(&mut self, node: &Node, joints: usize) -> Option<Point> {
        self.keys(node, "a point", &POINT_KEYS)?;
        let positions = self.require(node, "positions", "a point");
        let time = self.require(node, "time_from_start", "a point");
        let positions = self.numbers(positions?, "positions", joints);
        let derivative =
            |reader: &mut Reader, key| match node.get(key).filter(|node| has_values(node)) {
                None => Some(None),
                Some(node) => reader.numbers(node, key, joints).map(Some),
            };
        let velocities = derivative(self, "velocities");
        let accelerations = derivative(self, "accelerations");
        if node.get("effort").is_some_and(has_values)
            && !self.unused.iter().any(|key| key == "effort")
        {
            self.unused.push("effort".to_owned());
        }
        let time_s = self.time(time?);
        let (velocities, accelerations) = (velocities?, accelerations?);
        if velocities.is_none() && accelerations.is_some() {
            let message = "a point has accelerations, but no velocities";
            let fault = error(codes::MISSING_KEY, node.span, message);
            self.faults
                .push(fault.help("give velocities too, or no accelerations"));
            return None;
        }
        Some(Point {
            time_s: time_s?,
            positions: positions?,
            velocities,
            accelerations,
        })
    }

    /// Reads one number for each joint.
    fn numbers(&mut self, node: &Node, key: &str, joints: usize) -> Option<Vec<f64>> {
        let Some(list) = node.list() else {
            self.wrong_type(node, &format!("`{key}`"), "a list of numbers");
            return None;
        };
        if let Some(wrong) = list.iter().find(|element| number(element).is_none()) {
            self.wrong_type(wrong, &format!("an element of `{key}`"), "a finite number");
            return None;
        }
        if list.len() != joints {
            let message = format!("`{key}` has {} numbers for {joints} joints", list.len());
            self.faults
                .push(error(codes::WRONG_SHAPE, node.span, message));
            return None;
        }
        Some(list.iter().filter_map(number).collect())
    }

    /// Reads `{sec, nanosec}` (ROS 2), `{secs, nsecs}` (ROS 1) or a number of seconds.
    fn time(&mut self, node: &Node) -> Option<f64> {
        let part = |keys: [&str; 2]| keys.iter().find_map(|key| node.get(key)).map(number);
        let seconds = match node.map() {
            None => number(node),
            Some(_) => {
                let unknown = node
                    .unknown_keys(&["sec", "nanosec", "secs", "nsecs"])
                    .next();
                let whole = part(["sec", "secs"]).unwrap_or(Some(0.0));
                let rest = part(["nanosec", "nsecs"]).unwrap_or(Some(0.0));
                let sum = whole.zip(rest).map(|(whole, rest)| whole + rest * 1e-9);
                sum.filter(|_| unknown.is_none())
            }
        };
        let Some(seconds) = seconds else {
            self.wrong_type(
                node,
                "`time_from_start`",
                "{sec: …, nanosec: …}, or a number of seconds",
            );
            return None;
        };
        if !(0.0..=TIME_MAX_S).contains(&seconds) {
            let message =
                format!("`time_from_start` is {seconds} s, but must be from 0 s to {TIME_MAX_S} s");
            self.faults
                .push(error(codes::OUT_OF_RANGE, node.span, message));
            return None;
        }
        Some(seconds)
    }
}

fn number(node: &Node) -> Option<f64> {
    match node.value {
        Value::Int(value) => Some(value as f64),
        Value::Real(value) => Some(value),
        _ => None,
    }
}

/// Returns true unless a value is null, or an empty list, text or mapping.
fn has_values(node: &Node) -> bool {
    match &node.value {
        Value::Null => false,
        Value::List(list) => !list.is_empty(),
        Value::Map(entries) => entries.iter().any(|entry| has_values(&entry.value)),
        Value::Text(text) => !text.is_empty(),
        Value::Int(value) => *value != 0,
        Value::Real(value) => *value != 0.0,
        Value::Bool(_) => true,
    }
}

/// Returns true if the header asks for a start at a time of a clock.
fn has_start_time(header: &Node) -> bool {
    header.get("stamp").is_some_and(has_values)
}

#[cfg(test)]
mod tests;
