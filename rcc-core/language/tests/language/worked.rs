//! The worked values of every primitive's spec, compiled and run: the cycle computes what the manual shows.

use crate::harness::{NetHarness, cell};
use rcc_config::CellConfig;
use rcc_core::primitive::{Example, Spec};
use rcc_core::primitives::CATALOGUE;
use rcc_language::compile;

/// Tolerance of an output, relative to the larger of its worked value and 1.
const TOLERANCE: f64 = 1e-12;
const HOLD: [f64; 7] = [0.0; 7];

/// A parsed table of worked values.
struct Table<'a> {
    names: Vec<&'a str>,
    rows: Vec<Vec<&'a str>>,
}

impl<'a> Table<'a> {
    fn read(text: &'a str) -> Table<'a> {
        let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
        let cells = |line: &'a str| line.split('|').map(str::trim).collect::<Vec<_>>();
        let names = lines.next().map(cells).expect("a line of names");
        let rows: Vec<_> = lines.map(cells).collect();
        assert!(!rows.is_empty(), "no row below {names:?}");
        for row in &rows {
            assert_eq!(row.len(), names.len(), "columns of {row:?}");
        }
        Table { names, rows }
    }
}

/// Returns the net of one row: inputs come from `Input`s, and every output is read by an `OrElse` beside its worked
/// value, which takes the type and unit of the output.
fn net(spec: &Spec, example: &Example, table: &Table<'_>, row: &[&str]) -> String {
    let (mut wires, mut more, mut discard) = (Vec::new(), String::new(), Vec::new());
    for (name, value) in table.names.iter().zip(row) {
        if let Some((_, port)) = spec.input(name) {
            // A reader of type Int makes it an Int.
            if example.whole && port.ty.is_open() {
                let reader = format!("{{type: BitNot, inputs: {{in: in_{name}.value}}}}");
                more.push_str(&format!("  whole_{name}: {reader}\n"));
                discard.push(format!("whole_{name}.out"));
            }
            wires.push(format!("{name}: in_{name}.value"));
            let input = format!("{{type: Input, parameters: {{initial: {value}}}}}");
            more.push_str(&format!("  in_{name}: {input}\n"));
        } else {
            assert!(spec.output(name).is_some(), "`{name}` is no port");
            let sink = format!("{{type: OrElse, inputs: {{in: it.{name}, other: {value}}}}}");
            more.push_str(&format!("  out_{name}: {sink}\n"));
            discard.push(format!("out_{name}.out"));
        }
    }
    let shown = |name: &str| table.names.contains(&name);
    let hidden = spec.outputs.iter().filter(|port| !shown(port.name));
    let hidden = hidden.filter(|port| !port.diagnostic);
    discard.extend(hidden.map(|port| format!("it.{}", port.name)));
    let parameters = match example.parameters {
        "" => "{}",
        given => given,
    };
    // `Termination` as the primitive under test would be a second one.
    let end = match spec.name {
        "Termination" => "",
        _ => "  end: {type: Termination, inputs: {done: false}}\n",
    };
    format!(
        "net: worked\nperiod: {} ms\nprimitives:\n  it: {{type: {}, parameters: {parameters}, inputs: {{{}}}}}\n{more}{end}discard: [{}]\n",
        example.period_ms,
        spec.name,
        wires.join(", "),
        discard.join(", "),
    )
}

fn harness(text: &str, cell: &CellConfig) -> NetHarness {
    let net = compile(text, "worked", cell).unwrap_or_else(|faults| panic!("{faults}\n{text}"));
    let mut cell = cell.clone();
    cell.period_ns *= u64::from(net.plan.rate.every);
    NetHarness::new(net, &cell, HOLD)
}

fn close(have: f64, want: f64) -> bool {
    (have.is_nan() && want.is_nan())
        || have == want
        || (have - want).abs() <= TOLERANCE * want.abs().max(1.0)
}

/// Runs one example.
fn holds(spec: &Spec, example: &Example, cell: &CellConfig) {
    let table = Table::read(example.table);
    let mut running = harness(&net(spec, example, &table, typed(&table).as_slice()), cell);
    for (cycle, row) in table.rows.iter().enumerate() {
        // The row compiled alone gives the values of its literals in the arenas.
        let alone = harness(&net(spec, example, &table, &with_types(&table, row)), cell);
        let given = |name: &str| spec.input(name).is_some();
        for (name, value) in table.names.iter().zip(row).filter(|(name, _)| given(name)) {
            running.copy_from(&alone, &format!("in_{name}.value"), *value == "null");
        }
        running.step();
        for (name, value) in table.names.iter().zip(row).filter(|(name, _)| !given(name)) {
            let have = running.values(&format!("it.{name}"));
            let want = match *value {
                "null" => vec![f64::NAN; have.len()],
                _ => alone.values(&format!("out_{name}.other")),
            };
            let same = have
                .iter()
                .zip(&want)
                .all(|(have, want)| close(*have, *want));
            assert!(
                same,
                "{}, \"{}\", cycle {cycle}, `{name}`: {have:?}, worked: {want:?}",
                spec.name, example.shows
            );
        }
    }
}

/// Returns by column the first literal with a type of its own, for rows in which null determines no type.
fn typed<'a>(table: &Table<'a>) -> Vec<&'a str> {
    let column = |index: usize| table.rows.iter().map(move |row| row[index]);
    (0..table.names.len())
        .map(|index| {
            column(index)
                .find(|value| *value != "null")
                .unwrap_or("null")
        })
        .collect()
}

fn with_types<'a>(table: &Table<'a>, row: &[&'a str]) -> Vec<&'a str> {
    let typed = typed(table);
    row.iter()
        .zip(typed)
        .map(|(value, typed)| if *value == "null" { typed } else { value })
        .collect()
}

#[test]
fn every_worked_value_is_what_the_cycle_computes() {
    let cell = cell("tests/nets/cell.yaml");
    let mut examples = 0;
    for entry in CATALOGUE {
        for example in entry.spec.examples {
            holds(&entry.spec, example, &cell);
            examples += 1;
        }
    }
    assert!(examples > 0);
}

#[test]
fn a_wrong_worked_value_is_found() {
    let cell = cell("tests/nets/cell.yaml");
    let (_, add) = rcc_core::primitives::find("Add").expect("a primitive");
    let wrong = Example::new("a mistake", "", "a | b | out\n 1 | 2 | 3.000001");
    let found = std::panic::catch_unwind(|| holds(&add.spec, &wrong, &cell));
    assert!(found.is_err());
}
