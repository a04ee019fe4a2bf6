//! Results of other kinematics libraries, measured in turns with ours (`bench/kinematics/compare`).

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::Path;

use serde::Deserialize;

use crate::table::{digits, table};

/// A row of `bench/kinematics/compare --json`.
#[derive(Deserialize)]
struct KinematicsRow {
    robot: String,
    positions: usize,
    program: String,
    version: String,
    rounds: usize,
    fifo: bool,
    /// Maximum difference of poses and Jacobians from ours.
    difference: f64,
    ns: BTreeMap<String, f64>,
    times_ours: BTreeMap<String, f64>,
    solved: BTreeMap<String, f64>,
}

/// The compared functions: key in the file, and title.
const SUBJECTS: [(&str, &str); 6] = [
    ("forward", "forward"),
    ("jacobian", "Jacobian"),
    ("inverse", "inverse, one solution"),
    ("inverse_near", "inverse, from 2 mrad beside it"),
    ("inverse_all", "inverse, all solutions"),
    ("velocity", "joint velocities of a twist, damped"),
];

/// Returns the section of the page; see the module.
pub fn section(file: Option<&Path>) -> Result<String, Box<dyn Error>> {
    let head = "## Other programs\n\n";
    let Some(file) = file else {
        return Ok(format!(
            "{head}Not measured here: run `bench/kinematics/compare --json FILE` where Orocos KDL or pinocchio is installed.\n"
        ));
    };
    let programs: Vec<KinematicsRow> = serde_json::from_str(&fs::read_to_string(file)?)?;
    let Some(first) = programs.first() else {
        return Err(format!("{} has no rows", file.display()).into());
    };
    let mut text = format!(
        "{head}ns per call, and in parentheses the multiple of our duration: each program's best of many batches over the same positions \
         (`tests/data/kinematics`), in turns with ours, medians of {} rounds{}. Before that, poses and Jacobians were compared with \
         ours. KDL searches for inverse kinematics (Levenberg-Marquardt), from up to 0.3 rad, or 2 mrad, beside the solution, as \
         far as its tolerance of 10 µm; ours and rs-opw-kinematics solve in closed form and take the previous joints as a hint. \
         pinocchio has no inverse kinematics. rs-opw-kinematics checks each of its solutions by forward kinematics and \
         allocates a list on the heap, which a real-time cycle must not do; its Jacobian is numeric and not compared.\n",
        first.rounds,
        if first.fifo {
            ", under SCHED_FIFO"
        } else {
            ", **not under SCHED_FIFO**"
        },
    );
    let mut robots: Vec<&str> = programs.iter().map(|it| it.robot.as_str()).collect();
    robots.dedup();
    for robot in robots {
        let of_robot: Vec<&KinematicsRow> =
            programs.iter().filter(|it| it.robot == robot).collect();
        text += &robot_text(robot, &of_robot);
    }
    Ok(text)
}

fn robot_text(robot: &str, programs: &[&KinematicsRow]) -> String {
    let mut head = vec![robot.to_owned()];
    head.extend(
        programs
            .iter()
            .map(|it| format!("{} {}", it.program, it.version)),
    );
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    let row = |(key, name): (&str, &str)| {
        let cells = programs
            .iter()
            .map(|it| match (it.ns.get(key), it.times_ours.get(key)) {
                (Some(ns), Some(ratio)) if it.program != "RCC" => {
                    format!("{} ({}×)", digits(*ns), digits(*ratio))
                }
                (Some(ns), _) => digits(*ns),
                _ => "–".to_owned(),
            });
        [name.to_owned()]
            .into_iter()
            .chain(cells)
            .collect::<Vec<_>>()
    };
    let rows: Vec<_> = SUBJECTS.into_iter().map(row).collect();
    let mut text = format!("\n{}", table(&head, &rows));
    for it in programs.iter().filter(|it| it.program != "RCC") {
        text += &format!(
            "\n{} differs from ours by {:.1e} at most (m, elements of rotation and Jacobian; {} positions).{}\n",
            it.program,
            it.difference,
            it.positions,
            searched(it)
        );
    }
    text
}

/// Returns how many searches found a solution.
fn searched(program: &KinematicsRow) -> String {
    let solved = |key: &str| program.solved.get(key).copied();
    match (solved("inverse_solved"), solved("inverse_near_solved")) {
        (Some(far), Some(near)) => format!(
            " Its search ended at the pose for {} % of the positions, from nearby for {} %.",
            digits(100.0 * far),
            digits(100.0 * near)
        ),
        _ => String::new(),
    }
}
