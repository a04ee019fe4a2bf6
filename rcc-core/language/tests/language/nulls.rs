//! Tests of the null analysis: where null originates, how it propagates, and what stops it. Runs on a thread of the
//! test harness.

use std::path::{Path, PathBuf};

use crate::harness::{DEMO_START, NetHarness};
use proptest::prelude::*;
use rcc_config::CellConfig;
use rcc_language::compile;
use rcc_language::devices::DeviceTable;
use rcc_language::expand::expand;
use rcc_language::null_analysis::{NullAnalysis, NullCause, analyse_nulls, find_always_null};
use rcc_language::parse::parse;
use rcc_language::resolve::{NetGraph, OutputId, resolve};
use rcc_language::source_map::SourceMap;

/// Returns why each primitive of a net can be null, `-` if it cannot, in the order of the file.
fn why(primitives: &str) -> Vec<String> {
    let text = format!("net: test\nprimitives:\n{primitives}");
    look(&text, |graph, nulls| {
        let numbers = 0..graph.items.len();
        numbers
            .map(|number| nulls.why(graph, number).unwrap_or_else(|| "-".to_owned()))
            .collect()
    })
}

fn folder(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(path)
}

fn look<T>(text: &str, see: impl FnOnce(&NetGraph<'_>, &NullAnalysis) -> T) -> T {
    let cell = CellConfig::load_offline(&folder("configs/cells/demo.yaml"));
    let table = DeviceTable::from(&cell.unwrap());
    let mut faults = Vec::new();
    let net = parse(text, "net", &table, &[], &mut faults).unwrap();
    let flat = expand(net, &[], &mut SourceMap::new("net", text), &mut faults).unwrap();
    let graph = resolve(&flat, &table, &mut faults);
    assert!(faults.is_empty(), "{faults:?}");
    let nulls = analyse_nulls(&graph);
    see(&graph, &nulls)
}

#[test]
fn null_originates_at_a_device_and_propagates_to_its_readers() {
    let why = why("
  ft:    {type: ForceTorque, parameters: {device: lwr}}
  force: {type: Abs, inputs: {in: ft.fz}}
  touch: {type: Greater, inputs: {a: force.out, b: 12 N}}
  time:  {type: Time}
");
    assert_eq!(
        why,
        [
            "`lwr` is lost",
            "`lwr` is lost: ft",
            "`lwr` is lost: ft → force",
            "-"
        ]
    );
}

#[test]
fn a_known_fallback_stops_null() {
    let why = why("
  in:    {type: AnalogInput, parameters: {device: io, channel: temperature}}
  safe:  {type: OrElse, inputs: {in: in.out, other: 0}}
  both:  {type: OrElse, inputs: {in: in.out, other: in.out}}
  asked: {type: IsNull, inputs: {in: in.out}}
  chosen: {type: Select, inputs: {condition: asked.out, yes: 0, no: in.out}}
");
    assert_eq!(why[1], "-");
    assert!(why[2].contains("`io` is lost, or"), "{why:?}");
    assert_eq!(why[3], "-");
    // The analysis does not understand that `no` is selected only if it is known.
    assert!(why[4].ends_with(": in"), "{why:?}");
}

#[test]
fn causes_ruled_out_by_constants_and_ranges_are_ignored() {
    let why = why("
  time:  {type: Time}
  half:  {type: Divide, inputs: {a: time.out, b: 2 s}}
  bad:   {type: Divide, inputs: {a: 1, b: time.out}}
  zero:  {type: Divide, inputs: {a: time.out, b: 0}}
  two:   {type: Constant, parameters: {value: 2}}
  third: {type: Divide, inputs: {a: time.out, b: two.out}}
  root:  {type: SquareRoot, inputs: {in: bad.out}}
  four:  {type: SquareRoot, inputs: {in: 4}}
  kept:  {type: Limit, inputs: {in: half.out, low: 0, high: 1}}
  odd:   {type: Limit, inputs: {in: half.out, low: 1, high: 0}}
  sum:   {type: Add, inputs: {a: 1, b: 2}}
");
    let can: Vec<bool> = why.iter().map(|why| why != "-").collect();
    let wanted = [
        false, false, true, true, false, false, true, false, false, true, false,
    ];
    assert_eq!(can, wanted, "{why:?}");
    assert_eq!(why[2], "b = 0");
    assert_eq!(why[9], "low > high");
}

#[test]
fn a_delayed_link_is_null_in_the_first_cycle_unless_it_has_an_initial_value() {
    let why = why("
  time:   {type: Time}
  late:   {type: Negate, inputs: {in: {from: time.out, delayed: true}}}
  fine:   {type: Negate, inputs: {in: {from: time.out, delayed: true, initial: 0}}}
  none:   {type: Negate, inputs: {in: {from: time.out, delayed: true, initial: null}}}
");
    let first = "`in` is null in the first cycle";
    assert_eq!(why, ["-", first, "-", first]);
}

#[test]
fn a_loop_is_null_because_of_its_inputs_and_the_path_ends() {
    let path = folder("configs/nets/feedback.yaml");
    let text = std::fs::read_to_string(path).unwrap();
    look(&text, |graph, nulls| {
        let why = |id: &str| {
            let number = graph.items.iter().position(|item| item.id() == id).unwrap();
            nulls.why(graph, number).unwrap()
        };
        assert!(why("error").ends_with(": measured"), "{}", why("error"));
        assert!(why("y").contains("measured → "), "{}", why("y"));
    });
    let own = why("
  x: {type: OrElse, inputs: {in: {from: y.out, delayed: true, initial: null}, other: 0}}
  y: {type: Negate, inputs: {in: x.out}}
  z: {type: Negate, inputs: {in: {from: z.out, delayed: true, initial: null}}}
");
    assert_eq!(own, ["-", "-", "`in` is null in the first cycle"]);
}

#[test]
fn inputs_and_the_constant_null_can_be_null() {
    let text = "net: test\nprimitives:
  speed: {type: Input, parameters: {initial: 1}}
  goal:  {type: Input}
  void:  {type: Constant, parameters: {value: null}}
  out:   {type: Add, inputs: {a: speed.value, b: null}}
";
    look(text, |graph, nulls| {
        let why = |number| nulls.why(graph, number).unwrap();
        assert_eq!(nulls.item(0), Some(NullCause::NotSet));
        assert_eq!(
            [why(0), why(1), why(2)],
            ["it was set to null", "it is not set", "its value is null"]
        );
        assert_eq!(why(3), "`b` is the constant null");
        let inputs = [0, 1].map(|input| nulls.why_input(graph, 3, input).unwrap());
        assert_eq!(
            inputs,
            ["it was set to null: speed", "it is the constant null"]
        );
    });
}

#[test]
fn a_long_path_is_shown_by_its_ends() {
    let mut text = "  p0: {type: Input}\n".to_owned();
    for number in 1..20 {
        let before = number - 1;
        let port = if before == 0 { "value" } else { "out" };
        text += &format!("  p{number}: {{type: Negate, inputs: {{in: p{before}.{port}}}}}\n");
    }
    assert_eq!(
        why(&text)[19],
        "it is not set: p0 → p1 → p2 → … → p16 → p17 → p18"
    );
}

/// Returns the outputs that the analysis reports as never null, as `primitive.port`.
fn never_null(text: &str) -> Vec<String> {
    look(text, |graph, nulls| {
        let items = graph.items.iter().enumerate();
        items
            .filter(|(number, _)| nulls.item(*number).is_none())
            .flat_map(|(_, item)| {
                let outputs = item.spec().outputs.iter();
                outputs.map(|port| format!("{}.{}", item.id(), port.name))
            })
            .collect()
    })
}

/// Returns the outputs that are always null.
fn always_null(text: &str) -> Vec<String> {
    look(text, |graph, _| {
        let nulls = find_always_null(graph);
        let items = graph.items.iter().enumerate();
        let outputs = items.flat_map(|(item, primitive)| {
            (0..primitive.spec().outputs.len()).map(move |port| OutputId { item, port })
        });
        outputs
            .filter(|output| nulls.output(*output))
            .map(|output| graph.output_name(output).into())
            .collect()
    })
}

#[test]
fn what_is_always_null_is_found_behind_constants_clauses_and_regions() {
    let found = always_null(
        "net: test
primitives:
  state: {type: JointState, parameters: {device: lwr}}
  none:  {type: Constant, parameters: {value: null}}
  sum:   {type: Add, inputs: {a: 'state.position[0]', b: none.out}}
  kept:  {type: OrElse, inputs: {in: sum.out, other: 0 rad}}
  empty: {type: OrElse, inputs: {in: sum.out, other: none.out}}
  ratio: {type: Divide, inputs: {a: 1, b: 0}}
  wire:  {type: Add, inputs: {a: {from: sum.out, delayed: true, initial: 0 rad}, b: 0 rad}}
  angle: {type: ArmAngle, parameters: {device: lwr}, inputs: {joints: state.position}}
  asked: {type: Input, parameters: {type: Real}}
",
    );
    assert_eq!(found, ["none.out", "sum.out", "empty.out", "ratio.out"]);
}

/// Runs a net with its devices and then without them, and asserts that these outputs are never null.
fn run(text: &str) {
    let never = never_null(text);
    let always = always_null(text);
    let cell = crate::harness::cell("configs/cells/demo.yaml");
    let net = compile(text, "net", &cell).unwrap_or_else(|faults| panic!("{faults}\n{text}"));
    let mut harness = NetHarness::new(net, &cell, DEMO_START);
    for cycle in 0..60 {
        if cycle == 30 {
            harness
                .inputs
                .iter_mut()
                .for_each(|input| input.present = false);
        }
        harness.cancel = cycle >= 50;
        harness.step();
        for name in &always {
            let values = harness.values(name);
            assert!(
                values.iter().all(|value| value.is_nan()),
                "{name} in {cycle}: {text}"
            );
        }
        for name in &never {
            let values = harness.values(name);
            assert!(
                !values.iter().any(|value| value.is_nan()),
                "{name} in {cycle}: {text}"
            );
        }
    }
}

#[test]
fn values_reported_as_never_null_are_never_null_in_the_example_nets() {
    let mut nets = 0;
    for entry in std::fs::read_dir(folder("configs/nets")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|end| end == "yaml") {
            run(&std::fs::read_to_string(path).unwrap());
            nets += 1;
        }
    }
    assert!(nets >= 10);
}

/// Primitives of a random net: type, whether the output is a Bool, and inputs.
const KINDS: [(&str, bool, &[&str]); 14] = [
    ("Add", false, &["a", "b"]),
    ("Divide", false, &["a", "b"]),
    ("SquareRoot", false, &["in"]),
    ("Abs", false, &["in"]),
    ("OrElse", false, &["in", "other"]),
    ("Select", false, &["condition", "yes", "no"]),
    ("NullIf", false, &["in", "condition"]),
    ("Limit", false, &["in", "low", "high"]),
    ("LowPass", false, &["in"]),
    ("Greater", true, &["a", "b"]),
    ("IsNull", true, &["in"]),
    ("Input", false, &[]),
    ("AnalogInput", false, &[]),
    ("Not", true, &["in"]),
];

/// The recipe of a random primitive: its kind, and for each input the source (an earlier primitive or a constant),
/// whether it is delayed, and its initial value.
type Recipe = (usize, Vec<(usize, u8)>);

fn net_of(recipes: &[Recipe]) -> String {
    let mut text = "net: random\nprimitives:\n".to_owned();
    // Outputs so far: name, and whether the value is a Bool.
    let mut outputs: Vec<(String, bool)> = Vec::new();
    for (number, (kind, sources)) in recipes.iter().enumerate() {
        let (name, truth, inputs) = KINDS[*kind];
        let mut wires = Vec::new();
        for (place, input) in inputs.iter().enumerate() {
            let wants = name == "Not" || *input == "condition";
            let fits: Vec<&str> = outputs
                .iter()
                .filter(|(_, truth)| *truth == wants)
                .map(|(name, _)| name.as_str())
                .collect();
            let (from, how) = sources[place];
            let constant = match (wants, from % 4) {
                (true, 0) => "null",
                (true, _) => "true",
                (false, 0) => "null",
                (false, 1) => "0",
                (false, 2) => "-1.5",
                (false, _) => "2.0",
            };
            let source = match fits.get(from % (fits.len() + 1)) {
                None => constant.to_owned(),
                Some(output) => match how {
                    0 => format!("{{from: {output}, delayed: true, initial: null}}"),
                    1 => format!("{{from: {output}, delayed: true, initial: {constant}}}"),
                    _ => (*output).to_owned(),
                },
            };
            wires.push(format!("{}: {source}", input));
        }
        let parameters = match name {
            "LowPass" => ", parameters: {gain: 0.5}",
            "Input" => ", parameters: {initial: 1.0}",
            "AnalogInput" => ", parameters: {device: io, channel: temperature}",
            _ => "",
        };
        text += &format!(
            "  p{number}: {{type: {name}{parameters}, inputs: {{{}}}}}\n",
            wires.join(", ")
        );
        // A device's unit would not match the others.
        if name == "AnalogInput" {
            text +=
                &format!("  u{number}: {{type: Divide, inputs: {{a: p{number}.out, b: 1 K}}}}\n");
            outputs.push((format!("u{number}.out"), false));
        } else {
            let port = if name == "Input" { "value" } else { "out" };
            outputs.push((format!("p{number}.{port}"), truth));
        }
    }
    let unread: Vec<&str> = outputs
        .iter()
        .map(|(name, _)| name.as_str())
        .filter(|name| !text.contains(&format!(" {name}")))
        .collect();
    let unread = unread.join(", ");
    text + &format!("  end: {{type: Termination, inputs: {{done: false}}}}\ndiscard: [{unread}]\n")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn what_is_never_null_is_not_in_a_random_net(
        recipes in prop::collection::vec(
            (0..KINDS.len(), prop::collection::vec((0_usize..1000, 0_u8..8), 3)),
            1..25,
        )
    ) {
        run(&net_of(&recipes));
    }
}

#[test]
fn the_age_of_an_input_is_null_until_it_is_set_even_with_an_initial_value() {
    let why = why("
  speed: {type: Input, parameters: {initial: 1.0}}
  old:   {type: Greater, inputs: {a: speed.age, b: 1 s}}
  fast:  {type: Greater, inputs: {a: speed.value, b: 2.0}}
");
    assert_eq!(
        why[1..],
        ["it has never been set: speed", "it was set to null: speed"]
    );
}

#[test]
fn an_arm_angle_of_six_joints_cannot_reach_a_command() {
    let net = |arm: &str| {
        let cell = format!(
            "cell: a\nperiod: 1 ms\ndevices:\n  arm: {{driver: ideal-arm, robot: robots/{arm}.yaml}}\n"
        );
        let cell = CellConfig::parse_offline(&cell, "cell.yaml", &folder("configs")).unwrap();
        compile(
            "net: near
primitives:
  state: {type: JointState, parameters: {device: arm}}
  flange: {type: ForwardKinematics, parameters: {device: arm}, inputs: {joints: state.position}}
  angle: {type: ArmAngle, parameters: {device: arm}, inputs: {joints: state.position}}
  ik: {type: InverseKinematicsNear, parameters: {device: arm}, inputs: {pose: flange.pose, arm_angle: angle.angle, hint: state.position}}
  robot: {type: JointPositionCommand, parameters: {device: arm}, inputs: {position: ik.joints}}
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}
discard: [state.hold]
",
            "near.yaml",
            &cell,
        )
    };
    let faults = net("kr6_r900_2").unwrap_err();
    let fault = faults
        .diagnostics
        .iter()
        .find(|fault| fault.code == "RCC1412");
    let fault = fault.unwrap_or_else(|| panic!("{faults}"));
    assert!(
        fault
            .message
            .ends_with("the arm has no arm angle: angle → ik → robot"),
        "{}",
        fault.message
    );
    let seven = net("iiwa7").map_or_else(|faults| faults.to_string(), |_| String::new());
    assert!(!seven.contains("RCC1412"), "{seven}");
}
