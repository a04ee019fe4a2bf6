//! `import trajectory` as a user types it: files of ROS become nets that `check` accepts and that move a simulated arm through
//! their points, or are refused with joint and value. Needs no cell.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, FRAC_PI_6};

use serde_json::Value;

use crate::program::run_to;

/// Joints of the files, in the order of the robot's.
const MAPPED: [&str; 7] = [
    "--joint=lwr_a1_joint=J1",
    "--joint=lwr_a2_joint=J2",
    "--joint=lwr_a3_joint=J3",
    "--joint=lwr_a4_joint=J4",
    "--joint=lwr_a5_joint=J5",
    "--joint=lwr_a6_joint=J6",
    "--joint=lwr_a7_joint=J7",
];
/// Where the arm of the demo cell rests, rad.
const START: &str = "--start=0,-0.5235987755982988,0,1.5707963267948966,0,-1.0471975511965976,0";

fn data(name: &str) -> String {
    format!("rcc-cli/tests/data/trajectories/{name}")
}

/// Runs a verb that must end with this exit code; returns what it wrote to both streams.
fn run(exit: i32, arguments: &[&str]) -> (String, String) {
    let (out, err) = run_to(exit, arguments);
    // A message is wrapped for the terminal.
    (out, err.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// A net in a temporary folder.
struct Imported {
    _folder: rcc_testing::TempDir,
    net: String,
    said: String,
}

fn import(file: &str, options: &[&str]) -> Imported {
    let folder = rcc_testing::folder();
    let net = folder.path().join("net.yaml").display().to_string();
    let arguments = [&["import", "trajectory", file, "-o", &net], options].concat();
    let (_, said) = run(0, &arguments);
    Imported {
        _folder: folder,
        net,
        said,
    }
}

/// Simulates a net with options of `simulate`.
fn simulate(exit: i32, net: &str, options: &[&str]) -> Value {
    let (out, _) = run(
        exit,
        &[&["--output", "json", "simulate", net], options].concat(),
    );
    serde_json::from_str(&out).expect("JSON")
}

fn outcome(report: &Value) -> &str {
    report["outcome"].as_str().unwrap_or_default()
}

#[test]
fn a_trajectory_of_moveit_moves_the_arm_in_its_time() {
    let imported = import(&data("moveit.yaml"), &MAPPED);
    assert!(
        imported
            .said
            .contains("0.800 rad/s² at the first and last point are not used"),
        "{}",
        imported.said
    );
    run(0, &["check", "--rehearse", &imported.net]);
    let report = simulate(0, &imported.net, &[]);
    assert_eq!(outcome(&report), "arrived", "{report}");
    // 1.625 s at 1 ms, from the cycle at 0 s on.
    let cycles = report["cycles"].as_u64().expect("cycles");
    assert!((1626..=1627).contains(&cycles), "{report}");
}

#[test]
fn a_goal_with_joints_in_another_order_moves_the_arm() {
    let imported = import(&data("goal.json"), &[]);
    assert!(
        imported
            .said
            .contains("not used: goal_tolerance, goal_time_tolerance"),
        "{}",
        imported.said
    );
    run(0, &["check", "--rehearse", &imported.net]);
    assert_eq!(outcome(&simulate(0, &imported.net, &[])), "arrived");
}

#[test]
fn way_points_without_velocities_become_a_smooth_motion() {
    let imported = import(&data("way-points.yaml"), &[START]);
    run(0, &["check", "--rehearse", &imported.net]);
    assert_eq!(outcome(&simulate(0, &imported.net, &[])), "arrived");
}

/// The net passes the points of the file at their times.
#[test]
fn the_arm_is_at_each_point_at_its_time() {
    let imported = import(&data("way-points.yaml"), &[START]);
    let text = std::fs::read_to_string(&imported.net).expect("the net");
    let watched = text.replace(
        "primitives:\n",
        "primitives:\n  watch: {type: Monitor, parameters: {rate: 1000 Hz}, inputs: {value: [j1.out, j2.out, j3.out, j4.out, j5.out, j6.out, j7.out]}}\n",
    );
    assert_ne!(text, watched);
    std::fs::write(&imported.net, watched).expect("the net");
    let csv = format!("{}.csv", imported.net);
    simulate(0, &imported.net, &["--csv", &csv]);
    let table = std::fs::read_to_string(&csv).expect("the table");
    let rows: Vec<Vec<f64>> = table
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .filter_map(|cell| cell.parse().ok())
                .collect()
        })
        .collect();
    let start = [0.0, -FRAC_PI_6, 0.0, FRAC_PI_2, 0.0, -FRAC_PI_3, 0.0];
    let points = [
        (0, [0.0; 7]),
        (1000, [0.2, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0]),
        (2000, [0.2, 0.2, 0.0, -0.2, 0.0, 0.1, 0.3]),
        (3500, [-0.1, 0.2, 0.1, -0.2, 0.2, 0.0, 0.3]),
        (5000, [0.0; 7]),
    ];
    for (row, offsets) in points {
        let values = &rows[row][rows[row].len() - 7..];
        for joint in 0..7 {
            let want = start[joint] + offsets[joint];
            assert!(
                (values[joint] - want).abs() < 1e-9,
                "{row}, joint {joint}: {} {want}",
                values[joint]
            );
        }
    }
}

/// CANCEL at every phase: no limit is passed (`simulate` would end with a fault), and the arm comes to rest by itself.
#[test]
fn cancel_stops_on_the_path_within_the_limits() {
    let nets = [
        import(&data("moveit.yaml"), &MAPPED),
        import(&data("goal.json"), &[]),
        import(&data("way-points.yaml"), &[START]),
    ];
    for imported in &nets {
        for at in ["1ms", "50ms", "300ms", "777ms", "1200ms", "1500ms"] {
            let report = simulate(0, &imported.net, &["--cancel-at", at]);
            assert_eq!(report["reason"], "canceled", "{at}: {report}");
            assert!(report["fault"].is_null(), "{at}: {report}");
        }
    }
    let report = simulate(0, &nets[2].net, &["--cancel-at", "1200ms"]);
    assert_eq!(outcome(&report), "stopped", "{report}");
}

#[test]
fn what_does_not_fit_is_refused_with_what_to_do() {
    let moveit = data("moveit.yaml");
    let way_points = data("way-points.yaml");
    let folder = rcc_testing::folder();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        path.display().to_string()
    };
    let points = |second: &str, time: f64| {
        format!(
            "joint_names: [J1, J2, J3, J4, J5, J6, J7]\npoints:\n- {{positions: [0, 0, 0, 0, 0, 0, 0], time_from_start: 0}}\n\
             - {{positions: [{second}, 0, 0, 0, 0, 0, 0], time_from_start: {time}}}\n"
        )
    };
    let fast = write("fast.yaml", &points("1", 0.5));
    let outside = write("outside.yaml", &points("3.1", 60.0));
    let table: [(i32, &[&str], &[&str]); 9] = [
        (
            3,
            &[&moveit],
            &["has no joints lwr_a1_joint", "--joint lwr_a1_joint=J1"],
        ),
        (3, &[&way_points], &["the first point is at 1 s", "--start"]),
        (
            3,
            &[&way_points, "--start=0,0"],
            &["2 positions for 7 joints"],
        ),
        (
            3,
            &[&fast],
            &["J1 at", "velocity 3.7", "exceeds 1.9199 rad/s", "--stretch"],
        ),
        (
            3,
            &[&outside],
            &["J1 at", "position 3.1000 rad exceeds 2.9671 rad"],
        ),
        (
            2,
            &[&moveit, "--device=nobody"],
            &["no arm `nobody`", "lwr"],
        ),
        (
            2,
            &[&moveit, "--joint=x=J1"],
            &["no joint `x`", "lwr_a7_joint"],
        ),
        (
            2,
            &[&fast, "--stretch=3", "--name=No"],
            &["invalid name `No`"],
        ),
        (
            2,
            &[&moveit, "--stretch=0"],
            &["write a number from 1 to 1000"],
        ),
    ];
    for (exit, arguments, words) in table {
        let (_, said) = run(exit, &[&["import", "trajectory"], arguments].concat());
        for word in words {
            assert!(said.contains(word), "{arguments:?}: {word}: {said}");
        }
    }
}

/// The proposed factor is enough, and not twice what is needed.
#[test]
fn the_proposed_factor_keeps_the_limits() {
    let folder = rcc_testing::folder();
    let path = folder.path().join("fast.yaml");
    let text = "joint_names: [J1, J2, J3, J4, J5, J6, J7]\npoints:\n- {positions: [0, -0.5, 0, 1.5, 0, -1, 0], time_from_start: 0}\n\
                - {positions: [1, 0, 0, 1, 0, -1, 0], time_from_start: 0.2}\n";
    std::fs::write(&path, text).expect("a file");
    let file = path.display().to_string();
    let (_, said) = run(3, &["import", "trajectory", &file]);
    let factor = said
        .split("--stretch ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .expect("a factor");
    run(0, &["import", "trajectory", &file, "--stretch", factor]);
    let half: f64 = factor.parse::<f64>().expect("a number") / 2.0;
    run(
        3,
        &[
            "import",
            "trajectory",
            &file,
            "--stretch",
            &half.max(1.0).to_string(),
        ],
    );
}

/// Where the arm rests elsewhere, START is refused, as for every net.
#[test]
fn a_trajectory_that_begins_elsewhere_is_not_started() {
    let imported = import(&data("way-points.yaml"), &["--start=0.1,-0.5,0,1.5,0,-1,0"]);
    let (_, said) = run(5, &["simulate", &imported.net]);
    assert!(said.contains("J1"), "{said}");
}
