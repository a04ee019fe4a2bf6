//! Properties of the compiler: for any text, it returns diagnostics with spans and never panics; accepted nets pass the
//! plan check and run; the notation and the order of the primitives do not matter.

use std::fmt::Write as _;

use crate::harness::{NetHarness, cell, folder};
use proptest::prelude::*;
use rcc_config::{CellConfig, yaml};
use rcc_language::{Compiled, codes, compile};

fn golden() -> CellConfig {
    cell("tests/nets/cell.yaml")
}

fn texts(folder_name: &str) -> Vec<(String, String)> {
    let entries = std::fs::read_dir(folder(folder_name)).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|e| e == "yaml"))
        .collect();
    paths.sort();
    paths
        .iter()
        .map(|path| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            (name, std::fs::read_to_string(path).unwrap())
        })
        .collect()
}

/// Returns all bits of a plan and its names.
fn bits(compiled: &Compiled) -> String {
    format!("{:?} {:?}", compiled.plan, compiled.names)
}

#[test]
fn yaml_and_json_give_the_same_plan() {
    let cell = cell("configs/cells/demo.yaml");
    for (name, text) in texts("configs/nets") {
        let json = yaml::parse(&text).unwrap().to_json();
        let yaml = compile(&text, "net", &cell).unwrap();
        for json in [
            json.to_string(),
            serde_json::to_string_pretty(&json).unwrap(),
        ] {
            let json = compile(&json, "net", &cell).unwrap_or_else(|faults| panic!("{faults}"));
            assert_eq!(bits(&json), bits(&yaml), "{name}");
        }
    }
}

#[test]
fn the_same_text_gives_the_same_plan() {
    let cell = cell("configs/cells/demo.yaml");
    for (name, text) in texts("configs/nets") {
        let first = bits(&compile(&text, "net", &cell).unwrap());
        for _ in 0..10 {
            assert_eq!(
                bits(&compile(&text, "net", &cell).unwrap()),
                first,
                "{name}"
            );
        }
    }
}

#[test]
fn names_point_at_the_slots_of_the_plan() {
    let cell = cell("configs/cells/demo.yaml");
    for (name, text) in texts("configs/nets") {
        let compiled = compile(&text, "net", &cell).unwrap();
        let json = serde_json::to_string(&compiled.names).unwrap();
        assert_eq!(
            serde_json::from_str::<rcc_language::names::Names>(&json).unwrap(),
            compiled.names
        );
        assert_eq!(
            compiled.names.monitors.len(),
            compiled.plan.monitors.len(),
            "{name}"
        );
        for (names, point) in compiled.names.monitors.iter().zip(&compiled.plan.monitors) {
            assert_eq!(
                (names.store, names.slot, names.width),
                (point.store, point.slot, point.width)
            );
            let (id, port) = names.source.split_once('.').unwrap();
            let primitive = compiled
                .names
                .primitives
                .iter()
                .find(|primitive| primitive.id == id)
                .unwrap();
            let output = primitive
                .outputs
                .iter()
                .find(|output| output.name == port)
                .unwrap();
            assert_eq!(
                (output.slot, &*output.type_name),
                (point.slot, names.type_name.as_str())
            );
        }
    }
}

#[test]
fn types_and_units_propagate_along_links() {
    let text = "
net: units
primitives:
  ft: {type: ForceTorque, parameters: {device: lwr}}
  state: {type: JointState, parameters: {device: lwr}}
  way: {type: Constant, parameters: {value: 2 m}}
  work: {type: Multiply, inputs: {a: ft.fz, b: way.out}}
  time: {type: Time}
  power: {type: Divide, inputs: {a: work.out, b: time.out}}
  smooth: {type: RateLimit, parameters: {rate: 3}, inputs: {in: power.out}}
  known: {type: OrElse, inputs: {in: smooth.out, other: 0}}
  joints: {type: OrElse, inputs: {in: state.position, other: [0, 0, 0, 0, 0, 0, 0]}}
  pick: {type: Select, inputs: {condition: true, yes: 'joints.out[2]', no: deg(3)}}
  flag: {type: OrElse, inputs: {in: null, other: true}}
  end: {type: Termination, inputs: {done: flag.out}}
discard: [ft.fx, ft.fy, ft.tx, ft.ty, ft.tz, known.out, pick.out]
";
    let compiled = compile(text, "net", &golden()).unwrap_or_else(|faults| panic!("{faults}"));
    let output = |id: &str| {
        let primitive = compiled
            .names
            .primitives
            .iter()
            .find(|primitive| primitive.id == id)
            .unwrap();
        let output = &primitive.outputs[0];
        (
            output.type_name.clone(),
            output.unit.clone().unwrap_or_default(),
        )
    };
    for (id, ty, unit) in [
        ("work", "Real", "N·m"),
        ("power", "Real", "W"),
        ("known", "Real", "W"),
        ("joints", "Real[7]", "rad"),
        ("pick", "Real", "rad"),
        ("flag", "Bool", ""),
    ] {
        assert_eq!(output(id), (ty.into(), unit.into()), "{id}");
    }
}

#[test]
fn equal_primitives_run_in_a_row() {
    let mut text = String::from(
        "net: rows\nprimitives:\n  clock: {type: Time}\n  one: {type: Constant, parameters: {value: 1 s}}\n",
    );
    for i in 0..50 {
        let before = if i == 0 {
            "clock.out".to_string()
        } else {
            format!("max{}.out", i - 1)
        };
        writeln!(
            text,
            "  add{i}: {{type: Add, inputs: {{a: clock.out, b: one.out}}}}"
        )
        .unwrap();
        writeln!(
            text,
            "  max{i}: {{type: Max, inputs: {{a: add{i}.out, b: {before}}}}}"
        )
        .unwrap();
    }
    text.push_str("  end: {type: Termination, inputs: {done: false}}\ndiscard: [max49.out]\n");
    let compiled = compile(&text, "net", &golden()).unwrap_or_else(|faults| panic!("{faults}"));
    // Termination, Time, all Add, all Max: a chain of equal primitives is one run as well.
    assert_eq!(compiled.plan.runs.len(), 4);
}

#[test]
fn a_net_of_ten_thousand_primitives_is_compiled() {
    let mut text = String::from("net: large\nprimitives:\n");
    for i in (1..10_000).rev() {
        writeln!(
            text,
            "  p{i}: {{type: Add, inputs: {{a: p{}.out, b: {i}}}}}",
            i - 1
        )
        .unwrap();
    }
    text.push_str("  p0: {type: Constant, parameters: {value: 1 N}}\n  end: {type: Termination, inputs: {done: false}}\n");
    text.push_str("discard: [p9999.out]\n");
    let compiled = compile(&text, "net", &golden()).unwrap_or_else(|faults| panic!("{faults}"));
    assert_eq!(compiled.plan.runs.len(), 2);
    let mut harness = NetHarness::new(compiled, &golden(), [0.0; 7]);
    harness.step();
    assert_eq!(harness.value("p9999.out"), 1.0 + 9999.0 * 10_000.0 / 2.0);
}

/// Compiles any text and checks the answer.
fn answers_sensibly(text: &str, cell: &CellConfig) {
    match compile(text, "fuzz", cell) {
        Ok(compiled) => {
            let checked = compiled
                .plan
                .plan()
                .check(&cell.models(), cell.fingerprint());
            assert!(checked.is_ok(), "{checked:?}\n{text}");
        }
        Err(faults) => {
            assert!(faults.has_errors(), "{text}");
            for row in faults.rows() {
                let of_the_whole =
                    row.code == codes::MISSING_KEY || row.code == codes::TEXT_TOO_LARGE;
                assert!(row.line > 0 || of_the_whole, "{row:?}\n{text}");
                assert!(!row.message.contains("internal error"), "{row:?}\n{text}");
            }
            assert!(faults.render(false).contains("RCC1"));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_bytes_get_an_answer(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        answers_sensibly(&String::from_utf8_lossy(&bytes), golden_once());
    }

    #[test]
    fn any_text_of_the_right_characters_gets_an_answer(text in "([a-z0-9:,.{}\\[\\]'\"& *!|>~#-]|\n  |\n){0,120}") {
        answers_sensibly(&text, golden_once());
    }

    #[test]
    fn mutated_nets_get_an_answer(
        which in any::<prop::sample::Index>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0..6u8), 1..6),
    ) {
        let text = which.get(valid_once()).clone();
        answers_sensibly(&mutate(text, &changes), demo_once());
    }

    #[test]
    fn made_up_nets_compile_and_their_order_does_not_show(rows in prop::collection::vec(any::<[u8; 4]>(), 1..60)) {
        let (forward, backward) = (made_up(&rows, false), made_up(&rows, true));
        let run = |text: &str| {
            let compiled = compile(text, "net", golden_once()).unwrap_or_else(|faults| panic!("{faults}\n{text}"));
            let mut harness = NetHarness::new(compiled, golden_once(), [0.0; 7]);
            let mut values = Vec::new();
            for _ in 0..5 {
                harness.step();
                values.extend((0..rows.len()).map(|row| harness.value(&format!("p{row}.out")).to_bits()));
            }
            values
        };
        prop_assert_eq!(run(&forward), run(&backward), "{}", forward);
    }
}

fn golden_once() -> &'static CellConfig {
    static CELL: std::sync::OnceLock<CellConfig> = std::sync::OnceLock::new();
    CELL.get_or_init(golden)
}

fn demo_once() -> &'static CellConfig {
    static CELL: std::sync::OnceLock<CellConfig> = std::sync::OnceLock::new();
    CELL.get_or_init(|| cell("configs/cells/demo.yaml"))
}

fn valid_once() -> &'static [String] {
    static TEXTS: std::sync::OnceLock<Vec<String>> = std::sync::OnceLock::new();
    TEXTS.get_or_init(|| {
        texts("configs/nets")
            .into_iter()
            .map(|(_, text)| text)
            .collect()
    })
}

/// Cuts, duplicates, moves and replaces pieces of a text.
fn mutate(text: String, changes: &[(prop::sample::Index, prop::sample::Index, u8)]) -> String {
    const PIECES: [&str; 12] = [
        "{",
        "}",
        "[0]",
        ": ",
        "null",
        "\n",
        "true",
        "move.pose",
        "-1e9 m",
        "'",
        "{from: move.done, delayed: true}",
        "é",
    ];
    changes.iter().fold(text, |text, (at, other, how)| {
        let characters: Vec<char> = text.chars().collect();
        if characters.is_empty() {
            return text;
        }
        let (a, b) = (at.index(characters.len()), other.index(characters.len()));
        let (a, b) = (a.min(b), a.max(b));
        let [before, middle, after] = [&characters[..a], &characters[a..b], &characters[b..]]
            .map(|part| part.iter().collect::<String>());
        let short = b - a < 40;
        match how {
            0 | 1 if short => before + &after,
            2 if short => before + &middle + &middle + &after,
            3 => before + PIECES[other.index(PIECES.len())] + &middle + &after,
            4 => before + &after.chars().rev().take(5).collect::<String>() + &middle + &after,
            _ => {
                before
                    + PIECES[at.index(PIECES.len())]
                    + &characters[(a + 1).min(characters.len())..]
                        .iter()
                        .collect::<String>()
            }
        }
    })
}

/// A valid net of scalars: each row is a primitive that reads earlier ones, or any one through a delayed link.
fn made_up(rows: &[[u8; 4]], backwards: bool) -> String {
    let is_bool = |row: &[u8; 4]| row[0] % 20 < 8;
    let mut lines = Vec::new();
    for (number, row) in rows.iter().enumerate() {
        let [kind, a, b, c] = *row;
        let source = |choice: u8, bools: bool| {
            let candidates: Vec<usize> = (0..number)
                .filter(|n| is_bool(&rows[*n]) == bools)
                .collect();
            match candidates.get(usize::from(choice) % (candidates.len() + 1)) {
                Some(n) => format!("p{n}.out"),
                None if bools => choice.is_multiple_of(2).to_string(),
                None => format!("{}.5", choice),
            }
        };
        let (real, boolean) = (
            |choice| source(choice, false),
            |choice| source(choice, true),
        );
        // Any primitive may be read later, so this may close a loop; OrElse lets the loop recover from null.
        let any = usize::from(c) % rows.len();
        let old = |zero: &str| format!("{{from: p{any}.out, delayed: true, initial: {zero}}}");
        let line = match kind % 20 {
            0 => format!("And, inputs: {{a: {}, b: {}}}", boolean(a), boolean(b)),
            1 => format!("Or, inputs: {{a: {}, b: {}}}", boolean(a), boolean(b)),
            2 => format!("Not, inputs: {{in: {}}}", boolean(a)),
            3 => format!("Greater, inputs: {{a: {}, b: {}}}", real(a), real(b)),
            4 => format!("IsNull, inputs: {{in: {}}}", real(a)),
            5 => format!("RisingEdge, inputs: {{in: {}}}", boolean(a)),
            6 if is_bool(&rows[any]) => format!(
                "OrElse, inputs: {{in: {}, other: {}}}",
                old("false"),
                boolean(a)
            ),
            6 | 7 => format!(
                "Equals, parameters: {{tolerance: 1}}, inputs: {{a: {}, b: {}}}",
                real(a),
                real(b)
            ),
            8 => format!("Add, inputs: {{a: {}, b: {}}}", real(a), real(b)),
            9 => format!("Subtract, inputs: {{a: {}, b: {}}}", real(a), real(b)),
            10 => format!("Multiply, inputs: {{a: {}, b: 0.5}}", real(a)),
            11 => format!("Divide, inputs: {{a: {}, b: {}.0}}", real(a), b % 3),
            12 => format!("Min, inputs: {{a: {}, b: {}}}", real(a), real(b)),
            13 => format!("Negate, inputs: {{in: {}}}", real(a)),
            14 => format!(
                "Select, inputs: {{condition: {}, yes: {}, no: {}.25}}",
                boolean(a),
                real(b),
                c
            ),
            15 => format!(
                "RateLimit, parameters: {{rate: 1}}, inputs: {{in: {}}}",
                real(a)
            ),
            16 | 17 if !is_bool(&rows[any]) => {
                format!("OrElse, inputs: {{in: {}, other: {}}}", old("0"), real(a))
            }
            18 => format!("Constant, parameters: {{value: {a}.125}}"),
            _ => format!("Abs, inputs: {{in: {}}}", real(a)),
        };
        lines.push(format!("  p{number}: {{type: {line}}}\n"));
    }
    let text = lines.concat();
    let unread = (0..rows.len()).filter(|n| !text.contains(&format!("p{n}.out")));
    let discard: Vec<String> = unread.map(|n| format!("p{n}.out")).collect();
    if backwards {
        lines.reverse();
    }
    format!(
        "net: made-up\nprimitives:\n{}  end: {{type: Termination, inputs: {{done: false}}}}\ndiscard: [{}]\n",
        lines.concat(),
        discard.join(", ")
    )
}
