//! Nets that the predecessor's library generated: they load, or what is missing is reported with its span.

#[path = "../../language/tests/harness/mod.rs"]
mod harness;

use harness::{NetHarness, cell, folder};
use rcc_config::CellConfig;
use rcc_core::filter::Biquad;
use rcc_directionet::{NOTATION, compiler};
use rcc_language::devices::DeviceTable;
use rcc_language::parse::parse;
use rcc_language::{Compiled, Faults};

fn compile(text: &str, file: &str, cell: &CellConfig) -> Result<Compiled, Faults> {
    compiler(&DeviceTable::from(cell)).compile(text, file)
}

fn demo() -> CellConfig {
    cell("configs/cells/demo.yaml")
}

fn text(name: &str) -> String {
    std::fs::read_to_string(folder("tests/data/directionet").join(name)).unwrap()
}

/// Returns all nets, `flat/…` and `nested/…`, sorted.
fn all() -> Vec<String> {
    let mut names = Vec::new();
    for kind in ["flat", "nested"] {
        let files = std::fs::read_dir(folder("tests/data/directionet").join(kind)).unwrap();
        let files = files.map(|file| file.unwrap().file_name().to_string_lossy().into_owned());
        names.extend(files.map(|file| format!("{kind}/{file}")));
    }
    names.sort();
    names
}

/// Compiles a net with header lines prepended.
fn load(header: &str, name: &str, cell: &CellConfig) -> Result<Compiled, Faults> {
    compile(&format!("{header}\n{}", text(name)), name, cell)
}

#[test]
fn an_output_is_set_as_the_net_states() {
    let cell = demo();
    let header = "# devices: io0=io\n# end: _2";
    let name = "flat/do_set-01-io-digital-output-0-setdigitalva.net";
    let net = load(header, name, &cell).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(net.net, "do-set-01-io-digital-output-0-setdigitalva");
    let mut harness = NetHarness::new(net, &cell, [0.0; 7]);
    harness.step();
    let (io, _) = cell.device("io").unwrap();
    assert_eq!(harness.outputs[io].digital_commanded, 1);
    assert_eq!(harness.outputs[io].digital, 1);
}

#[test]
fn unknown_devices_are_reported_once_with_a_remedy() {
    let name = "flat/kr_lin-01-kr-ptp.net";
    let faults = load("", name, &demo()).unwrap_err();
    let devices: Vec<_> = faults
        .diagnostics
        .iter()
        .filter(|fault| fault.code == rcc_language::codes::UNKNOWN_DEVICE)
        .collect();
    assert_eq!(devices.len(), 1);
    let help = devices[0].help.as_ref().unwrap();
    assert!(help.contains("# devices: kr=NAME"), "{help}");
}

#[test]
fn all_errors_of_a_text_are_reported_with_their_spans() {
    let text = "{a=Core::DoubleAdd(inFrist=b.outValue,Second='x'),b=Core::DubleValue(Value='1'),\
        c=Core::TimeWall(),d=Core::DoubleAdd(inFirst=nobody.outValue,inSecond=a.outVal),outTerminate=a.outValue}";
    let faults = compile(text, "net", &demo()).unwrap_err();
    let places: Vec<&str> = faults
        .diagnostics
        .iter()
        .filter_map(|fault| fault.place)
        .map(|place| &text[place.start..place.end])
        .collect();
    assert_eq!(
        places,
        [
            "inFrist",
            "x",
            "Core::DubleValue",
            "Core::TimeWall",
            "nobody",
            "outVal"
        ]
    );
}

#[test]
fn arrays_beyond_the_longest_length_are_refused_before_they_are_built() {
    use rcc_language::codes;
    // One array more than the limit of 2^20 elements.
    let many: Vec<String> = (0..1025)
        .map(|number| format!("{number}=Core::DoubleArray(Size='1024')"))
        .collect();
    let texts = [
        (
            codes::BAD_ELEMENT,
            "{1=Core::DoubleArray(Size='1'),2=Core::DoubleArraySlice(inArray=1.outArray,Size='1',Start='4294967294')}".to_owned(),
        ),
        (
            codes::BAD_ELEMENT,
            "{1=Core::DoubleArray(Size='1'),2=Core::DoubleArraySlice(inArray=1.outArray,Size='2',Start='1023')}".to_owned(),
        ),
        (
            codes::OUT_OF_RANGE,
            "{1=Core::DoubleArray(Size='1'),2=Core::DoubleArraySetNull(inValue=1.outArray,Size='4000000000')}".to_owned(),
        ),
        (codes::NET_TOO_LARGE, format!("{{{}}}", many.join(","))),
    ];
    for (code, text) in texts {
        let faults = compile(&text, "net", &demo()).unwrap_err();
        let found = faults.diagnostics.iter().filter(|fault| fault.code == code);
        let shown = &text[..text.len().min(120)];
        assert_eq!(found.count(), 1, "{shown}\n{faults}");
    }
}

/// A motion to run: its file, start, the keys that end it, and the goal that the text states.
struct Motion {
    file: &'static str,
    start: [f64; 7],
    end: &'static str,
    goal: [f64; 7],
}

/// Goals of the PTP motions of the library's programs, as their texts state them.
const AFTER_PTP: [f64; 7] = [0.3, 0.4, 0.0, -1.4, 0.0, 1.1, 0.0];
const ZERO: [f64; 7] = [0.0; 7];

const PTP: &[Motion] = &[
    Motion {
        file: "flat/lwr_lin-01-lwr-ptp.net",
        start: ZERO,
        end: "_2",
        goal: AFTER_PTP,
    },
    Motion {
        file: "flat/lwr_lin_blend-01-lwr-ptp.net",
        start: ZERO,
        end: "_1",
        goal: AFTER_PTP,
    },
    Motion {
        file: "flat/lwr_spline-01-lwr-ptp.net",
        start: ZERO,
        end: "_1",
        goal: AFTER_PTP,
    },
];

/// Runs a net until it terminates by its own result; the arm follows without delay.
fn run(motion: &Motion, cell: &CellConfig) -> Vec<[f64; 7]> {
    let header = format!("# end: {}", motion.end);
    let net = load(&header, motion.file, cell).unwrap_or_else(|faults| panic!("{faults}"));
    let mut harness = NetHarness::new(net, cell, motion.start);
    let (lwr, _) = cell.device("lwr").unwrap();
    let mut trace = vec![motion.start];
    while !harness.terminated {
        assert!(harness.cycle < 5000, "{} does not end", motion.file);
        harness.step();
        let output = &harness.outputs[lwr];
        assert!(
            output.has_position,
            "{} in cycle {}",
            motion.file, harness.cycle
        );
        trace.push(output.position[..7].try_into().unwrap());
        let position = output.position;
        harness.inputs[lwr].measurement.hold = position;
        harness.inputs[lwr].measurement.position = position;
    }
    trace
}

/// Asserts that the set-points are finite, within the limits of the arm's configuration, and without a jump at the
/// start.
fn check_trace(trace: &[[f64; 7]], file: &str, cell: &CellConfig) {
    let (lwr, _) = cell.device("lwr").unwrap();
    let limits = cell.models()[lwr].limits;
    for joint in 0..7 {
        let of = |cycle: usize| trace[cycle][joint];
        for cycle in 1..trace.len() {
            let position = of(cycle);
            let within = position >= limits.lower[joint] && position <= limits.upper[joint];
            assert!(within, "{file}: joint {joint} at {position}");
            let velocity = (position - of(cycle - 1)).abs() / 1e-3;
            assert!(
                velocity <= limits.velocity_max[joint],
                "{file}: joint {joint}: {velocity} rad/s"
            );
        }
        let jump = (of(1) - of(0)).abs();
        assert!(
            jump < 0.1_f64.to_radians(),
            "{file}: joint {joint} jumps by {jump}"
        );
    }
}

#[test]
fn ptp_motions_end_at_their_goals_by_their_own_results() {
    let cell = demo();
    for motion in PTP {
        let trace = run(motion, &cell);
        check_trace(&trace, motion.file, &cell);
        let last = trace.last().unwrap();
        for (joint, goal) in motion.goal.iter().enumerate() {
            assert!(
                (last[joint] - goal).abs() < 1e-12,
                "{}: {last:?}",
                motion.file
            );
        }
    }
}

/// Largest jerk of a trace, as a share of the arm's limits.
fn jerk_share(trace: &[[f64; 7]], cell: &CellConfig) -> f64 {
    let (lwr, _) = cell.device("lwr").unwrap();
    let limits = cell.models()[lwr].limits;
    let shares = trace.windows(4).flat_map(|at| {
        (0..7).map(move |joint| {
            let change = at[3][joint] - 3.0 * at[2][joint] + 3.0 * at[1][joint] - at[0][joint];
            (change / 1e-9 / limits.jerk_max[joint]).abs()
        })
    });
    shares.fold(0.0, f64::max)
}

#[test]
fn the_filter_of_the_manual_brings_ptp_motions_within_the_limits_of_jerk() {
    let cell = demo();
    for motion in PTP {
        let mut trace = run(motion, &cell)[1..].to_vec();
        // `OnDelay` of 1 s before the end.
        trace.extend(vec![*trace.last().unwrap(); 1000]);
        assert!(jerk_share(&trace, &cell) > 1.0, "{}", motion.file);
        let mut filtered = trace.clone();
        let filter = Biquad::low_pass(2.0, 1.0, 1e-3);
        for joint in 0..7 {
            let mut before = [trace[0][joint]; 4];
            for (place, at) in filtered.iter_mut().zip(&trace) {
                let ([x1, x2, y1, y2], x) = (before, at[joint]);
                let y = filter.b[0] * x + filter.b[1] * x1 + filter.b[2] * x2
                    - filter.a[0] * y1
                    - filter.a[1] * y2;
                (place[joint], before) = (y, [x, x1, y, y1]);
            }
        }
        let share = jerk_share(&filtered, &cell);
        assert!(share < 1.0, "{}: {share}", motion.file);
        let last = filtered.last().unwrap();
        for (joint, goal) in motion.goal.iter().enumerate() {
            assert!(
                (last[joint] - goal).abs() < 1e-4,
                "{}: {last:?}",
                motion.file
            );
        }
    }
}

#[test]
fn straight_motions_stay_on_their_lines() {
    let cell = demo();
    let (lwr, _) = cell.device("lwr").unwrap();
    let arm = cell.models()[lwr].arm.unwrap();
    for (file, start, end) in [
        ("flat/lwr_lin-02-lwr-lin.net", AFTER_PTP, "_2"),
        ("flat/lwr_lin_blend-02-lwr-lin.net", AFTER_PTP, "_4"),
    ] {
        let motion = Motion {
            file,
            start,
            end,
            goal: ZERO,
        };
        let trace = run(&motion, &cell);
        check_trace(&trace, file, &cell);
        let poses: Vec<_> = trace
            .iter()
            .map(|joints| arm.forward(&harness::eight(joints)))
            .collect();
        let (first, last) = (poses[0], poses[poses.len() - 1]);
        let way: [f64; 3] = std::array::from_fn(|i| last.position[i] - first.position[i]);
        let length = way.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!(length > 0.05, "{file} moves {length} m");
        for pose in &poses {
            let from: [f64; 3] = std::array::from_fn(|i| pose.position[i] - first.position[i]);
            let along = (0..3).map(|i| from[i] * way[i]).sum::<f64>() / length;
            let beside = (0..3)
                .map(|i| (from[i] - along * way[i] / length).powi(2))
                .sum::<f64>();
            assert!(
                beside.sqrt() < 1e-9,
                "{file}: {} m beside the line",
                beside.sqrt()
            );
            assert!(first.angle_to(pose) < 1e-7, "{file}: it turns");
        }
    }
}

/// Runs a net of the blended program and returns its final position.
fn leg(file: &'static str, start: [f64; 7], end: &'static str, cell: &CellConfig) -> [f64; 7] {
    let goal = ZERO;
    let trace = run(
        &Motion {
            file,
            start,
            end,
            goal,
        },
        cell,
    );
    check_trace(&trace, file, cell);
    *trace.last().unwrap()
}

#[test]
fn three_successive_lines_return_to_the_start() {
    let cell = demo();
    let (lwr, _) = cell.device("lwr").unwrap();
    let arm = cell.models()[lwr].arm.unwrap();
    let first = leg("flat/lwr_lin_blend-02-lwr-lin.net", AFTER_PTP, "_3", &cell);
    let second = leg("flat/lwr_lin_blend-03-lwr-lin.net", first, "_1", &cell);
    let third = leg("flat/lwr_lin_blend-05-lwr-lin.net", second, "_1", &cell);
    let (begun, back) = (
        arm.forward(&harness::eight(&AFTER_PTP)),
        arm.forward(&harness::eight(&third)),
    );
    for axis in 0..3 {
        assert!((begun.position[axis] - back.position[axis]).abs() < 1e-12);
    }
    assert!(begun.angle_to(&back) < 1e-7);
}

#[test]
fn blended_lines_started_half_way_end_at_the_same_pose() {
    let cell = demo();
    let (lwr, _) = cell.device("lwr").unwrap();
    let arm = cell.models()[lwr].arm.unwrap();
    let whole = leg("flat/lwr_lin_blend-02-lwr-lin.net", AFTER_PTP, "_3", &cell);
    let half = leg("flat/lwr_lin_blend-02-lwr-lin.net", AFTER_PTP, "_4", &cell);
    let whole = leg("flat/lwr_lin_blend-03-lwr-lin.net", whole, "_1", &cell);
    let correcting = "flat/lwr_lin_blend-04-lwr-cartesianerrorcorrection-lin.net";
    let blended = leg(correcting, half, "_4", &cell);
    let half = leg(correcting, half, "_1", &cell);
    let end = leg("flat/lwr_lin_blend-05-lwr-lin.net", whole, "_1", &cell);
    let correcting = "flat/lwr_lin_blend-06-lwr-cartesianerrorcorrection-lin.net";
    let last = leg(correcting, half, "_3", &cell);
    for (whole, blended) in [(whole, blended), (end, last)] {
        let (whole, blended) = (
            arm.forward(&harness::eight(&whole)),
            arm.forward(&harness::eight(&blended)),
        );
        for axis in 0..3 {
            assert!((whole.position[axis] - blended.position[axis]).abs() < 1e-12);
        }
    }
}

#[test]
fn a_spline_ends_at_the_stated_height_but_exceeds_the_arms_velocity() {
    let cell = demo();
    let (lwr, _) = cell.device("lwr").unwrap();
    let model = &cell.models()[lwr];
    let trace = run(
        &Motion {
            file: "flat/lwr_spline-02-lwr-cartesianbezierspline.net",
            start: AFTER_PTP,
            end: "_1",
            goal: ZERO,
        },
        &cell,
    );
    let last = model
        .arm
        .unwrap()
        .forward(&harness::eight(trace.last().unwrap()));
    // A number from the text.
    assert!((last.position[2] - 0.4174850272742231).abs() < 1e-12);
    // The predecessor's driver passes it; RCC ends a net that commands it.
    let fastest = trace
        .windows(2)
        .map(|pair| (pair[1][0] - pair[0][0]).abs() / 1e-3);
    let fastest = fastest.fold(0.0, f64::max);
    assert!(fastest > model.limits.velocity_max[0], "{fastest} rad/s");
}

#[test]
fn an_output_follows_the_inputs_that_the_text_names() {
    let cell = demo();
    let header = "# devices: io0=io\n# channels: io.InBool.8=door_closed, io.InReal.1=temperature, io.OutBool.2=clamp";
    let name = "flat/do_mirror-01-io-digital-output-2-mirrordigita.net";
    let net = load(header, name, &cell).unwrap_or_else(|faults| panic!("{faults}"));
    let mut harness = NetHarness::new(net, &cell, ZERO);
    let (io, _) = cell.device("io").unwrap();
    // door_closed is the third digital input, temperature the second analog one, clamp the second output.
    for (door, temperature, clamp) in [
        (true, 0.7, true),
        (true, 0.5, false),
        (false, 0.7, false),
        (true, 0.6, true),
    ] {
        harness.inputs[io].measurement.digital = u64::from(door) << 2;
        harness.inputs[io].measurement.analog[1] = temperature;
        harness.step();
        assert_eq!(harness.outputs[io].digital >> 1 & 1 == 1, clamp);
    }
}

#[test]
fn a_line_begins_at_the_stated_pose() {
    let cell = demo();
    let (lwr, _) = cell.device("lwr").unwrap();
    let arm = cell.models()[lwr].arm.unwrap();
    // The first vector of flat/lwr_lin-02: computed by the predecessor's own kinematics.
    let predecessor = [
        -0.5294755315685863,
        -0.16378597519548818,
        0.5145808437891821,
    ];
    let position = arm.forward(&harness::eight(&AFTER_PTP)).position;
    for axis in 0..3 {
        assert!(
            (position[axis] - predecessor[axis]).abs() < 1e-12,
            "{position:?}"
        );
    }
}

#[test]
fn flat_and_nested_forms_give_the_same_set_points_bit_for_bit() {
    let cell = demo();
    let (lwr, _) = cell.device("lwr").unwrap();
    let mut pairs = 0;
    for name in all().iter().filter(|name| name.starts_with("flat/lwr")) {
        let nested = name.replacen("flat", "nested", 1);
        if !all().contains(&nested) {
            continue;
        }
        let harness = |name: &str| {
            let net = load("", name, &cell).unwrap_or_else(|faults| panic!("{faults}"));
            NetHarness::new(
                net,
                &cell,
                if name.contains("-01-") {
                    ZERO
                } else {
                    AFTER_PTP
                },
            )
        };
        let (mut flat, mut nested) = (harness(name), harness(&nested));
        for cycle in 0..1500 {
            flat.step();
            nested.step();
            let bits = |harness: &NetHarness| harness.outputs[lwr].position.map(f64::to_bits);
            assert_eq!(bits(&flat), bits(&nested), "{name} in cycle {cycle}");
        }
        pairs += 1;
    }
    assert_eq!(pairs, 7);
}

#[test]
fn every_net_for_the_demos_arm_loads() {
    let cell = demo();
    let mut loaded = 0;
    for name in all() {
        let header = "# devices: io0=io, iiwa=lwr\n# channels: io.InBool.8=door_closed, io.InReal.1=temperature, io.OutBool.2=clamp";
        match load(header, &name, &cell) {
            Ok(net) => {
                println!("{name}: {} primitives", net.names.primitives.len());
                loaded += 1;
            }
            Err(faults) => {
                assert!(name.contains("/kr_"), "{name}:\n{faults}");
                let told = |code| faults.diagnostics.iter().any(|fault| fault.code == code);
                assert!(
                    told(rcc_language::codes::UNKNOWN_DEVICE),
                    "{name}:\n{faults}"
                );
            }
        }
    }
    // All except the five nets for a KR with six axes.
    assert_eq!(loaded, 26);
}

#[test]
fn a_net_for_six_axes_is_refused_for_an_arm_of_seven() {
    let faults = load("# devices: kr=lwr", "flat/kr_lin-01-kr-ptp.net", &demo()).unwrap_err();
    let codes: Vec<_> = faults.diagnostics.iter().map(|fault| fault.code).collect();
    assert!(codes.contains(&rcc_language::codes::WRONG_ARM), "{faults}");
}

#[test]
fn a_net_converted_to_yaml_gives_the_same_plan() {
    let cell = demo();
    let table = DeviceTable::from(&cell);
    for name in all().iter().filter(|name| name.contains("/lwr")) {
        let text = text(name);
        let original = compile(&text, name, &cell).unwrap_or_else(|faults| panic!("{faults}"));
        let mut faults = Vec::new();
        let model = parse(&text, name, &table, &[NOTATION], &mut faults).unwrap();
        let yaml = rcc_language::write::yaml(&model);
        let converted = compile(&yaml, "yaml", &cell).unwrap_or_else(|faults| panic!("{faults}"));
        assert!(
            format!("{:?}", original.plan) == format!("{:?}", converted.plan),
            "{name}"
        );
    }
}

#[test]
fn a_net_survives_conversion_to_directionet_and_back() {
    let cell = demo();
    let table = DeviceTable::from(&cell);
    let yaml = "net: there-and-back\nprimitives:\n  cancel: {type: Cancel}\n  sum: {type: Add, inputs: {a: 1.5, b: 2.0}}\n  \
        big: {type: Greater, inputs: {a: sum.out, b: 3.0}}\n  stop: {type: Or, inputs: {a: cancel.requested, b: big.out}}\n  \
        lamp: {type: DigitalOutput, parameters: {device: io, channel: lamp}, inputs: {in: big.out}}\n  \
        end: {type: Termination, inputs: {done: stop.out}}\n";
    let there = |yaml: &str| {
        let compiled = compile(yaml, "net", &cell).unwrap_or_else(|faults| panic!("{faults}"));
        let mut faults = Vec::new();
        let model = parse(yaml, "net", &table, &[NOTATION], &mut faults).unwrap();
        let text = rcc_directionet::write::text(&model, &compiled.names, &table, &mut faults);
        text.ok_or(faults)
    };
    let text = there(yaml).unwrap();
    let net = compile(&text, "net", &cell).unwrap_or_else(|faults| panic!("{text}\n{faults}"));
    let mut harness = NetHarness::new(net, &cell, ZERO);
    harness.step();
    assert!(harness.terminated, "{text}");
    let (io, _) = cell.device("io").unwrap();
    assert_eq!(harness.outputs[io].digital & 1, 1);
    let yaml = yaml.replace(
        "{type: Add, inputs: {a: 1.5, b: 2.0}}",
        "{type: LowPass, parameters: {gain: 0.5}, inputs: {in: 1.5}}",
    );
    let faults = there(&yaml).unwrap_err();
    assert_eq!(faults[0].code, rcc_language::codes::NO_COUNTERPART);
}

/// A value that one net keeps from the application and another one reads, in the predecessor's notation; in RCC it is a
/// topic.
#[test]
fn values_between_nets_become_topics() {
    let cell = demo();
    let table = DeviceTable::from(&cell);
    let gives = "{a=Core::DoubleValue(Value='2.5'),\
        out=Core::DoubleNetcommOut(Key='Force',Report='false',inValue=a.outValue),\
        other=Core::BooleanInterNetcommOut(RemoteNet='Takes_It',RemoteKey='Go',inValue=Core::BooleanValue(Value='true').outValue),\
        shown=Core::DoubleNetcommOut(Key='Shown',inValue=a.outValue),outTerminate=Core::BooleanValue(Value='false').outValue}";
    let takes = "{force=Core::DoubleInterNetcommIn(RemoteRCC='',RemoteNet='Gives_It',RemoteKey='Force'),\
        big=Core::DoubleGreater(inFirst=force.outValue,inSecond=Core::DoubleValue(Value='1').outValue),\
        outTerminate=big.outValue}";
    let compiled = |text: &str, name: &str| {
        compile(text, name, &cell).unwrap_or_else(|faults| panic!("{faults}"))
    };
    let (gives, takes) = (
        compiled(gives, "Gives_It.net"),
        compiled(takes, "Takes_It.net"),
    );
    let published = gives.names.publishes.iter();
    let published: Vec<_> = published
        .map(|row| (row.topic.as_str(), row.type_name.as_str()))
        .collect();
    assert_eq!(
        published,
        [("gives-it/outForce", "Real"), ("takes-it/inGo", "Bool")]
    );
    assert_eq!(gives.names.monitors.len(), 1);
    let input = &takes.names.inputs[0];
    assert_eq!(input.topic.as_deref(), Some("gives-it/outForce"));
    // The topic of one net is the topic that the other publishes.
    let mut published = gives.plan.publishes.iter();
    assert!(published.any(|point| Some(point.topic) == takes.plan.inputs[0].topic));
    // And back to the predecessor's notation.
    let yaml = "net: gives\nprimitives:\n  force: {type: Subscribe, parameters: {topic: other/outForce}}\n  \
        big: {type: Greater, inputs: {a: force.value, b: 1.0}}\n  \
        give: {type: Publish, parameters: {topic: gives/outBig}, inputs: {in: big.out}}\n  \
        end: {type: Termination, inputs: {done: false}}\n";
    let converted = compiled(yaml, "net");
    let mut faults = Vec::new();
    let model = parse(yaml, "net", &table, &[NOTATION], &mut faults).unwrap();
    let text = rcc_directionet::write::text(&model, &converted.names, &table, &mut faults);
    let text = text.unwrap_or_else(|| panic!("{faults:?}"));
    let back = compiled(&text, "gives.net");
    assert_eq!(
        back.plan.publishes[0].topic,
        converted.plan.publishes[0].topic
    );
    assert_eq!(back.plan.inputs[0].topic, converted.plan.inputs[0].topic);
}

/// A KR 6, as the robot of nets for six axes.
fn six_axes() -> CellConfig {
    let text = "cell: six\nperiod: 1 ms\ndevices:\n  kr:\n    driver: ideal-arm\n    robot: ../robots/kr6_r900_2.yaml\n    \
                first_tolerance: deg(0.1)\n    delay: 80 ms\n    settings: {start: [0, -90 deg, 90 deg, 0, 30 deg, 0]}\n";
    let ports = std::collections::BTreeMap::new();
    CellConfig::parse(text, "six.yaml", &folder("configs/cells"), &ports)
        .unwrap_or_else(|faults| panic!("{faults}"))
}

#[test]
fn inverse_kinematics_of_six_axes_follow_any_hint() {
    let cell = six_axes();
    let hint = [0.0, -1.4, 1.5, 0.0, 0.3, 0.0];
    let mut text = "{1=Core::DoubleNetcommOut(inValue=2.outValue,Key='_1',Value='0.0'),\
                    2=Core::DoubleArrayGet(inArray=3.outJoints,Size='6',Index='0'),\
                    3=ArmKinematics::InvKin(inFrame=4.outValue,inHintJoints=25.outArray,Robot='kr'),\
                    4=World::FrameFromPosRot(X='0.6',Y='0.1',Z='0.7',A='0.0',B='1.2',C='0.0'),\
                    5=Core::BooleanValue(Value='false'),19=Core::DoubleArray(Size='6')"
        .to_owned();
    for (axis, position) in hint.iter().enumerate() {
        let (value, before, array) = (10 + axis, 19 + axis, 20 + axis);
        text.push_str(&format!(
            ",{value}=Core::DoubleValue(Value='{position:?}'),{array}=Core::DoubleArraySet(inArray={before}.outArray,\
             inValue={value}.outValue,Size='6',Index='{axis}')"
        ));
    }
    text.push_str(",outTerminate=5.outValue}");
    let net = compile(&text, "hint.net", &cell).unwrap_or_else(|faults| panic!("{faults}"));
    let mut harness = NetHarness::new(net, &cell, [0.0, -1.57, 1.57, 0.0, 0.5, 0.0, 0.0]);
    harness.step();
    let primitives = &harness.net.names.primitives;
    let inverse = primitives
        .iter()
        .find(|primitive| primitive.type_name == "InverseKinematicsNear")
        .expect("an inverse kinematics with a hint");
    let joints = harness.values(&format!("{}.joints", inverse.id));
    assert!(joints.iter().all(|joint| joint.is_finite()), "{joints:?}");
    let mut all = [0.0; 8];
    all[..6].copy_from_slice(&joints);
    let (kr, _) = cell.device("kr").unwrap();
    let flange = cell.models()[kr].arm.unwrap().forward(&all).position;
    let wanted = [0.6, 0.1, 0.7];
    assert!(
        (0..3).all(|axis| (flange[axis] - wanted[axis]).abs() < 1e-9),
        "{flange:?}"
    );
}
