//! `rcc-cli wrench identify`: synthetic readings are identified exactly without noise, within the deviation with noise,
//! and refused if they are insufficient; files of other verbs are read. Run by the threads of the test harness.

use nalgebra::Vector3;
use rcc_cli::identify::readings::{ReadingSelection, read};
use rcc_cli::identify::{GRAVITY, Identified, IdentifyError, Reading, identify};
use rcc_core::rotation;
use rcc_testing::{Random, Rng};

use crate::program::{self, repository, run_to};

const MASS: f64 = 1.37;
const CENTRE: [f64; 3] = [0.012, -0.031, 0.085];
const FORCE: [f64; 3] = [3.2, -1.7, 12.5];
const TORQUE: [f64; 3] = [0.21, -0.34, 0.055];
const DOWN: [f64; 3] = [0.0, 0.0, -GRAVITY];

/// Returns the reading of a sensor, computed by rotation matrices and components, independently of the tested code.
fn reading(rpy: [f64; 3], noise: f64, chance: &mut Rng) -> Reading {
    let rotation = rotation::from_rpy(rpy);
    let matrix = nalgebra::Rotation3::from_euler_angles(rpy[0], rpy[1], rpy[2]);
    let w = matrix.matrix().transpose() * Vector3::new(0.0, 0.0, -GRAVITY * MASS);
    let [cx, cy, cz] = CENTRE;
    let wrench = [
        FORCE[0] + w.x,
        FORCE[1] + w.y,
        FORCE[2] + w.z,
        TORQUE[0] + cy * w.z - cz * w.y,
        TORQUE[1] + cz * w.x - cx * w.z,
        TORQUE[2] + cx * w.y - cy * w.x,
    ];
    let scale = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1];
    let wrench = std::array::from_fn(|i| wrench[i] + noise * scale[i] * chance.uniform(-1.0, 1.0));
    Reading { wrench, rotation }
}

fn readings(rpy: impl IntoIterator<Item = [f64; 3]>, noise: f64) -> Vec<Reading> {
    let mut chance = Rng::with_seed(1);
    rpy.into_iter()
        .map(|rpy| reading(rpy, noise, &mut chance))
        .collect()
}

/// Gravity along the three axes, in both directions.
const SIX: [[f64; 3]; 6] = [
    [0.0, 0.0, 0.3],
    [3.1, 0.1, 0.0],
    [1.6, 0.0, -0.7],
    [-1.5, 0.1, 0.2],
    [0.1, 1.4, 0.0],
    [0.2, -1.5, 2.0],
];

fn far(found: &Identified) -> f64 {
    let pairs = found.centre.iter().zip(CENTRE);
    let pairs = pairs.chain(found.force_offset.iter().zip(FORCE));
    let pairs = pairs.chain(found.torque_offset.iter().zip(TORQUE));
    pairs
        .map(|(a, b)| (a - b).abs())
        .fold((found.mass - MASS).abs(), f64::max)
}

#[test]
fn without_noise_six_orientations_give_the_parameters_to_1e_9() {
    let found = identify(&readings(SIX, 0.0), DOWN).expect("six orientations");
    assert!(far(&found) < 1e-12, "{found:?}");
    assert!(found.residual_max.iter().all(|left| *left < 1e-12));
    assert_eq!((found.orientations, found.readings), (6, 6));
    assert!(found.spread > 0.7 && found.condition < 1.5, "{found:?}");
}

#[test]
fn accepted_orientations_are_exact_without_noise() {
    let (mut chance, mut refused) = (Rng::with_seed(7), 0);
    for _ in 0..300 {
        let width = 0.2 + 3.0 * chance.uniform(-1.0, 1.0).abs();
        let count = 6 + (20.0 * chance.uniform(-1.0, 1.0).abs()) as usize;
        let rpy: Vec<_> = (0..count)
            .map(|_| std::array::from_fn(|_| width * chance.uniform(-1.0, 1.0)))
            .collect();
        match identify(&readings(rpy, 0.0), DOWN) {
            Ok(found) => assert!(far(&found) < 1e-9, "{found:?}"),
            Err(_) => refused += 1,
        }
    }
    assert!((5..200).contains(&refused), "{refused}");
}

#[test]
fn with_noise_the_error_is_within_a_few_reported_deviations() {
    let mut chance = Rng::with_seed(3);
    let rpy: Vec<_> = (0..400)
        .map(|_| std::array::from_fn(|_| 3.0 * chance.uniform(-1.0, 1.0)))
        .collect();
    // Uniform noise up to 0.5 N has a standard deviation of 0.5 / sqrt 3.
    let found = identify(&readings(rpy, 0.5), DOWN).expect("many orientations");
    let [mass, centre] = found.deviation;
    assert!((found.mass - MASS).abs() < 4.0 * mass, "{found:?}");
    let off = found
        .centre
        .iter()
        .zip(CENTRE)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>()
        .sqrt();
    assert!(off < 5.0 * centre && centre < 1e-3, "{off} {found:?}");
    let [force, torque] = found.residual;
    assert!((force / (0.5 / 3f64.sqrt()) - 1.0).abs() < 0.1, "{force}");
    assert!(
        (torque / (0.05 / 3f64.sqrt()) - 1.0).abs() < 0.1,
        "{torque}"
    );
}

#[test]
fn many_readings_of_few_orientations_are_refused() {
    let turned_about_the_vertical = (0..50).map(|n| [0.4, -0.2, f64::from(n) * 0.1]);
    let error = identify(&readings(turned_about_the_vertical, 0.0), DOWN);
    assert_eq!(
        error,
        Err(IdentifyError::TooFew {
            orientations: 1,
            readings: 50
        })
    );
    assert!(error.unwrap_err().to_string().contains("vertical"));
    let five = identify(&readings(SIX[..5].iter().copied(), 0.0), DOWN);
    assert_eq!(
        five,
        Err(IdentifyError::TooFew {
            orientations: 5,
            readings: 5
        })
    );
    assert!(matches!(
        identify(&[], DOWN),
        Err(IdentifyError::TooFew { .. })
    ));
}

#[test]
fn orientations_within_a_few_degrees_are_refused() {
    let near = (0..6).map(|n| {
        let angle = f64::from(n) * std::f64::consts::TAU / 6.0;
        [0.15 * angle.cos(), 0.15 * angle.sin(), 0.0]
    });
    let error = identify(&readings(near, 0.0), DOWN);
    assert!(
        matches!(error, Err(IdentifyError::TooSimilar { .. })),
        "{error:?}"
    );
}

#[test]
fn a_sensor_with_nothing_on_it_or_of_the_other_sign_is_refused() {
    let turned = readings(SIX, 0.0).into_iter().map(|reading| Reading {
        wrench: reading.wrench.map(|x| -x),
        ..reading
    });
    let error = identify(&turned.collect::<Vec<_>>(), DOWN);
    assert!(
        matches!(error, Err(IdentifyError::Mass { mass, .. }) if mass < -1.0),
        "{error:?}"
    );
    let empty: Vec<_> = SIX
        .iter()
        .map(|rpy| Reading {
            wrench: [1.0; 6],
            rotation: rotation::from_rpy(*rpy),
        })
        .collect();
    assert!(matches!(
        identify(&empty, DOWN),
        Err(IdentifyError::Mass { .. })
    ));
}

#[test]
fn a_disturbed_reading_or_a_wrong_scale_is_refused_and_the_reading_named() {
    let mut all = readings(SIX, 0.05);
    assert!(identify(&all, DOWN).is_ok());
    all[4].wrench[0] += 60.0;
    let error = identify(&all, DOWN);
    assert!(
        matches!(
            error,
            Err(IdentifyError::Misfit { number: 5, .. } | IdentifyError::Mass { .. })
        ),
        "{error:?}"
    );
    all[4].wrench[0] -= 50.0;
    let error = identify(&all, DOWN);
    assert!(
        matches!(error, Err(IdentifyError::Misfit { number: 5, .. })),
        "{error:?}"
    );
    let scaled = readings(SIX, 0.0).into_iter().map(|mut reading| {
        reading.wrench[0] *= 2.0;
        reading
    });
    let error = identify(&scaled.collect::<Vec<_>>(), DOWN);
    assert!(
        matches!(error, Err(IdentifyError::Misfit { .. })),
        "{error:?}"
    );
}

#[test]
fn readings_that_are_not_finite_are_refused_with_their_number() {
    let mut all = readings(SIX, 0.0);
    all[3].wrench[2] = f64::NAN;
    assert_eq!(
        identify(&all, DOWN),
        Err(IdentifyError::Reading { number: 4 })
    );
    all[3] = all[2];
    all[1].rotation = [0.0; 4];
    assert_eq!(
        identify(&all, DOWN),
        Err(IdentifyError::Reading { number: 2 })
    );
    assert_eq!(identify(&all, [0.0; 3]), Err(IdentifyError::Gravity));
}

const WRENCH: [f64; 6] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
const ROTATION: [f64; 4] = [0.0, 0.0, 0.6, 0.8];

fn head(name: &str, width: usize, unit: &str) -> String {
    (0..width).map(|n| format!(",{name}[{n}]{unit}")).collect()
}

fn cells(values: &[f64]) -> String {
    values.iter().map(|value| format!(",{value}")).collect()
}

fn sheet_of(pose: &[f64]) -> String {
    format!(
        "time [s]{}{},n/speed [m/s]\n0{}{},1\n0.1{},,,,,,,,\n0.2{}{},null\n",
        head("n/ft.wrench", 6, ""),
        head("n/at.pose", pose.len(), ""),
        cells(&WRENCH),
        cells(pose),
        cells(&WRENCH).replace(",1", ",null"),
        cells(&WRENCH),
        cells(pose),
    )
}

fn two() -> Vec<Reading> {
    vec![
        Reading {
            wrench: WRENCH,
            rotation: ROTATION
        };
        2
    ]
}

#[test]
fn a_table_of_simulate_gives_the_lines_in_which_both_are_known() {
    let pose = [0.4, 0.1, 0.5, 0.0, 0.0, 0.6, 0.8];
    assert_eq!(
        read(&sheet_of(&pose), &ReadingSelection::default()),
        Ok(two())
    );
}

#[test]
fn a_rotation_does_as_well_as_a_pose() {
    let text = sheet_of(&ROTATION).replace(",,,,,,,,", ",,,,,");
    assert_eq!(read(&text, &ReadingSelection::default()), Ok(two()));
}

#[test]
fn lines_of_tail_are_paired_by_their_cycle() {
    let line = |name: &str, cycle: u64, value: &[f64]| {
        format!(
            "{}\n",
            serde_json::json!({"name": name, "cycle": cycle, "value": value})
        )
    };
    let mut text = String::from("{\"lost\": 3}\n");
    for cycle in [7, 8] {
        text += &line("n/ft.wrench", cycle, &WRENCH);
        text += &line("n/at.rotation", cycle, &ROTATION);
    }
    text += &line("n/ft.wrench", 9, &WRENCH);
    assert_eq!(read(&text, &ReadingSelection::default()), Ok(two()));
}

#[test]
fn one_of_two_wrenches_is_selected_by_name() {
    let text = format!(
        "{}{}{}\n0{}{}{}\n",
        "time [s]",
        head("n/raw", 6, "") + &head("n/filtered", 6, ""),
        head("n/at.rotation", 4, ""),
        cells(&[0.0; 6]),
        cells(&WRENCH),
        cells(&ROTATION),
    );
    let error = read(&text, &ReadingSelection::default()).unwrap_err();
    assert!(error.to_string().contains("n/raw, n/filtered"), "{error}");
    let wanted = ReadingSelection {
        wrench: Some("filtered".to_owned()),
        pose: None,
    };
    assert_eq!(read(&text, &wanted), Ok(two()[..1].to_vec()));
}

#[test]
fn parse_errors_name_their_line() {
    for (text, part) in [
        ("", "line 1"),
        ("a,b\n1\n", "line 2"),
        ("a,b\n1,x\n", "`x` is not a number"),
        ("{\"name\": \n", "line 1"),
        ("a,b\n1,2\n", "a, b"),
    ] {
        let error = read(text, &ReadingSelection::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains(part), "{error}");
    }
}

/// Runs the program on a table in a temporary file.
fn run(readings: &[Reading]) -> (i32, String, String) {
    let mut text = format!(
        "time [s]{}{}\n",
        head("n/ft.wrench", 6, ""),
        head("n/at.rotation", 4, "")
    );
    for (index, reading) in readings.iter().enumerate() {
        text += &format!(
            "{index}{}{}\n",
            cells(&reading.wrench),
            cells(&reading.rotation)
        );
    }
    let folder = rcc_testing::folder();
    let path = folder.path().join("readings.csv");
    std::fs::write(&path, text).expect("a file");
    let path = path.to_str().expect("UTF-8");
    let (code, out, errors) = program::run(&["wrench", "identify", path]);
    (code.expect("a code"), out, errors)
}

#[test]
fn the_printed_primitive_compiles() {
    let (code, out, err) = run(&readings(SIX, 0.0));
    assert_eq!(code, 0, "{err}");
    assert!(
        out.contains("mass: 1.37 kg") && out.contains("centre: [0.012, -0.031, 0.085]"),
        "{out}"
    );
    let primitive: String = out.lines().map(|line| format!("  {line}\n")).collect();
    let net = format!(
        "net: pasted\nprimitives:\n{primitive}    inputs: {{wrench: [0, 0, 0, 0, 0, 0], rotation: {{rpy: [0, 0, 0]}}}}\n  \
         end: {{type: Termination, inputs: {{done: false}}}}\ndiscard: [compensated.out]\n"
    );
    let cell = repository().join("tests/nets/cell.yaml");
    let cell =
        rcc_config::CellConfig::load_offline(&cell).unwrap_or_else(|faults| panic!("{faults}"));
    rcc_language::compile(&net, "pasted", &cell).unwrap_or_else(|faults| panic!("{faults}\n{net}"));
}

#[test]
fn too_few_orientations_are_refused_with_a_reason() {
    let (code, _, err) = run(&readings(SIX[..5].iter().copied(), 0.0));
    assert_eq!(code, 2, "{err}");
    assert!(
        err.contains("5 different orientations") && err.contains("docs/force.md"),
        "{err}"
    );
}

#[test]
fn commands_of_the_docs_print_what_the_docs_show() {
    let root = repository();
    let page = std::fs::read_to_string(root.join("docs/force.md")).expect("the page");
    let mut commands = 0;
    for block in page.split("```console\n").skip(1) {
        let block = block.split("```").next().expect("a block");
        let (command, shown) = block.split_once('\n').expect("lines");
        let words: Vec<&str> = command.split_whitespace().collect();
        assert_eq!(&words[..2], ["$", "rcc-cli"]);
        let (out, _) = run_to(0, &words[2..]);
        assert!(shown.is_empty() || out == shown, "{command}: {out}");
        commands += 1;
    }
    assert_eq!(commands, 3);
}
