//! Every net in `configs/nets` compiles for the demo cell, runs in virtual time and does what it is there to show.

mod harness;

use harness::{NetHarness, cell, eight, example, folder};
use rcc_config::CellConfig;
use rcc_core::path::PathLimits;
use rcc_core::pose::Pose;
use rcc_language::fault;
use rcc_motion::stop_time;

/// The start of the demo's arm, see `configs/cells/demo.yaml`.
const START: [f64; 7] = [
    0.0,
    (-30.0_f64).to_radians(),
    0.0,
    90.0_f64.to_radians(),
    0.0,
    (-60.0_f64).to_radians(),
    0.0,
];
const FIGURES: [&str; 3] = ["line", "guarded-line", "welding-line"];
/// No example takes longer.
const CYCLES_MAX: u64 = 20_000;

fn demo() -> CellConfig {
    cell("configs/cells/demo.yaml")
}

fn bench(name: &str, cell: &CellConfig) -> NetHarness {
    NetHarness::new(example(name, cell), cell, START)
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

fn set_digital(bench: &mut NetHarness, (device, channel): (usize, usize), value: bool) {
    let digital = &mut bench.inputs[device].measurement.digital;
    *digital = *digital & !(1 << channel) | u64::from(value) << channel;
}

/// The commanded value of a digital output; `None`: not commanded.
fn digital(bench: &NetHarness, (device, channel): (usize, usize)) -> Option<bool> {
    let output = &bench.outputs[device];
    (output.digital_commanded >> channel & 1 == 1).then_some(output.digital >> channel & 1 == 1)
}

fn pose(values: &[f64]) -> Pose {
    Pose::from_slots(values.try_into().unwrap())
}

/// How far a point is from the line through two others, m.
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
        let mut bench = bench(&name, &cell);
        assert_eq!(bench.net.net, name, "a net is named as its file");
        assert!(
            !bench.net.description.is_empty(),
            "{name} says what it shows"
        );
        for cycle in 0..2000 {
            bench
                .inputs
                .iter_mut()
                .for_each(|input| input.present = cycle % 700 != 699);
            bench.step();
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
            &[fault::NOT_CANCELABLE][..]
        } else {
            &[]
        };
        assert_eq!(codes, expected, "{name}");
    }
}

#[test]
fn the_figures_end_on_their_lines_one_after_the_other() {
    let cell = demo();
    let arm = cell.models()[0].arm.unwrap();
    let mut hold = START;
    for name in FIGURES {
        let mut bench = NetHarness::new(example(name, &cell), &cell, hold);
        let (from, to) = (arm.forward(&eight(&hold)), pose(&bench.values_of_goal()));
        while !bench.terminated {
            bench.step();
            assert!(bench.cycle < CYCLES_MAX, "{name} does not end");
            let set_point = bench.outputs[0].position;
            assert!(
                bench.outputs[0].has_position,
                "{name}: cycle {}",
                bench.cycle
            );
            hold.copy_from_slice(&set_point[..7]);
            let flange = arm.forward(&eight(&hold));
            assert!(
                off_line(&flange, &from, &to) < 1e-9,
                "{name}: cycle {}",
                bench.cycle
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
        assert_eq!(bench.value("move.done"), 1.0);
        assert!(
            arm.forward(&eight(&hold)).distance_to(&to) < 1e-9,
            "{name} ends at its goal"
        );
    }
}

impl NetHarness {
    /// The goal of the motion: the only pose among the constants of the examples.
    fn values_of_goal(&self) -> Vec<f64> {
        let down = |pose: &&[f64]| (pose[4] - 1.0).abs() < 1e-9 && pose[0] > 0.1;
        self.net.plan.reals.windows(7).find(down).unwrap().to_vec()
    }
}

/// Limits of the guarded line; a stop does not depend on the length.
const LINE: PathLimits = PathLimits {
    length: 0.0,
    velocity: 0.1,
    acceleration: 0.5,
    jerk: 5.0,
};

#[test]
fn the_guarded_line_stops_within_its_limits_when_the_force_rises() {
    let cell = demo();
    let mut bench = bench("guarded-line", &cell);
    while bench.value("move.distance").is_nan() || bench.value("move.distance") < 0.05 {
        bench.step();
        assert_eq!(bench.value("stop.out"), 0.0);
    }
    let stop_s = stop_time(
        bench.value("move.speed"),
        bench.value("move.acceleration"),
        &LINE,
    );
    let begin = bench.cycle;
    bench.inputs[0].measurement.wrench[2] = 12.5;
    bench.step();
    assert_eq!(bench.value("stop.out"), 1.0, "in the same cycle");
    // The contact is over at once; the motion stays stopped all the same.
    bench.inputs[0].measurement.wrench[2] = 0.0;
    while !bench.terminated {
        bench.step();
        assert!(bench.cycle < CYCLES_MAX);
    }
    let took_s = (bench.cycle - begin) as f64 * 1e-3;
    assert!(
        (took_s - stop_s).abs() <= 1e-3 + 1e-9,
        "{took_s} s, not {stop_s} s"
    );
    assert!(bench.value("move.distance") < 0.08);
}

#[test]
fn the_guarded_line_stops_when_the_sensor_is_lost() {
    let cell = demo();
    let mut bench = bench("guarded-line", &cell);
    (0..500).for_each(|_| bench.step());
    let before = bench.value("move.distance");
    bench.inputs[0].present = false;
    while !bench.terminated {
        bench.step();
        assert!(bench.cycle < CYCLES_MAX);
    }
    assert!(bench.value("move.distance") - before < 0.02);
}

#[test]
fn the_torch_burns_exactly_between_its_positions() {
    let cell = demo();
    let mut bench = bench("welding-line", &cell);
    let torch = channel(&cell, "lwr", "torch");
    let mut burnt = 0;
    while !bench.terminated {
        bench.step();
        let distance = bench.value("move.distance");
        let burning = digital(&bench, torch).expect("it is always commanded");
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
    let mut bench = bench("welding-line", &cell);
    let torch = channel(&cell, "lwr", "torch");
    while digital(&bench, torch) != Some(true) {
        bench.step();
    }
    (0..100).for_each(|_| bench.step());
    bench.cancel = true;
    while !bench.terminated {
        bench.step();
        assert_eq!(digital(&bench, torch), Some(false));
        assert!(bench.cycle < CYCLES_MAX);
    }
    assert!(bench.value("move.distance") < 0.1);
}

#[test]
fn blink_switches_the_lamp_at_its_times_and_ends() {
    let cell = demo();
    let (mut bench, lamp) = (bench("blink", &cell), channel(&cell, "io", "lamp"));
    let mut on = Vec::new();
    while !bench.terminated {
        bench.step();
        if digital(&bench, lamp) == Some(true) {
            on.push(bench.cycle);
        }
    }
    assert_eq!((on.first(), on.len(), bench.cycle), (Some(&502), 999, 2002));
}

#[test]
fn mirror_shows_the_door() {
    let cell = demo();
    let mut bench = bench("mirror", &cell);
    let (door, lamp) = (
        channel(&cell, "io", "door_closed"),
        channel(&cell, "io", "lamp"),
    );
    for value in [false, true, false] {
        set_digital(&mut bench, door, value);
        bench.step();
        assert_eq!(digital(&bench, lamp), Some(value));
    }
    bench.inputs[door.0].present = false;
    bench.step();
    assert_eq!(digital(&bench, lamp), None);
}

#[test]
fn scale_commands_what_it_computes() {
    let cell = demo();
    let mut bench = bench("scale", &cell);
    let (temperature, belt) = (
        channel(&cell, "io", "temperature"),
        channel(&cell, "io", "belt_speed"),
    );
    for (kelvin, speed) in [(300.0, 0.01), (300.1, 0.0101), (280.0, 0.0099)] {
        bench.inputs[temperature.0].measurement.analog[temperature.1] = kelvin;
        bench.step();
        let commanded = bench.outputs[belt.0].analog[belt.1];
        assert!(
            (commanded - speed).abs() < 1e-12,
            "{kelvin} K: {commanded} m/s"
        );
    }
}

#[test]
fn rising_edge_ends_when_the_door_is_closed_after_it_was_open() {
    let cell = demo();
    let (mut bench, door) = (
        bench("rising-edge", &cell),
        channel(&cell, "io", "door_closed"),
    );
    for (closed, ends) in [(true, false), (true, false), (false, false), (true, true)] {
        set_digital(&mut bench, door, closed);
        bench.step();
        assert_eq!(bench.terminated, ends);
    }
}

#[test]
fn or_else_goes_on_without_a_value() {
    let cell = demo();
    let mut bench = bench("or-else", &cell);
    assert!(bench.net.plan.survives_device_loss);
    let (wire, belt) = (
        channel(&cell, "lwr", "wire_speed_measured"),
        channel(&cell, "io", "belt_speed"),
    );
    for (present, lamp, speed) in [(true, false, 0.2), (false, true, 0.05), (true, false, 0.2)] {
        bench.inputs[wire.0].measurement.analog[wire.1] = 0.2;
        bench.inputs[wire.0].present = present;
        bench.step();
        assert_eq!(digital(&bench, channel(&cell, "io", "lamp")), Some(lamp));
        assert_eq!(bench.outputs[belt.0].analog[belt.1], speed);
    }
}

#[test]
fn feedback_filters_and_forgets_null() {
    let cell = demo();
    let (mut bench, temperature) = (
        bench("feedback", &cell),
        channel(&cell, "io", "temperature"),
    );
    let mut step = |kelvin: f64| {
        bench.inputs[temperature.0].measurement.analog[temperature.1] = kelvin;
        bench.step();
        bench.value("y.out")
    };
    assert_eq!(step(300.0), 300.0);
    assert!((step(400.0) - 301.0).abs() < 1e-9);
    assert!((step(400.0) - 301.99).abs() < 1e-9);
    assert!(step(f64::NAN).is_nan());
    assert_eq!(step(310.0), 310.0);
}

#[test]
fn toggle_remembers_its_lamp() {
    let cell = demo();
    let mut bench = bench("toggle", &cell);
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
        set_digital(&mut bench, door, closed);
        bench.step();
        assert_eq!(digital(&bench, lamp), Some(lit));
    }
}

#[test]
fn new_goal_ends_at_the_second_goal_within_half_of_the_robot_s_limits() {
    let cell = demo();
    let limits = cell.models()[0].limits;
    let mut bench = bench("new-goal", &cell);
    let (mut position, mut velocity) = (START, [0.0; 7]);
    let mut acceleration = [0.0; 7];
    while !bench.terminated {
        bench.step();
        assert!(bench.cycle < CYCLES_MAX, "it does not end");
        let now = bench.values("move.position");
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
fn the_seam_is_followed_aside_within_the_bound_while_the_line_goes_on() {
    let cell = demo();
    let mut bench = bench("seam", &cell);
    let (mut last, mut fastest) = (0.0, 0.0_f64);
    let mut widest = 0.0_f64;
    while !bench.terminated {
        let wish = match bench.cycle {
            0..1000 => 0.004,
            1000..1800 => 0.015,
            _ => f64::NAN,
        };
        bench.set_real("beside.value", wish);
        bench.step();
        assert!(bench.cycle < CYCLES_MAX, "it does not end");
        let (path, seam) = (bench.values("move.pose"), bench.values("seam.pose_out"));
        let offset = bench.value("seam.offset");
        assert!((seam[0] - path[0] - offset).abs() < 1e-12 && seam[1] == path[1]);
        let limited = bench.value("seam.limited");
        assert_eq!(limited == 1.0, wish > 0.01, "beyond the bound is said");
        fastest = fastest.max((offset - last).abs() / 1e-3);
        widest = widest.max(offset);
        last = offset;
        if bench.cycle == 900 {
            assert!((offset - 0.004).abs() < 1e-12, "{offset}");
        }
    }
    assert!((widest - 0.01).abs() < 1e-12, "{widest}");
    assert_eq!(last, widest, "a null wish leaves the offset where it is");
    assert!(fastest <= 0.02 * (1.0 + 1e-9), "{fastest}");
    assert!((bench.value("move.pose") - 0.538).abs() < 1e-3);
}
