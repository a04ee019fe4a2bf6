//! Rules of the null analysis: where null begins, how far it goes, and what stops it. A thread of the test harness.

use std::path::{Path, PathBuf};

use rcc_config::CellConfig;
use rcc_language::compile;
use rcc_language::devices::DeviceTable;
use rcc_language::library::NoFiles;
use rcc_language::nulls::{Cause, Nulls, nulls};
use rcc_language::resolve::{Graph, resolve};

/// Why each primitive of a net can be null, `-` if it cannot; in the order of the file.
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

fn look<T>(text: &str, see: impl FnOnce(&Graph<'_>, &Nulls) -> T) -> T {
    let cell = CellConfig::load_offline(&folder("configs/cells/demo.yaml"));
    let table = DeviceTable::from(&cell.unwrap());
    let mut faults = Vec::new();
    let (flat, _) = compile::flatten(text, "net", &table, &NoFiles, &mut faults);
    let flat = flat.unwrap();
    let graph = resolve(&flat, &table, &mut faults);
    assert!(faults.is_empty(), "{faults:?}");
    let nulls = nulls(&graph);
    see(&graph, &nulls)
}

#[test]
fn null_begins_at_a_device_and_goes_on_to_what_reads_it() {
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
fn a_fallback_that_is_known_ends_null() {
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
    // It is not understood that `no` is only chosen when it is known.
    assert!(why[4].ends_with(": in"), "{why:?}");
}

#[test]
fn what_constants_and_ranges_rule_out_is_not_counted() {
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
fn the_first_cycle_of_a_delayed_link_counts_as_it_is_written() {
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
fn a_loop_is_null_for_what_comes_into_it_and_the_way_ends() {
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
fn what_is_set_from_outside_and_the_constant_null_can_be_null() {
    let text = "net: test\nprimitives:
  speed: {type: Input, parameters: {initial: 1}}
  goal:  {type: Input}
  void:  {type: Constant, parameters: {value: null}}
  out:   {type: Add, inputs: {a: speed.value, b: null}}
";
    look(text, |graph, nulls| {
        let why = |number| nulls.why(graph, number).unwrap();
        assert_eq!(nulls.item(0), Some(Cause::NotSet));
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
fn a_long_way_is_shown_by_its_ends() {
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
