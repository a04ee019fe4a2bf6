//! `import trajectory FILE`: makes a net from a trajectory_msgs/JointTrajectory of ROS. Needs no cell and no ROS.

use std::path::{Path, PathBuf};

use rcc_api::codes::{self, exit};
use rcc_config::diagnostic::Faults;
use rcc_config::{CellConfig, JointConfig, RobotConfig};
use rcc_language::syntax::is_net_name;
use rcc_trajectory::{
    Brake, Excess, Interpolation, JointTrajectory, NetParts, PathError, Quantity, TrajectoryPath,
    excesses, read, stretch, text,
};

use crate::context::Context;
use crate::failure::Failure;
use crate::follow::read_text;
use crate::output::print_note;
use crate::result_file::ResultTarget;
use crate::scenario::{config_or_demo, load_config};

/// Arguments of `import trajectory`.
#[derive(clap::Args, Debug)]
pub(super) struct Arguments {
    /// Trajectory, alone or in a goal or message around it; - reads standard input
    file: String,
    /// Arm that moves [default: the only arm of the cell]
    #[arg(long)]
    device: Option<String>,
    /// Cell configuration that has the arm [default: the demo cell's]
    #[arg(long)]
    config: Option<PathBuf>,
    /// Map a joint of the trajectory to one of the robot; joints of equal names need none
    #[arg(long = "joint", value_name = "THEIRS=OURS")]
    joints: Vec<String>,
    /// Positions at 0 s, in the order of the trajectory's joints (rad), if its first point is later
    #[arg(
        long,
        value_name = "Q,Q,…",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    start: Option<Vec<f64>>,
    /// Multiply all times by this factor, 1 to 1000: 2 moves at half the speed
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = factor)]
    stretch: f64,
    /// Name of the net [default: made from the file's name]
    #[arg(long)]
    name: Option<String>,
    #[command(flatten)]
    target: ResultTarget,
}

fn factor(text: &str) -> Result<f64, String> {
    let factor = text
        .parse()
        .ok()
        .filter(|factor| (1.0..=1000.0).contains(factor));
    factor.ok_or_else(|| format!("invalid factor `{text}`: write a number from 1 to 1000"))
}

/// Runs the verb.
///
/// # Errors
/// Fails if the file is not a trajectory, if its joints are not those of the arm, if it does not begin and end at rest, or if
/// it exceeds a limit of the robot.
pub(super) fn run(context: &Context, arguments: &Arguments) -> Result<(), Failure> {
    let config = load_config(&config_or_demo(arguments.config.as_deref())?)?;
    let (device, robot) = arm(&config, arguments.device.as_deref())?;
    let (name, source) = read_text(&arguments.file)?;
    let given = read(&source).map_err(|faults| {
        Failure::from_faults(
            "invalid trajectory",
            &Faults::new(name.as_str(), source, faults),
        )
    })?;
    if robot.arm.is_linear() {
        let message = format!(
            "`{device}` has linear axes; a trajectory of ROS is imported for rotary joints only"
        );
        let help =
            "write a net with JointMotion or MotionSequence, or name another device by --device";
        return Err(Failure::new(codes::BAD_REQUEST, message, help));
    }
    let order = JointOrder::of(&given, device, robot, &arguments.joints).map_err(|wrong| *wrong)?;
    let start = arguments.start.as_deref();
    if let Some(start) = start.filter(|start| start.len() != given.joints.len()) {
        let error = PathError::StartWidth {
            have: start.len(),
            joints: given.joints.len(),
        };
        return Err(not_a_motion(&name, &error));
    }
    let start = start.map(|start| order.sorted(start));
    let trajectory = order.trajectory(&given);
    let path = TrajectoryPath::new(&trajectory, start.as_deref(), arguments.stretch)
        .map_err(|error| not_a_motion(&name, &error))?;
    let joints: Vec<&JointConfig> = robot.joints.iter().collect();
    let passed = excesses(&path, &joints, config.period_ns as f64 * 1e-9);
    if !passed.is_empty() {
        return Err(beyond_limits(&name, &passed, robot, arguments.stretch));
    }
    let brake = Brake::of(&path, &joints).ok_or_else(|| no_brake(&name))?;
    let parts = NetParts {
        name: &net_name(arguments)?,
        description: &described(&path, &name),
        device,
        path: &path,
        brake,
    };
    let net = text(&parts);
    notes(&path, &trajectory, brake);
    arguments.target.write(context, &net)
}

/// Returns the name of the arm, and its robot.
fn arm<'a>(
    config: &'a CellConfig,
    wanted: Option<&str>,
) -> Result<(&'a str, &'a RobotConfig), Failure> {
    let arms = config.devices.iter();
    let arms = arms.filter_map(|device| Some((device.name.as_str(), device.robot.as_ref()?)));
    let arms: Vec<(&str, &RobotConfig)> = arms.collect();
    let names = arms
        .iter()
        .map(|(name, _)| *name)
        .collect::<Vec<_>>()
        .join(", ");
    let cell = config.source.display();
    match (wanted, arms.as_slice()) {
        (None, [only]) => Ok(*only),
        (_, []) => Err(bad(
            format!("{cell} has no arm"),
            "name the configuration of another cell with --config FILE",
        )),
        (None, _) => Err(bad(
            format!("{cell} has several arms: {names}"),
            "name the one that moves with --device NAME",
        )),
        (Some(wanted), arms) => {
            let found = arms.iter().find(|(name, _)| *name == wanted);
            found.copied().ok_or_else(|| {
                bad(
                    format!("{cell} has no arm `{wanted}`"),
                    format!("its arms are: {names}"),
                )
            })
        }
    }
}

fn bad(message: String, help: impl Into<String>) -> Failure {
    Failure::new(codes::BAD_REQUEST, message, help)
}

fn invalid(message: String, help: impl Into<String>) -> Failure {
    Failure {
        exit: exit::INVALID,
        ..bad(message, help)
    }
}

/// For each joint of the robot, its index in the trajectory.
struct JointOrder(Vec<usize>);

impl JointOrder {
    fn of(
        given: &JointTrajectory,
        device: &str,
        robot: &RobotConfig,
        renamed: &[String],
    ) -> Result<JointOrder, Box<Failure>> {
        let mut names = given.joints.clone();
        for pair in renamed {
            let Some((theirs, ours)) = pair.split_once('=') else {
                let help = "write --joint THEIRS=OURS, such as --joint panda_joint1=joint_1";
                return Err(Box::new(bad(
                    format!("invalid joint mapping `{pair}`"),
                    help,
                )));
            };
            let place = given.joints.iter().position(|name| name == theirs);
            match place.and_then(|place| names.get_mut(place)) {
                Some(name) => ours.clone_into(name),
                None => {
                    let message = format!("--joint {pair}: the trajectory has no joint `{theirs}`");
                    let help = format!("its joints are: {}", given.joints.join(", "));
                    return Err(Box::new(bad(message, help)));
                }
            }
        }
        let known = |name: &String| robot.joints.iter().any(|joint| joint.name == *name);
        let foreign: Vec<&str> = names
            .iter()
            .filter(|name| !known(name))
            .map(String::as_str)
            .collect();
        let places = robot
            .joints
            .iter()
            .map(|joint| names.iter().position(|name| *name == joint.name));
        let places: Option<Vec<usize>> = places.collect();
        match places.filter(|places| foreign.is_empty() && places.len() == names.len()) {
            Some(places) => Ok(JointOrder(places)),
            None => Err(Box::new(other_joints(&names, &foreign, device, robot))),
        }
    }

    /// Returns values of the trajectory's joints in the order of the robot's.
    fn sorted(&self, values: &[f64]) -> Vec<f64> {
        self.0
            .iter()
            .filter_map(|place| values.get(*place).copied())
            .collect()
    }

    /// Returns the trajectory in the order of the robot's joints.
    fn trajectory(&self, given: &JointTrajectory) -> JointTrajectory {
        let mut trajectory = given.clone();
        let names = self
            .0
            .iter()
            .filter_map(|place| given.joints.get(*place).cloned());
        trajectory.joints = names.collect();
        for point in &mut trajectory.points {
            point.positions = self.sorted(&point.positions);
            for values in [&mut point.velocities, &mut point.accelerations] {
                *values = values.as_ref().map(|values| self.sorted(values));
            }
        }
        trajectory
    }
}

/// The joints are not those of the arm: names both, and how to map them.
fn other_joints(names: &[String], foreign: &[&str], device: &str, robot: &RobotConfig) -> Failure {
    let ours: Vec<&str> = robot
        .joints
        .iter()
        .map(|joint| joint.name.as_str())
        .collect();
    let missing: Vec<&str> = ours
        .iter()
        .copied()
        .filter(|name| !names.iter().any(|other| other == name))
        .collect();
    let message = match (foreign.is_empty(), missing.is_empty()) {
        (true, true) => format!("two joints of the trajectory are one joint of `{device}`"),
        (true, false) => format!(
            "the trajectory lacks joints of `{device}`: {}",
            missing.join(", ")
        ),
        (false, _) => format!(
            "`{device}` ({}) has no joints {}",
            robot.name,
            foreign.join(", ")
        ),
    };
    let pairs = foreign
        .iter()
        .zip(&missing)
        .map(|(theirs, ours)| format!("--joint {theirs}={ours}"));
    let help = match foreign.len() == missing.len() && !foreign.is_empty() {
        true => format!(
            "map each by its meaning; if both are in the same order: {}",
            pairs.collect::<Vec<_>>().join(" ")
        ),
        false => format!(
            "a trajectory names each joint of the arm once: {}",
            ours.join(", ")
        ),
    };
    invalid(message, help)
}

fn not_a_motion(name: &str, error: &PathError) -> Failure {
    let help = match error {
        PathError::OnePoint => "add the positions where the arm rests at 0 s",
        PathError::NoStart { .. } => {
            "give them with --start Q,Q,…, in the order of joint_names: where the arm rests before START (rad)"
        }
        PathError::TwoStarts => "omit --start",
        PathError::StartWidth { .. } => "give one position for each of joint_names, in their order",
        PathError::InMotion { .. } => {
            "an arm is at rest before and after a net: let its velocities be 0 there"
        }
    };
    invalid(format!("{name}: {error}"), help)
}

/// Lists everything that passes a limit, and the factor that helps.
fn beyond_limits(name: &str, passed: &[Excess], robot: &RobotConfig, used: f64) -> Failure {
    let rows = passed.iter().map(|excess| {
        let joint = robot
            .joints
            .get(excess.joint)
            .map_or("?", |joint| joint.name.as_str());
        excess.sentence(joint)
    });
    let rows: Vec<String> = rows.collect();
    let help = match stretch(passed) {
        Some(factor) => format!("with --stretch {:.2} it keeps them", used * factor),
        None if passed.iter().all(|excess| excess.quantity == Quantity::Position) => {
            "plan the trajectory with the limits of the robot's file".to_owned()
        }
        None => "no speed keeps a joint in its range: plan the trajectory with the limits of the robot's file".to_owned(),
    };
    invalid(
        format!(
            "{name}: the trajectory passes limits of {}: {}",
            robot.name,
            rows.join("; ")
        ),
        help,
    )
}

fn no_brake(name: &str) -> Failure {
    invalid(
        format!(
            "{name}: the trajectory uses the limits up, so CANCEL could not stop the arm on its path"
        ),
        "slow it down a little, for example with --stretch 1.1",
    )
}

/// Returns the name of the net.
fn net_name(arguments: &Arguments) -> Result<String, Failure> {
    let given = arguments.name.clone();
    let name = given.unwrap_or_else(|| name_of_file(&arguments.file));
    if is_net_name(&name) {
        return Ok(name);
    }
    Err(bad(
        format!("invalid name `{name}` for a net"),
        "use lower-case letters, digits and `-`, beginning with a letter: --name pick-and-place",
    ))
}

/// Returns a net's name for a file's: `Pick 2.yaml` gives `pick-2`.
fn name_of_file(file: &str) -> String {
    let stem = Path::new(file)
        .file_stem()
        .map_or_else(Default::default, |stem| stem.to_string_lossy());
    let letters = stem.chars().map(|c| match c.to_ascii_lowercase() {
        c @ ('a'..='z' | '0'..='9') => c,
        _ => '-',
    });
    let name: String = letters
        .skip_while(|c| !c.is_ascii_lowercase())
        .take(64)
        .collect();
    match name.is_empty() {
        true => "trajectory".to_owned(),
        false => name,
    }
}

fn described(path: &TrajectoryPath, file: &str) -> String {
    let points = path.times_s.len();
    let kind = match path.interpolation {
        Interpolation::Spline => "positions",
        Interpolation::Cubic => "positions and velocities",
        Interpolation::Quintic => "positions, velocities and accelerations",
    };
    let file = Path::new(file)
        .file_name()
        .map_or(file.into(), |name| name.to_string_lossy());
    let file: String = file
        .chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    format!(
        "Trajectory of {file}: {points} points ({kind}), {:.3} s.",
        path.duration_s()
    )
}

/// Tells what was taken from the file, and what was not.
fn notes(path: &TrajectoryPath, trajectory: &JointTrajectory, brake: Brake) {
    if !trajectory.unused.is_empty() {
        print_note(&format!("not used: {}", trajectory.unused.join(", ")));
    }
    if path.dropped_rad_s2 > 0.0 {
        print_note(&format!(
            "accelerations of up to {:.3} rad/s² at the first and last point are not used: an arm at rest has none",
            path.dropped_rad_s2
        ));
    }
    print_note(&format!(
        "{:.3} s; CANCEL brings the arm to rest on its path within {:.2} s",
        path.duration_s(),
        brake.duration_s()
    ));
}
