//! Formulas: random ones against an evaluator of their trees, bit for bit, in every type and with nulls; what they become;
//! hostile texts.

mod trees;

use std::sync::OnceLock;

use crate::harness::{NetHarness, cell};
use proptest::prelude::*;
use rcc_config::CellConfig;
use rcc_language::{Compiled, codes, compile};
use trees::{Random, Trees, Value, maybe, same};

fn golden() -> &'static CellConfig {
    static CELL: OnceLock<CellConfig> = OnceLock::new();
    CELL.get_or_init(|| cell("configs/cells/demo.yaml"))
}

fn net(primitives: &str) -> String {
    format!(
        "net: f\nprimitives:\n{primitives}  cancel: {{type: Cancel}}\n  end: {{type: Termination, inputs: {{done: cancel.requested}}}}\n"
    )
}

fn compiled(text: &str) -> Compiled {
    compile(text, "f.yaml", golden()).unwrap_or_else(|faults| panic!("{faults}\n{text}"))
}

/// Returns types and ids of the primitives, without those of every net.
fn types(compiled: &Compiled) -> Vec<String> {
    let rows = compiled.names.primitives.iter();
    let rows = rows.filter(|row| row.id != "cancel" && row.id != "end");
    rows.map(|row| format!("{} {}", row.id, row.type_name))
        .collect()
}

#[test]
fn a_formula_is_primitives_with_readable_names() {
    let text = net(
        "  temperature: {type: AnalogInput, parameters: {device: io, channel: temperature}}
  speed: {type: Formula, parameters: {expr: 'clamp((t - 290 K) * 1 mm/s/K, 0 m/s, 1 m/s)'}, inputs: {t: temperature.out}}
  belt: {type: AnalogOutput, parameters: {device: io, channel: belt_speed}, inputs: {in: '= min(2 * speed.out, 0.5 m/s)'}}\n",
    );
    let net = compiled(&text);
    let want = [
        "temperature AnalogInput",
        "speed/1 Subtract",
        "speed/2 Multiply",
        "speed Limit",
        "belt/1 Multiply",
        "belt/2 Min",
        "belt AnalogOutput",
    ];
    let mut found = types(&net);
    let mut want: Vec<String> = want.map(str::to_owned).to_vec();
    found.sort();
    want.sort();
    assert_eq!(found, want);
}

#[test]
fn common_parts_stand_once_and_constants_are_folded() {
    let text = net("  x: {type: Time}
  a: {type: Formula, parameters: {expr: '(x.out + 2 s) * (x.out + 1 s + 1 s)'}}
  b: {type: Formula, parameters: {expr: 'sqrt((x.out + 2 s) * (x.out + 2 * 1 s))'}}
  m: {type: Monitor, inputs: {value: [a.out, '= a.out + a.out']}}
  n: {type: Monitor, inputs: {value: b.out}}\n");
    let found = types(&compiled(&text));
    let count = |ty: &str| found.iter().filter(|row| row.ends_with(ty)).count();
    // (x + 2 s), x + 1 s, x + 1 s + 1 s, and a + a.
    assert_eq!(count(" Add"), 4, "{found:?}");
    // In `b`, 2 * 1 s is a constant.
    assert_eq!(count(" Multiply"), 2, "{found:?}");
}

#[test]
fn equal_texts_take_the_unit_of_each_place() {
    let text = net("  button: {type: DigitalInput, parameters: {device: io, channel: door_closed}}
  belt: {type: AnalogOutput, parameters: {device: io, channel: belt_speed}, inputs: {in: '= if button.out then 0 else 1'}}
  late: {type: OnDelay, inputs: {in: button.out, time: '= if button.out then 0 else 1'}}
  lamp: {type: DigitalOutput, parameters: {device: io, channel: lamp}, inputs: {in: late.out}}
  sum: {type: Monitor, inputs: {value: '= (if button.out then 0 else 1) * 1 m + (if button.out then 0 else 2 * 1) * 1 m'}}\n");
    let found = types(&compiled(&text));
    let selects = found.iter().filter(|row| row.ends_with(" Select"));
    assert_eq!(selects.count(), 4, "{found:?}");
    // Operands with a unit, or that are outputs, leave nothing open: the part stands once.
    let text = net(
        "  button: {type: DigitalInput, parameters: {device: io, channel: door_closed}}
  m: {type: Monitor, inputs: {value: '= if button.out then 0 m else 1 m'}}
  n: {type: Monitor, inputs: {value: '= 2 * (if button.out then 0 m else 1 m)'}}
  o: {type: Monitor, inputs: {value: '= not button.out'}}
  p: {type: Monitor, inputs: {value: '= not button.out'}}\n",
    );
    let found = types(&compiled(&text));
    let count = |ty: &str| found.iter().filter(|row| row.ends_with(ty)).count();
    assert_eq!((count(" Select"), count(" Not")), (1, 1), "{found:?}");
}

#[test]
fn a_product_with_a_vector_is_scale_also_in_a_fragment() {
    let text = "net: f
fragments:
  twice:
    inputs: {v: {}}
    parameters: {k: {}}
    outputs: {out: w.out}
    primitives:
      w: {type: Formula, parameters: {expr: '2 * $k * v'}}
primitives:
  clock: {type: Time}
  point: {type: MakeVector, inputs: {x: clock.out, y: 0 s, z: 1 s}}
  a: {fragment: twice, parameters: {k: 3}, inputs: {v: point.out}}
  b: {fragment: twice, parameters: {k: 3}, inputs: {v: clock.out}}
  m: {type: Monitor, inputs: {value: '= a.out.x + b.out'}}
  cancel: {type: Cancel}
  end: {type: Termination, inputs: {done: cancel.requested}}\n";
    let found = types(&compiled(text));
    assert!(found.contains(&"a/w Scale".to_owned()), "{found:?}");
    assert!(found.contains(&"b/w Multiply".to_owned()), "{found:?}");
    let mut run = NetHarness::new(compiled(text), golden(), [0.0; 7]);
    (0..3).for_each(|_| run.step());
    assert_eq!(run.value("m/1.out"), 2.0 * 6.0 * run.value("clock.out"));
}

#[test]
fn prev_is_a_delayed_link() {
    let text = net(
        "  count: {type: Formula, parameters: {expr: 'or_else(prev(count.out, 0), 0) + 1'}}
  before: {type: Formula, parameters: {expr: 'prev(prev(count.out * 2, -1), -3)'}}
  m: {type: Monitor, inputs: {value: [count.out, before.out]}}\n",
    );
    let mut run = NetHarness::new(compiled(&text), golden(), [0.0; 7]);
    let mut seen = Vec::new();
    for _ in 0..4 {
        run.step();
        seen.push((run.value("count.out"), run.value("before.out")));
    }
    assert_eq!(seen, [(1.0, -3.0), (2.0, -1.0), (3.0, 2.0), (4.0, 4.0)]);
}

#[test]
fn random_formulas_compute_what_their_trees_do() {
    let cell = golden();
    let mut compared = 0;
    for seed in 0..150 {
        let mut random = Random::new(seed);
        let mut trees = Trees {
            random: &mut random,
            reals: Vec::new(),
            ints: Vec::new(),
            bools: Vec::new(),
        };
        for index in 0..4 {
            let real = (trees.below(2001) as f64 - 1000.0) / 97.0;
            let real = [0.0, -0.0, 1e200, real, real][trees.below(5)];
            let real = maybe(&mut trees, real);
            trees.reals.push(real);
            let int = [0, 3, -7, i64::MAX / 2, index][trees.below(5)];
            let int = maybe(&mut trees, int);
            trees.ints.push(int);
            let truth = trees.below(2) == 0;
            let truth = maybe(&mut trees, truth);
            trees.bools.push(truth);
        }
        let formulas: Vec<(String, Value)> = (0..4)
            .map(|index| trees.tree(1 + index))
            .filter(|(text, _)| text.len() < 3000)
            .collect();
        let mut primitives = String::new();
        let mut discard = Vec::new();
        for index in 0..4 {
            for (letter, ty) in [("r", "Real"), ("i", "Int"), ("b", "Bool")] {
                primitives +=
                    &format!("  {letter}{index}: {{type: Input, parameters: {{type: {ty}}}}}\n");
                primitives += &format!(
                    "  read_{letter}{index}: {{type: IsNull, inputs: {{in: {letter}{index}.value}}}}\n"
                );
                discard.push(format!("read_{letter}{index}.out"));
            }
        }
        for (index, (text, _)) in formulas.iter().enumerate() {
            primitives +=
                &format!("  f{index}: {{type: Formula, parameters: {{expr: '{text}'}}}}\n");
            discard.push(format!("f{index}.out"));
        }
        let text = net(&primitives) + &format!("discard: [{}]\n", discard.join(", "));
        let (reals, ints, bools) = (trees.reals.clone(), trees.ints.clone(), trees.bools.clone());
        let mut run = NetHarness::new(compiled(&text), cell, [0.0; 7]);
        for index in 0..4 {
            run.set_element(&format!("r{index}.value"), reals[index], None, None);
            run.set_element(&format!("i{index}.value"), None, ints[index], None);
            run.set_element(&format!("b{index}.value"), None, None, bools[index]);
        }
        run.step();
        for (index, (text, want)) in formulas.iter().enumerate() {
            let found = run.values(&format!("f{index}.out"));
            assert!(
                same(&found, want),
                "seed {seed}: {found:?}, want {want:?}\n{text}"
            );
            compared += 1;
        }
    }
    assert!(compared >= 400, "{compared}");
}

#[test]
fn five_hundred_formulas_are_the_plan_of_their_primitives_so_they_run_as_fast() {
    let [formulas, primitives] =
        [true, false].map(|formulas| compiled(&net(&rcc_testing::formulas::chain(formulas))));
    // Kernel and number of primitives of each run, in order of evaluation: the work of a cycle.
    let work = |compiled: &Compiled| {
        let runs = compiled.plan.runs.iter();
        let mut work: Vec<(u16, u32)> = runs.map(|run| (run.kernel, run.operands)).collect();
        work.sort_unstable();
        work
    };
    assert_eq!(work(&formulas), work(&primitives));
    let sizes = |compiled: &Compiled| (compiled.plan.reals.len(), compiled.plan.bools.len());
    assert_eq!(sizes(&formulas), sizes(&primitives));
    assert!(formulas.plan.operands.len() > 4000);
}

#[test]
fn hostile_texts_are_refused_without_overflow() {
    for text in [
        "(".repeat(4000),
        "-".repeat(4000),
        "[".repeat(4000),
        "not ".repeat(1000),
        "if ".repeat(1000),
        "abs(".repeat(900),
        format!("{}1{}", "(".repeat(2000), ")".repeat(2000)),
        "1+".repeat(3000),
    ] {
        let text = net(&format!(
            "  f: {{type: Formula, parameters: {{expr: '{text}'}}}}\n"
        ));
        let faults = compile(&text, "f.yaml", golden()).unwrap_err();
        let known = faults
            .diagnostics
            .iter()
            .any(|fault| fault.code == codes::BAD_FORMULA);
        assert!(known, "{faults}");
    }
    // A long chain is not nested.
    let chain = format!("x.out{}", " + x.out".repeat(500));
    compiled(&net(&format!(
        "  x: {{type: Time}}\n  m: {{type: Monitor, inputs: {{value: '= {chain}'}}}}\n"
    )));
}

#[test]
fn a_list_named_many_times_is_refused_before_it_fills_the_memory() {
    let list = vec!["x.out"; 1024].join(", ");
    // 1500 copies of 1024 links, in one expression of 3000 characters and in two.
    let expressions = |names: usize, of: usize| {
        let expression = vec!["l"; names].join("+");
        let rows = (0..of).map(|number| {
            format!("  f{number}: {{type: Formula, parameters: {{expr: '{expression}'}}, inputs: {{l: [{list}]}}}}\n")
        });
        net(&format!(
            "  x: {{type: Time}}\n{}",
            rows.collect::<String>()
        ))
    };
    for (names, of) in [(1500, 1), (750, 2), (750, 4)] {
        let faults = compile(&expressions(names, of), "f.yaml", golden()).unwrap_err();
        let found = faults.diagnostics.iter();
        let found = found.filter(|fault| fault.code == codes::NET_TOO_LARGE);
        assert_eq!(found.count(), 1, "{names} names in each of {of}\n{faults}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_text_gives_diagnostics_with_places(text in "[ a-z0-9.,()\\[\\]+*/<>=!$%-]{0,60}|(if|then|else|not|and|or|prev|x\\.out|1 mm|deg\\(|\\(|\\)|,|-|[*]|/| |\\.x|\\[0\\]){0,25}") {
        let text = net(&format!("  x: {{type: Time}}\n  f: {{type: Formula, parameters: {{expr: '{text}'}}}}\n"));
        if let Err(faults) = compile(&text, "f.yaml", golden()) {
            for fault in &faults.diagnostics {
                prop_assert!(fault.place.is_none_or(|place| place.end <= text.len() && text.is_char_boundary(place.start)), "{}", faults);
            }
        }
    }
}
