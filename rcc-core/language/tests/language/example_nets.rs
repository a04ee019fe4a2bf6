//! Every net in `configs/nets` compiles for the demo cell, runs in virtual time and does what it demonstrates.

use crate::harness::{DEMO_START, NetHarness, cell, eight, example, folder};
use rcc_config::CellConfig;
use rcc_core::path::PathLimits;
use rcc_core::pose::Pose;
use rcc_language::codes;
use rcc_motion::stop_time;

const FIGURES: [&str; 3] = ["line", "guarded-line", "welding-line"];
/// Limit of cycles for every example.
const CYCLES_MAX: u64 = 20_000;

fn demo() -> CellConfig {
    cell("configs/cells/demo.yaml")
}

fn harness(name: &str, cell: &CellConfig) -> NetHarness {
    NetHarness::new(example(name, cell), cell, DEMO_START)
}

fn channel(cell: &CellConfig, device: &str, channel: &str) -> (usize, usize) {
    let (index, device) = cell.device(device).unwrap();
    let channel = device
        .channels
        .iter()
        .find(|known| known.name == channel)
        .unwrap();
    (index, channel.index as usize)
}

fn set_digital(harness: &mut NetHarness, (device, channel): (usize, usize), value: bool) {
    let digital = &mut harness.inputs[device].measurement.digital;
    *digital = *digital & !(1 << channel) | u64::from(value) << channel;
}

/// Returns the commanded value of a digital output; `None` if it is not commanded.
fn digital(harness: &NetHarness, (device, channel): (usize, usize)) -> Option<bool> {
    let output = &harness.outputs[device];
    (output.digital_commanded >> channel & 1 == 1).then_some(output.digital >> channel & 1 == 1)
}

fn pose(values: &[f64]) -> Pose {
    Pose::from_slots(values.try_into().unwrap())
}

/// Returns the distance of a point from the line through two others, m.
fn off_line(point: &Pose, from: &Pose, to: &Pose) -> f64 {
    let along: Vec<f64> = (0..3).map(|i| to.position[i] - from.position[i]).collect();
    let way: Vec<f64> = (0..3)
        .map(|i| point.position[i] - from.position[i])
        .collect();
    let length = along.iter().map(|x| x * x).sum::<f64>();
    let share = (0..3).map(|i| along[i] * way[i]).sum::<f64>() / length;
    (0..3)
        .map(|i| (way[i] - share * along[i]).powi(2))
        .sum::<f64>()
        .sqrt()
}

#[test]
fn all_examples_run_without_a_panic() {
    let cell = demo();
    let mut count = 0;
    for entry in std::fs::read_dir(folder("configs/nets")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let mut harness = harness(&name, &cell);
        assert_eq!(harness.net.net, name, "a net is named as its file");
        assert!(
            !harness.net.description.is_empty(),
            "{name} says what it shows"
        );
        for cycle in 0..2000 {
            harness
                .inputs
                .iter_mut()
                .for_each(|input| input.present = cycle % 700 != 699);
            harness.step();
        }
        count += 1;
    }
    assert!(count >= 8);
}

#[test]
fn only_figure_3_has_a_warning() {
    let cell = demo();
    for entry in std::fs::read_dir(folder("configs/nets")).unwrap() {
        let name = entry
            .unwrap()
            .path()
            .file_stem()
            .unwrap()
            .to_string_lossy()
            .into_owned();
        let warnings = example(&name, &cell).warnings.diagnostics;
        let codes: Vec<&str> = warnings.iter().map(|fault| fault.code).collect();
        let expected = if name == "line" {
            &[codes::NOT_CANCELABLE][..]
        } else {
            &[]
        };
        assert_eq!(codes, expected, "{name}");
    }
}

#[test]
fn the_figures_end_on_their_successive_lines() {
    let cell = demo();
    let arm = cell.models()[0].arm.unwrap();
    let mut hold = DEMO_START;
    for name in FIGURES {
        let mut harness = NetHarness::new(example(name, &cell), &cell, hold);
        let (from, to) = (arm.forward(&eight(&hold)), pose(&harness.values_of_goal()));
        while !harness.terminated {
            harness.step();
            assert!(harness.cycle < CYCLES_MAX, "{name} does not end");
            let set_point = harness.outputs[0].position;
            assert!(
                harness.outputs[0].has_position,
                "{name}: cycle {}",
                harness.cycle
            );
            hold.copy_from_slice(&set_point[..7]);
            let flange = arm.forward(&eight(&hold));
            assert!(
                off_line(&flange, &from, &to) < 1e-9,
                "{name}: cycle {}",
                harness.cycle
            );
            assert!(
                cell.models()[0]
                    .limits
                    .lower
                    .iter()
                    .zip(hold)
                    .all(|(lower, q)| q > *lower)
            );
            assert!(
                cell.models()[0]
                    .limits
                    .upper
                    .iter()
                    .zip(hold)
                    .all(|(upper, q)| q < *upper)
            );
        }
        assert_eq!(harness.value("move.done"), 1.0);
        assert!(
            arm.forward(&eight(&hold)).distance_to(&to) < 1e-9,
            "{name} ends at its goal"
        );
    }
}

impl NetHarness {
    /// Returns the goal of the motion: the only pose among the constants of the examples.
    fn values_of_goal(&self) -> Vec<f64> {
        let down = |pose: &&[f64]| (pose[4] - 1.0).abs() < 1e-9 && pose[0] > 0.1;
        self.net.plan.reals.windows(7).find(down).unwrap().to_vec()
    }
}

/// Limits of the guarded line; a stop does not depend on its length.
const LINE: PathLimits = PathLimits {
    length: 0.0,
    velocity: 0.1,
    acceleration: 0.5,
    jerk: 5.0,
};

#[test]
fn the_guarded_line_stops_within_its_limits_when_the_force_rises() {
    let cell = demo();
    let mut harness = harness("guarded-line", &cell);
    while harness.value("move.distance").is_nan() || harness.value("move.distance") < 0.05 {
        harness.step();
        assert_eq!(harness.value("stop.out"), 0.0);
    }
    let stop_s = stop_time(
        harness.value("move.speed"),
        harness.value("move.acceleration"),
        &LINE,
    );
    let begin = harness.cycle;
    harness.inputs[0].measurement.wrench[2] = 12.5;
    harness.step();
    assert_eq!(harness.value("stop.out"), 1.0, "in the same cycle");
    // The contact ends at once, but the motion stays stopped.
    harness.inputs[0].measurement.wrench[2] = 0.0;
    while !harness.terminated {
        harness.step();
        assert!(harness.cycle < CYCLES_MAX);
    }
    let took_s = (harness.cycle - begin) as f64 * 1e-3;
    assert!(
        (took_s - stop_s).abs() <= 1e-3 + 1e-9,
        "{took_s} s, not {stop_s} s"
    );
    assert!(harness.value("move.distance") < 0.08);
}

#[test]
fn the_guarded_line_stops_when_the_sensor_is_lost() {
    let cell = demo();
    let mut harness = harness("guarded-line", &cell);
    (0..500).for_each(|_| harness.step());
    let before = harness.value("move.distance");
    harness.inputs[0].present = false;
    while !harness.terminated {
        harness.step();
        assert!(harness.cycle < CYCLES_MAX);
    }
    assert!(harness.value("move.distance") - before < 0.02);
}

#[test]
fn the_torch_is_on_exactly_between_its_positions() {
    let cell = demo();
    let mut harness = harness("welding-line", &cell);
    let torch = channel(&cell, "lwr", "torch");
    let mut burnt = 0;
    while !harness.terminated {
        harness.step();
        let distance = harness.value("move.distance");
        let burning = digital(&harness, torch).expect("it is always commanded");
        assert_eq!(
            burning,
            distance > 0.05 && distance < 0.1,
            "at {distance} m"
        );
        burnt += u32::from(burning);
    }
    assert!(burnt > 400, "{burnt} cycles");
}

#[test]
fn the_torch_is_off_from_the_cycle_of_the_cancel() {
    let cell = demo();
    let mut harness = harness("welding-line", &cell);
    let torch = channel(&cell, "lwr", "torch");
    while digital(&harness, torch) != Some(true) {
        harness.step();
    }
    (0..100).for_each(|_| harness.step());
    harness.cancel = true;
    while !harness.terminated {
        harness.step();
        assert_eq!(digital(&harness, torch), Some(false));
        assert!(harness.cycle < CYCLES_MAX);
    }
    assert!(harness.value("move.distance") < 0.1);
}

#[test]
fn blink_switches_the_lamp_at_its_times_and_ends() {
    let cell = demo();
    let (mut harness, lamp) = (harness("blink", &cell), channel(&cell, "io", "lamp"));
    let mut on = Vec::new();
    while !harness.terminated {
        harness.step();
        if digital(&harness, lamp) == Some(true) {
            on.push(harness.cycle);
        }
    }
    assert_eq!(
        (on.first(), on.len(), harness.cycle),
        (Some(&502), 999, 2002)
    );
}

#[test]
fn mirror_shows_the_door() {
    let cell = demo();
    let mut harness = harness("mirror", &cell);
    let (door, lamp) = (
        channel(&cell, "io", "door_closed"),
        channel(&cell, "io", "lamp"),
    );
    for value in [false, true, false] {
        set_digital(&mut harness, door, value);
        harness.step();
        assert_eq!(digital(&harness, lamp), Some(value));
    }
    harness.inputs[door.0].present = false;
    harness.step();
    assert_eq!(digital(&harness, lamp), None);
}

#[test]
fn scale_commands_what_it_computes() {
    let cell = demo();
    let mut harness = harness("scale", &cell);
    let (temperature, belt) = (
        channel(&cell, "io", "temperature"),
        channel(&cell, "io", "belt_speed"),
    );
    for (kelvin, speed) in [(300.0, 0.01), (300.1, 0.0101), (280.0, 0.0099)] {
        harness.inputs[temperature.0].measurement.analog[temperature.1] = kelvin;
        harness.step();
        let commanded = harness.outputs[belt.0].analog[belt.1];
        assert!(
            (commanded - speed).abs() < 1e-12,
            "{kelvin} K: {commanded} m/s"
        );
    }
}

#[test]
fn rising_edge_ends_when_the_door_is_closed_after_it_was_open() {
    let cell = demo();
    let (mut harness, door) = (
        harness("rising-edge", &cell),
        channel(&cell, "io", "door_closed"),
    );
    for (closed, ends) in [(true, false), (true, false), (false, false), (true, true)] {
        set_digital(&mut harness, door, closed);
        harness.step();
        assert_eq!(harness.terminated, ends);
    }
}

#[test]
fn or_else_continues_without_a_value() {
    let cell = demo();
    let mut harness = harness("or-else", &cell);
    assert!(harness.net.plan.survives_device_loss);
    let (wire, belt) = (
        channel(&cell, "lwr", "wire_speed_measured"),
        channel(&cell, "io", "belt_speed"),
    );
    for (present, lamp, speed) in [(true, false, 0.2), (false, true, 0.05), (true, false, 0.2)] {
        harness.inputs[wire.0].measurement.analog[wire.1] = 0.2;
        harness.inputs[wire.0].present = present;
        harness.step();
        assert_eq!(digital(&harness, channel(&cell, "io", "lamp")), Some(lamp));
        assert_eq!(harness.outputs[belt.0].analog[belt.1], speed);
    }
}

#[test]
fn feedback_filters_and_recovers_from_null() {
    let cell = demo();
    let (mut harness, temperature) = (
        harness("feedback", &cell),
        channel(&cell, "io", "temperature"),
    );
    let mut step = |kelvin: f64| {
        harness.inputs[temperature.0].measurement.analog[temperature.1] = kelvin;
        harness.step();
        harness.value("y.out")
    };
    assert_eq!(step(300.0), 300.0);
    assert!((step(400.0) - 301.0).abs() < 1e-9);
    assert!((step(400.0) - 301.99).abs() < 1e-9);
    assert!(step(f64::NAN).is_nan());
    assert_eq!(step(310.0), 310.0);
}

#[test]
fn toggle_keeps_its_lamp() {
    let cell = demo();
    let mut harness = harness("toggle", &cell);
    let (door, lamp) = (
        channel(&cell, "io", "door_closed"),
        channel(&cell, "io", "lamp"),
    );
    let expected = [
        (false, false),
        (true, true),
        (true, true),
        (false, true),
        (true, false),
        (false, false),
    ];
    for (closed, lit) in expected {
        set_digital(&mut harness, door, closed);
        harness.step();
        assert_eq!(digital(&harness, lamp), Some(lit));
    }
}

#[test]
fn new_goal_ends_at_the_second_goal_within_half_of_the_robot_s_limits() {
    let cell = demo();
    let limits = cell.models()[0].limits;
    let mut harness = harness("new-goal", &cell);
    let (mut position, mut velocity) = (DEMO_START, [0.0; 7]);
    let mut acceleration = [0.0; 7];
    while !harness.terminated {
        harness.step();
        assert!(harness.cycle < CYCLES_MAX, "it does not end");
        let now = harness.values("move.position");
        for (joint, now) in now.into_iter().enumerate() {
            let speed = (now - position[joint]) / 1e-3;
            let rate = (speed - velocity[joint]) / 1e-3;
            let jerk = (rate - acceleration[joint]) / 1e-3;
            let within = |value: f64, limit: f64| value.abs() <= 0.5 * limit * 1.001 + 1e-3;
            assert!(within(speed, limits.velocity_max[joint]), "{speed}");
            assert!(within(rate, limits.acceleration_max[joint]), "{rate}");
            assert!(within(jerk, limits.jerk_max[joint]), "{jerk}");
            (position[joint], velocity[joint], acceleration[joint]) = (now, speed, rate);
        }
    }
    let goal = [-15.0_f64, -20.0, 0.0, 80.0, 10.0, -60.0, -20.0].map(f64::to_radians);
    for (now, goal) in position.into_iter().zip(goal) {
        assert!((now - goal).abs() < 1e-12, "{now} {goal}");
    }
}

#[test]
fn the_seam_correction_stays_within_its_bound_while_the_line_continues() {
    let cell = demo();
    let mut harness = harness("seam", &cell);
    let (mut last, mut fastest) = (0.0, 0.0_f64);
    let mut widest = 0.0_f64;
    while !harness.terminated {
        let wish = match harness.cycle {
            0..1000 => 0.004,
            1000..1800 => 0.015,
            _ => f64::NAN,
        };
        harness.set_real("beside.value", wish);
        harness.step();
        assert!(harness.cycle < CYCLES_MAX, "it does not end");
        let (path, seam) = (harness.values("move.pose"), harness.values("seam.pose_out"));
        let offset = harness.value("seam.offset");
        assert!((seam[0] - path[0] - offset).abs() < 1e-12 && seam[1] == path[1]);
        let limited = harness.value("seam.limited");
        assert_eq!(limited == 1.0, wish > 0.01, "beyond the bound is said");
        fastest = fastest.max((offset - last).abs() / 1e-3);
        widest = widest.max(offset);
        last = offset;
        if harness.cycle == 900 {
            assert!((offset - 0.004).abs() < 1e-12, "{offset}");
        }
    }
    assert!((widest - 0.01).abs() < 1e-12, "{widest}");
    assert_eq!(last, widest, "a null wish leaves the offset where it is");
    assert!(fastest <= 0.02 * (1.0 + 1e-9), "{fastest}");
    assert!((harness.value("move.pose") - 0.538).abs() < 1e-3);
}
