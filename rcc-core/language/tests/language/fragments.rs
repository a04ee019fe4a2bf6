//! Fragments and libraries: an instance is equivalent to its primitives, each error is reported once, and no text
//! expands beyond the limits of an executor. Runs on a thread of the test harness.

use std::collections::BTreeMap;

use crate::harness::{NetHarness, cell};
use rcc_language::bundle::bundle;
use rcc_language::devices::DeviceTable;
use rcc_language::library::NoLibraries;
use rcc_language::{Compiled, Compiler, Faults, compile_for};

fn compile(text: &str, libraries: &[(&str, &str)]) -> Result<Compiled, Faults> {
    let cell = cell("tests/nets/cell.yaml");
    let libraries: BTreeMap<String, String> = libraries
        .iter()
        .map(|(path, text)| ((*path).to_owned(), (*text).to_owned()))
        .collect();
    let cell = DeviceTable::from(&cell);
    let compiler = Compiler {
        libraries: &libraries,
        ..Compiler::of(&cell)
    };
    compiler.compile(text, "nets/net.yaml")
}

fn good(text: &str) -> Compiled {
    compile(text, &[]).unwrap_or_else(|faults| panic!("{faults}"))
}

/// Returns codes and positions of the diagnostics of a text.
fn bad(text: &str, libraries: &[(&str, &str)]) -> Vec<String> {
    let Err(faults) = compile(text, libraries) else {
        panic!("it is valid:\n{text}");
    };
    let rows = faults.rows().into_iter();
    rows.map(|row| {
        let used_at = row
            .used_at
            .map(|place| format!(" {} {}:{}", place.label, place.file, place.line));
        let place = format!("{} {}:{}", row.code, row.file, row.line);
        place + &used_at.unwrap_or_default()
    })
    .collect()
}

/// Asserts that the two texts give the same plan.
fn same(fragments: &str, flat: &str) {
    let (fragments, flat) = (good(fragments), good(flat));
    assert_eq!(format!("{:?}", fragments.plan), format!("{:?}", flat.plan));
}

fn ids(net: &Compiled) -> Vec<&str> {
    let primitives = net.names.primitives.iter();
    primitives.map(|primitive| primitive.id.as_str()).collect()
}

const END: &str = "  end: {type: Termination, inputs: {done: false}}\n";

#[test]
fn an_instance_is_equivalent_to_its_primitives() {
    let text = format!(
        "net: two
fragments:
  smooth:
    parameters: {{gain: {{type: Real, unit: 1, default: 0.1}}, from: {{type: Text}}}}
    inputs: {{x: {{type: Real}}, limit: {{default: 5 N}}}}
    outputs: {{y: filter.out, above: {{from: above.out}}}}
    primitives:
      ft: {{type: ForceTorque, parameters: {{device: $from}}}}
      sum: {{type: Add, inputs: {{a: x, b: ft.fz}}}}
      filter: {{type: LowPass, parameters: {{gain: $gain}}, inputs: {{in: sum.out}}}}
      above: {{type: Greater, inputs: {{a: filter.out, b: limit}}}}
    discard: [ft.fx, ft.fy, ft.tx, ft.ty, ft.tz]
primitives:
  a: {{fragment: smooth, parameters: {{from: lwr}}, inputs: {{x: 0}}}}
  b: {{fragment: smooth, parameters: {{gain: 0.2, from: lwr}}, inputs: {{x: a.y, limit: -2.5 N}}}}
  both: {{type: And, inputs: {{a: a.above, b: b.above}}}}
  watch: {{type: Monitor, inputs: {{value: both.out}}}}
{END}discard: [b.y]
"
    );
    let flat = format!(
        "net: two
primitives:
  a_ft: {{type: ForceTorque, parameters: {{device: lwr}}}}
  a_sum: {{type: Add, inputs: {{a: 0, b: a_ft.fz}}}}
  a_filter: {{type: LowPass, parameters: {{gain: 0.1}}, inputs: {{in: a_sum.out}}}}
  a_above: {{type: Greater, inputs: {{a: a_filter.out, b: 5 N}}}}
  b_ft: {{type: ForceTorque, parameters: {{device: lwr}}}}
  b_sum: {{type: Add, inputs: {{a: a_filter.out, b: b_ft.fz}}}}
  b_filter: {{type: LowPass, parameters: {{gain: 0.2}}, inputs: {{in: b_sum.out}}}}
  b_above: {{type: Greater, inputs: {{a: b_filter.out, b: -2.5 N}}}}
  both: {{type: And, inputs: {{a: a_above.out, b: b_above.out}}}}
  watch: {{type: Monitor, inputs: {{value: both.out}}}}
{END}discard: [a_ft.fx, a_ft.fy, a_ft.tx, a_ft.ty, a_ft.tz, b_ft.fx, b_ft.fy, b_ft.tx, b_ft.ty, b_ft.tz]
"
    );
    same(&text, &flat);
    let net = good(&text);
    assert_eq!(
        ids(&net)[..5],
        ["a/ft", "a/sum", "a/filter", "a/above", "b/ft"]
    );
    assert_eq!(net.names.monitors[0].source, "both.out");
}

#[test]
fn an_instance_is_evaluated_in_the_cycle_of_its_sources() {
    let net = good(&format!(
        "net: twice
fragments:
  twice:
    inputs: {{x: {{}}}}
    outputs: {{y: sum.out}}
    primitives: {{sum: {{type: Add, inputs: {{a: x, b: x}}}}}}
primitives:
  a: {{fragment: twice, inputs: {{x: 1.5}}}}
  b: {{fragment: twice, inputs: {{x: a.y}}}}
{END}discard: [b.y]
"
    ));
    let mut harness = NetHarness::new(net, &cell("tests/nets/cell.yaml"), [0.0; 7]);
    harness.step();
    assert_eq!(harness.value("b/sum.out"), 6.0);
}

#[test]
fn types_are_inferred_for_each_instance() {
    let net = good(&format!(
        "net: any
fragments:
  first:
    inputs: {{a: {{}}, b: {{}}}}
    outputs: {{y: pick.out}}
    primitives: {{pick: {{type: Select, inputs: {{condition: true, yes: a, no: b}}}}}}
primitives:
  number: {{fragment: first, inputs: {{a: 1 m, b: 2 m}}}}
  flag: {{fragment: first, inputs: {{a: true, b: false}}}}
{END}discard: [number.y, flag.y]
"
    ));
    let types = net.names.primitives.iter().take(2);
    let types: Vec<_> = types.map(|it| &*it.outputs[0].type_name).collect();
    assert_eq!(types, ["Real", "Bool"]);
}

#[test]
fn nested_instances_pass_elements_and_delays() {
    let text = format!(
        "net: nested
fragments:
  outer:
    inputs: {{q: {{}}, start: {{default: 3}}}}
    parameters: {{joint: {{}}}}
    outputs: {{y: inner.change, all: inner.sum}}
    primitives:
      inner: {{fragment: inner, parameters: {{offset: $joint}}, inputs: {{x: 'q[2]', other: start}}}}
  inner:
    inputs: {{x: {{type: Real}}, other: {{}}}}
    parameters: {{offset: {{}}}}
    outputs: {{change: change.out, sum: sum.out}}
    primitives:
      change: {{type: Subtract, inputs: {{a: x, b: {{from: x, delayed: true, initial: $offset}}}}}}
      sum: {{type: Add, inputs: {{a: {{from: other, delayed: true, initial: 0}}, b: change.out}}}}
primitives:
  state: {{type: JointState, parameters: {{device: lwr}}}}
  a: {{fragment: outer, parameters: {{joint: 0.5}}, inputs: {{q: state.position}}}}
  b: {{fragment: outer, parameters: {{joint: 0.5}}, inputs: {{q: state.position, start: {{from: a.y, delayed: false}}}}}}
{END}discard: [b.y, a.all, b.all, state.torque, state.external_torque, state.hold]
"
    );
    let flat = format!(
        "net: nested
primitives:
  state: {{type: JointState, parameters: {{device: lwr}}}}
  three: {{type: Constant, parameters: {{value: 3}}}}
  change: {{type: Subtract, inputs: {{a: 'state.position[2]', b: {{from: 'state.position[2]', delayed: true, initial: 0.5}}}}}}
  sum: {{type: Add, inputs: {{a: {{from: three.out, delayed: true, initial: 0}}, b: change.out}}}}
  change2: {{type: Subtract, inputs: {{a: 'state.position[2]', b: {{from: 'state.position[2]', delayed: true, initial: 0.5}}}}}}
  sum2: {{type: Add, inputs: {{a: {{from: change.out, delayed: true, initial: 0}}, b: change2.out}}}}
{END}discard: [sum.out, sum2.out, state.torque, state.external_torque, state.hold]
"
    );
    same(&text, &flat);
    assert_eq!(
        ids(&good(&text))[1..4],
        ["a/inner/change", "a/inner/other", "a/inner/sum"]
    );
}

#[test]
fn parameters_are_substituted_in_lists_and_poses() {
    let text = |value: &str, parameters: &str| {
        format!(
            "net: pose
fragments:
  shift:
    parameters: {{height: {{unit: m}}, turn: {{}}, place: {{}}}}
    outputs: {{y: there.out}}
    primitives:
      here: {{type: Constant, parameters: {{value: {value}}}}}
      there: {{type: Compose, inputs: {{a: here.out, b: $place}}}}
primitives:
  a: {{fragment: shift, parameters: {parameters}}}
{END}discard: [a.y]
"
        )
    };
    let given = "{height: 20 mm, turn: deg(90), place: {xyz: [1, 2, 3], quat: [0, 0, 0, 1]}}";
    let net = good(&text("{xyz: [0, 0, $height], rpy: [0, 0, $turn]}", given));
    let pose = &net.names.primitives[0].outputs[0];
    let reals = &net.plan.reals[pose.slot as usize..][..4];
    assert_eq!(reals, [0.0, 0.0, 0.02, 0.0]);
    let bad = bad(
        &text(
            "{xyz: [0, 0, $height], rpy: [0, 0, $turn]}",
            &given.replace("deg(90)", "2 m"),
        ),
        &[],
    );
    assert_eq!(
        bad,
        ["RCC1304 nets/net.yaml:7 in the instance `a` nets/net.yaml:10"]
    );
}

#[test]
fn loops_are_checked_on_the_expanded_net() {
    // Each output depends on one of the inputs, so the instances form a cycle, but their primitives do not.
    let text = |second: &str| {
        format!(
            "net: no-loop
fragments:
  two_ways:
    inputs: {{p: {{}}, q: {{}}}}
    outputs: {{p: one.out, q: two.out}}
    primitives: {{one: {{type: Abs, inputs: {{in: p}}}}, two: {{type: Abs, inputs: {{in: q}}}}}}
primitives:
  time: {{type: Time}}
  a: {{fragment: two_ways, inputs: {{p: time.out, q: b.p}}}}
  b: {{fragment: two_ways, inputs: {{p: a.p, q: {second}}}}}
{END}discard: [b.q]
"
        )
    };
    good(&text("a.q"));
    assert_eq!(
        bad(
            &text("b.q").replace("discard: [b.q]", "discard: [a.q]"),
            &[]
        ),
        ["RCC1405 nets/net.yaml:10"]
    );
}

const LIBRARY: &str = "library: filters
use: [more.yaml, ../library/filters.yaml]
fragments:
  smooth:
    inputs: {x: {}}
    outputs: {y: inner.y}
    primitives: {inner: {fragment: twice, inputs: {x: x}}}
";
const MORE: &str = "library: more
fragments:
  twice:
    inputs: {x: {}}
    outputs: {y: sum.out}
    primitives: {sum: {type: Add, inputs: {a: x, b: x}}}
";

#[test]
fn libraries_use_libraries_and_each_is_read_once() {
    let text = format!(
        "net: library
use: [library/filters.yaml, ./library/more.yaml]
primitives:
  time: {{type: Time}}
  a: {{fragment: smooth, inputs: {{x: time.out}}}}
{END}discard: [a.y]
"
    );
    let libraries = [
        ("nets/library/filters.yaml", LIBRARY),
        ("nets/library/more.yaml", MORE),
    ];
    let net = compile(&text, &libraries).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(ids(&net), ["time", "a/inner/sum", "end"]);
    let broken = MORE.replace("type: Add", "type: Ad");
    let libraries = [
        ("nets/library/filters.yaml", LIBRARY),
        ("nets/library/more.yaml", &broken),
    ];
    let place = "RCC1201 nets/library/more.yaml:6 in the instance `a/inner` nets/net.yaml:5";
    assert_eq!(bad(&text, &libraries), [place]);
}

#[test]
fn a_library_in_a_text_without_files_is_refused() {
    let text = format!("net: alone\nuse: [a.yaml]\nprimitives:\n{END}");
    let cell = cell("tests/nets/cell.yaml");
    let faults = compile_for(&text, "net", &DeviceTable::from(&cell)).unwrap_err();
    let row = &faults.rows()[0];
    assert_eq!((row.code.as_str(), row.line), ("RCC1211", 2));
}

#[test]
fn an_error_in_a_fragment_is_reported_once() {
    let mut text = "net: often
fragments:
  wrong:
    outputs: {y: sum.out}
    primitives: {sum: {type: Add, inputs: {a: 1}}}
primitives:
"
    .to_owned();
    for number in 0..100 {
        text += &format!("  i{number}: {{fragment: wrong}}\n");
    }
    text += END;
    let faults = bad(
        &format!(
            "{text}discard: [{}]\n",
            (0..100)
                .map(|n| format!("i{n}.y"))
                .collect::<Vec<_>>()
                .join(", ")
        ),
        &[],
    );
    assert_eq!(
        faults,
        ["RCC1401 nets/net.yaml:5 in the instance `i0`, and in 99 others nets/net.yaml:7"]
    );
}

#[test]
fn a_short_text_cannot_expand_to_a_million_primitives() {
    let mut text = "net: bomb\nfragments:\n".to_owned();
    for depth in 0..20 {
        let inner: Vec<String> = (0..10)
            .map(|n| format!("i{n}: {{fragment: f{}}}", depth + 1))
            .collect();
        text += &format!("  f{depth}: {{primitives: {{{}}}}}\n", inner.join(", "));
    }
    text += "  f20: {primitives: {one: {type: Time}}, discard: [one.out]}\n";
    text += &format!("primitives:\n  a: {{fragment: f0}}\n{END}");
    let faults = bad(&text, &[]);
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert!(
        faults[0].starts_with("RCC1505 nets/net.yaml:2") && faults[0].ends_with("nets/net.yaml:25"),
        "{faults:?}"
    );
}

#[test]
fn a_list_that_a_fragment_reads_many_times_is_refused_before_it_fills_the_memory() {
    let list = vec!["time.out"; 1024].join(", ");
    // 1100 copies of 1024 links.
    let rows = |source: &str| {
        let rows = (0..1100).map(|n| format!("c{n}: {{type: Copy, inputs: {{in: {source}}}}}"));
        rows.collect::<Vec<String>>().join(", ")
    };
    let discard = (0..1100).map(|n| format!("c{n}.out"));
    let discard = discard.collect::<Vec<String>>().join(", ");
    let net = |given: &str, source: &str| {
        format!(
            "net: lists\nfragments:\n  f: {{inputs: {{x: {{}}}}, primitives: {{{}}}, discard: [{discard}]}}\nprimitives:\n  time: {{type: Time}}\n  a: {{fragment: f, inputs: {{x: {given}}}}}\n{END}",
            rows(source)
        )
    };
    let faults = bad(&net(&format!("[{list}]"), "x"), &[]);
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert!(faults[0].starts_with("RCC1505"), "{faults:?}");
    // An element of the list is one link.
    good(&net(&format!("[{list}]"), "'x[7]'"));
}

#[test]
fn the_nesting_of_instances_is_limited() {
    let mut text = "net: deep\nfragments:\n".to_owned();
    for depth in 0..50 {
        text += &format!(
            "  f{depth}: {{outputs: {{y: i.y}}, primitives: {{i: {{fragment: f{}}}}}}}\n",
            depth + 1
        );
    }
    text += "  f50: {outputs: {y: one.out}, primitives: {one: {type: Time}}}\n";
    text += &format!("primitives:\n  a: {{fragment: f0}}\n{END}discard: [a.y]\n");
    assert!(bad(&text, &[])[0].starts_with("RCC1505"));
}

#[test]
fn the_nets_of_the_documentation_are_valid() {
    let text = std::fs::read_to_string(crate::harness::folder("docs/fragments.md")).unwrap();
    let blocks: Vec<&str> = text
        .split("```yaml\n")
        .skip(1)
        .map(|block| block.split("```").next().unwrap())
        .collect();
    let [net, library] = blocks.as_slice() else {
        panic!("a net and a library")
    };
    let shown = good(net);
    assert!(ids(&shown).contains(&"a/first/filter"));
    let user = format!(
        "net: user\nuse: [library/filters.yaml]\nprimitives:\n  a: {{fragment: smooth, inputs: {{x: 1}}}}\n{END}discard: [a.y]\n"
    );
    let net = compile(&user, &[("nets/library/filters.yaml", library)]);
    assert_eq!(
        ids(&net.unwrap_or_else(|faults| panic!("{faults}")))[0],
        "a/filter"
    );
}

#[test]
fn a_bundled_net_gives_the_same_plan() {
    let library = "library: filters
fragments:
  smooth:
    inputs: {x: {}}
    outputs: {y: filter.out}
    primitives:
      filter: {type: LowPass, parameters: {gain: 0.5}, inputs: {in: x}}
";
    let text = format!(
        "net: two
use: [filters.yaml]
primitives:
  t: {{type: Time}}
  a: {{fragment: smooth, inputs: {{x: t.out}}}}
{END}discard: [a.y]
"
    );
    let libraries = BTreeMap::from([("nets/filters.yaml".to_owned(), library.to_owned())]);
    let bundled = bundle(&text, "nets/net.yaml", &libraries).unwrap_or_else(|f| panic!("{f}"));
    let with = compile(&text, &[("nets/filters.yaml", library)]).unwrap_or_else(|f| panic!("{f}"));
    assert_eq!(
        format!("{:?}", good(&bundled).plan),
        format!("{:?}", with.plan)
    );
    let missing = bundle(&text, "nets/net.yaml", &NoLibraries).expect_err("no files");
    assert_eq!(missing.diagnostics[0].code, "RCC1211");
    assert_eq!(
        bundle("no net", "", &NoLibraries).expect("as it is"),
        "no net"
    );
}
